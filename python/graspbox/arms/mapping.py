"""Where an arm reaches things on the table around its base, and where its base stands best for a workspace."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox._common.by_value import ByValue
from graspbox._common.rotations import rotation_about, upright_pose
from graspbox.arms.loading import ArmLike, load_arm
from graspbox.arms.reaching import reachable
from graspbox.configs import ReachConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand

__all__ = ["BasePlace", "ReachMap", "reach_map"]

#: Most poses of one map, and most cells of a workspace.
_MOST_POSES, _MOST_CELLS = 4_000_000, 10_000
#: How much farther than the flange a hand may reach, metres: the map ends there.
_HAND = 0.2
#: Directions of a base that are compared, and its least distance from the workspace, metres.
_YAWS, _BESIDE = 24, 0.15


class BasePlace(NamedTuple):
    """Where an upright base stands, in the frame of the workspace.

    Attributes
    ----------
    x, y, height : float
        Metres; the table is at 0.
    yaw : float
        Turn about the vertical, radians.
    share, least : float
        Share of the typical grasps that are reached, over the workspace and at its worst position.
    """

    x: float
    y: float
    height: float
    yaw: float
    share: float
    least: float

    @property
    def pose(self) -> NDArray[np.float64]:
        """Return ``table_from_base``, (4, 4)."""
        return upright_pose((self.x, self.y, self.height), self.yaw)


@dataclass(frozen=True, eq=False)
class ReachMap(ByValue):
    """Which share of typical grasps an arm reaches, by where the thing stands relative to its base.

    Attributes
    ----------
    arm, hand : str
        Their names.
    x, y : (c,) and (r,) float64
        Positions of the thing on the table, metres, along the axes of the base's frame: x is to the front.
    height : float
        Height of the base over the table, metres.
    share : (r, c) float64
        Share of the grasps that are reached, each turned about the vertical by several angles, from 0 to 1.
    above, side : (r, c) float64
        The same of those from above and of those from the side; NaN if there are none.
    grasps : int
        Number of grasps per position, turned ones included.
    """

    arm: str
    hand: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    height: float
    share: NDArray[np.float64]
    above: NDArray[np.float64]
    side: NDArray[np.float64]
    grasps: int

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the share at positions (..., 2) in the base's frame, metres: 0 beyond the map."""
        places = floats(points, "points")
        step = self.x[1] - self.x[0]
        columns = (places[..., 0] - self.x[0]) / step
        rows = (places[..., 1] - self.y[0]) / step
        padded = np.pad(self.share, 1)
        found = np.zeros(places.shape[:-1])
        for right in (0, 1):
            for up in (0, 1):
                column, row = np.floor(columns).astype(np.int64) + right, np.floor(rows).astype(np.int64) + up
                weight = np.clip(1 - np.abs(columns - column), 0, 1) * np.clip(1 - np.abs(rows - row), 0, 1)
                inside = np.clip(column + 1, 0, len(self.x) + 1), np.clip(row + 1, 0, len(self.y) + 1)
                found += weight * padded[inside[1], inside[0]]
        return found

    def best_base(self, low: ArrayLike, high: ArrayLike, *, beside: float = _BESIDE) -> BasePlace:
        """Find where the base reaches the most in a rectangle of the table.

        Parameters
        ----------
        low, high : (2,) array_like
            Corners of the workspace, metres.
        beside : float
            Least distance of the base's frame from it, metres.

        Raises
        ------
        ConfigError
            If the rectangle is empty or too large, or nothing in it is reached from anywhere.
        """
        corners = np.stack([floats(low, "low"), floats(high, "high")])
        if corners.shape != (2, 2) or not (corners[0] < corners[1]).all():
            raise ConfigError(
                f"the workspace is from {low!r} to {high!r}; pass x and y of the lower, then the upper corner"
            )
        step, (least, most) = float(self.x[1] - self.x[0]), corners
        counts = np.ceil((most - least) / step).astype(np.int64) + 1
        if counts.prod() > _MOST_CELLS:
            raise ConfigError(
                f"the workspace is {most - least} m large; pass at most {_MOST_CELLS} cells of {step:g} m"
            )
        axes = [np.linspace(least[i], most[i], counts[i]) for i in range(2)]
        cells = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        reach = self.x[-1]
        places = [np.arange(least[i] - reach, most[i] + reach + step / 2, step).round(9) + 0.0 for i in range(2)]
        bases = np.stack(np.meshgrid(*places), axis=-1).reshape(-1, 2)
        away = np.maximum(np.maximum(least - bases, bases - most), 0.0)
        bases = bases[np.linalg.norm(away, axis=1) >= beside - 1e-9]
        best = BasePlace(0.0, 0.0, self.height, 0.0, 0.0, 0.0)
        for yaw in 2 * np.pi * np.arange(_YAWS) / _YAWS - np.pi:
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            shares = self.at((cells[None] - bases[:, None]) @ turn)
            means = shares.mean(axis=1)
            first = int(means.argmax())
            if means[first] > best.share:
                x, y = bases[first].tolist()
                best = BasePlace(x, y, self.height, float(yaw), float(means[first]), float(shares[first].min()))
        if not best.share:
            raise ConfigError(f"the arm {self.arm} reaches nothing in the workspace from any place of its base")
        return best

    def to_json(self) -> dict[str, Any]:
        """Return plain values, None instead of NaN."""
        shares = {name: getattr(self, name) for name in ("share", "above", "side")}
        return {
            "arm": self.arm,
            "hand": self.hand,
            "height": self.height,
            "grasps": self.grasps,
            "x": self.x.tolist(),
            "y": self.y.tolist(),
            **{name: None if np.isnan(rows).any() else rows.tolist() for name, rows in shares.items()},
        }


