"""How a hand probably closes, from its URDF only: fingertips, and which end of each joint is the closed one."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graspbox.hand_tools.bodies import Floats, HandBodies, Ints
from graspbox.hands import Hand
from graspbox.hands.description import Link, independent

__all__ = ["Closing", "Fingers", "follow", "guess_closing", "middle"]

#: Weight of the distance to the palm relative to that between fingertips: it decides for one finger and parallel ones.
_PALM = 0.5
#: A joint closes the hand if it brings fingertips together by this share of the distance that it moves them.
_CLOSES = 0.15
#: Joints of three and more fingers close them if they bring tips to the palm by this share too: others spread fingers,
#: or turn a thumb.
_BENDS = 0.35
#: A joint goes one way from 0 if 0 is this near to the end of its range; shares of the range that are tried, and the
#: least gain of opposition, of at most 1.
_END, _TURNS, _BETTER = 0.2, (0.25, 0.5, 0.75, 1.0), 0.1
#: Joints bend a finger together if the cosine of their axes is above the first; fingers face below the second.
_ALONG, _FACING = 0.9, 0.5
#: Shares of the closing motion at which closeness is measured.
_LOOKS = (0.5, 1.0)
#: Shares at which fingers are followed until they meet.
_SHARES = np.linspace(0.0, 1.0, 41)
#: Distance of fingertips that meet, metres.
_TOUCH = 1e-3
#: Shapes that are nearer when the hand is open pass beside each other, and those that come closer by less do, metres.
_BESIDE, _NEARER = 3e-3, 2e-3
#: Most rounds in which directions are reconsidered.
_ROUNDS = 8


def middle(points: Floats) -> Floats:
    """Return the centre (3,) of the box around points (n, 3)."""
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


class Fingers(HandBodies):
    """Fingertips of a hand whose grasp frame is that of its base.

    Attributes
    ----------
    neutral : (c,) float64
        Positions of the independent joints nearest to 0, rad or m.
    tips : dict of int to int
        The rigid body at the tip of each finger, by its chain: the one that gets farthest from the chain's root. Chains
        without collision shapes, and the bars of a finger that is a linkage, are no fingers.
    length : float
        Greatest distance of a fingertip from the root of its chain, metres.
    """

    def __init__(self, hand: Hand) -> None:
        super().__init__(hand)
        self.neutral = np.clip(np.zeros(len(self.limits)), self.limits[:, 0], self.limits[:, 1])
        self.tips: dict[int, int] = {}
        farthest: dict[int, float] = {}
        for positions in (self.neutral, *self.limits.T, self.limits.mean(axis=1)):
            roots = hand.joint_frames(np.ascontiguousarray(positions))[0]
            for body in sorted({int(body) for body in self.bodies if body >= 0}):
                chain = int(self.chain_of[body])
                root = roots[int(np.flatnonzero(self.chain_of == chain)[0]), :3, 3]
                away = float(np.linalg.norm(self.corners(positions, body) - root, axis=1).max())
                if away > farthest.get(chain, -1.0) + 1e-6:
                    self.tips[chain], farthest[chain] = body, away
        bars = {chain for chain in self.tips if self._is_bar(chain, farthest)}
        self.length = max(farthest.values(), default=0.0)
        self.tips = {chain: body for chain, body in sorted(self.tips.items()) if chain not in bars}
        self._between = self._tip_pairs()

    def _is_bar(self, chain: int, reach: dict[int, float]) -> bool:
        """Whether a chain is the bar of a linkage: it moves with a longer chain, and always stays beside it."""
        longer = [other for other in self.tips if reach[other] > reach[chain]]
        return any(self.is_pinned(chain, other) for other in longer)

    def _tip_pairs(self) -> Ints:
        """Return the pairs (n, 2) of shapes of two fingertips, or of one and the palm; none for more fingers."""
        own = [np.flatnonzero(self.bodies == body) for body in self.tips.values()]
        if len(own) == 1:
            own.append(np.flatnonzero(self.bodies == -1))
        pairs = [(i, j) for i in own[0] for j in own[1]] if len(own) == 2 else []
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    def apart(self, positions: Floats) -> float:
        """Return the mean distance of the fingertips from each other, metres.

        Of two it is that of their surfaces: the centres of long shapes, such as rails, pass each other as they close.
        """
        if len(self._between):
            return float(np.maximum(self.pair_gaps(positions, self._between), 0.0).mean())
        tips = [float(np.linalg.norm(a - b)) for a, b in combinations(self.tip_centers(positions), 2)]
        return float(np.mean(tips)) if tips else 0.0

    def body_of(self, link: Link) -> int:
        """Return the rigid body that a link's joint moves."""
        return self.described.moving.index(link)

    def tip_centers(self, positions: Floats) -> Floats:
        """Return the centres (k, 3) of the fingertips, base frame."""
        return np.array([middle(self.corners(positions, body)) for body in self.tips.values()]).reshape(-1, 3)

    @property
    def palm_center(self) -> Floats:
        """Centre (3,) of the palm's shapes, else the base's origin."""
        corners = self.corners(self.neutral, -1)
        return middle(corners) if len(corners) else np.zeros(3)

    def facing(self, opened: Floats, closed: Floats) -> Ints:
        """Return the pairs (n, 2) of shapes between which the closing hand holds an object.

        They are those of fingertips that move towards each other, of all fingertips if none do, and of a single finger
        and the palm; of these, the pairs that come closer as the hand closes, if there are any.
        """
        own = [np.flatnonzero(self.bodies == body) for body in self.tips.values()]
        ways = self.tip_centers(closed) - self.tip_centers(opened)
        ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
        every = list(combinations(range(len(own)), 2))
        opposed = [(a, b) for a, b in every if float(ways[a] @ ways[b]) < _FACING] or every
        chosen = [(own[a], own[b]) for a, b in opposed]
        if len(own) == 1:
            chosen = [(own[0], np.flatnonzero(self.bodies == -1))]
        listed = [(i, j) for first, second in chosen for i in first for j in second]
        pairs = np.array(listed, dtype=np.int64).reshape(-1, 2)
        if not len(pairs):
            return pairs
        before = self.pair_gaps(opened, pairs)
        path = (opened + share * (closed - opened) for share in (0.5, 0.75, 1.0))
        after = np.min([self.pair_gaps(positions, pairs) for positions in path], axis=0)
        nearing = (before > _BESIDE) & (after < before - _NEARER)
        return pairs[nearing] if nearing.any() or len(own) == 1 else pairs

    def palm_gap(self, positions: Floats) -> float:
        """Return the least distance of a fingertip from the palm, metres; infinity without shapes of the palm."""
        pairs = np.argwhere(np.isin(self.bodies, list(self.tips.values()))[:, None] & (self.bodies == -1)[None])
        return float(self.pair_gaps(positions, pairs).min()) if len(pairs) else float("inf")


