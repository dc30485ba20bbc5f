"""A first ``hand.toml`` for a URDF: joints, actuators, pads and grasp frame, guessed from its geometry."""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from graspbox._common.files import read_bounded
from graspbox.errors import HandError
from graspbox.hand_tools import tables
from graspbox.hand_tools.bodies import Floats, inertia_of
from graspbox.hand_tools.closing import Closing, Fingers, guess_closing
from graspbox.hand_tools.frames import approach_of, axes_of, frame_with, guess_pads, with_raised_fingers
from graspbox.hand_tools.palm import Cut, cut_above_palm, without_blank_lines
from graspbox.hand_tools.tables import Drive, Frame
from graspbox.hands import FittedUrdf, Hand
from graspbox.hands.description import Link, describe_urdf, independent, passing_links
from graspbox.hands.reading import is_mjcf, read_hand
from graspbox.hands.urdf_meshes import LARGEST, read_text

__all__ = ["Guess", "GuessedHand", "begin_guess", "guess_converted", "guess_hand"]

#: Greatest number of actuators, as in the core.
_MOST = 32
#: Force at a fingertip where the URDF has no effort or a placeholder, and the range that is believed, N: of jaws the
#: strongest that grasp (2F-85: 235 N), of hands with more fingers than two (3-Finger Gripper: 60 N; most 10 to 20 N).
_FORCE, _LEAST_FORCE, _JAW, _FINGER = 30.0, 0.5, 300.0, 60.0
#: Least range of a joint, rad or m, and least speed that is believed, rad/s or m/s.
_LEAST_RANGE, _LEAST_SPEED = 1e-5, 1e-3
#: Time in which a joint comes from the open hand to where the fingers meet at the speed of its motor, seconds; a trial
#: lifts soon after.
_IN_TIME = 1.2
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
    fitted : FittedUrdf
        The URDF with which it loads.
    urdf : str or None
        Contents of the URDF with which it loads, if that is not the given one: without what is above the palm.
    """

    name: str
    text: str
    review: tuple[str, ...]
    fitted: FittedUrdf
    urdf: str | None = None


@dataclass(frozen=True, eq=False)
class Guess:
    """What is guessed of a hand; `write` makes a ``hand.toml`` of it.

    Attributes
    ----------
    name, urdf : str
        Name of the hand, and that of its URDF.
    fitted : FittedUrdf
        The URDF of the hand alone, without collision meshes.
    cut : Cut or None
        What is above the palm in the URDF, if anything is.
    fingers, closing, pads
        Fingertips, how they close, and the pads with their chains.
    axes : (3, 3) float64
        Axes of the grasp frame in the base, columns.
    no_contact : tuple of tuple of str
        Lists of links and colliders that do not touch each other.
    passing : tuple of str
        Pairs of links that overlap in the open hand.
    alone : bool
        Whether the given file has more than the hand, which thus needs a URDF of its own.
    """

    name: str
    urdf: str
    fitted: FittedUrdf
    cut: Cut | None
    fingers: Fingers
    closing: Closing
    pads: dict[str, int]
    axes: Floats
    no_contact: tuple[tuple[str, ...], ...] = ()
    passing: tuple[str, ...] = ()
    alone: bool = False

    def write(self) -> GuessedHand:
        """Write the file of the guess."""
        return self.written(*self.text(self.closing, frame_with(self.fingers, self.closing, self.pads, self.axes)))

    def written(self, text: str, review: tuple[str, ...]) -> GuessedHand:
        """Return a file of this hand with the URDF that it needs."""
        alone = without_blank_lines(self.fitted.text) if self.alone else None
        return GuessedHand(self.name, text, review, self.fitted, alone)

    def text(self, closing: Closing, frame: Frame, found: str | None = None) -> tuple[str, tuple[str, ...]]:
        """Return the file of a hand that closes so and has this grasp frame, and what to review of it.

        `found` is the source of these, if they are no guess.
        """
        levers = _levers(self.fingers, closing)
        drives = tuple(_drive(self.fingers, closing, index, levers) for index in range(len(levers)))
        review = (*self._left_out, *_review(self.fingers, closing, drives, frame, found))
        if self.passing:
            review += (f"links that overlap in the open hand, and pass through each other: {', '.join(self.passing)}",)
        pads = tuple(self.pads)
        text = tables.write(self.name, self.urdf, pads, drives, frame, review, self.no_contact, found=found)
        return text, review

    @property
    def _left_out(self) -> tuple[str, ...]:
        """What of the URDF is not part of the hand."""
        if self.cut is None:
            return ()
        palm, links = self.cut.base, f"{self.cut.links} link{'s' if self.cut.links > 1 else ''}"
        return (
            *(f"joint {name} is above the palm, {palm}: it is no part of the hand" for name in self.cut.joints),
            f"{links} above the palm: left out of the hand's URDF; another palm: --base LINK",
        )


def guess_hand(
    urdf: str | os.PathLike[str],
    name: str | None = None,
    no_contact: Sequence[Sequence[str]] = (),
    base: str | None = None,
) -> GuessedHand:
    """Guess a ``hand.toml`` for a URDF.

    Every number states its source; those that begin with "guess" come from geometry or experience. Tendons are not
    guessed: every independent joint gets a servo of its own, also where one motor of the real hand bends several.

    Parameters
    ----------
    urdf : str or PathLike
        The URDF; a xacro or an MJCF file as `graspbox.hands.fitted_urdf` takes it.
    name : str, optional
        Name of the hand; by default that of the file.
    no_contact : sequence of sequences of str
        Lists of links and colliders that do not touch each other, such as `FittedUrdf.no_contact`.
    base : str, optional
        A link of the palm, of an MJCF file a body; by default the link from which chains branch. What is above it is
        left out.

    Raises
    ------
    FileError
        If the file cannot be read.
    HandError
        If the URDF describes no hand; the message lists every wrong line.
    """
    return begin_guess(urdf, name, no_contact, base).write()


def begin_guess(
    urdf: str | os.PathLike[str],
    name: str | None = None,
    no_contact: Sequence[Sequence[str]] = (),
    base: str | None = None,
    leaves_out: Callable[[], object] = lambda: None,
) -> Guess:
    """Guess how a hand closes and where it grasps; parameters and errors as for `guess_hand`.

    `leaves_out` is called as soon as it is known that the file has more than the hand, and may raise.
    """
    path = Path(urdf)
    read_bounded(path, LARGEST)  # raises if it cannot be read
    chosen = base is not None and is_mjcf(read_text(path))
    cut: Cut | None = None
    if chosen:
        leaves_out()

    def hand_alone(text: str) -> str:
        nonlocal cut
        cut = cut_above_palm(path, text, base)
        if cut is None:
            return text
        leaves_out()
        return cut.text

    def check(text: str, place: str) -> None:
        _check_joints(path, describe_urdf(text, place))

    # What is wrong besides meshes is found before minutes of fitting.
    fitted = read_hand(path, check, None if chosen else hand_alone, base)
    guess = _guessed(path, path.stem if name is None else name, fitted, cut, no_contact)
    return replace(guess, alone=chosen or cut is not None)


def guess_converted(mjcf: Path, fitted: FittedUrdf, urdf: str, name: str, base: str | None) -> GuessedHand:
    """Guess a ``hand.toml`` for a converted MJCF file, whose URDF will be the file `urdf`; its base stays if given."""
    cut = None if base is not None else cut_above_palm(mjcf, fitted.text)
    text = fitted.text if cut is None else without_blank_lines(cut.text)
    converted = replace(fitted, text=text, name=f"{mjcf} (converted)")
    return replace(_guessed(mjcf, name, converted, cut), urdf=urdf, alone=True).write()


def _guessed(
    path: Path, name: str, fitted: FittedUrdf, cut: Cut | None, no_contact: Sequence[Sequence[str]] = ()
) -> Guess:
    """Guess from the URDF of the hand alone; `path` is the file that errors name."""
    names = (fitted.name, "hand.toml")
    links = describe_urdf(fitted.text, names[0])
    _check_joints(path, links)
    fitted = _of_hand(fitted, links)
    fingers = Fingers(Hand(fitted.text, tables.minimal(links), names))
    if not fingers.tips:
        raise HandError(f"{path}: no link that a joint moves has a collision shape; a hand touches objects with them")
    closing = guess_closing(fingers)
    z = approach_of(fingers, closing)
    closing = with_raised_fingers(fingers, closing, z)
    pads = guess_pads(fingers, closing)
    written = name.encode(errors="replace").decode()
    apart = _still_there((*map(tuple, no_contact), *fitted.no_contact), links)
    guess = Guess(written, path.name, fitted, cut, fingers, closing, pads, axes_of(fingers, closing, z), apart)
    passing = passing_links(Hand(fitted.text, guess.write().text, names))
    return replace(guess, passing=tuple(passing))


def _of_hand(fitted: FittedUrdf, links: tuple[Link, ...]) -> FittedUrdf:
    """Leave out the fits of meshes and loops of a converted file that are not below the palm."""
    shapes, joints = {shape.name for link in links for shape in link.shapes}, {link.joint for link in links}
    fits = {name: fit for name, fit in fitted.fits.items() if {name, f"{name}.0"} & shapes}
    return replace(fitted, fits=fits, loops={name: fit for name, fit in fitted.loops.items() if name in joints})


def _still_there(lists: Sequence[tuple[str, ...]], links: tuple[Link, ...]) -> tuple[tuple[str, ...], ...]:
    """Keep the names of links and colliders that the hand has, in lists that still name two."""
    shapes = {shape.name for link in links for shape in link.shapes}
    # NAME also stands for NAME.0, NAME.1, ...
    known = {link.name for link in links} | shapes | {re.sub(r"\.\d+$", "", name) for name in shapes}
    kept = (tuple(name for name in names if name in known) for names in lists)
    return tuple(names for names in kept if len(names) > 1)


def _check_joints(path: Path, links: tuple[Link, ...]) -> None:
    """Refuse a URDF without joints that actuators could move, and one with too many."""
    joints = independent(links)
    if not joints:
        raise HandError(f"{path} has no joint that moves by itself; a hand needs revolute or prismatic joints")
    if len(joints) > _MOST:
        raise HandError(
            f"{path} has {len(joints)} independent joints, and a hand has at most {_MOST} actuators: let joints that "
            "one motor moves follow each other (`mimic`), or name the palm with --base LINK"
        )
    for joint in joints:
        if joint.limits[1] - joint.limits[0] < _LEAST_RANGE:
            raise HandError(
                f"{path}: joint {joint.joint!r} has the limits {list(joint.limits)}; widen them, or make it fixed"
            )


def _levers(fingers: Fingers, closing: Closing) -> Floats:
    """Return how far the fingertips of the half-closed hand move by each independent joint, m/rad or 1: (n,).

    A joint that others follow shares its force among the fingers that it moves.
    """
    half_closed, spans = (closing.opened + closing.closed) / 2, np.diff(fingers.limits, axis=1)[:, 0]
    levers = []
    for step in 1e-3 * np.diag(spans):
        moved = fingers.tip_centers(half_closed + step) - fingers.tip_centers(half_closed - step)
        levers.append(float(np.linalg.norm(moved, axis=1).sum()) / (2 * float(step.sum())))
    return np.maximum(levers, _LEAST_LEVER)


def _is_believed(fingers: Fingers, index: int, levers: Floats) -> bool:
    """Whether the effort of an independent joint may be that of its motor.

    Motors that are alike are judged where they push least: the same motor pushes more with a shorter lever.
    """
    joints = independent(fingers.described.links)
    joint, jaw = joints[index], len(fingers.tips) <= 2 or joints[index].kind == "prismatic"
    alike = [each.effort == joint.effort and each.kind == joint.kind for each in joints]
    return _LEAST_FORCE <= joint.effort / float(levers[alike].max()) <= (_JAW if jaw else _FINGER)


def _drive(fingers: Fingers, closing: Closing, index: int, levers: Floats) -> Drive:
    """Guess the servo of an independent joint."""
    joint = independent(fingers.described.links)[index]
    low, high = (float(limit) for limit in fingers.limits[index])
    closes = bool(closing.closes[index])
    rising = not closes or bool(closing.closed[index] > closing.opened[index])
    way = abs(float(closing.meets[index] - closing.opened[index]))
    stated = _is_believed(fingers, index, levers)
    return Drive(
        link=joint,
        limits=(low, high),
        closes=closes,
        ratio=1.0 if rising else -1.0,
        offset=low if rising else high,
        neutral=float(closing.opened[index]) - low,
        opened=abs(float(closing.opened[index]) - (low if rising else high)),
        load=joint.effort if stated else _FORCE * float(levers[index]),
        load_stated=stated,
        speed=joint.velocity if joint.velocity >= max(_LEAST_SPEED, way / _IN_TIME) else None,
        inertia=inertia_of(fingers.hand, index, (closing.opened + closing.closed) / 2),
    )


def _review(
    fingers: Fingers, closing: Closing, drives: tuple[Drive, ...], frame: Frame, found: str | None
) -> tuple[str, ...]:
    """List the guesses to review."""
    review = [
        "[grasp] xyz, rpy: z must point out of the palm, towards objects, and x along the closing fingers",
        "offset and ratio of each servo: position 0 is the open hand, and the position increases as it closes",
    ]
    if found is not None:
        review = [f"[grasp], [[grasp.preshapes]] and what closes: {found}; see whether your hand may do this"]
    side = [drive.link.joint for drive in drives if not drive.closes]
    if side:
        review.append(f"joints that seem to spread or turn fingers, and do not close: {', '.join(side)}")
    chains = [int(fingers.chain_of[fingers.body_of(drive.link)]) for drive in drives if drive.closes]
    if len(chains) > len(set(chains)):
        review.append(
            "fingers with several joints: no tendon can be guessed, so each joint has its own servo; if one "
            "motor bends a finger, replace them by a spool and a table in [tendons], or let joints follow (`mimic`)"
        )
    slow = [drive.link.joint for drive in drives if drive.speed is None and drive.link.velocity >= _LEAST_SPEED]
    if slow:
        review.append(
            f"max_speed of {', '.join(slow)}: with the URDF's velocity the hand would close in more than {_IN_TIME} s, "
            "when a trial lifts; it is taken to be faster"
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
