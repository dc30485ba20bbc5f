"""A first ``hand.toml`` for a URDF: joints, actuators, pads and grasp frame, guessed from its geometry."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from graspbox._common.files import read_bounded
from graspbox._common.rotations import euler_from_rotation
from graspbox.errors import HandError
from graspbox.hand_tools import tables
from graspbox.hand_tools.bodies import Floats, inertia_of
from graspbox.hand_tools.closing import Closing, Fingers, guess_closing, middle
from graspbox.hand_tools.tables import Drive, Frame
from graspbox.hands import Hand, fitted_urdf
from graspbox.hands.description import describe_urdf, independent, passing_links
from graspbox.hands.geometry import box_corners
from graspbox.hands.urdf_meshes import LARGEST

__all__ = ["GuessedHand", "guess_hand"]

#: Greatest number of actuators, as in the core.
_MOST = 32
#: Words in the names of shapes that touch objects, the clearest first.
_PAD_WORDS = ("pad", "rubber", "fingertip")
#: Directions within this angle of an axis of the base are along it, radians.
_SNAP = np.radians(20.0)
#: A palm is flat if it is thinner than this share of its middle side. Fingers curl over it if they move along its
#: normal by the second share of their way, and close along x if they move along it by the third.
_FLAT, _CURLS, _ACROSS = 0.85, 0.3, 0.5
#: Shapes of the palm within this distance of the nearest are below the grasp centre too, metres.
_BESIDE = 5e-3
#: Room between an object and the open fingers, on both sides together, metres; smaller openings are not stated.
_ROOM, _LEAST_WIDTH = 2e-3, 5e-3
#: Least distance of the grasp centre from the palm, metres.
_LEAST_DEPTH = 5e-3
#: Force at a fingertip where the URDF has no effort or a placeholder, and the range that is believed, N.
_FORCE, _BELIEVED = 30.0, (0.5, 300.0)
#: Least range of a joint, rad or m, and least speed that is believed, rad/s or m/s.
_LEAST_RANGE, _LEAST_SPEED = 1e-5, 1e-3
#: Least lever of a joint, for one that moves no fingertip, metres.
_LEAST_LEVER = 0.01


@dataclass(frozen=True)
class GuessedHand:
    """A first ``hand.toml``.

    Attributes
    ----------
    name : str
        Name of the hand.
    text : str
        Contents of the file, which loads with the URDF.
    review : tuple of str
        Guesses to review, the most doubtful first; the file begins with them.
    """

    name: str
    text: str
    review: tuple[str, ...]


def guess_hand(
    urdf: str | os.PathLike[str], name: str | None = None, no_contact: Sequence[Sequence[str]] = ()
) -> GuessedHand:
    """Guess a ``hand.toml`` for a URDF.

    Every number states its source; those that begin with "guess" come from geometry or experience. Tendons are not
    guessed: every independent joint gets a servo of its own, also where one motor of the real hand bends several.

    Parameters
    ----------
    urdf : str or PathLike
        The URDF.
    name : str, optional
        Name of the hand; by default that of the file.
    no_contact : sequence of sequences of str
        Lists of links and colliders that do not touch each other, such as `FittedUrdf.no_contact`.

    Raises
    ------
    FileError
        If the file cannot be read.
    HandError
        If the URDF describes no hand; the message lists every wrong line.
    """
    path = Path(urdf)
    read_bounded(path, LARGEST)  # raises if it cannot be read
    fitted = fitted_urdf(path)
    names = (fitted.name, "hand.toml")
    links = describe_urdf(fitted.text, names[0])
    joints = independent(links)
    if not joints:
        raise HandError(f"{path} has no joint that moves by itself; a hand needs revolute or prismatic joints")
    if len(joints) > _MOST:
        raise HandError(
            f"{path} has {len(joints)} independent joints, and a hand has at most {_MOST} actuators: let joints that "
            "one motor moves follow each other (`mimic`)"
        )
    for joint in joints:
        if joint.limits[1] - joint.limits[0] < _LEAST_RANGE:
            raise HandError(
                f"{path}: joint {joint.joint!r} has the limits {list(joint.limits)}; widen them, or make it fixed"
            )
    fingers = Fingers(Hand(fitted.text, tables.minimal(links), names))
    if not fingers.tips:
        raise HandError(f"{path}: no link that a joint moves has a collision shape; a hand touches objects with them")
    closing = guess_closing(fingers)
    pads = _pads(fingers)
    frame = _frame(fingers, closing, pads)
    drives = tuple(_drive(fingers, closing, index) for index in range(len(joints)))
    chosen = (path.stem if name is None else name).encode(errors="replace").decode()
    review = _review(fingers, closing, drives, frame)
    text = tables.write(chosen, path.name, tuple(pads), drives, frame, review, no_contact)
    if passing := passing_links(Hand(fitted.text, text, names)):
        review += (f"links that overlap in the open hand, and pass through each other: {', '.join(passing)}",)
        text = tables.write(chosen, path.name, tuple(pads), drives, frame, review, no_contact)
    return GuessedHand(chosen, text, review)


def _pads(fingers: Fingers) -> dict[str, int]:
    """Guess the shapes that are pads, and the chain of each: those whose names say so, else all of every fingertip."""
    shapes = list(zip(fingers.shape_names, fingers.bodies.tolist(), strict=True))
    moving = {name: int(fingers.chain_of[body]) for name, body in shapes if body >= 0}
    for word in _PAD_WORDS:
        named = {name: chain for name, chain in moving.items() if word in name.lower()}
        if set(named.values()) == set(fingers.tips):
            return named
    tips = {row: chain for chain, row in fingers.tips.items()}
    return {name: tips[body] for name, body in shapes if body in tips}


def _pad_corners(fingers: Fingers, pads: dict[str, int], positions: Floats) -> dict[int, Floats]:
    """Return the corners (n, 3) of the pads of each chain, base frame; of its whole tip where it has none."""
    corners = {chain: fingers.corners(positions, body) for chain, body in fingers.tips.items()}
    poses, halves = fingers.boxes(positions)
    for chain in corners:
        own = [index for index, name in enumerate(fingers.shape_names) if pads.get(name) == chain]
        if own:
            corners[chain] = box_corners(poses[own], halves[own])
    return corners


def _snapped(direction: Floats) -> Floats:
    """Return a direction, or the axis of the base that is close to it."""
    unit = direction / max(float(np.linalg.norm(direction)), 1e-12)
    index = int(np.abs(unit).argmax())
    if abs(float(unit[index])) < np.cos(_SNAP):
        return unit
    axis = np.zeros(3)
    axis[index] = np.sign(unit[index])
    return axis


def _approach(fingers: Fingers, closing: Closing) -> Floats:
    """Guess the direction out of the palm, base frame (3,).

    It points from the palm to the fingertips of the half-closed hand; those of the open hand may lie beside the palm.
    Where fingers curl over one face of a flat palm, as those of a human hand do, it is the normal of this face.
    """
    opened, half = fingers.tip_centers(closing.opened), fingers.tip_centers((closing.opened + closing.closed) / 2)
    palm = fingers.corners(fingers.neutral, -1)
    if len(palm):
        net, moved = (half - opened).mean(axis=0), float(np.linalg.norm(half - opened, axis=1).mean())
        sides = np.ptp(palm, axis=0)
        thin = int(sides.argmin())
        along = abs(float(net[thin]))
        flat = sides[thin] < _FLAT * float(np.sort(sides)[1])
        if flat and along > _CURLS * moved and along > float(np.linalg.norm(net)) / 2:
            normal = np.zeros(3)
            normal[thin] = np.sign(net[thin])
            return normal
    out = half.mean(axis=0) - fingers.palm_center
    return _snapped(out) if float(np.linalg.norm(out)) > 1e-6 else np.array([0.0, 0.0, 1.0])


def _axes(fingers: Fingers, closing: Closing) -> Floats:
    """Guess the axes of the grasp frame in the base: columns (3, 3)."""
    z = _approach(fingers, closing)
    ways = fingers.tip_centers(closing.meets) - fingers.tip_centers(closing.opened)
    ways = ways - np.outer(ways @ z, z)
    x = _snapped(np.linalg.eigh(ways.T @ ways)[1][:, -1])
    x = x - (x @ z) * z
    if float(np.linalg.norm(x)) < 1e-3:
        x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= float(np.linalg.norm(x))
    if x[int(np.abs(x).argmax())] < 0:
        x = -x
    return np.stack([x, np.cross(z, x), z], axis=1)


def _palm_height(fingers: Fingers, axes: Floats, meeting: Floats) -> float | None:
    """Return the height along z of the palm below a point: the top of its nearest shapes; None without any."""
    palm = fingers.bodies == -1
    if not palm.any():
        return None
    poses, halves = (values[palm] for values in fingers.boxes(fingers.neutral))
    reach = np.einsum("nij,nj->ni", np.abs(axes.T @ poses[:, :3, :3]), halves)
    centers = poses[:, :3, 3] @ axes
    outside = np.linalg.norm(np.maximum(np.abs(meeting @ axes - centers) - reach, 0.0)[:, :2], axis=1)
    return float((centers + reach)[outside <= outside.min() + _BESIDE, 2].max())


def _width(fingers: Fingers, closing: Closing, pads: dict[str, int], x: Floats) -> float | None:
    """Return the distance along x between the pads of fingers that close along it from both sides, less some room."""
    ways = fingers.tip_centers(closing.meets) - fingers.tip_centers(closing.opened)
    facing = ways @ x / np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
    spans = [c @ x for c in _pad_corners(fingers, pads, closing.opened).values()]
    left = [float(span.max()) for span, cosine in zip(spans, facing, strict=True) if cosine > _ACROSS]
    right = [float(span.min()) for span, cosine in zip(spans, facing, strict=True) if cosine < -_ACROSS]
    if not left or not right or len(left) + len(right) < len(spans):
        return None
    width = min(right) - max(left) - _ROOM
    return width if width > _LEAST_WIDTH else None


def _frame(fingers: Fingers, closing: Closing, pads: dict[str, int]) -> Frame:
    axes = _axes(fingers, closing)
    x, y, z = axes.T
    meeting = np.mean([middle(corners) for corners in _pad_corners(fingers, pads, closing.meets).values()], axis=0)
    palm = _palm_height(fingers, axes, meeting)
    roots = fingers.hand.joint_frames(closing.opened)[0][:, :3, 3]
    height = min(float((roots @ z).min()) if palm is None else palm, float(meeting @ z) - _LEAST_DEPTH)
    (rpy,) = euler_from_rotation(axes[None])
    return Frame(
        xyz=x * float(meeting @ x) + y * float(meeting @ y) + z * height,
        rpy=rpy,
        center=np.array([0.0, 0.0, float(meeting @ z) - height]),
        width=_width(fingers, closing, pads, x),
        on_palm=palm is not None,
    )


def _drive(fingers: Fingers, closing: Closing, index: int) -> Drive:
    """Guess the servo of an independent joint."""
    joint = independent(fingers.described.links)[index]
    low, high = (float(limit) for limit in fingers.limits[index])
    closes = bool(closing.closes[index])
    rising = not closes or bool(closing.closed[index] > closing.opened[index])
    step = np.zeros(len(fingers.limits))
    step[index] = 1e-3 * (high - low)
    half_closed = (closing.opened + closing.closed) / 2
    moved = fingers.tip_centers(half_closed + step) - fingers.tip_centers(half_closed - step)
    # A joint that others follow shares its force among the fingers that it moves.
    lever = max(float(np.linalg.norm(moved, axis=1).sum()) / (2 * float(step[index])), _LEAST_LEVER)
    force = joint.effort / lever
    stated = _BELIEVED[0] <= force <= _BELIEVED[1]
    return Drive(
        link=joint,
        limits=(low, high),
        closes=closes,
        ratio=1.0 if rising else -1.0,
        offset=low if rising else high,
        neutral=float(fingers.neutral[index]) - low,
        load=joint.effort if stated else _FORCE * lever,
        load_stated=stated,
        speed=joint.velocity if joint.velocity >= _LEAST_SPEED else None,
        inertia=inertia_of(fingers.hand, index, half_closed),
    )


def _review(fingers: Fingers, closing: Closing, drives: tuple[Drive, ...], frame: Frame) -> tuple[str, ...]:
    """List the guesses to review."""
    review = [
        "[grasp] xyz, rpy: z must point out of the palm, towards objects, and x along the closing fingers",
        "offset and ratio of each servo: position 0 is the open hand, and the position increases as it closes",
    ]
    side = [drive.link.joint for drive in drives if not drive.closes]
    if side:
        review.append(f"joints that seem to spread or turn fingers, and do not close: {', '.join(side)}")
    chains = [int(fingers.chain_of[fingers.body_of(drive.link)]) for drive in drives if drive.closes]
    if len(chains) > len(set(chains)):
        review.append(
            "fingers with several joints: no tendon can be guessed, so each joint has its own servo; if one "
            "motor bends a finger, replace them by a spool and a table in [tendons], or let joints follow (`mimic`)"
        )
    if frame.width is None:
        review.append(
            "the fingers do not face each other: no width is stated; add one to [[grasp.preshapes]] of a gripper"
        )
    unknown = [drive.link.joint for drive in drives if not drive.load_stated]
    if unknown:
        joints = "" if len(unknown) == len(drives) else f" of {', '.join(unknown)}"
        review.append(f"load_limit{joints}: the URDF states no believable effort; take it from the data sheet")
    pads = "pads: the shapes that touch objects and are rubber"
    return *review, pads, "friction, damping, armature, stop_stiffness: numbers of experience"