def reach_map(
    arm: ArmLike,
    hand: HandLike,
    poses: ArrayLike,
    preshape: ArrayLike,
    *,
    spacing: float = 0.05,
    turns: int = 4,
    height: float = 0.0,
    mount: ArrayLike | None = None,
    seed: int = 0,
    config: ReachConfig = ReachConfig(solutions=1),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> ReachMap:
    """Map which share of typical grasps an arm reaches, by where the thing stands.

    Only arm, hand and table are in the way, not the things themselves.

    Parameters
    ----------
    arm, hand
        As of `reachable`.
    poses, preshape : (n, 4, 4) and (n,) array_like
        Grasps of things on the table's origin, such as those of `graspbox.planning.typical_grasps`.
    spacing : float
        Distance between positions, metres.
    turns : int
        Angles about the vertical by which each grasp is turned, evenly apart; the first is random.
    height : float
        Height of the base over the table, metres; the base is upright.
    mount, config, num_threads
        As of `reachable`.
    seed : int
        Seed of the angles.

    Raises
    ------
    ArmError, ConfigError
        As `reachable`; also without grasps, and for more than 4 million poses.
    """
    loaded, held = load_arm(arm), load_hand(hand)
    grasps, shapes = floats(poses, "poses"), floats(preshape, "preshape")
    if grasps.ndim != 3 or grasps.shape[1:] != (4, 4) or len(grasps) != len(shapes) or not len(shapes):
        raise ConfigError(f"poses have shape {grasps.shape}, preshapes {shapes.shape}; pass (n, 4, 4) and (n,), n > 0")
    if not (0.0 < spacing <= 0.5 and 1 <= turns <= 360):
        raise ConfigError(f"spacing is {spacing}, turns is {turns}; pass 0 to 0.5 m, and 1 to 360 turns")
    half = int(np.ceil((loaded.reach_length + _HAND) / spacing))
    count = (2 * half + 1) ** 2 * turns * len(grasps)
    if count > _MOST_POSES:
        raise ConfigError(f"a map of {count} poses is too large, {_MOST_POSES} are the most; pass a greater spacing")
    places = floats(spacing * np.arange(-half, half + 1), "places")
    angles = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(grasps))[:, None]
    angles = angles + 2 * np.pi * np.arange(turns) / turns
    turned = np.tile(np.eye(4), (len(grasps), turns, 1, 1))
    turned[..., :3, :3] = rotation_about([0.0, 0.0, 1.0], angles)
    around = (turned @ grasps[:, None]).reshape(-1, 4, 4)
    base, reached = np.eye(4), []
    base[2, 3] = height
    for y in places:
        row = np.tile(around, (len(places), 1, 1, 1))
        row[..., 0, 3] += places[:, None]
        row[..., 1, 3] += y
        all_shapes = np.tile(np.repeat(shapes, turns), len(places))
        flat = row.reshape(-1, 4, 4)
        found = reachable(loaded, held, flat, all_shapes, base, mount=mount, config=config, num_threads=num_threads)
        reached.append(found.reached.reshape(len(places), len(around)))
    from_above = np.repeat(-grasps[:, 2, 2] > np.sqrt(0.5), turns)
    shares = np.stack(reached)
    return ReachMap(
        loaded.name,
        held.name,
        places,
        places,
        height,
        shares.mean(axis=2),
        _mean(shares[..., from_above]),
        _mean(shares[..., ~from_above]),
        len(around),
    )


def _mean(reached: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the share along the last axis; NaN where there is none."""
    return np.asarray(reached.mean(axis=2) if reached.shape[2] else np.full(reached.shape[:2], np.nan))
