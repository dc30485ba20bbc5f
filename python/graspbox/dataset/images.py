"""Images and voxels of the rows of a data set, rendered on demand, on all threads."""

import json
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox._common.arguments import floats, plain
from graspbox._core import Mesh
from graspbox.dataset.resting import RestingScene
from graspbox.dataset.settings import DatasetConfig
from graspbox.dataset.tables import column, lists, matrices
from graspbox.errors import ConfigError
from graspbox.hands import cache_folder
from graspbox.meshes import placed
from graspbox.planning.plan_files import mesh_hash
from graspbox.views import Views, depth_millimetres

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Rendered", "RowObjects", "load_mesh_of", "placed_objects", "render", "scene_images", "voxels"]

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
    """Load the mesh of a row or of a neighbour; the last 512 are cached.

    Raises
    ------
    ConfigError
        If the mesh has changed since the row was made.
    ObjectSetError, FileError, MeshError
        If it cannot be found or read.
    """
    mesh = object_sets.load(source, scale=scale)[0].load()
    if (found := mesh_hash(mesh)) != sha256:
        raise ConfigError(
            f"the mesh of {source!r} has changed: its hash is {found[:12]}, that of the rows {sha256[:12]}"
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
        Rows of trials from `graspbox.dataset.load`: all, or some (``table.take``, ``table.slice``).
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
        raise ConfigError(f"world_from_camera has shape {list(cameras.shape)}; give ({len(rows)}, v, 4, 4)")
    if view is not None:
        if not 0 <= view < cameras.shape[1]:
            raise ConfigError(f"view is {view}; the rows have {cameras.shape[1]} cameras")
        cameras = cameras[:, view : view + 1]
    fovs = set(column(rows, "fov").tolist())
    if len(fovs) > 1:
        raise ConfigError(f"the rows have the fields of view {sorted(fovs)}; render each alone")
    size = (image_size, image_size) if np.ndim(image_size) == 0 else image_size
    fov = fovs.pop() if fovs else 0.6
    objects = matrices(rows, "world_from_object")
    scenes = _scenes(rows)
    unique, back = _unique_images(scenes, cameras)
    channels = {"rgb": rgb, "segmentation": segmentation, "table": table}
    shown = _shown([scenes[index] for index in unique])
    found = _images(shown, cameras[unique], size, fov, channels, num_threads)
    return Rendered(
        depth=found["depth"][back],
        rgb=found["rgb"][back] if rgb else None,
        segmentation=found["segmentation"][back] if segmentation else None,
        intrinsics=_intrinsics(size, fov),
        world_from_camera=cameras,
        camera_from_object=np.linalg.inv(cameras) @ objects[:, None],
    )


#: Fields of an object that name its mesh.
_MESH_FIELDS = ("source", "scale", "sha256", "size_factor")


class _Object(NamedTuple):
    """An object of a scene: the arguments of `load_mesh_of`, and its pose as the 128 bytes of a matrix (4, 4)."""

    mesh: tuple[str, float, str, float]
    world_from_object: bytes


class _SceneRow(NamedTuple):
    """What the images of a row show: the object, then its neighbours; and walls, as pose and half extents."""

    objects: tuple[_Object, ...]
    walls: tuple[tuple[bytes, tuple[float, ...]], ...]


class _Shown(NamedTuple):
    """What n images show: meshes, their indices and poses (k, 4, 4) in each image, and its walls."""

    meshes: list[Mesh]
    meshes_of: list[list[int]]
    world_from_objects: list[NDArray[np.float64]]
    walls: list[list[tuple[NDArray[np.float64], list[float]]]]


def _scenes(rows: "pa.Table") -> list[_SceneRow]:
    """Read what the images of each row show."""
    names = (*_MESH_FIELDS, "world_from_object")
    values = zip(*(lists(rows, name) for name in names), strict=True)
    objects = (dict(zip(names, each, strict=True)) for each in values)
    return [
        _SceneRow(
            tuple(map(_object, [target, *neighbours])),
            tuple((_bytes(wall["world_from_wall"]), tuple(wall["half_extents"])) for wall in walls),
        )
        for target, neighbours, walls in zip(objects, lists(rows, "neighbours"), lists(rows, "walls"), strict=True)
    ]


def _object(fields: dict[str, Any]) -> _Object:
    source, scale, sha256, size_factor = (fields[name] for name in _MESH_FIELDS)
    return _Object((source, scale, sha256, size_factor), _bytes(fields["world_from_object"]))


def _bytes(matrix: list[float]) -> bytes:
    return np.array(matrix, np.float64).tobytes()


def _matrix(content: bytes) -> NDArray[np.float64]:
    return np.frombuffer(content, np.float64).reshape(4, 4)


def _shown(scenes: list[_SceneRow]) -> _Shown:
    index_of: dict[tuple[str, float, str, float], int] = {}
    meshes_of = [[index_of.setdefault(each.mesh, len(index_of)) for each in scene.objects] for scene in scenes]
    return _Shown(
        [load_mesh_of(*key) for key in index_of],
        meshes_of,
        [np.stack([_matrix(each.world_from_object) for each in scene.objects]) for scene in scenes],
        [[(_matrix(pose), list(half)) for pose, half in scene.walls] for scene in scenes],
    )


class RowObjects(NamedTuple):
    """Objects and walls of a row, as `graspbox.meshes.Surroundings`; the first object is that of the row."""

    meshes: list[Mesh]
    world_from_objects: NDArray[np.float64]
    world_from_walls: NDArray[np.float64]
    wall_half_extents: NDArray[np.float64]


def placed_objects(row: "pa.Table") -> RowObjects:
    """Load the objects and walls of one row; errors as of `load_mesh_of`."""
    shown = _shown(_scenes(row))
    walls = shown.walls[0]
    return RowObjects(
        [shown.meshes[index] for index in shown.meshes_of[0]],
        shown.world_from_objects[0],
        np.array([pose for pose, _ in walls]).reshape(-1, 4, 4),
        np.array([half for _, half in walls]).reshape(-1, 3),
    )


def _unique_images(
    scenes: list[_SceneRow], cameras: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows whose images differ, and for each row the index of its images among them."""
    seen: dict[tuple[_SceneRow, bytes], int] = {}
    unique: list[int] = []
    back = np.zeros(len(scenes), np.int64)
    for index, (scene, poses) in enumerate(zip(scenes, cameras, strict=True)):
        key = (scene, poses.tobytes())
        if key not in seen:
            seen[key] = len(unique)
            unique.append(index)
        back[index] = seen[key]
    return np.array(unique, np.int64), back


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
    found = _core.render_scenes(
        shown.meshes,
        [each for each in shown.meshes_of for _ in range(views)],
        np.concatenate([np.zeros((0, 4, 4)), *(each for each in shown.world_from_objects for _ in range(views))]),
        [each for each in shown.walls for _ in range(views)],
        np.ascontiguousarray(world_from_camera.reshape(-1, 4, 4)),
        json.dumps(plain(config, "the images")),
        num_threads,
    )
    return {name: image.reshape(count, views, *image.shape[1:]) for name, image in found.items()}  # type: ignore[attr-defined]


def _intrinsics(size: Any, fov: float) -> NDArray[np.float64]:
    """Intrinsics with square pixels and the optical axis through the middle of the image."""
    height, width = size
    focal = height / (2.0 * np.tan(fov / 2.0))
    return np.array([[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]])


def scene_images(columns: dict[str, Any], resting: RestingScene, config: DatasetConfig) -> dict[str, Any]:
    """Make the columns of a scene's stored images, from the columns of its trials."""
    cameras, rest = columns["world_from_camera"][0], columns["world_from_object"][0]
    views = len(cameras)
    around, walls = placed(resting.around)
    meshes = [resting.scene.mesh, *(mesh for mesh, _ in around)]
    poses = np.stack([rest, *(pose for _, pose in around)])
    channels = {"rgb": False, "segmentation": True, "table": True}
    shown = _Shown(meshes, [list(range(len(meshes)))], [poses], [walls])
    found = _images(shown, cameras[None], config.image_size, config.fov, channels, 1)
    return {
        "scene": [columns["scene"][0]] * views,
        "split": [columns["split"][0]] * views,
        "view": np.arange(views),
        "world_from_object": np.repeat(rest[None], views, axis=0),
        "world_from_camera": cameras,
        "intrinsics": np.repeat(_intrinsics(config.image_size, config.fov)[None], views, axis=0),
        "depth": depth_millimetres(found["depth"][0]),
        "segmentation": found["segmentation"][0],
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
        If the frames cannot be found without a segmentation, or a number is out of range.
    """
    count, views = rendered.depth.shape[:2]
    frames = grid_frames(rendered) if world_from_grid is None else floats(world_from_grid, "world_from_grid")
    if frames.shape != (count, 4, 4):
        raise ConfigError(f"world_from_grid has shape {list(frames.shape)}; give ({count}, 4, 4)")
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
    """Frames with the world's axes, on the table below the middle of the object's visible points: (n, 4, 4).

    Raises
    ------
    ConfigError
        If the images have no segmentation.
    """
    if rendered.segmentation is None:
        raise ConfigError("the images have no segmentation; render them with segmentation=True or give the frames")
    height, width = rendered.depth.shape[2:]
    rows, columns = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(rendered.intrinsics).T
    frames = np.tile(np.eye(4), (len(rendered.depth), 1, 1))
    for index, pose in enumerate(rendered.world_from_camera):
        mask = (rendered.segmentation[index] == 2) & (rendered.depth[index] > 0)
        seen = [(rays[m] * d[m][:, None]) @ p[:3, :3].T + p[:3, 3] for m, d, p in
                zip(mask, rendered.depth[index], pose, strict=True)]  # fmt: skip
        points = np.concatenate(seen)
        if len(points):
            frames[index, :2, 3] = (points.min(axis=0)[:2] + points.max(axis=0)[:2]) / 2.0
    return frames
