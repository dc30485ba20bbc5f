"""Images and voxels of the rows of a data set, rendered on demand, on all threads."""

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox._common.arguments import floats, plain
from graspbox._core import Mesh
from graspbox.configs.cameras import lens
from graspbox.data.trials.resting import RestingScene
from graspbox.data.trials.settings import DatasetConfig
from graspbox.data.trials.tables import column, lists, matrices
from graspbox.errors import ConfigError
from graspbox.hands import cache_folder
from graspbox.meshes import placed
from graspbox.meshes.views import Views, depth_millimetres
from graspbox.planning.plan_files import mesh_hash
from graspbox.simulation.layouts import Arrangement

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Rendered", "arrangement_of", "grid_frames", "load_mesh_of", "render", "scene_images", "voxels"]

#: Meshes that are cached between calls.
_KEPT = 512
#: Clipping distances, metres.
_NEAR, _FAR = 0.02, 5.0


class Rendered(Views):
    """Images of n rows, each from v cameras.

    As `graspbox.Views`, but the arrays have the shapes (n, v, ...); `intrinsics` (3, 3) holds for all cameras.
    """


@lru_cache(maxsize=_KEPT)
def load_mesh_of(source: str, scale: float, sha256: str, size_factor: float) -> Mesh:
    """Load the mesh of a row or of a neighbour, unless it has changed; the last 512 are cached."""
    mesh = object_sets.load(source, scale=scale)[0].load()
    if (digest := mesh_hash(mesh)) != sha256:
        raise ConfigError(
            f"the mesh of {source!r} has changed: its hash is {digest[:12]}, that of the rows {sha256[:12]}"
        )
    return mesh if size_factor == 1.0 else mesh.scaled(size_factor, cache_folder())


def render(
    rows: "pa.Table",
    *,
    view: int | None = None,
    image_size: int | tuple[int, int] = 64,
    rgb: bool = False,
    segmentation: bool = True,
    table: bool = True,
    world_from_camera: NDArray[np.float64] | None = None,
    num_threads: int | None = None,
) -> Rendered:
    """Render the views of each row's cameras: the object at rest, its neighbours and walls, without the hand.

    Rows of one scene that share their cameras are rendered once.

    Parameters
    ----------
    rows : pyarrow.Table
        Rows of trials from `graspbox.data.trials.load`: all, or some (``table.take``, ``table.slice``).
    view : int, optional
        Index of one camera; all cameras of the row by default.
    image_size : int or (int, int)
        Rows and columns.
    rgb, segmentation : bool
        Images to render besides depth.
    table : bool
        Whether to render table and ground.
    world_from_camera : (n, v, 4, 4) array_like, optional
        Replacement of the rows' cameras, for augmentation.
    num_threads : int, optional
        Threads to use; images do not depend on it.

    Raises
    ------
    ConfigError
        If the rows have different fields of view or numbers of cameras, there is no such view, or a mesh has changed.
    """
    cameras = matrices(rows, "world_from_camera") if world_from_camera is None else floats(world_from_camera)
    if cameras.ndim != 4 or len(cameras) != len(rows):
        raise ConfigError(f"world_from_camera has shape {list(cameras.shape)}; it must be ({len(rows)}, v, 4, 4)")
    if view is not None:
        if not 0 <= view < cameras.shape[1]:
            raise ConfigError(f"view is {view}; the rows have {cameras.shape[1]} cameras")
        cameras = cameras[:, view : view + 1]
    fovs = set(column(rows, "fov").tolist())
    if len(fovs) > 1:
        raise ConfigError(f"the rows have the fields of view {sorted(fovs)}; render each separately")
    size: Any = (image_size, image_size) if np.ndim(image_size) == 0 else image_size
    fov = fovs.pop() if fovs else 0.6
    objects = matrices(rows, "world_from_object")
    scenes = _scenes(rows)
    keys = [(repr(scene), poses.tobytes()) for scene, poses in zip(scenes, cameras, strict=True)]
    # Rows with equal images, by their first row.
    first = {key: index for index, key in reversed(list(enumerate(keys)))}
    unique = sorted(first.values())
    back = np.searchsorted(unique, [first[key] for key in keys])
    channels = {"rgb": rgb, "segmentation": segmentation, "table": table}
    shown = _shown([scenes[index] for index in unique])
    images = _images(shown, cameras[unique], size, fov, channels, num_threads)
    return Rendered(
        depth=images["depth"][back],
        rgb=images["rgb"][back] if rgb else None,
        segmentation=images["segmentation"][back] if segmentation else None,
        intrinsics=lens(fov, size),
        world_from_camera=cameras,
        camera_from_object=np.linalg.inv(cameras) @ objects[:, None],
    )


