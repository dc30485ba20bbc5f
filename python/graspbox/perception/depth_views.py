"""One depth image with its camera, which an observer gives to a finder."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
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
        image = np.asarray(self.depth)
        metres = 0.001 * image if image.dtype == np.uint16 else image
        pose = floats(self.world_from_camera, "world_from_camera")
        return replace(self, world_from_camera=level(metres, floats(self.intrinsics, "intrinsics"), pose))

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
