"""Where a hand probably grasps, from its geometry: how far it opens, its pads, its grasp frame and its width."""

import numpy as np

from graspbox._common.rotations import euler_from_rotation
from graspbox.hand_tools.bodies import Floats
from graspbox.hand_tools.closing import Closing, Fingers, follow, middle
from graspbox.hand_tools.tables import Frame
from graspbox.hands.geometry import box_corners

__all__ = ["PALM", "approach_of", "axes_of", "directions_of", "frame_with", "guess_pads", "with_raised_fingers"]

#: The chain of the palm's shapes among pads.
PALM = -1
#: Words in the names of shapes that touch objects, the clearest first.
_PAD_WORDS = ("pad", "rubber", "fingertip")
#: Directions within this angle of an axis of the base are along it, radians.
_SNAP = np.radians(20.0)
#: A palm is flat if it is thinner than this share of its middle side. Fingers curl over it if they move along its
#: normal by the second share of their way, and close along x if they move along it by the third.
_FLAT, _CURLS, _ACROSS = 0.85, 0.3, 0.5
#: Shapes of the palm within this distance of the nearest are below the grasp centre too, and shapes of the palm within
#: this distance of a closed finger are a fixed jaw, metres.
_BESIDE = 5e-3
#: Room between an object and the open fingers, on both sides together, metres; smaller openings are not stated.
_ROOM, _LEAST_WIDTH = 2e-3, 5e-3
#: Least distance of the grasp centre from the palm, metres.
_LEAST_DEPTH = 5e-3
#: A finger whose limits let its tip go below its root by the first number, metres, opens only until its tip has risen
#: by the second share of its greatest height.
_BELOW, _RISEN = 5e-3, 0.7
#: Range of an object's centre between a fixed jaw and an open one, as a share of the opening.
_PLACES = 0.7


def guess_pads(fingers: Fingers, closing: Closing) -> dict[str, int]:
    """Guess the shapes that are pads, and the chain of each: those whose names say so, else all of every fingertip.

    A jaw that does not move belongs to them: the shapes of the palm that a single finger meets.
    """
    shapes = list(zip(fingers.shape_names, fingers.bodies.tolist(), strict=True))
    fixed = {fingers.shape_names[index]: PALM for index in _fixed_jaw(fingers, closing)}
    moving = {name: int(fingers.chain_of[body]) for name, body in shapes if body >= 0}
    for word in _PAD_WORDS:
        named = {name: chain for name, chain in moving.items() if word in name.lower()}
        named = {name: chain for name, chain in named.items() if chain in fingers.tips}
        if set(named.values()) == set(fingers.tips):
            return named | fixed
    tips = {row: chain for chain, row in fingers.tips.items()}
    return {name: tips[body] for name, body in shapes if body in tips} | fixed


def _fixed_jaw(fingers: Fingers, closing: Closing) -> list[int]:
    """Return the shapes of the palm that the only finger meets."""
    if len(fingers.tips) != 1 or not len(closing.facing):
        return []
    near = fingers.pair_gaps(closing.meets, closing.facing)
    return sorted({int(j) for (_, j), gap in zip(closing.facing, near, strict=True) if gap < near.min() + _BESIDE})


def _pad_corners(fingers: Fingers, pads: dict[str, int], positions: Floats) -> dict[int, Floats]:
    """Return the corners (n, 3) of the pads of each chain, base frame; of its whole tip where it has none."""
    corners = {chain: fingers.corners(positions, body) for chain, body in fingers.tips.items()}
    poses, halves = fingers.boxes(positions)
    for chain in {*corners, *pads.values()}:
        own = [index for index, name in enumerate(fingers.shape_names) if pads.get(name) == chain]
        if own:
            corners[chain] = box_corners(poses[own], halves[own])
    return corners


