"""The study's training data: images or voxels of objects, each with the pose of a successful grasp.

Inputs:

| kind | array | values |
|---|---|---|
| ``image``   | (n, 256, 256) uint8    | grey; a camera 0.7 m away, within 15 degrees and 5 cm of one pose (`graspbox.views`, plan ``study``) |
| ``binary``  | (n, 64, 64, 64) uint8  | 0 transparent, 255 opaque: the mesh, as binvox with ``-d 128 -down -ri -e`` |
| ``ternary`` | (n, 64, 64, 64) uint8  | 0 transparent, 128 unseen, 255 opaque: the view of one such camera, in the same cube |

Input-output mappings: pairing of images and poses.

| mapping | sample k of an object |
|---|---|
| ``one_to_many`` | the object's first view, its k-th pose: the same input with different labels |
| ``one_to_one``  | its k-th view, its k-th pose |
| ``many_to_one`` | its k-th view, its best pose: the mapping that the study chose |

A binary grid is the same from every view. Labels are a position (metres) and an orientation in the object's base frame
(`graspbox.study.grasps`), independent of the camera: the network must infer the object's axes from the image.
"""  # noqa: E501 (tables)

import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox import meshes
from graspbox._common.by_value import ByValue
from graspbox._common.files import replacing
from graspbox._common.rotations import (
    euler_from_rotation,
    poses_from,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)
from graspbox._core import Mesh
from graspbox.errors import ConfigError, FileError
from graspbox.meshes.views import Views, occupancy, views
from graspbox.meshes.voxels import voxelize
from graspbox.object_sets import ObjectSet
from graspbox.simulation import Scene
from graspbox.study.grasps import Grasps, base_pose

__all__ = [
    "Kind", "Mapping", "Samples", "Split", "base_mesh", "grey", "labels_of", "make_samples", "observe",
    "poses_of_labels", "split_at_random",
]  # fmt: skip

Kind = Literal["image", "binary", "ternary"]
Mapping = Literal["one_to_many", "one_to_one", "many_to_one"]

#: Side of an image, pixels, and of a voxel grid.
IMAGE_SIZE, GRID_SIZE = 256, 64
#: Values of a voxel.
TRANSPARENT, UNSEEN, OPAQUE = 0, 128, 255
#: Weights of red, green and blue in grey (ITU-R BT.601).
_LUMA = np.array([0.299, 0.587, 0.114])
#: Views rendered per call.
_CHUNK = 64


@dataclass(frozen=True, eq=False)
class Samples(ByValue):
    """Inputs (n, ...) of a network with the pose to predict of each, in the base frame, and the preshape of the grasp.

    `names` are those of the objects, and `object` indexes them.
    """

    names: tuple[str, ...]
    inputs: NDArray[np.uint8]
    object: NDArray[np.int64]
    base_from_hand: NDArray[np.float64]
    preshape: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.object)

    def __getitem__(self, rows: NDArray[np.int64] | slice) -> "Samples":
        return replace(self, **{name: getattr(self, name)[rows] for name in _COLUMNS})

    def save(self, path: Path) -> None:
        """Write the samples as ``.npz``; raises as `replacing`."""
        columns = {name: getattr(self, name) for name in _COLUMNS}
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, names=np.array(self.names), **columns)

    @classmethod
    def load(cls, path: Path) -> "Samples":
        """Read the file of `save`; a missing one is a `FileError`, a damaged one a `ConfigError`."""
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return cls(tuple(arrays["names"].tolist()), **{name: arrays[name] for name in _COLUMNS})
        except OSError as error:
            raise FileError(error.errno, error.strerror or str(error), str(path)) from None
        except (KeyError, ValueError, zipfile.BadZipFile):
            raise ConfigError(f"{str(path)!r} is not a file of samples; remove it, and it will be made again") from None


#: Names of the arrays of `Samples`.
_COLUMNS = ("inputs", "object", "base_from_hand", "preshape")


@dataclass(frozen=True, eq=False)
class Split(ByValue):
    """Rows of the training, validation and test samples."""

    train: NDArray[np.int64]
    validation: NDArray[np.int64]
    test: NDArray[np.int64]


def split_at_random(count: int, seed: int = 0) -> Split:
    """Split samples 85/10/5 at random, as the study does: objects of the training samples occur in the test as well."""
    if count < 20:
        raise ConfigError(f"there are {count} samples; there must be 20 or more, so that 5 % of them are one")
    order = np.random.default_rng(seed).permutation(count)
    first, second = round(0.85 * count), round(0.95 * count)
    return Split(np.sort(order[:first]), np.sort(order[first:second]), np.sort(order[second:]))


def labels_of(base_from_hand: NDArray[np.float64], size: int) -> NDArray[np.float32]:
    """Convert poses (n, 4, 4) to labels (n, 3 + size): position, then quaternion (size 4) or Euler angles (size 3)."""
    rotations = base_from_hand[:, :3, :3]
    orientation = quaternion_from_rotation(rotations) if size == 4 else euler_from_rotation(rotations)
    return np.concatenate([base_from_hand[:, :3, 3], orientation], axis=1).astype(np.float32)


