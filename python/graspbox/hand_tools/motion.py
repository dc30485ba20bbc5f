"""The closing motion: shapes that overlap, fingers that meet, reach, width and symmetries."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graspbox.hand_tools.boxes import gaps
from graspbox.hand_tools.findings import CheckedHand, Finding, Severity
from graspbox.hands import asymmetries_of, reach_of, symmetries_of

__all__ = ["closing_gaps", "extent", "meeting", "overlaps", "pads"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Shares of the closing motion that are looked at.
_SHARES = tuple(np.linspace(0.0, 1.0, 21).tolist())
#: Depth from which an overlap counts, metres.
_DEPTH = 1e-3
#: Fingers that come closer than this meet, metres.
_MEET = 0.01
#: Change of a distance that counts as a motion, metres.
_MOVED = 2e-3
_MIRRORS = {(1.0, -1.0, 1.0): "mirror y = 0", (-1.0, 1.0, 1.0): "mirror x = 0", (-1.0, -1.0, 1.0): "half turn about z"}


def _pairs(checked: CheckedHand) -> Ints:
    """Return pairs (n, 2) of shapes on bodies that are no neighbours; bodies without shapes count as joints."""
    shaped = {-1, *checked.bodies.tolist()}

    def parent(row: int) -> int:
        above = checked.tree.parent_body(row)
        while above not in shaped:
            above = checked.tree.parent_body(above)
        return above

    above = {row: parent(row) for row in shaped if row >= 0}
    bodies = checked.bodies.tolist()
    found = [
        (i, j)
        for i, j in combinations(range(len(bodies)), 2)
        if bodies[i] != bodies[j] and above.get(bodies[i]) != bodies[j] and above.get(bodies[j]) != bodies[i]
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _gaps_at(checked: CheckedHand, preshape: float, share: float, pairs: Ints) -> Floats:
    shapes, halves, _, _ = checked.hand.shapes(checked.hand.closed(preshape, share))
    first, second = pairs.T
    return gaps(shapes[first], halves[first], shapes[second], halves[second])


def overlaps(checked: CheckedHand) -> Iterator[Finding]:
    """Find shapes that run into each other, per pair of chains and preshape at the first share at which any two do."""
    pairs = _pairs(checked)
    if not len(pairs):
        return
    groups = np.sort(checked.chains[pairs], axis=1)
    facing = checked.pads[pairs].all(axis=1) & (groups[:, 0] != groups[:, 1])
    seen: set[tuple[str, str, bool]] = set()
    for name, preshape in checked.preshapes:
        motion = np.stack([_gaps_at(checked, preshape, share, pairs) for share in _SHARES])
        for group in np.unique(groups, axis=0):
            own = np.flatnonzero((groups == group).all(axis=1))
            deep = motion[:, own] < -_DEPTH
            if not deep.any():
                continue
            step = int(np.flatnonzero(deep.any(axis=1))[0])
            pair = int(own[motion[step, own].argmin()])
            # A finger whose pad has met that of a third one is stopped as well.
            involved = facing & np.isin(groups, group).any(axis=1)
            apart = float(motion[: step + 1, involved].min()) if involved.any() else np.inf
            finding = _overlap(checked, pairs[pair], name, step, float(-motion[:, pair].min()), apart)
            key = (finding.subject, finding.severity, step == 0)
            if key not in seen:
                seen.add(key)
                yield finding


def _overlap(checked: CheckedHand, pair: Ints, preshape: str, step: int, deepest: float, apart: float) -> Finding:
    """Describe the first overlap of two chains, or of a chain and the palm.

    `apart` is the least distance of their pads from those of other chains until then, metres.
    """
    i, j = pair.tolist()
    first, second = checked.shape_names[i], checked.shape_names[j]
    share = _SHARES[step]
    where = f"preshape {preshape!r}, {'open' if share == 0 else f'{share:.0%} closed'}"
    value = f"{deepest * 1e3:.1f} mm at most"
    chains = checked.chains[[i, j]]
    severity: Severity = "warning"
    if chains[0] == chains[1]:
        severity, message = "note", "links of one chain overlap; the simulation lets them, a real finger may not"
        remedy = "check limits and mimic ratios if the picture shows it, else shrink the boxes"
    elif step > 0 and checked.pads[[i, j]].all():
        severity, message, remedy = "note", "pads touch as the empty hand closes", ""
    elif step > 0 and (chains < 0).any():
        severity, message, remedy = "note", "a finger closes onto the palm", ""
    elif step > 0 and apart < _MEET:
        severity, message, remedy = "note", "fingers touch as the empty hand closes, where their pads meet", ""
    elif step == 0:
        message = "they overlap in the open hand, so the simulation starts by pushing them apart"
        remedy = "shrink or move one of the shapes, or correct the origin of a joint"
    else:
        distance = f"with the pads {apart * 1e3:.0f} mm apart" if np.isfinite(apart) else "before any pad"
        message = f"bare shapes meet {distance}, so the fingers stop there and cannot close further"
        remedy = "shrink the shapes, correct limits, or name the shape in `pads` if it should touch objects"
    return Finding(severity, "self-collision", f"{first} and {second}", value, f"{where}: {message}", remedy)


def _finger_pairs(checked: CheckedHand) -> tuple[Ints, bool]:
    """Return pairs of shapes that could hold an object: pads of different chains, all shapes of a chain without pads.

    Where there is one chain, its shapes face those of the palm; the flag says so.
    """
    padded = {int(chain) for chain in checked.chains[checked.pads] if chain >= 0}
    front = checked.pads | ~np.isin(checked.chains, list(padded))
    alone = len(set(checked.chains[checked.chains >= 0].tolist())) < 2
    shapes = [i for i in range(len(checked.chains)) if front[i] or checked.chains[i] < 0]
    found = [
        (i, j)
        for i, j in combinations(shapes, 2)
        if checked.chains[i] != checked.chains[j] and (alone or min(checked.chains[i], checked.chains[j]) >= 0)
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2), alone


def closing_gaps(checked: CheckedHand, preshape: float) -> Floats:
    """Return the least distance (s,) between fingers along the closing motion, metres; empty without fingers."""
    pairs, _ = _finger_pairs(checked)
    if not len(pairs):
        return np.zeros(0)
    return np.array([_gaps_at(checked, preshape, share, pairs).min() for share in _SHARES])


def meeting(checked: CheckedHand) -> Iterator[Finding]:
    """Find hands whose fingers do not meet, or move apart as they close."""
    pairs, alone = _finger_pairs(checked)
    if not len(pairs):
        yield Finding(
            "error",
            "closing",
            "collision shapes",
            "",
            "no two chains have collision shapes, so there is nothing to hold an object between",
            "give the fingers collision shapes, and check that joints move them",
        )
        return
    motions = [
        np.stack([_gaps_at(checked, preshape, share, pairs) for share in _SHARES]) for _, preshape in checked.preshapes
    ]
    nearest = min(float(motion.min()) for motion in motions)
    fingers = "finger and palm" if alone else "fingers"
    if nearest > _MEET:
        yield Finding(
            "warning",
            "closing",
            fingers,
            f"{nearest * 1e3:.1f} mm",
            "they come no closer than this when the hand is closed, so thin objects fall through",
            "check the limits of the joints and which actuators `closing` names",
        )
    if all(
        (motion[-1] > motion[0] + _MOVED).any() and (motion.min(axis=0) > motion[0] - _MOVED).all()
        for motion in motions
    ):
        yield Finding(
            "error",
            "closing",
            fingers,
            f"{min(float((m[-1] - m[0]).max()) for m in motions) * 1e3:.1f} mm",
            "they move apart as the hand closes: an actuator's position must be smallest when the hand is open",
            "change the sign of `ratio` of the actuators, and set `offset` to the limit of the open hand",
        )


def pads(checked: CheckedHand) -> Iterator[Finding]:
    """Find chains that close without pads."""
    for index, name in enumerate(checked.hand.chains):
        own = checked.chains == index
        if not own.any():
            yield Finding(
                "warning",
                "pads",
                f"chain {name}",
                "",
                "it has no collision shapes, so it passes through objects",
                "give its links collision shapes, or make its joints fixed",
            )
        elif not checked.pads[own].any():
            yield Finding(
                "warning",
                "pads",
                f"chain {name}",
                "",
                "none of its shapes is a pad, so it touches objects with the low friction of `bare`",
                "name the shapes that touch objects in `pads`",
            )


def extent(checked: CheckedHand) -> Iterator[Finding]:
    """State reach, width and symmetries; find a reach of nothing and a palm frame that faces backwards."""
    for name, preshape in checked.preshapes:
        reach = reach_of(checked.hand, preshape)
        subject = f"preshape {name}"
        if reach <= 0:
            yield Finding(
                "error",
                "reach",
                subject,
                f"{reach * 1e3:.1f} mm",
                "no finger reaches beyond the palm along z of the grasp frame, so the hand faces away from objects",
                "correct `xyz` and `rpy` of `[grasp]`: z points out of the palm",
            )
        else:
            message = "how far the fingers reach from the palm, along z of the grasp frame"
            yield Finding("note", "reach", subject, f"{reach * 1e3:.1f} mm", message)
    yield from _width(checked)
    found = [_MIRRORS[signs] for signs in symmetries_of(checked.hand)]
    if found:
        message = "trainings use them to show every grasp in several ways"
    else:
        signs, distance = min(asymmetries_of(checked.hand).items(), key=lambda item: item[1])
        message = (
            f"none, which is fine for a human-like hand; the {_MIRRORS[signs]} moves shapes by {distance * 1e3:.1f} mm"
        )
    yield Finding("note", "symmetry", "grasp frame", ", ".join(found) or "none", message)


def _width(checked: CheckedHand) -> Iterator[Finding]:
    widest = checked.hand.widest
    if np.isinf(widest):
        yield Finding(
            "note",
            "width",
            "preshapes",
            "not stated",
            "no `width` says which objects fit between the open fingers; the planner relies on collisions alone",
            "for a gripper, give `width` of each of `[[grasp.preshapes]]`: the opening less 1 mm on both sides",
        )
        return
    span = max(
        (float(g[0]) for g in (closing_gaps(checked, value) for _, value in checked.preshapes) if len(g)), default=0.0
    )
    if len(checked.hand.chains) == 2 and widest > span + _DEPTH:
        yield Finding(
            "warning",
            "width",
            "preshapes",
            f"{widest * 1e3:.1f} mm",
            f"`width` exceeds the {span * 1e3:.1f} mm between the open pads: the planner tries objects that cannot fit",
            "give the opening less 1 mm on both sides",
        )
    else:
        yield Finding(
            "note",
            "width",
            "preshapes",
            f"{widest * 1e3:.1f} mm",
            "the widest object that fits between the open fingers",
        )