def with_raised_fingers(fingers: Fingers, closing: Closing, z: Floats) -> Closing:
    """Open fingers less whose limits let them go below the palm: until their tips have risen enough along z (3,)."""
    shares = np.linspace(0.0, 1.0, 41)
    path = [closing.opened + share * (closing.closed - closing.opened) for share in shares]
    roots = fingers.hand.joint_frames(fingers.neutral)[0][:, :3, 3] @ z
    first = [float(roots[int(np.flatnonzero(fingers.chain_of == chain)[0])]) for chain in fingers.tips]
    heights = np.array([fingers.tip_centers(positions) @ z - first for positions in path])
    starts: dict[int, float] = {}
    for chain, height in zip(fingers.tips, heights.T, strict=True):
        risen = np.flatnonzero(height >= _RISEN * height.max())
        if height[0] < -_BELOW and height.max() > 0.0:
            starts[chain] = float(shares[int(risen[0])])
    if not starts:
        return closing
    chains = [int(chain) for chain in fingers.hand.joint_chains]
    share = np.array([starts.get(chain, 0.0) for chain in chains])
    opened = closing.opened + share * (closing.closed - closing.opened)
    return follow(fingers, opened, closing.closed, closing.closes)


def _snapped(direction: Floats) -> Floats:
    """Return a direction, or the axis of the base that is close to it."""
    unit = direction / max(float(np.linalg.norm(direction)), 1e-12)
    index = int(np.abs(unit).argmax())
    if abs(float(unit[index])) < np.cos(_SNAP):
        return unit
    axis = np.zeros(3)
    axis[index] = np.sign(unit[index])
    return axis


def approach_of(fingers: Fingers, closing: Closing) -> Floats:
    """Guess the direction out of the palm, base frame (3,).

    It points from the palm to the fingertips of the half-closed hand; those of the open hand may lie beside the palm.
    Where fingers curl over one face of a flat palm, as those of a human hand do, it is the normal of this face.
    """
    opened, half = fingers.tip_centers(closing.opened), fingers.tip_centers(closing.half)
    palm = fingers.corners(fingers.neutral, -1)
    if len(palm):
        net, moved = (half - opened).mean(axis=0), float(np.linalg.norm(half - opened, axis=1).mean())
        sides = np.ptp(palm, axis=0)
        thin = int(sides.argmin())
        along = abs(float(net[thin]))
        flat = sides[thin] < _FLAT * float(np.sort(sides)[1])
        if flat and along > _CURLS * moved and along > float(np.linalg.norm(net)) / 2:
            return np.asarray(np.sign(net[thin]) * np.eye(3)[thin])
    out = half.mean(axis=0) - fingers.palm_center
    return _snapped(out) if float(np.linalg.norm(out)) > 1e-6 else np.array([0.0, 0.0, 1.0])


def directions_of(fingers: Fingers, closing: Closing) -> list[Floats]:
    """Return other possible directions (3,) out of the palm: its normal, to the fingertips, and between both."""
    half = fingers.tip_centers(closing.half)
    out, net = half.mean(axis=0) - fingers.palm_center, (half - fingers.tip_centers(closing.opened)).mean(axis=0)
    sides = np.ptp(fingers.corners(fingers.neutral, -1), axis=0) if (fingers.bodies == -1).any() else np.ones(3)
    thin = int(sides.argmin())
    normal = (1.0 if net[thin] >= 0.0 else -1.0) * np.eye(3)[thin]
    length = float(np.linalg.norm(out))
    if length < 1e-6:
        return [normal]
    between = [_snapped(normal + out / length)] if float(normal @ out) > 0.0 else []
    return [normal, _snapped(out), *between]


def _along_the_jaw(fingers: Fingers, closing: Closing, way: Floats) -> Floats:
    """Guess the direction out of the palm of a hand with one finger, base frame (3,): across its motion, to its tip."""
    frames, _, revolute = fingers.hand.joint_frames(closing.meets)
    rows = [row for row in range(len(frames)) if revolute[row]]
    palm = [i for i in np.flatnonzero(fingers.bodies == -1) if i not in _fixed_jaw(fingers, closing)]
    poses, halves = fingers.boxes(closing.meets)
    root = frames[rows[-1], :3, 3] if rows else fingers.palm_center
    if not rows and palm:
        root = middle(box_corners(poses[palm], halves[palm]))
    out = fingers.tip_centers(closing.meets)[0] - root
    if rows:  # The plane of the motion, beside which the hinge may be.
        axis = frames[rows[-1], :3, 0]
        out = out - (out @ axis) * axis
    return np.asarray(out - (out @ way) * way)


