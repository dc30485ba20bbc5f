"""The closing motion, also in simulation: shapes that overlap, fingers that meet, reach, width and symmetries."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from graspbox import object_sets
from graspbox.configs import TrialConfig
from graspbox.errors import SimulationError
from graspbox.hand_tools.bodies import Floats, Ints
from graspbox.hand_tools.boxes import gaps
from graspbox.hand_tools.findings import CheckedHand, Finding, Severity
from graspbox.hands import asymmetries_of, reach_of, symmetries_of
from graspbox.hands.description import passing_links
from graspbox.simulation import Scene

__all__ = ["emptied", "extent", "meeting", "open_width", "overlaps", "pads"]

#: Shares of the closing motion at which distances are measured.
_SHARES = tuple(np.linspace(0.0, 1.0, 21).tolist())
#: Depth from which an overlap counts, metres.
_DEPTH = 1e-3
#: Fingers that come closer than this meet, metres.
_MEET = 0.01
#: Change of a distance that counts as a motion, metres.
_MOVED = 2e-3
#: A joint has gone all the way from the first share of its travel on, and is stuck below the second. Shapes of a hand
#: that stands still press on each other if they are closer than this, metres. Speed of a joint that moves, its
#: travel per second.
_WHOLE, _STUCK, _PRESSED, _MOVES = 0.95, 0.1, 1.5e-3, 0.02
#: An object that is far below the hand, its scale, and the height of the hand, metres.
_FAR, _SCALE, _HEIGHT = "procedural:box:0", 0.3, 0.8
_MIRRORS = {(1.0, -1.0, 1.0): "mirror y = 0", (-1.0, 1.0, 1.0): "mirror x = 0", (-1.0, -1.0, 1.0): "half turn about z"}


def _pairs(checked: CheckedHand) -> Ints:
    """Return pairs (n, 2) of shapes that touch on bodies that are no neighbours; bodies without shapes are joints."""
    described, bodies, names = checked.described, checked.bodies.tolist(), checked.shape_names
    shaped = {-1, *bodies}

    def parent(body: int) -> int:
        above = described.carriers[described.moving[body].parent]
        return above if above in shaped else parent(above)

    adjacent = {frozenset((body, parent(body))) for body in shaped if body >= 0}
    pairs = [
        (i, j)
        for i, j in combinations(range(len(bodies)), 2)
        if bodies[i] != bodies[j]
        and frozenset((bodies[i], bodies[j])) not in adjacent
        and frozenset((names[i], names[j])) not in described.no_contact
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _distances(checked: CheckedHand, preshape: float, share: float, pairs: Ints) -> Floats:
    """Return the distances (n,) of pairs of shapes after a share of the closing motion, metres."""
    shapes, halves = checked.boxes(checked.hand.closed(preshape, share))
    first, second = pairs.T
    return gaps(shapes[first], halves[first], shapes[second], halves[second])


def _motion(checked: CheckedHand, preshape: float, pairs: Ints) -> Floats:
    """Return the distances (s, n) of pairs of shapes along the closing motion, metres."""
    return np.stack([_distances(checked, preshape, share, pairs) for share in _SHARES])


def overlaps(checked: CheckedHand) -> Iterator[Finding]:
    """Find shapes that run into each other, per pair of chains and preshape at the first share at which any two do."""
    for links in passing_links(checked.hand):
        message = "they overlap in the open hand, so the simulation lets them pass through each other"
        remedy = "shrink or move one of their shapes if they should stop each other"
        yield Finding("note", "self-collision", links, "", message, remedy)
    pairs = _pairs(checked)
    if not len(pairs):
        return
    groups = np.sort(checked.chains[pairs], axis=1)
    facing = checked.pads[pairs].all(axis=1) & (groups[:, 0] != groups[:, 1])
    seen: set[tuple[str, str]] = set()
    for name, preshape in checked.preshapes:
        motion = _motion(checked, preshape, pairs)
        for group in np.unique(groups, axis=0):
            own = np.flatnonzero((groups == group).all(axis=1))
            if group[0] != group[1]:
                # Shapes that overlap in the open hand pass through each other: these do so only by their boxes.
                own = own[motion[0, own] >= -_DEPTH]
            deep = motion[:, own] < -_DEPTH
            if not deep.any():
                continue
            step = int(np.flatnonzero(deep.any(axis=1))[0])
            pair = int(own[motion[step, own].argmin()])
            # A finger whose pad has met that of a third one is stopped as well.
            involved = facing & np.isin(groups, group).any(axis=1)
            apart = float(motion[: step + 1, involved].min()) if involved.any() else np.inf
            finding = _overlap(checked, pairs[pair], name, step, float(-motion[:, pair].min()), apart)
            key = (finding.subject, finding.severity)
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
    elif checked.pads[[i, j]].all():
        severity, message, remedy = "note", "pads touch as the empty hand closes", ""
    elif (chains < 0).any():
        severity, message, remedy = "note", "a finger closes onto the palm", ""
    elif apart < _MEET:
        severity, message, remedy = "note", "fingers touch as the empty hand closes, where their pads meet", ""
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
    front = checked.pads | ~np.isin(checked.chains, [*padded, *_bars(checked)])
    single = len(set(checked.chains[checked.chains >= 0].tolist())) < 2
    shapes = [i for i in range(len(checked.chains)) if front[i] or checked.chains[i] < 0]
    pairs = [
        (i, j)
        for i, j in combinations(shapes, 2)
        if checked.chains[i] != checked.chains[j] and (single or min(checked.chains[i], checked.chains[j]) >= 0)
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2), single


def _bars(checked: CheckedHand) -> set[int]:
    """Return the chains without pads that are bars of linkages."""
    padded = {int(chain) for chain in checked.chains[checked.pads] if chain >= 0}
    others = set(checked.chain_of.tolist()) - padded
    return {chain for chain in others if any(checked.is_pinned(chain, finger) for finger in padded)}


def open_width(checked: CheckedHand) -> float:
    """Return the greatest distance between the open fingers of any preshape, metres; 0 without fingers."""
    pairs, _ = _finger_pairs(checked)
    preshapes = checked.preshapes if len(pairs) else ()
    return max((float(_distances(checked, preshape, 0.0, pairs).min()) for _, preshape in preshapes), default=0.0)


def meeting(checked: CheckedHand) -> Iterator[Finding]:
    """Find hands whose fingers do not meet, or move apart as they close."""
    pairs, single = _finger_pairs(checked)
    if not len(pairs):
        message = "no two chains have collision shapes, so there is nothing to hold an object between"
        remedy = "add collision shapes to the fingers, and check that joints move them"
        yield Finding("error", "closing", "collision shapes", "", message, remedy)
        return
    motions = [_motion(checked, preshape, pairs) for _, preshape in checked.preshapes]
    nearest = min(float(motion.min()) for motion in motions)
    fingers = "finger and palm" if single else "fingers"
    if nearest > _MEET:
        message = "they come no closer than this when the hand is closed, so thin objects fall through"
        remedy = "check the limits of the joints and which actuators `closing` names"
        yield Finding("warning", "closing", fingers, f"{nearest * 1e3:.1f} mm", message, remedy)
    if all(
        (motion[-1] > motion[0] + _MOVED).any() and (motion.min(axis=0) > motion[0] - _MOVED).all()
        for motion in motions
    ):
        value = f"{min(float((m[-1] - m[0]).max()) for m in motions) * 1e3:.1f} mm"
        message = "they move apart as the hand closes: an actuator's position must be smallest when the hand is open"
        remedy = "change the sign of `ratio` of the actuators, and set `offset` to the limit of the open hand"
        yield Finding("error", "closing", fingers, value, message, remedy)


def pads(checked: CheckedHand) -> Iterator[Finding]:
    """Find chains that close without pads; the bars of a linkage need none."""
    bars = _bars(checked)
    for index, name in enumerate(checked.hand.chains):
        own = checked.chains == index
        if not own.any():
            message = "it has no collision shapes, so it passes through objects"
            remedy = "add collision shapes to its links, or make its joints fixed"
            yield Finding("warning", "pads", f"chain {name}", "", message, remedy)
        elif not checked.pads[own].any() and index not in bars:
            message = "none of its shapes is a pad, so it touches objects with the low friction of `bare`"
            remedy = "name the shapes that touch objects in `pads`"
            yield Finding("warning", "pads", f"chain {name}", "", message, remedy)


def extent(checked: CheckedHand) -> Iterator[Finding]:
    """Report reach, width and symmetries; find a reach of nothing and a palm frame that faces backwards."""
    for name, preshape in checked.preshapes:
        reach = reach_of(checked.hand, preshape)
        subject, value = f"preshape {name}", f"{reach * 1e3:.1f} mm"
        if reach <= 0:
            message = (
                "no finger reaches beyond the palm along z of the grasp frame, so the hand faces away from objects"
            )
            remedy = "correct `xyz` and `rpy` of `[grasp]`: z points out of the palm"
            yield Finding("error", "reach", subject, value, message, remedy)
        else:
            message = "how far the fingers reach from the palm, along z of the grasp frame"
            yield Finding("note", "reach", subject, value, message)
    yield from _width(checked)
    mirrors = [_MIRRORS[signs] for signs in symmetries_of(checked.hand)]
    if mirrors:
        message = "trainings use them to show every grasp in several ways"
    else:
        signs, distance = min(asymmetries_of(checked.hand).items(), key=lambda item: item[1])
        message = (
            f"none, which is fine for a human-like hand; the {_MIRRORS[signs]} moves shapes by {distance * 1e3:.1f} mm"
        )
    yield Finding("note", "symmetry", "grasp frame", ", ".join(mirrors) or "none", message)


def _width(checked: CheckedHand) -> Iterator[Finding]:
    widest = checked.hand.widest
    if np.isinf(widest):
        message = "no `width` says which objects fit between the open fingers; the planner relies only on collisions"
        remedy = "for a gripper, state `width` of each of `[[grasp.preshapes]]`: the opening less 1 mm on both sides"
        yield Finding("note", "width", "preshapes", "not stated", message, remedy)
        return
    span, value = open_width(checked), f"{widest * 1e3:.1f} mm"
    if len(checked.hand.chains) == 2 and widest > span + _DEPTH:
        message = (
            f"`width` exceeds the {span * 1e3:.1f} mm between the open pads: the planner tries objects that cannot fit"
        )
        yield Finding("warning", "width", "preshapes", value, message, "state the opening less 1 mm on both sides")
    else:
        message = "the widest object that fits between the open fingers"
        yield Finding("note", "width", "preshapes", value, message)


def emptied(checked: CheckedHand) -> Iterator[Finding]:
    """Simulate how the hand closes on nothing: how much of its travel each joint goes, and which shapes stop it."""
    for name, preshape in checked.preshapes:
        started, ended = checked.hand.open(preshape), checked.hand.closed(preshape, 1.0)
        try:
            joints = _closed_on_nothing(checked, preshape)
        except SimulationError as error:
            yield Finding("warning", "empty closing", f"preshape {name}", "", str(error), "read the error")
            continue
        travels = [j for j in range(len(ended)) if abs(ended[j] - started[j]) > 1e-6]
        shares = {j: float((joints[-1, j] - started[j]) / (ended[j] - started[j])) for j in travels}
        speeds = {j: abs(float((joints[-1, j] - joints[-11, j]) / (ended[j] - started[j]))) * 10.0 for j in travels}
        whole = [j for j in travels if shares[j] >= _WHOLE]
        message = "joints that close go all the way in simulation, with nothing in the hand"
        yield Finding("note", "empty closing", f"preshape {name}", f"{len(whole)} of {len(travels)}", message)
        for joint in travels:
            if joint not in whole:
                yield _stopped(checked, name, joint, shares[joint], speeds[joint], joints[-1])


def _closed_on_nothing(checked: CheckedHand, preshape: float) -> Floats:
    """Return the positions (t, c) of the independent joints as the hand closes high above the table."""
    scene = Scene(object_sets.load(_FAR, scale=_SCALE)[0].load(), hand=checked.hand)
    world_from_hand = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_hand[2, 3] = _HEIGHT
    pose = np.linalg.inv(scene.world_from_object) @ world_from_hand
    _, trace = scene.trace(pose, preshape, config=TrialConfig(legacy=True))
    if len(trace.time) < 11:
        raise SimulationError("the hand is too large to be simulated above the table")
    return trace.joints


def _stopped(checked: CheckedHand, preshape: str, joint: int, share: float, speed: float, positions: Floats) -> Finding:
    """Describe a joint that does not go all the way: the nearest pair of shapes, one of which it moves."""
    subject, value = f"preshape {preshape}, joint {checked.hand.joints[joint]}", f"{share:.0%} of its travel"
    if speed > _MOVES:
        message, remedy = "it still moves when the trial lifts", "raise `default_speed` of its actuator"
        return Finding("warning", "empty closing", subject, value, message, remedy)
    step = np.zeros(len(positions))
    step[joint] = 1e-3
    before, after = (checked.boxes(positions + each)[0] for each in (-step, step))
    moved = np.abs(after - before).max(axis=(1, 2)) > 1e-9
    pairs = _pairs(checked)
    pairs = pairs[moved[pairs[:, 0]] != moved[pairs[:, 1]]]
    poses, halves = checked.boxes(positions)
    near = gaps(poses[pairs[:, 0]], halves[pairs[:, 0]], poses[pairs[:, 1]], halves[pairs[:, 1]])
    message = "a spring, or another joint of its tendon, holds it"
    stuck = share < _STUCK
    if len(near) and near.min() < _PRESSED:
        first, second = (checked.shape_names[index] for index in pairs[int(near.argmin())].tolist())
        message = f"{first} and {second} meet there"
        facing = bool(checked.pads[pairs[int(near.argmin())]].all())
        stuck = stuck and not facing
    if not stuck:
        return Finding("note", "empty closing", subject, value, message)
    message += ", so it hardly closes"
    remedy = "shrink the shapes that block it, or raise `load_limit` if nothing does"
    return Finding("warning", "empty closing", subject, value, message, remedy)
