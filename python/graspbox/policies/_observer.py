"""Depth images of a policy: from a camera of its environments, with the noise of a real one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from graspbox._core import Hand
from graspbox.configs.cameras import camera_pose, lens
from graspbox.errors import ConfigError
from graspbox.perception.configs import DepthNoise
from graspbox.perception.crops import add_depth_noise
from graspbox.perception.depth_views import DepthView
from graspbox.policies._hand_view import HandView
from graspbox.policies.base import Task

__all__ = ["Observer"]


class Observer:
    """Takes depth images of the table with one of the environments' cameras, which must be fixed in the world.

    `noise` is added to the depth that the environments render. `image` is the name of the depth image in observations,
    `hand_view` the hand in it. Raises ConfigError if the camera is mounted on the hand.
    """

    def __init__(
        self,
        task: Task,
        hand: Hand,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        camera: int = 0,
    ) -> None:
        chosen, size = task.cameras.cameras[camera], task.cameras.image_size
        if chosen.mount != "world":
            raise ConfigError(f"camera {chosen.name!r} is mounted on the hand; put one first whose mount is 'world'")
        self.image = f"depth_{chosen.name}" if camera else "depth"
        self._world_from_camera, self._intrinsics, self._noise = camera_pose(chosen), lens(chosen.fov, size), noise
        self.hand_view = HandView(hand, self._world_from_camera, self._intrinsics, size)

    def look(self, row: Mapping[str, Any], seed: int) -> DepthView:
        """Return the depth image (H, W, 1), metres, of an environment's row, with simulated noise of a seed."""
        clean = np.asarray(row[self.image])[None, :, :, 0]
        depth = add_depth_noise(clean, self._intrinsics, seed, self._noise)[0]
        return DepthView(depth, self._intrinsics, self._world_from_camera)
