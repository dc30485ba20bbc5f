"""One depth image with its camera, and the crop around the object that it shows."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops, crop
from graspbox.perception.depth_images import points_of
from graspbox.perception.leveling import level

__all__ = ["DepthView", "Seen", "voxels_of"]


@dataclass(frozen=True, eq=False)
class DepthView:
    """A depth image of a table, and the camera that took it.

    Attributes
    ----------
    depth : (H, W) array
        Metres, or millimetres if the dtype is uint16; 0 where nothing was measured.
    intrinsics : (3, 3) array
        Pixels.
    world_from_camera : (4, 4) array
        Pose of the camera, metres: z forward, x right, y down; the table is the plane z = 0.
    """

    depth: ArrayLike
    intrinsics: ArrayLike
    world_from_camera: ArrayLike

    def leveled(self) -> Self:
        """Correct small errors of the camera's height and tilt: see `graspbox.perception.leveling.level`."""
        pose = floats(self.world_from_camera, "world_from_camera")
        return replace(self, world_from_camera=level(self.metres(), floats(self.intrinsics, "intrinsics"), pose))

    def seen(
        self,
        config: CropConfig,
        target: NDArray[np.bool_] | None = None,
        *,
        num_threads: int | None = None,
    ) -> "Seen":
        """Level the camera, find the object, and fill the voxels around it; arguments as of `Query`.

        Raises ConfigError for arrays of another shape or type. For real images see `graspbox.perception.captured.look`.
        """
        view = self.leveled()
        image, lens = np.asarray(view.depth)[None], floats(view.intrinsics, "intrinsics")
        pose = np.asarray(view.world_from_camera)
        crops = crop(image, lens, pose[None], config=config, num_threads=num_threads)
        if not crops.found[0]:
            return Seen(crops, None, view)
        if target is None:
            return Seen(crops, None, view)
        frame = crops.world_from_crop[0]
        own, others = (view.voxels(pixels, frame, config) for pixels in (target, crops.object[0] & ~target))
        return Seen(crops, own, view, others)

    def metres(self) -> NDArray[np.float64]:
        """Return the depth (H, W), metres."""
        image = np.asarray(self.depth)
        return 0.001 * image if image.dtype == np.uint16 else np.asarray(image, np.float64)

    def points(self) -> NDArray[np.float64]:
        """Return what the pixels with a depth show, row by row, (k, 3), world frame, metres."""
        pose = floats(self.world_from_camera, "world_from_camera")
        points = points_of(self.metres(), floats(self.intrinsics, "intrinsics"))
        return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])

    def voxels(
        self, pixels: NDArray[np.bool_], world_from_crop: NDArray[np.float64], config: CropConfig
    ) -> NDArray[np.bool_]:
        """Return the voxels (N, N, N) of a crop in which pixels (H, W) see something."""
        depth = self.metres()
        if np.shape(pixels) != depth.shape or np.asarray(pixels).dtype != np.bool_:
            raise ConfigError(f"the mask has shape {np.shape(pixels)}; pass bool {depth.shape}, as the image")
        points = points_of(np.where(pixels, depth, 0.0), floats(self.intrinsics, "intrinsics")).T
        crop_from_camera = np.linalg.inv(world_from_crop) @ floats(self.world_from_camera, "world_from_camera")
        return _filled((crop_from_camera[:3, :3] @ points + crop_from_camera[:3, 3:]).T, config)


class Seen(NamedTuple):
    """The crop of one depth image, and the levelled image.

    To grasp one of several objects, `target` and `others` (N, N, N) bool are the voxels in which its pixels, and those
    of the others, see something.
    """

    crops: Crops
    target: NDArray[np.bool_] | None = None
    view: DepthView | None = None
    others: NDArray[np.bool_] | None = None


def voxels_of(
    points: NDArray[np.float64], world_from_crop: NDArray[np.float64], config: CropConfig
) -> NDArray[np.bool_]:
    """Return the voxels (N, N, N) of a crop that hold points (n, 3), world frame, metres."""
    return _filled((points - world_from_crop[:3, 3]) @ world_from_crop[:3, :3], config)


def _filled(points: NDArray[np.float64], config: CropConfig) -> NDArray[np.bool_]:
    """Return the voxels (N, N, N) of a crop that hold points (n, 3) in its frame, metres."""
    cells = np.floor((points - config.origin) / config.voxel_size).astype(np.int64)
    inside = cells[((cells >= 0) & (cells < config.resolution)).all(axis=1)]
    visible = np.zeros((config.resolution,) * 3, dtype=np.bool_)
    visible[tuple(inside.T)] = True
    return visible