@dataclass(frozen=True)
class Closing:
    """A guess of how a hand closes; positions of the independent joints (c,), rad or m.

    Attributes
    ----------
    opened, closed : (c,) float64
        The open hand, and the hand closed as far as it goes; joints that do not close stay.
    closes : (c,) bool
        Which joints close the hand; the others spread fingers or turn them.
    meets : (c,) float64
        Where fingertips meet first, or are closest.
    half : (c,) float64
        Half of the way to where the hand is closed, or to where a fingertip meets the palm.
    facing : (n, 2) int64
        Pairs of shapes that hold an object between them.
    """

    opened: Floats
    closed: Floats
    closes: NDArray[np.bool_]
    meets: Floats
    half: Floats
    facing: Ints


def guess_closing(fingers: Fingers) -> Closing:
    """Guess the closed end of every joint: that at which all fingertips are closest to each other and to the palm.

    Directions are changed one at a time while this brings fingertips closer, from two first guesses: every joint closes
    away from 0, and the opposite.
    """
    count = len(fingers.limits)
    away = np.abs(fingers.limits[:, 1]) >= np.abs(fingers.limits[:, 0])
    best, _ = min((_descend(fingers, start) for start in (away, ~away)), key=lambda result: result[1])
    gains = [_gain(fingers, best, joint) for joint in range(count)]
    closes = np.array([gain > _CLOSES and lift > _BENDS for gain, lift in gains], dtype=bool)
    if not closes.any():
        closes = np.array([gain > _CLOSES for gain, _ in gains], dtype=bool)
    if not closes.any():
        closes[:] = True
    _bend_along(fingers, best, closes)
    opened, closed = _ends(fingers, best)
    return _opposed(
        fingers,
        follow(fingers, np.where(closes, opened, fingers.neutral), np.where(closes, closed, fingers.neutral), closes),
    )


def _opposed(fingers: Fingers, closing: Closing) -> Closing:
    """Turn the joints that do not close, but go one way from 0 only, so that fingertips meet from opposite sides.

    So does a thumb that comes round before the palm. Other joints spread fingers, and stay.
    """
    low, high = fingers.limits.T
    one_way = ~closing.closes & (
        (fingers.neutral - low < _END * (high - low)) | (high - fingers.neutral < _END * (high - low))
    )
    for joint in np.flatnonzero(one_way) if len(fingers.tips) > 2 else ():
        others = []
        for share in _TURNS:
            opened, closed = closing.opened.copy(), closing.closed.copy()
            opened[joint] = closed[joint] = low[joint] + share * (high[joint] - low[joint])
            others.append(follow(fingers, opened, closed, closing.closes))
        scores = [_opposition(fingers, other) for other in others]
        if max(scores) > _opposition(fingers, closing) + _BETTER:
            closing = others[int(np.argmax(scores))]
    return closing


