"""Truncated signed distance fields of depth images, the input of VGN and later planners.

The workspace is a cube of 0.3 m around the middle of the table. Its frame has the axes of the world, and its origin at
the least corner of the cube; the table top is at z = 0.05 m. Voxel (i, j, k) of 40 along each side has its centre at
((i, j, k) + 0.5) times 0.0075 m.

A voxel holds (d + 1) / 2, where d is the mean over the images of the distance along the ray from the voxel to the
surface behind it, over the truncation of 4 voxels, and at most 1: it is 0.5 on the surface, more in front of it, less
behind. As in VGN, a voxel holds 0 where no image measures a distance, more than the truncation behind every surface,
and where abs(d) is 0.98 or more, also in free space.

References
----------
M. Breyer, J. J. Chung, L. Ott, R. Siegwart, J. Nieto, "Volumetric Grasping Network: real-time 6 DOF grasp detection in
clutter", CoRL 2020; ``ethz-asl/vgn``, ``src/vgn/perception.py`` and ``src/vgn/simulation.py``. The values are those of
``ExtractVoxelGrid`` of Open3D's ``UniformTSDFVolume``.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats, natural
from graspbox.configs import CameraConfig
from graspbox.errors import ConfigError

__all__ = ["RESOLUTION", "SIDE", "VOXEL_SIZE", "WORLD_FROM_WORKSPACE", "cameras_around", "tsdf_of"]

#: Side of the workspace, metres.
SIDE = 0.3
#: Voxels along each side.
RESOLUTION = 40
#: Side of a voxel, metres.
VOXEL_SIZE = SIDE / RESOLUTION
#: Pose (4, 4) of the frame of the workspace, metres.
WORLD_FROM_WORKSPACE = np.array(
    [[1.0, 0.0, 0.0, -SIDE / 2], [0.0, 1.0, 0.0, -SIDE / 2], [0.0, 0.0, 1.0, -0.05], [0.0, 0.0, 0.0, 1.0]]
)
#: Distance from the surface at which the field is cut, metres.
_TRUNCATION = 4 * VOXEL_SIZE
#: Voxels at this share of the truncation and beyond count as unknown.
_CUT = 0.98
#: Distance of the cameras from the middle of the floor of the workspace, metres, and angle from the vertical, radians;
#: their vertical field of view is that of 480 rows with a focal length of 540 pixels.
_DISTANCE, _TILT, _FOV = 2 * SIDE, np.pi / 6, 2 * float(np.arctan(240 / 540))


def cameras_around(count: int) -> tuple[CameraConfig, ...]:
    """Return VGN's cameras, evenly around the workspace: ``view0`` on the side of +x, ``view1`` and so on.

    Raises
    ------
    ConfigError
        If `count` is less than 1.
    """
    if natural(count, "count") < 1:
        raise ConfigError(f"count is {count}; pass 1 camera or more")
    floor = (0.0, 0.0, float(WORLD_FROM_WORKSPACE[2, 3]))
    away, up = _DISTANCE * float(np.sin(_TILT)), floor[2] + _DISTANCE * float(np.cos(_TILT))
    turns = 2 * np.pi * np.arange(count) / count
    return tuple(
        CameraConfig(
            f"view{index}", eye=(away * float(np.cos(turn)), away * float(np.sin(turn)), up), target=floor, fov=_FOV
        )
        for index, turn in enumerate(turns)
    )


def tsdf_of(depths: ArrayLike, intrinsics: ArrayLike, world_from_cameras: ArrayLike) -> NDArray[np.float32]:
    """Fuse depth images of a table into the field of the workspace, (1, 40, 40, 40) float32, 0 to 1: see the module.

    Parameters
    ----------
    depths : (v, H, W) array_like
        Depths along the optical axis, metres; 0 where nothing was measured.
    intrinsics : (3, 3) array_like
        Pixels; pixel (row, column) has its centre at (row + 0.5, column + 0.5).
    world_from_cameras : (v, 4, 4) array_like
        Poses of the cameras, metres: z forward, x right, y down; the table is the plane z = 0.

    Raises
    ------
    ConfigError
        For arrays of another shape, or no image.
    """
    images, lens, poses = (
        floats(values, name)
        for values, name in (
            (depths, "depths"),
            (intrinsics, "intrinsics"),
            (world_from_cameras, "world_from_cameras"),
        )
    )
    if images.ndim != 3 or not len(images):
        raise ConfigError(f"depths has shape {images.shape}; pass one image or more, (v, H, W)")
    if lens.shape != (3, 3) or poses.shape != (len(images), 4, 4):
        raise ConfigError(
            f"intrinsics has shape {lens.shape} and world_from_cameras {poses.shape}; "
            f"pass (3, 3) and {(len(images), 4, 4)}"
        )
    centers = (np.indices((RESOLUTION,) * 3).reshape(3, -1).T + 0.5) * VOXEL_SIZE + WORLD_FROM_WORKSPACE[:3, 3]
    total, count = np.zeros(len(centers)), np.zeros(len(centers), dtype=np.int64)
    for depth, pose in zip(images, poses, strict=True):
        rows, distance = _distances(centers, depth, lens, pose)
        total[rows] += np.minimum(1.0, distance / _TRUNCATION)
        count[rows] += 1
    mean = total / np.maximum(count, 1)
    known = (count > 0) & (mean >= -_CUT) & (mean < _CUT)
    field = np.where(known, 0.5 * (mean + 1.0), 0.0)
    return field.astype(np.float32).reshape(1, RESOLUTION, RESOLUTION, RESOLUTION)


def _distances(
    centers: NDArray[np.float64], depth: NDArray[np.float64], lens: NDArray[np.float64], pose: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return rows of points (n, 3) whose distance to the surface behind them is known, and that distance, metres."""
    local = (centers - pose[:3, 3]) @ pose[:3, :3]
    ahead = np.flatnonzero(local[:, 2] > 0)
    z = local[ahead, 2]
    columns = np.floor(lens[0, 0] * local[ahead, 0] / z + lens[0, 2])
    lines = np.floor(lens[1, 1] * local[ahead, 1] / z + lens[1, 2])
    inside = (columns >= 0) & (columns < depth.shape[1]) & (lines >= 0) & (lines < depth.shape[0])
    ahead, z = ahead[inside], z[inside]
    seen = depth[lines[inside].astype(np.int64), columns[inside].astype(np.int64)]
    distance = (seen - z) * np.linalg.norm(local[ahead], axis=1) / z
    known = (seen > 0) & (distance > -_TRUNCATION)
    return ahead[known], distance[known]
