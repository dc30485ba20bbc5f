"""Correction of a camera's pose by the visible table.

The table shows a camera's height and tilt better than anything else: every image has thousands of its pixels. It shows
neither the camera's place along the table nor its turn about the vertical.
"""

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.depth_images import MAX_COORDINATE, points_of

__all__ = ["level"]

#: Steps of the fit: distances from the plane within which points count, metres, and the weight of those above it. There
#: are things on a table and none below it: at first the lower points count more.
_STEPS = ((0.04, 0.02), (0.02, 0.02), (0.01, 0.1), (0.006, 0.3), (0.004, 1.0), (0.004, 1.0))
#: Every third pixel of every third row is enough.
_EVERY = 3
#: Least share of the image's points that the plane must have.
_SHARE = 0.25
#: Greatest correction, metres and radians: a plane that deviates more is no table, or the camera is not calibrated.
_MOST_HEIGHT, _MOST_TILT = 0.04, 0.06
#: Corrections below both are left out: noise and flat objects cause as much.
_LEAST_HEIGHT, _LEAST_TILT = 0.002, 0.005


def level(
    depth: NDArray[np.floating], intrinsics: NDArray[np.float64], world_from_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn and lift a camera until the table in its depth image (H, W), metres, is the plane z = 0.

    `world_from_camera` (4, 4) is its approximate pose: z forward, x right, y down, metres. It is returned if the table
    is
    within 2 mm and 0.3 degrees of z = 0, or if no plane within 4 cm and 3.4 degrees of it has a quarter of the image.

    Raises
    ------
    ConfigError
        For arrays of another shape, and a camera farther than `MAX_COORDINATE` from the origin.
    """
    for name, matrix, shape in (("intrinsics", intrinsics, (3, 3)), ("world_from_camera", world_from_camera, (4, 4))):
        if matrix.shape != shape:
            raise ConfigError(f"{name} has shape {matrix.shape}; pass {shape}")
    if depth.ndim != 2:
        raise ConfigError(f"depth has shape {depth.shape}; pass one image (H, W)")
    if not np.linalg.det(intrinsics):
        raise ConfigError(f"intrinsics are {intrinsics.tolist()}; pass focal lengths above 0 in the diagonal")
    if not (np.abs(world_from_camera) <= MAX_COORDINATE).all():
        raise ConfigError(f"world_from_camera is {world_from_camera.tolist()}; pass metres, at most {MAX_COORDINATE:g}")
    points = points_of(depth, intrinsics, _EVERY) @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    flat, heights = np.column_stack([points[:, :2], np.ones(len(points))]), points[:, 2]
    plane = np.zeros(3)
    for band, above in _STEPS:
        over = heights - flat @ plane
        on = np.abs(over) < band
        if on.sum() < max(3, _SHARE * len(points)):
            return world_from_camera
        weighted = flat[on].T * np.where(over[on] > 0.0, above, 1.0)
        plane = np.linalg.lstsq(weighted @ flat[on], weighted @ heights[on], rcond=None)[0]
    up = np.array([-plane[0], -plane[1], 1.0]) / np.sqrt(1.0 + plane[0] ** 2 + plane[1] ** 2)
    middle = flat[on].mean(axis=0)
    off, tilt = abs(float(middle @ plane)), float(np.arccos(min(up[2], 1.0)))
    if (off < _LEAST_HEIGHT and tilt < _LEAST_TILT) or off > _MOST_HEIGHT or tilt > _MOST_TILT:
        return world_from_camera
    # The least turn that takes `up` to z, about the camera: it is the camera that is tilted, not the table.
    across = np.array([up[1], -up[0], 0.0])
    cross = np.array([[0.0, 0.0, across[1]], [0.0, 0.0, -across[0]], [-across[1], across[0], 0.0]])
    leveled = world_from_camera.copy()
    leveled[:3, :3] = (np.eye(3) + cross + cross @ cross / (1.0 + up[2])) @ world_from_camera[:3, :3]
    # The camera's height over the plane stays.
    leveled[2, 3] = up @ (world_from_camera[:3, 3] - np.array([0.0, 0.0, plane[2]]))
    return leveled
