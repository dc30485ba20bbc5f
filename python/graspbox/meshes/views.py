"""Depth, colour and segmentation images of an object from many views, and occupancy grids from depth images.

>>> import graspbox
>>> mesh = graspbox.object_sets.load("procedural:mug:3")[0].load()
>>> seen = graspbox.views(mesh, count=4, image_size=(48, 64))
>>> seen.depth.shape, seen.camera_from_object.shape
((4, 48, 64), (4, 4, 4))

Camera frames have z forward, x right, y down; pixel (row, column) has its centre at (column + 0.5, row + 0.5).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import floats, plain
from graspbox._common.by_value import ByValue
from graspbox.errors import ConfigError
from graspbox.meshes import MeshLike, Surroundings, as_mesh, placed

__all__ = ["ViewPlan", "Views", "depth_millimetres", "occupancy", "views"]


@dataclass(frozen=True)
class ViewPlan:
    """Placement of cameras: on a spherical cap about the target, looking at it, upright.

    Attributes
    ----------
    pattern : {"grid", "random"}
        Evenly by area along a spiral, the same for every seed; or at random, uniformly by area.
    axis : tuple of float
        Direction from the target to the middle of the cap, world frame, of any length.
    cap : float
        Angle from the middle of the cap to its border, radians.
    distance : pair of float
        Least and greatest distance from the target, metres.
    shift : float
        Greatest shift of each coordinate of the camera afterwards, metres; the shift does not change its orientation.
    up : tuple of float
        Upward direction of the images, world frame.
    """

    pattern: Literal["grid", "random"] = "random"
    axis: tuple[float, float, float] = (-1.0, 0.0, 1.0)
    cap: float = float(np.radians(15.0))
    distance: tuple[float, float] = (0.7, 0.7)
    shift: float = 0.05
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)


#: Plans by name. ``study``: 0.7 m away, within 15 degrees and 5 cm of one pose, which the reference study does not
#: specify; here it looks down at 45 degrees. The others: anywhere on the hemisphere above the table, 0.7 m away.
PLANS = {
    "study": ViewPlan(),
    "grid": ViewPlan("grid", axis=(0.0, 0.0, 1.0), cap=float(np.pi / 2), shift=0.0),
    "random": ViewPlan("random", axis=(0.0, 0.0, 1.0), cap=float(np.pi / 2), shift=0.0),
}


@dataclass(frozen=True, eq=False)
class Views(ByValue):
    """Images of an object, one row per view.

    Attributes
    ----------
    depth : (n, H, W) float32
        Distance along the optical axis, metres; 0 where nothing was seen.
    rgb : (n, H, W, 3) uint8 or None
        Red, green, blue.
    segmentation : (n, H, W) uint8 or None
        0 background, 1 table, ground and walls, 2 object, 3 and more its neighbours.
    intrinsics : (3, 3) float64
        Maps a point in the camera's frame to homogeneous pixel coordinates.
    world_from_camera, camera_from_object : (n, 4, 4) float64
        Poses.
    """

    depth: NDArray[np.float32]
    rgb: NDArray[np.uint8] | None
    segmentation: NDArray[np.uint8] | None
    intrinsics: NDArray[np.float64]
    world_from_camera: NDArray[np.float64]
    camera_from_object: NDArray[np.float64]

    def __len__(self) -> int:
        """Count the views."""
        return len(self.depth)


def views(
    mesh: MeshLike,
    *,
    plan: str | ViewPlan = "study",
    count: int = 16,
    seed: int = 0,
    image_size: int | tuple[int, int] = (128, 128),
    images: str | Iterable[str] = ("depth", "segmentation"),
    fov: float = 0.6,
    near: float = 0.02,
    far: float = 5.0,
    table: bool = True,
    levels: bool = True,
    world_from_object: ArrayLike | None = None,
    target: ArrayLike | None = None,
    neighbours: Surroundings | None = None,
    num_threads: int | None = None,
) -> Views:
    """Render an object from many views.

    Parameters
    ----------
    mesh : Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`).
    plan : {"study", "grid", "random"} or ViewPlan
        Placement of the cameras.
    count : int
        Number of views.
    seed : int
        Seed of random plans; their first views do not depend on `count`.
    image_size : int or (int, int)
        Rows and columns.
    images : str or iterable of {"depth", "rgb", "segmentation"}
        Images besides depth, which is always rendered.
    fov : float
        Vertical field of view, radians.
    near, far : float
        Clipping distances, metres.
    table : bool
        Whether to render table and ground.
    levels : bool
        Whether to render levels of detail, which change images by at most half a pixel. They are made when a mesh is
        first rendered, which takes as long as about 20 views; for a few views of each of many meshes, turn them off.
    world_from_object : (4, 4) array, optional
        Pose of the object; by default the file's +z is up, the lowest vertex at z = 0, and the object is centred above
        the table's origin.
    target : (3,) array, optional
        Point that the cameras look at, world frame; by default the centre of the object's bounds.
    neighbours : Surroundings, optional
        Other objects and walls, such as `graspbox.Arrangement.without` returns.
    num_threads : int, optional
        Number of threads; images do not depend on it.

    Raises
    ------
    ConfigError
        For a value out of range (also a ValueError).
    """
    if isinstance(plan, str) and plan not in PLANS:
        raise ConfigError(f"there is no plan {plan!r}; choose from {', '.join(PLANS)} or give a ViewPlan")
    wanted = {images} if isinstance(images, str) else set(images)
    if unknown := wanted - {"depth", "rgb", "segmentation"}:
        raise ConfigError(f"there is no image {sorted(unknown)[0]!r}; choose from depth, rgb, segmentation")
    viewpoints = {
        "plan": PLANS[plan] if isinstance(plan, str) else plan,
        "count": count,
        "seed": seed,
        "levels": levels,
    }
    config = {
        "image_size": (image_size, image_size) if np.ndim(image_size) == 0 else image_size,
        "fov": fov,
        "near": near,
        "far": far,
        "rgb": "rgb" in wanted,
        "segmentation": "segmentation" in wanted,
        "table": table,
    }
    arguments = {"world_from_object": world_from_object, "target": target}
    pose, middle = (None if value is None else floats(value, name) for name, value in arguments.items())
    others, walls = placed(neighbours)
    found = _core.views(
        as_mesh(mesh), plain(viewpoints, "views"), plain(config, "views"), pose, middle, num_threads, others, walls
    )
    return Views(
        depth=found["depth"],
        rgb=found.get("rgb"),
        segmentation=found.get("segmentation"),
        intrinsics=found["intrinsics"],
        world_from_camera=found["world_from_camera"],
        camera_from_object=found["camera_from_object"],
    )


def occupancy(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    frame_from_camera: ArrayLike,
    resolution: int,
    origin: ArrayLike,
    side: float,
    *,
    far: float = 5.0,
    nothing_is_free: bool = True,
) -> NDArray[np.uint8]:
    """Classify the voxels of a cube as occupied, free or unseen from depth images.

    Parameters
    ----------
    depth : (n, H, W) array
        Distance along the optical axis, 0 where nothing was seen: in metres, or in millimetres if the dtype is uint16,
        as from 16-bit cameras and `depth_millimetres`.
    intrinsics : (3, 3) array
        Intrinsics of all images.
    frame_from_camera : (n, 4, 4) array
        Poses of the cameras in the frame of the cube: the inverse of `Views.camera_from_object` for the object's frame.
    resolution : int
        Voxels along each side.
    origin : (3,) array
        Least corner of the cube, metres.
    side : float
        Side of the cube, metres.
    far : float
        Greatest depth that the cameras see, metres.
    nothing_is_free : bool
        Whether the ray of a pixel without depth is free up to `far`, as in a rendered image; otherwise it is ignored.

    Returns
    -------
    (N, N, N) uint8
        0 unseen, 1 free, 2 occupied.

    Raises
    ------
    ConfigError
        For arrays of another shape, depths that are negative or not finite, or integers that are not uint16 (also a
        ValueError).
    """
    return _core.occupancy(
        depth_metres(depth),
        np.array(intrinsics, dtype=np.float64),
        np.array(frame_from_camera, dtype=np.float64),
        resolution,
        np.array(origin, dtype=np.float64),
        side,
        far,
        nothing_is_free,
    )


def depth_metres(depth: ArrayLike) -> NDArray[np.float32]:
    """Return depth in metres, float32; values of dtype uint16 are millimetres."""
    image = np.asarray(depth)
    if image.dtype == np.uint16:
        return np.ascontiguousarray(image * np.float32(1e-3), dtype=np.float32)
    if not np.issubdtype(image.dtype, np.floating):
        raise ConfigError(f"depth is of dtype {image.dtype}; give metres as float32, or millimetres as uint16")
    return np.ascontiguousarray(image, dtype=np.float32)


def depth_millimetres(depth: ArrayLike) -> NDArray[np.uint16]:
    """Convert depth to the format of 16-bit cameras and their files.

    Parameters
    ----------
    depth : (...) array_like
        Metres, 0 where nothing was seen: `Views.depth`, or the observation ``depth``.

    Returns
    -------
    (...) uint16
        Millimetres, rounded; 0 where nothing was seen, and beyond 65.535 m.

    Raises
    ------
    ConfigError
        For depths that are negative or not finite.
    """
    metres = np.asarray(depth, dtype=np.float32)
    if not np.isfinite(metres).all() or (metres < 0).any():
        raise ConfigError("depth holds numbers that are negative or not finite; give metres, 0 where nothing was seen")
    rounded = np.floor(metres * np.float32(1000) + np.float32(0.5))
    return np.where(rounded < 65_536, rounded, 0).astype(np.uint16)
