"""Hand poses outside the camera image, so that the hand is not mistaken for part of the object."""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._core import Hand
from graspbox.envs import spaces
from graspbox.errors import ConfigError

__all__ = ["HandView"]

#: Collision shapes grow by this much on every side, metres: links look larger, and the arm lags a little.
_MARGIN = 0.015
#: Steps in which the hand is raised, metres, and lateral positions to try, as shares of half the workspace.
_RAISE = 0.02
_ASIDE = (-1.0, -0.5, 0.0, 0.5, 1.0)
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


class HandView:
    """A hand in the image of a fixed camera with the pose ``world_from_camera`` (4, 4) and a lens (3, 3), pixels."""

    def __init__(
        self, hand: Hand, world_from_camera: ArrayLike, intrinsics: ArrayLike, image_size: tuple[int, int]
    ) -> None:
        self._hand = hand
        self._camera_from_world = np.linalg.inv(np.asarray(world_from_camera, dtype=np.float64))
        lens = np.asarray(intrinsics, dtype=np.float64)
        rows, columns = image_size
        edges = (0.0 - lens[0, 2]) / lens[0, 0], (columns - lens[0, 2]) / lens[0, 0]
        ends = (0.0 - lens[1, 2]) / lens[1, 1], (rows - lens[1, 2]) / lens[1, 1]
        # Inward normals (4, 3) of the planes through the eye and the borders of the image.
        self._inward = np.array([[1, 0, -edges[0]], [-1, 0, edges[1]], [0, 1, -ends[0]], [0, -1, ends[1]]])
        self._low, self._high = (np.array(bound) for bound in spaces.tables(hand)["workspace"])

    def _meets(
        self, world_from_hand: NDArray[np.float64], shapes: NDArray[np.float64], halves: NDArray[np.float64]
    ) -> bool:
        frames = self._camera_from_world @ world_from_hand @ shapes
        local = _CORNERS[None] * (halves[:, None] + _MARGIN)
        corners = np.einsum("nij,nkj->nki", frames[:, :3, :3], local) + frames[:, None, :3, 3]
        # A box is out of the image if all of it is beyond one border.
        beyond = (corners @ self._inward.T < 0.0).all(axis=1).any(axis=1)
        return bool((~beyond).any())

    def leave(self, world_from_hand: ArrayLike, preshape: float) -> list[NDArray[np.float64]]:
        """Find the way out of the image: straight up if that is enough, else up and aside; never down.

        Returns waypoints ``world_from_hand`` (4, 4), none if the hand is not in the image. Raises ConfigError if the
        hand is in
        the image at every pose in the workspace.
        """
        start = np.asarray(world_from_hand, dtype=np.float64)
        shapes, halves, _, _ = self._hand.shapes(self._hand.open(preshape))
        heights = np.arange(start[2, 3], self._high[2], _RAISE)
        for height in [*heights, self._high[2]]:
            raised = start.copy()
            raised[2, 3] = max(height, start[2, 3])
            if not self._meets(raised, shapes, halves):
                return [raised] if raised[2, 3] > start[2, 3] else []
        middle, half = (self._low + self._high) / 2, (self._high - self._low) / 2
        places = [middle[:2] + half[:2] * share for share in product(_ASIDE, repeat=2)]
        for height in heights[:: 1 + len(heights) // 8]:
            for place in sorted(places, key=lambda place: float(np.linalg.norm(place - start[:2, 3]))):
                raised, aside = start.copy(), start.copy()
                raised[2, 3] = aside[2, 3] = height
                aside[:2, 3] = place
                if not self._meets(aside, shapes, halves):
                    return [raised, aside]
        raise ConfigError(
            "the first camera sees the hand wherever it goes; move the camera, or narrow its field of view"
        )
