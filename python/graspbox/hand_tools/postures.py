"""The numbers that a search changes: how a hand opens, what closes, how the thumb opposes, and where it grasps."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from graspbox._common.rotations import rotation_from_euler
from graspbox.errors import HandError
from graspbox.hand_tools.bodies import Floats
from graspbox.hand_tools.closing import Closing, follow
from graspbox.hand_tools.frames import axes_of, directions_of, frame_with
from graspbox.hand_tools.guessing import Guess
from graspbox.hand_tools.tables import Frame
from graspbox.hands import Hand, symmetries_of
from graspbox.hands.description import independent

__all__ = ["Posture", "Postures"]

#: Joints are alike if their ranges differ by less than the first share, and the lengths from them to the fingertips by
#: less than the second factor.
_RANGE, _LENGTH = 0.02, 1.5
#: A joint closes from this number on, and turns against the guess below its negative.
_CLOSES = 1 / 3
#: Units of the turns of the grasp frame about its x, y and z axes (rad), and of the shift of its centre (m).
_TURN, _SHIFT = 0.3, 0.02
#: Openings of the first postures, as shares of the ranges of the joints.
_OPENINGS = (0.0, 0.25, 0.5)
#: Width of the widest thing as a share of the length of fingers.
_HELD = 0.7
#: Bend of the outer joints of fingers that close at their roots alone, as a share of the range.
_BENT = 0.15
#: Random first postures: greatest opening, share of joints that close as guessed, and that do not close and stay.
_WIDE, _KEPT = 0.7, 0.8
#: Numbers of the frame: turns about x, y, z and shifts along x, y, z; and those that each mirror of the hand fixes.
_FRAME = 6
_FIXED = {(1.0, -1.0, 1.0): (0, 2, 4), (-1.0, 1.0, 1.0): (1, 2, 3), (-1.0, -1.0, 1.0): (0, 1, 3, 4)}


@dataclass(frozen=True, eq=False)
class Posture:
    """A point of the search: which direction the palm faces, a number of `Postures.axes`, and its numbers (d,)."""

    facing: int
    point: Floats


class Postures:
    """All postures of a guessed hand, as points of numbers of order one.

    The numbers are, for each group of joints that are alike (those of parallel fingers): the mean opening, as a share
    of the range from the guessed open end on, which moves all alike; whether it closes: 1 as guessed, 0 not, -1 in the
    other direction. Then the turns and shifts of the grasp frame that no mirror of the hand forbids.
    """

    def __init__(self, guess: Guess) -> None:
        self.guess, self._fingers = guess, guess.fingers
        closing = guess.closing
        limits = self._fingers.limits
        # Joints that do not close and mirror each other, as spreading ones may, are counted from their mirrored ends.
        ends = np.abs(limits[:, 1]) >= np.abs(limits[:, 0])
        self._rises = np.where(closing.closes, closing.closed >= closing.opened, ends)
        starts = np.where(self._rises, limits[:, 0], limits[:, 1])
        #: Opening of each joint in the guess, as a share of its range.
        self._shares = np.abs(closing.opened - starts) / (limits[:, 1] - limits[:, 0])
        self.groups = self._alike()
        ways = directions_of(self._fingers, closing)
        self.axes = [guess.axes, *(axes_of(self._fingers, closing, way) for way in ways)]
        self.axes = [each for i, each in enumerate(self.axes) if not any(np.allclose(each, b) for b in self.axes[:i])]

    def _alike(self) -> list[list[int]]:
        """Group independent joints by their place in the chain, their range and their distance from the fingertip."""
        fingers, links = self._fingers, independent(self._fingers.described.links)
        frames, _, _ = fingers.hand.joint_frames(fingers.neutral)
        tips = dict(zip(fingers.tips, fingers.tip_centers(fingers.neutral), strict=True))
        chains = [int(chain) for chain in fingers.hand.joint_chains]
        keys: list[tuple[int, str, bool, float, float]] = []
        for joint, (link, chain) in enumerate(zip(links, chains, strict=True)):
            root = frames[fingers.body_of(link), :3, 3]
            length = float(np.linalg.norm(tips[chain] - root)) if chain in tips else 0.0
            low, high = fingers.limits[joint]
            keys.append(
                (chains[joint:].count(chain), link.kind, bool(self.guess.closing.closes[joint]), high - low, length)
            )
        groups: list[list[int]] = []
        for joint, key in enumerate(keys):
            for group in groups:
                other = keys[group[0]]
                near = abs(key[3] - other[3]) <= _RANGE * other[3]
                lengths = sorted((key[4], other[4]))
                if key[:3] == other[:3] and near and lengths[1] <= _LENGTH * lengths[0] + 1e-6:
                    group.append(joint)
                    break
            else:
                groups.append([joint])
        return groups

    @cached_property
    def free(self) -> list[int]:
        """Numbers of the frame that vary."""
        hand = Hand(self.guess.fitted.text, self.guess.write().text)
        fixed = {number for mirror in symmetries_of(hand) for number in _FIXED[mirror]}
        return [number for number in range(_FRAME) if number not in fixed]

    @property
    def size(self) -> int:
        """Count of the numbers of a point."""
        return 2 * len(self.groups) + len(self.free)

    def guessed(self) -> Posture:
        """Return the posture of the guess."""
        opening = [float(np.mean(self._shares[group])) for group in self.groups]
        closes = [float(self.guess.closing.closes[group[0]]) for group in self.groups]
        return Posture(0, np.array([*opening, *closes, *([0.0] * len(self.free))]))

    def opening(self) -> float:
        """Return how wide the hand opens, metres: the widest of the first postures, from limit to limit.

        Many fingers hold things as wide as most of their length, even if two of them are side by side. A single one,
        whose root is near the fixed jaw, holds things as wide as its tip moves.
        """
        count = len(self.groups)
        widest = self._fingers.length * _HELD if len(self._fingers.tips) > 2 else 0.0
        for opening in (*_OPENINGS, None):
            point = self.guessed().point
            if opening is not None:
                point[:count] = np.where(point[count : 2 * count] > 0, opening, point[:count])
            closing = self.closing_of(Posture(0, point))
            if len(closing.facing):
                widest = max(widest, self._gap(closing))
        return widest

    def _gap(self, closing: Closing) -> float:
        """Return the least gap between open fingers that face each other, metres; of a single one how far it moves."""
        if len(self._fingers.tips) > 1:
            return float(self._fingers.pair_gaps(closing.opened, closing.facing).min())
        before, after = (self._fingers.tip_centers(each)[0] for each in (closing.opened, closing.meets))
        return float(np.linalg.norm(after - before))

    def first(self, rng: np.random.Generator) -> Iterator[Posture]:
        """Give postures to begin with: the guess, variants of it, then random ones without end."""
        guessed, count = self.guessed(), len(self.groups)
        yield guessed
        closing = guessed.point[count : 2 * count] > 0
        outer = self._outer()
        facings = range(len(self.axes))
        for opening, at_roots, facing in product(_OPENINGS, (False, True), facings):
            point = guessed.point.copy()
            point[:count] = np.where(closing, np.maximum(point[:count], opening), point[:count])
            if at_roots:
                point[count : 2 * count] *= ~outer
                point[:count] = np.where(outer & closing, guessed.point[:count] + _BENT, point[:count])
            if (opening, at_roots, facing) != (0.0, False, 0) and (outer.any() or not at_roots):
                yield Posture(facing, point)
        while True:
            point = guessed.point.copy()
            moved = closing | (rng.random(count) > 0.5)
            point[:count] = np.where(moved, rng.random(count) * np.where(closing, _WIDE, 1.0), point[:count])
            other = rng.random(count) > _KEPT
            point[count : 2 * count] = np.where(other, rng.integers(-1, 2, count), point[count : 2 * count])
            if at_roots := bool(rng.random() < 0.5):
                point[count : 2 * count] *= ~outer
            point[2 * count :] = rng.normal(size=len(self.free)) / 2
            yield Posture(int(rng.integers(len(self.axes))), point)

    def _outer(self) -> NDArray[np.bool_]:
        """Return the groups that close and are not the first of their fingers to do so."""
        chains = [int(chain) for chain in self._fingers.hand.joint_chains]
        closes = self.guess.closing.closes
        first = {chain: min(j for j, c in enumerate(chains) if c == chain and closes[j])
                 for chain in {c for j, c in enumerate(chains) if closes[j]}}  # fmt: skip
        roots = set(first.values())
        return np.array([bool(closes[group[0]]) and not roots & set(group) for group in self.groups])

    def closing_of(self, posture: Posture) -> Closing:
        """Return how the hand closes in a posture."""
        count, limits = len(self.groups), self._fingers.limits
        opened, closed = self.guess.closing.opened.copy(), self.guess.closing.opened.copy()
        closes = np.zeros(len(opened), dtype=bool)
        for number, group in enumerate(self.groups):
            wider, way = posture.point[number] - np.mean(self._shares[group]), float(posture.point[count + number])
            for joint in group:
                low, high = limits[joint] if self._rises[joint] else limits[joint][::-1]
                share = float(np.clip(self._shares[joint] + wider, 0.0, 1.0))
                opened[joint] = closed[joint] = low + share * (high - low)
                if abs(way) >= _CLOSES:
                    closed[joint] = high if way > 0 else low
                    closes[joint] = abs(closed[joint] - opened[joint]) > 1e-3 * abs(high - low)
        return follow(self._fingers, opened, closed, closes)

    def frame_of(self, posture: Posture, closing: Closing) -> Frame:
        """Return the grasp frame of a posture."""
        numbers = np.zeros(_FRAME)
        numbers[self.free] = posture.point[2 * len(self.groups) :]
        turned = self.axes[posture.facing] @ rotation_from_euler(_TURN * np.clip(numbers[None, :3], -3.0, 3.0))[0]
        shift = _SHIFT * np.clip(numbers[3:], -5.0, 5.0)
        return frame_with(self._fingers, closing, self.guess.pads, turned, shift)

    def text(self, posture: Posture, found: str) -> tuple[str, tuple[str, ...]]:
        """Return the ``hand.toml`` of a posture, and what to review of it; `found` is its source."""
        closing = self.closing_of(posture)
        if not closing.closes.any():
            raise HandError("no joint closes the hand")
        return self.guess.text(closing, self.frame_of(posture, closing), found)

    def hand(self, posture: Posture) -> Hand:
        """Make the hand of a posture."""
        return Hand(self.guess.fitted.text, self.text(posture, "search")[0])
