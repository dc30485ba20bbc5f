"""One depth image with its camera, which an observer gives to a finder."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops, crop
from graspbox.perception.leveling import level

__all__ = ["DepthView"]


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
        return replace(self, world_from_camera=level(self._metres(), floats(self.intrinsics, "intrinsics"), pose))

    def _metres(self) -> NDArray[np.float64]:
        image = np.asarray(self.depth)
        return 0.001 * image if image.dtype == np.uint16 else np.asarray(image, np.float64)

    def voxels(
        self, pixels: NDArray[np.bool_], world_from_crop: NDArray[np.float64], config: CropConfig
    ) -> NDArray[np.bool_]:
        """Return the voxels (N, N, N) of a crop in which pixels (H, W) see something.

        Raises
        ------
        ConfigError
            If `pixels` is no mask of the image's shape.
        """
        depth = self._metres()
        if np.shape(pixels) != depth.shape or np.asarray(pixels).dtype != np.bool_:
            raise ConfigError(f"the mask has shape {np.shape(pixels)}; give bool {depth.shape}, as the image")
        rows, columns = np.nonzero(pixels & (depth > 0))
        ahead = depth[rows, columns]
        rays = np.linalg.inv(floats(self.intrinsics, "intrinsics")) @ [columns + 0.5, rows + 0.5, np.ones(len(rows))]
        crop_from_camera = np.linalg.inv(world_from_crop) @ floats(self.world_from_camera, "world_from_camera")
        points = crop_from_camera[:3, :3] @ (rays * ahead) + crop_from_camera[:3, 3:]
        cells = np.floor((points.T - config.origin) / config.voxel_size).astype(np.int64)
        inside = cells[((cells >= 0) & (cells < config.resolution)).all(axis=1)]
        found = np.zeros((config.resolution,) * 3, dtype=np.bool_)
        found[tuple(inside.T)] = True
        return found

    def crops(
        self, config: CropConfig, *, within: NDArray[np.bool_] | None = None, num_threads: int | None = None
    ) -> Crops:
        """Find the object and fill the voxels around it: the one crop of this image, as `graspbox.perception.crop`.

        `within` (H, W) are the pixels among which the object is looked for; by default all.
        """
        image, pose = np.asarray(self.depth)[None], np.asarray(self.world_from_camera)[None]
        labels = None
        if within is not None:
            inside = np.where(within, image, image.dtype.type(0))
            labels = crop(inside, self.intrinsics, pose, config=config, num_threads=num_threads).object
        return crop(image, self.intrinsics, pose, labels=labels, config=config, num_threads=num_threads)