def _opposition(fingers: Fingers, closing: Closing) -> float:
    """Say how well fingertips meet: each opposite another one, and near each other; at most 1."""
    if not len(closing.facing):
        return -np.inf
    ways = fingers.tip_centers(closing.meets) - fingers.tip_centers(closing.opened)
    units = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    apart = max(float(fingers.pair_gaps(closing.meets, closing.facing).min()), 0.0)
    return float((1.0 - units @ units.T).max(axis=1).mean()) / 2 - apart / max(fingers.length, 1e-6)


def follow(fingers: Fingers, opened: Floats, closed: Floats, closes: NDArray[np.bool_]) -> Closing:
    """Follow the fingers from the open hand to the closed one, positions (c,); `closes` (c,) are joints that move."""
    path = [opened + share * (closed - opened) for share in _SHARES]
    facing = fingers.facing(opened, closed)
    at = len(path) // 2
    if len(facing):
        spans = np.array([fingers.pair_gaps(positions, facing).min() for positions in path])
        touching = 1 + np.flatnonzero(spans[1:] < _TOUCH)
        at = int(touching[0]) if len(touching) else int(spans.argmin())
    lifts = np.array([fingers.palm_gap(positions) for positions in path])
    inside = np.flatnonzero(lifts < min(float(lifts[0]), 0.0) - _TOUCH)
    last = int(inside[0]) if len(inside) else len(path) - 1
    return Closing(opened, closed, closes, path[at], path[last // 2], facing)


def _bend_along(fingers: Fingers, upper: NDArray[np.bool_], closes: NDArray[np.bool_]) -> None:
    """Add the joints that bend a finger about the axis of one that closes it, in the same direction."""
    frames, chains, revolute = fingers.hand.joint_frames(fingers.neutral)
    rows = [fingers.body_of(link) for link in independent(fingers.described.links)]
    for joint, row in enumerate(rows):
        for other in np.flatnonzero(closes) if not closes[joint] and revolute[row] else ():
            cosine = float(frames[row, :3, 0] @ frames[rows[other], :3, 0])
            if revolute[rows[other]] and chains[row] == chains[rows[other]] and abs(cosine) > _ALONG:
                upper[joint] = upper[other] == (cosine > 0)
                closes[joint] = True
                break


def _ends(fingers: Fingers, upper: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    low, high = fingers.limits.T
    return np.where(upper, low, high), np.where(upper, high, low)


def _spread(fingers: Fingers, positions: Floats) -> float:
    """Return the distances of the fingertips from each other and from the palm, weighted, metres."""
    tips = fingers.tip_centers(positions)
    if not len(tips):
        return 0.0
    lift = np.linalg.norm(tips - fingers.palm_center, axis=1)
    return fingers.apart(positions) + _PALM * float(lift.mean())


def _closeness(fingers: Fingers, upper: NDArray[np.bool_]) -> float:
    opened, closed = _ends(fingers, upper)
    return sum(_spread(fingers, opened + share * (closed - opened)) for share in _LOOKS)


def _descend(fingers: Fingers, start: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], float]:
    upper, value = start.copy(), _closeness(fingers, start)
    for _ in range(_ROUNDS):
        before = value
        for joint in range(len(upper)):
            upper[joint] = ~upper[joint]
            changed = _closeness(fingers, upper)
            if changed < value - 1e-9:
                value = changed
            else:
                upper[joint] = ~upper[joint]
        if value == before:
            break
    return upper, value


def _gain(fingers: Fingers, upper: NDArray[np.bool_], joint: int) -> tuple[float, float]:
    """Return the shares of a joint's motion that bring fingertips together, and to the palm.

    The other joints are half closed. Of two fingers the second share is not asked for: it is 1.
    """
    opened, closed = _ends(fingers, upper)
    middle = (opened + closed) / 2
    first, last = middle.copy(), middle.copy()
    first[joint], last[joint] = opened[joint], closed[joint]
    before, after = fingers.tip_centers(first), fingers.tip_centers(last)
    moved = float(np.linalg.norm(after - before, axis=1).sum())
    if moved < 1e-6:
        return 0.0, 0.0
    gain = len(after) * (_spread(fingers, first) - _spread(fingers, last)) / moved
    far, near = (float(np.linalg.norm(tips - fingers.palm_center, axis=1).sum()) for tips in (before, after))
    return gain, (far - near) / moved if len(after) > 2 else 1.0
