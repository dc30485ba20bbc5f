"""Depth images of an object on a table: sensor noise, and the voxels of a crop around the object."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict, floats, natural
from graspbox._common.by_value import ByValue
from graspbox.errors import ConfigError
from graspbox.meshes import MeshLike, as_mesh
from graspbox.meshes.views import depth_metres
from graspbox.perception.configs import CropConfig, DepthNoise

__all__ = ["CHANNELS", "OCCUPIED", "Crops", "add_depth_noise", "crop", "solid_occupancy"]

#: Names of the channels of a crop, in order.
CHANNELS: tuple[str, ...] = tuple(_core.channel_names()[0])
#: A voxel of an occupancy of this value or more, of 255, belongs to the object: a quarter, as for proposals.
OCCUPIED = 64


@dataclass(frozen=True, eq=False)
class Crops(ByValue):
    """The object in n depth images, as voxels in n crop frames.

    A crop frame has its origin on the table below the middle of the object's visible surface, z up, and x horizontally
    away from the camera.

    Attributes
    ----------
    world_from_crop : (n, 4, 4) float64
        Pose of the crop frame, metres; the identity without an object.
    found : (n,) bool
        Whether the image shows an object.
    object : (n, H, W) bool
        Pixels of the object.
    channels : (n, 3, N, N, N) uint8
        By voxel along x, y and z, 0 to 255 for 0 to 1: `CHANNELS`. ``surface``: how near to a voxel's centre a pixel of
        the object is. ``unseen``: the share of the voxel behind the visible surface. ``table``: its share below the
        table.
    """

    world_from_crop: NDArray[np.float64]
    found: NDArray[np.bool_]
    object: NDArray[np.bool_]
    channels: NDArray[np.uint8]

    def __len__(self) -> int:
        """Count the crops."""
        return len(self.found)

    @classmethod
    def joined(cls, parts: "Iterable[Crops]") -> "Crops":
        """Join the crops of one or more tables."""
        tables = [vars(part) for part in parts]
        return cls(**{name: np.concatenate([table[name] for table in tables]) for name in tables[0]})

    def rows(self, chosen: NDArray[np.bool_]) -> "Crops":
        """Return the crops with a true flag (n,)."""
        return Crops(**{name: values[chosen] for name, values in vars(self).items()})


def add_depth_noise(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    seed: int | Sequence[int] = 0,
    noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
    *,
    num_threads: int | None = None,
) -> NDArray[np.uint16]:
    """Return rendered depth as a camera would measure it.

    Parameters
    ----------
    depth : (n, H, W) array
        Metres along the optical axis, 0 where nothing was seen.
    intrinsics : (3, 3) array
        Of every image, pixels.
    seed : int or sequence of n int
        One per image; or the first image's, from which the others follow by ones.
    noise : DepthNoise
        The camera.
    num_threads : int, optional
        By default one per core; the result does not depend on it.

    Returns
    -------
    (n, H, W) uint16
        Millimetres; 0 where the camera measures nothing.

    Raises
    ------
    ConfigError
        For arrays of another shape, depths that are negative or not finite, or a setting out of range.
    """
    images = depth_metres(depth)
    if images.ndim != 3:
        raise ConfigError(f"depth has shape {images.shape}; pass (n, H, W)")
    if isinstance(seed, int | np.integer):
        first = natural(seed, "seed", 63)
        seeds = [first + i for i in range(len(images))]
    else:
        seeds = [natural(one, "seed", 64) for one in seed]
    return _core.add_depth_noise(
        images, floats(intrinsics, "intrinsics"), seeds, config_dict(noise, DepthNoise, "noise"), num_threads
    )


def crop(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    world_from_camera: ArrayLike,
    *,
    labels: ArrayLike | None = None,
    middle: ArrayLike | None = None,
    config: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> Crops:
    """Find the object in depth images of a table, and fill the voxels around it.

    Parameters
    ----------
    depth : (n, H, W) array
        Distance along the optical axis, 0 where nothing was measured: metres, or millimetres if the dtype is uint16.
    intrinsics : (3, 3) array
        Of every image, pixels.
    world_from_camera : (n, 4, 4) array
        Poses of the cameras (z forward, x right, y down), metres; the table is the plane z = 0, z is up.
    labels : (n, H, W) bool array, optional
        Pixels of the object; by default the largest group of pixels above the table.
    middle : (n, H, W) bool array, optional
        Pixels around which the crop lies; by default those of the object.
    config : CropConfig
        The crop.
    num_threads : int, optional
        By default one per core; the result does not depend on it.

    Raises
    ------
    ConfigError
        For arrays of another shape or type, or a setting out of range.
    """
    images = depth_metres(depth)
    flags, around = (None if each is None else np.ascontiguousarray(each) for each in (labels, middle))
    for name, each in (("labels", flags), ("middle", around)):
        if each is not None and each.dtype != np.bool_:
            raise ConfigError(f"{name} are of dtype {each.dtype}; pass bool, True for the object")
    arrays = _core.crops(
        images,
        floats(intrinsics, "intrinsics"),
        floats(world_from_camera, "world_from_camera"),
        (flags, around),
        config_dict(config, CropConfig),
        num_threads,
    )
    return Crops(**arrays)


def solid_occupancy(
    meshes: Sequence[MeshLike],
    mesh_of: Sequence[int],
    crop_from_object: ArrayLike,
    *,
    config: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> NDArray[np.uint8]:
    """Fill the voxels of crops with the objects themselves.

    Parameters
    ----------
    meshes : sequence of Mesh
        The objects.
    mesh_of : sequence of n int
        Index of the object in each crop.
    crop_from_object : (n, 4, 4) array
        ``inv(world_from_crop) @ world_from_object``.
    config : CropConfig
        The crop.
    num_threads : int, optional
        By default one per core; the result does not depend on it.

    Returns
    -------
    (n, N, N, N) uint8
        The share of each voxel that the object fills, 0 to 255 for 0 to 1, in steps of an eighth.

    Raises
    ------
    ConfigError
        For arrays of another shape, an index without a mesh, or a setting out of range.
    """
    models = [as_mesh(mesh) for mesh in meshes]
    indices = [natural(index, "mesh_of") for index in mesh_of]
    poses = floats(crop_from_object, "crop_from_object")
    return _core.solids(models, indices, poses, config_dict(config, CropConfig), num_threads)
