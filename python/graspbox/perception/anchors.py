"""Anchors: a regular grid of steep grasps over the table, which a network classifies one by one.

A grasp is described by its grasp point (a fixed distance in front of the palm, between the fingers), the roll of the
hand about the vertical, the tilt of its approach from straight down, and its preshape. Anchors have grasp points on a
grid of the crop, evenly spaced rolls, and no tilt. `Anchors.encode` and `Anchors.decode` convert between a pose and its
nearest anchor with a residual of at most half a step.

Steep grasps are enough for objects on a table: in 170 of the first 171 scenes of a data set of boxes and blocks
(`graspbox dataset`, 112 trials each) one within 0.32 rad of the vertical succeeded.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import check_range
from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig
from graspbox.perception.outputs import check_finite

__all__ = ["RESIDUALS", "AnchorConfig", "Anchors", "Candidates", "Encoded"]

#: Numbers of a residual: offsets of x, y, height and roll in steps of the grid, and the tilt in units of `max_tilt`.
RESIDUALS = 6
#: The hand straight down, roll 0: its z is the table's -z, its x that of the crop.
_DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class AnchorConfig:
    """The grid of anchors.

    Attributes
    ----------
    cells : int
        Grasp points along x and along y, centred on the crop; even.
    spacing : float
        Distance between them, metres; two voxels of the crop.
    heights : int
        Grasp points along z.
    lowest : float
        Height of the lowest over the table, metres; perhaps below, since the fingers close above it.
    rolls : int
        Rolls of the hand in a full turn; even.
    reach : float
        Distance of the grasp point from the hand's origin along its z, metres.
    max_tilt : float
        Steepest angle between the approach and straight down, radians.
    """

    cells: int = 12
    spacing: float = 0.0125
    heights: int = 18
    lowest: float = -0.045
    rolls: int = 16
    reach: float = 0.08
    max_tilt: float = 0.32

    def __post_init__(self) -> None:
        for name in ("cells", "rolls", "heights"):
            check_range(self, name, 2, 256)
            if name != "heights" and getattr(self, name) % 2:
                raise ConfigError(f"{name} is {getattr(self, name)}; pass an even number")
        for name, least in (("spacing", 1e-4), ("reach", 1e-4), ("lowest", -1.0)):
            check_range(self, name, least, 1.0)
        if not 0.0 < self.max_tilt < np.pi / 2:
            raise ConfigError(f"max_tilt is {self.max_tilt}; pass more than 0, and less than pi / 2: the horizon")

    def check(self, crop: CropConfig) -> None:
        """Refuse a grid whose points do not lie on every second voxel of a crop."""
        if abs(self.spacing - 2.0 * crop.voxel_size) > 1e-9 or self.cells > crop.resolution // 2:
            raise ConfigError(
                f"{self.cells} anchors {self.spacing} m apart do not fit a crop of {crop.resolution} voxels of "
                f"{crop.voxel_size} m; pass spacing = {2.0 * crop.voxel_size} and at most {crop.resolution // 2} cells"
            )


@dataclass(frozen=True, eq=False)
class Candidates:
    """k grasps of one crop, best first: ``crop_from_hand`` (k, 4, 4), metres; preshapes (k,) by index; scores (k,)."""

    poses: NDArray[np.float64]
    preshape: NDArray[np.int64]
    scores: NDArray[np.float64]

    def __post_init__(self) -> None:
        for values in (self.poses, self.scores):
            check_finite(values, "head")


@dataclass(frozen=True, eq=False)
class Encoded:
    """m poses among the anchors.

    `place` (m, 4): in steps of the grid, x, y, height, and roll in [0, rolls). `tilt` (m, 2): axis of the turn from
    straight
    down to the approach, in the horizontal axes of the untilted hand, times its angle, radians. `inside` (m,): whether
    the
    pose is at most half a step outside the grid, and not tilted too far.
    """

    place: NDArray[np.float64]
    tilt: NDArray[np.float64]
    inside: NDArray[np.bool_]


class Anchors:
    """A grid of anchors for a hand with `preshapes` preshapes."""

    def __init__(self, preshapes: int, config: AnchorConfig = AnchorConfig()) -> None:
        self.config = config
        #: Anchors along each axis: preshape, height, roll, x, y.
        self.shape = (preshapes, config.heights, config.rolls, config.cells, config.cells)

    def __len__(self) -> int:
        """Count the anchors."""
        return int(np.prod(self.shape))

    def places(self, crop_from_hand: NDArray[np.float64]) -> Encoded:
        """Locate poses ``crop_from_hand`` (m, 4, 4) among the anchors."""
        c = self.config
        approach = crop_from_hand[:, :3, 2]
        point = crop_from_hand[:, :3, 3] + c.reach * approach
        # The shortest turn from straight down (0, 0, -1) to the approach is about (0, 0, -1) x approach.
        axis = np.stack([approach[:, 1], -approach[:, 0]], axis=1)
        sine = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(sine, -approach[:, 2])
        turn = axis * (angle / np.maximum(sine, 1e-12))[:, None]
        untilted = np.swapaxes(_turns(turn), 1, 2) @ crop_from_hand[:, :3, :3]
        roll = np.arctan2(untilted[:, 1, 0], untilted[:, 0, 0])
        place = np.stack(
            [
                point[:, 0] / c.spacing + 0.5 * (c.cells - 1),
                point[:, 1] / c.spacing + 0.5 * (c.cells - 1),
                (point[:, 2] - c.lowest) / c.spacing,
                np.mod(roll * (c.rolls / (2.0 * np.pi)), c.rolls),
            ],
            axis=1,
        )
        last = np.array([c.cells - 1, c.cells - 1, c.heights - 1])
        on_grid = ((place[:, :3] >= -0.5) & (place[:, :3] <= last + 0.5)).all(axis=1)
        tilt = _turned(turn, -roll)
        return Encoded(place, tilt, on_grid & (angle <= c.max_tilt))

    def poses(self, place: NDArray[np.float64], tilt: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses ``crop_from_hand`` (m, 4, 4) of places (m, 4) and tilts (m, 2): the inverse of `places`."""
        c = self.config
        roll = place[:, 3] * (2.0 * np.pi / c.rolls)
        cosine, sine = np.cos(roll), np.sin(roll)
        about = np.zeros((len(place), 3, 3))
        about[:, 0, 0], about[:, 0, 1], about[:, 1, 0], about[:, 1, 1], about[:, 2, 2] = cosine, -sine, sine, cosine, 1
        poses = np.tile(np.eye(4), (len(place), 1, 1))
        poses[:, :3, :3] = _turns(_turned(tilt, roll)) @ about @ _DOWN
        poses[:, :2, 3] = (place[:, :2] - 0.5 * (c.cells - 1)) * c.spacing
        poses[:, 2, 3] = place[:, 2] * c.spacing + c.lowest
        poses[:, :3, 3] -= c.reach * poses[:, :3, 2]
        return poses

    def encode(
        self, crop_from_hand: NDArray[np.float64], preshape: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
        """Find the nearest anchors of poses (m, 4, 4) with preshapes (m,), by index.

        Returns their indices (m,) in an array of `shape`; residuals (m, 6), each of the first four at most 1/2; and
        whether
        the pose is on the grid (m,). Poses off the grid have the residual of the nearest pose on it.
        """
        encoded = self.places(crop_from_hand)
        nearest = self._clipped(np.rint(encoded.place).astype(np.int64))
        offset = encoded.place - nearest
        offset[:, 3] -= self.config.rolls * np.rint(offset[:, 3] / self.config.rolls)
        residual = np.concatenate([offset, encoded.tilt / self.config.max_tilt], axis=1)
        residual[:, :4] = np.clip(residual[:, :4], -0.5, 0.5)
        return self._index(preshape, nearest), np.clip(residual, -1.0, 1.0), encoded.inside

    def decode(
        self, index: NDArray[np.int64], residual: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return poses ``crop_from_hand`` (m, 4, 4) and preshapes (m,), by index, of anchors (m,) and residuals (m, 6).

        Without residuals the poses are the anchors' own.
        """
        preshape, height, roll, x, y = np.unravel_index(index, self.shape)
        place = np.stack([x, y, height, roll], axis=1).astype(np.float64)
        if residual is None:
            return self.poses(place, np.zeros((len(index), 2))), preshape
        return self.poses(place + residual[:, :4], residual[:, 4:] * self.config.max_tilt), preshape

    def candidates(
        self, index: NDArray[np.int64], residual: NDArray[np.float32], scores: NDArray[np.float32]
    ) -> Candidates:
        """Make grasps of a network's anchors (k,), residuals (k, 6) and scores (k,), best first.

        Raises
        ------
        ConfigError
            If there is no such anchor, or a number is not finite.
        """
        if len(index) and not (index.min() >= 0 and index.max() < len(self)):
            raise ConfigError(
                f"the head returns anchors from {index.min()} to {index.max()}, and there are {len(self)}; its network "
                "and its settings do not fit, so export the policy again"
            )
        # Residuals of a grasp from its own anchor have this range.
        bounds = np.array([0.5] * 4 + [1.0] * 2)
        poses, preshape = self.decode(index, np.clip(residual.astype(np.float64), -bounds, bounds))
        return Candidates(poses, preshape, scores.astype(np.float64))

    def mirrored(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Mirror anchors (m,) in the crop's plane y = 0; the hand must be symmetric in its plane y = 0."""
        preshape, height, roll, x, y = np.unravel_index(index, self.shape)
        flipped = np.ravel_multi_index(
            (preshape, height, -roll % self.config.rolls, x, self.config.cells - 1 - y), self.shape
        )
        return np.asarray(flipped, dtype=np.int64)

    def _clipped(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Move nodes (m, 4) to the nearest on the grid; rolls wrap around."""
        c = self.config
        clipped = np.clip(nodes, 0, [c.cells - 1, c.cells - 1, c.heights - 1, nodes.max(initial=0)])
        clipped[:, 3] = nodes[:, 3] % c.rolls
        return clipped

    def _index(self, preshape: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        x, y, height, roll = nodes.T
        return np.asarray(np.ravel_multi_index((preshape, height, roll, x, y), self.shape), dtype=np.int64)


def _turned(vectors: NDArray[np.float64], angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn horizontal vectors (m, 2) about the vertical by angles (m,)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)


def _turns(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations (m, 3, 3) about horizontal vectors (m, 2) by their length, radians."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y = (vectors / np.maximum(angle, 1e-12)[:, None]).T
    cosine, sine = np.cos(angle), np.sin(angle)
    rest = 1.0 - cosine
    rows = [
        np.stack([cosine + x * x * rest, x * y * rest, y * sine], axis=1),
        np.stack([x * y * rest, cosine + y * y * rest, -x * sine], axis=1),
        np.stack([-y * sine, x * sine, cosine], axis=1),
    ]
    return np.stack(rows, axis=1)