def axes_of(fingers: Fingers, closing: Closing, z: Floats) -> Floats:
    """Guess the axes of the grasp frame in the base, columns (3, 3), from the direction out of the palm, z (3,)."""
    ways = fingers.tip_centers(closing.meets) - fingers.tip_centers(closing.opened)
    if len(ways) == 1 and float(np.linalg.norm(ways)) > 1e-6:
        out = _along_the_jaw(fingers, closing, ways[0] / float(np.linalg.norm(ways)))
        z = _snapped(out) if float(np.linalg.norm(out)) > 1e-6 else z
    ways = ways - np.outer(ways @ z, z)
    x = _snapped(np.linalg.eigh(ways.T @ ways)[1][:, -1])
    x = x - (x @ z) * z
    if float(np.linalg.norm(x)) < 1e-3:
        x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= float(np.linalg.norm(x))
    if x[int(np.abs(x).argmax())] < 0:
        x = -x
    return np.stack([x, np.cross(z, x), z], axis=1)


def _palm_height(fingers: Fingers, axes: Floats, meeting: Floats, pads: dict[str, int]) -> float | None:
    """Return the height along z of the palm below a point: the top of its nearest shapes; None without any."""
    jaw = [pads.get(name) == PALM for name in fingers.shape_names]
    palm = (fingers.bodies == -1) & ~np.array(jaw, dtype=bool)
    if not palm.any():
        return None
    poses, halves = (values[palm] for values in fingers.boxes(fingers.neutral))
    reach = np.einsum("nij,nj->ni", np.abs(axes.T @ poses[:, :3, :3]), halves)
    centers = poses[:, :3, 3] @ axes
    outside = np.linalg.norm(np.maximum(np.abs(meeting @ axes - centers) - reach, 0.0)[:, :2], axis=1)
    return float((centers + reach)[outside <= outside.min() + _BESIDE, 2].max())


def _width(fingers: Fingers, closing: Closing, pads: dict[str, int], x: Floats) -> float | None:
    """Return the distance between the nearest surfaces of open pads that close along x from both sides, less some room.

    That of a hand with one finger is the way of its pad.
    """
    ways = fingers.tip_centers(closing.meets) - fingers.tip_centers(closing.opened)
    facing = ways @ x / np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
    if len(ways) == 1:
        width = float(np.linalg.norm(ways)) - _ROOM
        return width if PALM in pads.values() and width > _LEAST_WIDTH else None
    if not (facing > _ACROSS).any() or not (facing < -_ACROSS).any() or (np.abs(facing) <= _ACROSS).any():
        return None
    chains = np.array([pads.get(name, PALM) for name in fingers.shape_names])
    sides = dict(zip(fingers.tips, np.sign(facing), strict=True)) | {PALM: 0.0}
    side = np.array([sides[int(chain)] for chain in chains])
    pairs = np.argwhere((side[:, None] > 0.0) & (side[None] < 0.0))
    if not len(pairs):
        return None
    width = float(fingers.pair_gaps(closing.opened, pairs).min()) - _ROOM
    return width if width > _LEAST_WIDTH else None


def frame_with(
    fingers: Fingers, closing: Closing, pads: dict[str, int], axes: Floats, shift: Floats | None = None
) -> Frame:
    """Return the grasp frame with given axes, columns (3, 3), base frame.

    The grasp centre is where the fingertips meet, moved by `shift` (3,) along the axes, metres. Between a fixed jaw and
    an open one it is in the middle.
    """
    x, y, z = axes.T
    corners = _pad_corners(fingers, pads, closing.meets)
    meeting = np.mean([middle(each) for each in corners.values()], axis=0)
    places = None
    if PALM in corners:
        way = fingers.tip_centers(closing.opened)[0] - fingers.tip_centers(closing.meets)[0]
        meeting = meeting + way / 2
        half = _PLACES * float(np.linalg.norm(way)) / 2
        places = (-half, half)
    if shift is not None:
        meeting = meeting + axes @ shift
    palm = _palm_height(fingers, axes, meeting, pads)
    roots = fingers.hand.joint_frames(closing.opened)[0][:, :3, 3]
    height = min(float((roots @ z).min()) if palm is None else palm, float(meeting @ z) - _LEAST_DEPTH)
    (rpy,) = euler_from_rotation(axes[None])
    return Frame(
        xyz=x * float(meeting @ x) + y * float(meeting @ y) + z * height,
        rpy=rpy,
        center=np.array([0.0, 0.0, float(meeting @ z) - height]),
        width=_width(fingers, closing, pads, x),
        on_palm=palm is not None,
        places=places,
    )