#: Fields of an object that name its mesh: the arguments of `load_mesh_of`.
_MESH_FIELDS = ("source", "scale", "sha256", "size_factor")


class _Shown(NamedTuple):
    """Contents of n images: meshes, their indices and poses (k, 4, 4) in each image, and its walls."""

    meshes: list[Mesh]
    meshes_of: list[list[int]]
    world_from_objects: list[NDArray[np.float64]]
    walls: list[list[tuple[NDArray[np.float64], list[float]]]]


#: Objects of a row, the target first, and its walls, with the fields of their columns.
_Scene = tuple[list[dict[str, Any]], list[dict[str, Any]]]


def _scenes(rows: "pa.Table") -> list[_Scene]:
    names = (*_MESH_FIELDS, "world_from_object")
    targets = [dict(zip(names, each, strict=True)) for each in zip(*(lists(rows, n) for n in names), strict=True)]
    around = zip(targets, lists(rows, "neighbours"), lists(rows, "walls"), strict=True)
    return [([target, *neighbours], walls) for target, neighbours, walls in around]


def _shown(scenes: list[_Scene]) -> _Shown:
    def matrix(fields: Mapping[str, Any], name: str) -> NDArray[np.float64]:
        return np.array(fields[name], np.float64).reshape(4, 4)

    index_of: dict[tuple[Any, ...], int] = {}
    meshes_of = [
        [index_of.setdefault(tuple(each[name] for name in _MESH_FIELDS), len(index_of)) for each in objects]
        for objects, _ in scenes
    ]
    return _Shown(
        [load_mesh_of(*key) for key in index_of],
        meshes_of,
        [np.stack([matrix(each, "world_from_object") for each in objects]) for objects, _ in scenes],
        [[(matrix(wall, "world_from_wall"), wall["half_extents"]) for wall in walls] for _, walls in scenes],
    )


def arrangement_of(row: "pa.Table") -> Arrangement:
    """Load the objects, the target first, and the walls of one row; errors as of `load_mesh_of`."""
    shown = _shown(_scenes(row))
    return Arrangement(
        "packed" if (layout := lists(row, "layout")[0]) == "single" else layout,
        tuple(range(len(shown.meshes_of[0]))),
        tuple(shown.meshes[index] for index in shown.meshes_of[0]),
        shown.world_from_objects[0],
        np.array([pose for pose, _ in shown.walls[0]]).reshape(-1, 4, 4),
        np.array([half for _, half in shown.walls[0]]).reshape(-1, 3),
    )


def _images(
    shown: _Shown,
    world_from_camera: NDArray[np.float64],
    size: Any,
    fov: float,
    channels: dict[str, bool],
    num_threads: int | None,
) -> dict[str, Any]:
    """Images (n, v, ...) of n scenes, each from v cameras (n, v, 4, 4)."""
    count, views = world_from_camera.shape[:2]
    config = {"image_size": size, "fov": fov, "near": _NEAR, "far": _FAR, **channels}
    images = _core.render_scenes(
        shown.meshes,
        [each for each in shown.meshes_of for _ in range(views)],
        np.concatenate([np.zeros((0, 4, 4)), *(each for each in shown.world_from_objects for _ in range(views))]),
        [each for each in shown.walls for _ in range(views)],
        np.ascontiguousarray(world_from_camera.reshape(-1, 4, 4)),
        plain(config, "the images"),
        num_threads,
    )
    return {name: image.reshape(count, views, *image.shape[1:]) for name, image in images.items()}  # type: ignore[attr-defined]