def poses_of_labels(labels: NDArray[np.floating]) -> NDArray[np.float64]:
    """Convert labels, or finite outputs of a network with normalized quaternions, to poses (n, 4, 4)."""
    values = np.asarray(labels, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] not in (6, 7):
        raise ConfigError(f"the labels have shape {values.shape}; it must be (n, 7) or (n, 6)")
    if not np.isfinite(values).all():
        raise ConfigError("the labels hold numbers that are not finite; the network has diverged")
    orientation = values[:, 3:]
    rotations = rotation_from_quaternion(orientation) if values.shape[1] == 7 else rotation_from_euler(orientation)
    return poses_from(values[:, :3], rotations)


def grey(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert colour images (..., 3) to grey (...)."""
    return np.asarray(np.rint(rgb @ _LUMA), dtype=np.uint8)


def base_mesh(scene: Scene) -> Mesh:
    """Return the object of a scene at rest, in its base frame."""
    pose = np.linalg.inv(base_pose(scene)) @ scene.world_from_object
    points = scene.mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    return meshes.mesh_from_arrays(points, scene.mesh.faces, name=scene.name, mass=scene.mesh.mass)


def make_samples(
    objects: ObjectSet,
    grasps: Grasps,
    *,
    kind: Kind,
    mapping: Mapping,
    count: int | None = None,
    seed: int = 0,
    num_threads: int | None = None,
    done: Callable[[int], None] = lambda _: None,
) -> Samples:
    """Render or voxelize the objects, in the order of `Grasps.names`, and pair the inputs with their grasps.

    There are `count` samples, by default one per grasp; more repeat an object's grasps with further views. `seed` is
    that of the views. The samples do not depend on `num_threads`. `done` is called with the number of samples so far.
    """
    for name, value, known in (("kind", kind, get_args(Kind)), ("mapping", mapping, get_args(Mapping))):
        if value not in known:
            raise ConfigError(f"{name} is {value!r}; choose from {', '.join(known)}")
    if objects.names != grasps.names:
        raise ConfigError("the grasps belong to other objects; pass those that they were collected for")
    total = len(grasps) if count is None else count
    sizes = _sizes(np.bincount(grasps.object, minlength=len(objects)), total)
    best = grasps.best()
    inputs, rows = [], []
    for i, spec in enumerate(objects):
        if not sizes[i]:
            continue
        own = np.flatnonzero(grasps.object == i)
        rows.append(np.full(sizes[i], best[i]) if mapping == "many_to_one" else own[np.arange(sizes[i]) % len(own)])
        shots = 1 if mapping == "one_to_many" else int(sizes[i])
        seen = observe(Scene(spec.load()), kind, shots, seed + i, num_threads=num_threads)
        inputs.append(np.broadcast_to(seen, (sizes[i], *seen.shape[1:])) if len(seen) == 1 else seen)
        done(sum(map(len, inputs)))
    chosen = np.concatenate(rows)
    targets = grasps.object[chosen], grasps.base_from_hand[chosen], grasps.preshape[chosen]
    return Samples(grasps.names, np.concatenate(inputs), *targets)


def _sizes(counts: NDArray[np.int64], total: int) -> NDArray[np.int64]:
    """Distribute a number of samples over objects, in proportion to their grasps; the parts sum up to it."""
    if total < 1:
        raise ConfigError(f"count is {total}; it must be 1 or more")
    ends = np.rint(np.cumsum(counts) * (total / counts.sum())).astype(np.int64)
    return np.asarray(np.diff(ends, prepend=0))


def observe(scene: Scene, kind: Kind, count: int, seed: int, *, num_threads: int | None = None) -> NDArray[np.uint8]:
    """Render the object of a scene from `count` views of the study's plan, as `Samples.inputs`.

    A binary grid has a single row, which all views share.
    """
    if kind == "image":
        return np.concatenate([grey(seen.rgb) for seen in _views(scene, count, seed, kind, num_threads)])  # type: ignore[arg-type]
    # As the study does: binvox with ``-d 128 -down -ri -e``.
    grid = voxelize(base_mesh(scene), 2 * GRID_SIZE, down=1, remove_internal=True, exact=True)
    if kind == "binary":
        return np.where(grid.occupancy, OPAQUE, TRANSPARENT).astype(np.uint8)[None]
    cube = grid.resolution, grid.origin, grid.resolution * grid.voxel_size
    base_from_world, rows = np.linalg.inv(base_pose(scene)), []
    for seen in _views(scene, count, seed, kind, num_threads):
        for depth, pose in zip(seen.depth, base_from_world @ seen.world_from_camera, strict=True):
            rows.append(
                np.array([UNSEEN, TRANSPARENT, OPAQUE], np.uint8)[
                    occupancy(depth[None], seen.intrinsics, pose[None], *cube)
                ]
            )
    return np.stack(rows)


def _views(scene: Scene, count: int, seed: int, kind: Kind, num_threads: int | None) -> Iterable[Views]:
    """Render `count` views of the study's plan, a bounded number at a time."""
    for start in range(0, count, _CHUNK):
        # Every chunk has its own seed: a plan's first views do not depend on the number of views.
        yield views(
            scene.mesh,
            plan="study",
            count=min(_CHUNK, count - start),
            seed=1000 * seed + start // _CHUNK,
            image_size=IMAGE_SIZE,
            images="rgb" if kind == "image" else "depth",
            # Rays to the table would carve the cube from below the object; the study's grids contain only the object.
            table=kind == "image",
            world_from_object=scene.world_from_object,
            num_threads=num_threads,
        )