def scene_images(columns: dict[str, Any], resting: RestingScene, config: DatasetConfig) -> dict[str, Any]:
    """Make the columns of a scene's stored images, from the columns of its trials."""
    cameras, rest = columns["world_from_camera"][0], columns["world_from_object"][0]
    around, walls = placed(resting.around)
    meshes = [resting.scene.mesh, *(mesh for mesh, _ in around)]
    poses = np.stack([rest, *(pose for _, pose in around)])
    channels = {"rgb": False, "segmentation": True, "table": True}
    shown = _Shown(meshes, [list(range(len(meshes)))], [poses], [walls])
    images = _images(shown, cameras[None], config.image_size, config.fov, channels, 1)
    same = {
        "scene": columns["scene"][0],
        "split": columns["split"][0],
        "world_from_object": rest,
        "intrinsics": lens(config.fov, config.image_size),
    }
    return {
        **{name: [value] * len(cameras) for name, value in same.items()},
        "view": np.arange(len(cameras)),
        "world_from_camera": cameras,
        "depth": depth_millimetres(images["depth"][0]),
        "segmentation": images["segmentation"][0],
    }


def voxels(
    rendered: Rendered,
    *,
    resolution: int = 32,
    side: float = 0.30,
    world_from_grid: NDArray[np.float64] | None = None,
    num_threads: int | None = None,
) -> NDArray[np.uint8]:
    """Fuse the depth images of each row into voxels of the space around its object.

    Parameters
    ----------
    rendered : Rendered
        Images of n rows, possibly with sensor noise added to their depth.
    resolution : int
        Voxels along each side.
    side : float
        Side of the cube, metres.
    world_from_grid : (n, 4, 4) array_like, optional
        Frame of each cube, with its middle at x = y = 0 and its floor at z = 0. By default the world's axes, with
        the origin on the table below the middle of the object's visible points.
    num_threads : int, optional
        Threads to use; voxels do not depend on it.

    Returns
    -------
    (n, N, N, N) uint8
        0 unseen, 1 free, 2 occupied.

    Raises
    ------
    ConfigError
        If there are neither frames nor a segmentation, or a number is out of range.
    """
    count, views = rendered.depth.shape[:2]
    frames = grid_frames(rendered) if world_from_grid is None else floats(world_from_grid, "world_from_grid")
    if frames.shape != (count, 4, 4):
        raise ConfigError(f"world_from_grid has shape {list(frames.shape)}; it must be ({count}, 4, 4)")
    poses = np.linalg.inv(frames)[:, None] @ rendered.world_from_camera
    return _core.occupancies(
        np.ascontiguousarray(rendered.depth),
        rendered.intrinsics,
        np.ascontiguousarray(poses.reshape(count * views, 4, 4)),
        resolution,
        [-side / 2.0, -side / 2.0, 0.0],
        side,
        _FAR,
        True,
        num_threads,
    )


def grid_frames(rendered: Rendered) -> NDArray[np.float64]:
    """Frames with the world's axes, on the table below the middle of the object's visible points: (n, 4, 4)."""
    if rendered.segmentation is None:
        raise ConfigError("the images have no segmentation; render them with segmentation=True or pass world_from_grid")
    height, width = rendered.depth.shape[2:]
    rows, columns = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(rendered.intrinsics).T
    frames = np.tile(np.eye(4), (len(rendered.depth), 1, 1))
    for index, pose in enumerate(rendered.world_from_camera):
        mask = (rendered.segmentation[index] == 2) & (rendered.depth[index] > 0)
        views = zip(mask, rendered.depth[index], pose, strict=True)
        points = np.concatenate([(rays[m] * d[m][:, None]) @ p[:3, :3].T + p[:3, 3] for m, d, p in views])
        if len(points):
            frames[index, :2, 3] = (points.min(axis=0)[:2] + points.max(axis=0)[:2]) / 2.0
    return frames
