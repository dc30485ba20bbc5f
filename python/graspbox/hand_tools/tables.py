"""The text of a guessed ``hand.toml``."""

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graspbox.hand_tools.bodies import Floats
from graspbox.hands.description import Link, independent

__all__ = ["Drive", "Frame", "minimal", "quoted", "write"]

#: Units by the kind of a joint's position: of a damper, of a spring, of inertia and of force.
_UNITS = {"rad": ("N m s/rad", "N m/rad", "kg m2", "N m"), "m": ("N s/m", "N/m", "kg", "N")}
#: Deflection of a servo under its full load: rad, m.
_GIVES = {"rad": 0.05, "m": 0.003}
#: Natural frequency of a servo with its joint, rad/s; the armature follows from it.
_FREQUENCY = {"rad": 200.0, "m": 600.0}
#: Time constant of force control, seconds, and time in which a hand closes.
_SETTLES, _CLOSES = 0.05, 1.0
#: Digits of numbers in the file; rounded further, the angles of a grasp frame break its symmetries.
_DIGITS = 7
_PAD, _BARE = 1.0, 0.4
#: Share of a joint's range below which a position counts as that of the open hand.
_OPEN = 1e-6


@dataclass(frozen=True, eq=False)
class Drive:
    """The servo of an independent joint, which is at offset + ratio x position.

    ``neutral`` is the actuator's position of a joint that does not close; ``load_stated`` says whether the load is the
    URDF's effort; ``speed`` is the URDF's, if it has a believable one. ``opened`` is the position of an actuator that
    closes in the open hand.
    """

    link: Link
    limits: tuple[float, float]
    closes: bool
    ratio: float
    offset: float
    neutral: float
    opened: float
    load: float
    load_stated: bool
    speed: float | None
    inertia: float

    @property
    def stiffness(self) -> float:
        """Stiffness of the servo, N m/rad or N/m."""
        return self.load / _GIVES[self.link.unit]

    @property
    def armature(self) -> float:
        """Inertia of the rotor at the joint, kg m2 or kg."""
        return self.stiffness / _FREQUENCY[self.link.unit] ** 2

    @property
    def damping(self) -> float:
        """Critical damping of the servo, N m s/rad or N s/m."""
        return 2 * math.sqrt(self.stiffness * (self.armature + self.inertia))


@dataclass(frozen=True, eq=False)
class Frame:
    """The grasp frame in the base's frame, the grasp centre in it, and the width between open fingers that face.

    ``places`` is the range of an object's centre along x, from the grasp centre, where only one of two jaws moves.
    """

    xyz: Floats
    rpy: Floats
    center: Floats
    width: float | None
    on_palm: bool
    places: tuple[float, float] | None = None


def quoted(text: str) -> str:
    """Write a string of TOML."""
    escapes = {'"': '\\"', "\\": "\\\\"}
    safe = (escapes.get(c) or (c if c.isprintable() or c == " " else f"\\U{ord(c):08X}") for c in text)
    return f'"{"".join(safe)}"'


def _key(name: str) -> str:
    """Write a key, without quotes where it needs none."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)


def _number(value: float) -> str:
    rounded = float(f"{value:.{_DIGITS}g}") + 0.0
    return repr(0.0 if abs(rounded) < 1e-9 else rounded)


def _quantity(value: float | Sequence[float] | Floats, unit: str, source: str) -> str:
    text = f"[{', '.join(map(_number, value))}]" if isinstance(value, Sequence | np.ndarray) else _number(value)
    return f'{{ value = {text}, unit = "{unit}", source = {quoted(source)} }}'


def minimal(links: tuple[Link, ...]) -> str:
    """Return the shortest file with which a URDF loads; its grasp frame is that of the base."""
    drives = [Drive(link, (0.0, 1.0), True, 1.0, 0.0, 0.0, 0.0, 1.0, False, None, 1.0) for link in independent(links)]
    frame = Frame(np.zeros(3), np.zeros(3), np.zeros(3), None, False)
    return write("hand", "", (), drives, frame, ())


def write(
    name: str,
    urdf: str,
    pads: Sequence[str],
    drives: Sequence[Drive],
    frame: Frame,
    review: Sequence[str],
    no_contact: Sequence[Sequence[str]] = (),
    *,
    found: str | None = None,
) -> str:
    """Return the file of the hand `name`, whose URDF has the name `urdf`; `pads` are shapes, `review` lists guesses.

    `no_contact` has lists of links and shapes that do not touch each other; `found` is the source of how the hand
    opens, closes and where it grasps, if that is no guess.
    """
    lines = _head(urdf, review)
    lines += [f"name = {quoted(name)}", "", "# guess: the shapes that touch objects; all others are bare."]
    lines += ["pads = [", *(f"    {quoted(pad)}," for pad in pads), "]", ""]
    if no_contact:
        lines += ["# Links and shapes that pass through each other.", "no_contact = ["]
        lines += [*(f"    [{', '.join(map(quoted, names))}]," for names in no_contact), "]", ""]
    lines.append("[friction]")
    lines.append(f"pad = {_quantity(_PAD, '1', 'guess: rubber on a dry object')}")
    lines.append(f"bare = {_quantity(_BARE, '1', 'guess: plastic or metal on a dry object')}")
    for drive in drives:
        lines += ["", *_joint(drive)]
    for drive in drives:
        lines += ["", *_actuator(drive, found)]
    lines += ["", *_grasp(drives, frame, found), ""]
    return "\n".join(lines)


def _head(urdf: str, review: Sequence[str]) -> list[str]:
    if not review:
        return []
    lines = [
        f"# A first description of the hand in {' '.join(urdf.split())}, guessed by `graspbox hand new`.",
        "# Review:",
    ]
    for item in review:
        shown = "".join(c if c.isprintable() else "?" for c in item)
        lines += textwrap.wrap(shown, 110, initial_indent="# - ", subsequent_indent="#   ", break_long_words=False)
    lines.append("# Then run `graspbox hand check` with both files, and state the true source of every number.")
    return ["".join(c if c.isprintable() else "?" for c in line) for line in lines]


def _joint(drive: Drive) -> list[str]:
    damper, spring, inertia, _ = _UNITS[drive.link.unit]
    return [
        f"[joints.{_key(drive.link.joint)}]",
        "encoder = true",
        f"damping = {_quantity(0.02 * drive.damping, damper, 'guess: small compared with the damping of the servo')}",
        f"armature = {_quantity(drive.armature, inertia, 'guess: rotor and gear; keeps the servo slow enough')}",
        f"stop_stiffness = {_quantity(3 * drive.stiffness, spring, 'guess: three times the stiffness of the servo')}",
    ]


def _actuator(drive: Drive, found: str | None) -> list[str]:
    joint, unit, (low, high) = drive.link.joint, drive.link.unit, drive.limits
    damper, spring, _, force = _UNITS[unit]
    gain, ratio = f"{unit}/(s {force})", "rad/m" if unit == "m" else "1"
    span = high - low
    fastest = 2 * span / _CLOSES if drive.speed is None else drive.speed
    usual, limit = min(span / _CLOSES, fastest), "lower" if drive.offset == low else "upper"
    key = f"servo.joints.{_key(joint)}"
    direction = "guess: this direction brings fingertips together"
    if not drive.closes:
        direction = "guess: it does not close the hand"
    effort = "URDF: effort of the joint"
    if not drive.load_stated:
        stated = drive.link.effort
        said = f"an effort of {stated:.4g} {force}, which is not believable" if stated else "no effort"
        effort = f"guess: the URDF states {said}; 30 N at the fingertip"
    gives = f"guess: gives by {_GIVES[unit]} {unit} under the load"
    zero = "open" if drive.closes else "position 0"
    speed = "URDF: velocity of the joint"
    if drive.speed is None:
        speed = "guess: twice the usual speed; the URDF states none with which the hand closes within a second"
    return [
        "[[actuators]]",
        f"name = {quoted(joint)}",
        f"{key}.ratio = {_quantity(drive.ratio, '1', found or direction)}",
        f"{key}.offset = {_quantity(drive.offset, unit, f'guess: {zero} at the {limit} limit of the URDF')}",
        f"servo.stiffness = {_quantity(drive.stiffness, spring, gives)}",
        f"servo.damping = {_quantity(drive.damping, damper, 'guess: critical for the armature and the links')}",
        f"travel = {_quantity([0.0, span], unit, 'guess: from limit to limit in the URDF')}",
        f"default_speed = {_quantity(usual, f'{unit}/s', 'guess: closes in a second, if the motor is that fast')}",
        f"max_speed = {_quantity(max(fastest, usual), f'{unit}/s', speed)}",
        f"ratio = {_quantity(1.0, ratio, 'guess: positions are those of the joint')}",
        f"load_limit = {_quantity(drive.load, force, effort)}",
        f"force_gain = {_quantity(1 / (_SETTLES * drive.stiffness), gain, 'guess: time constant 50 ms')}",
    ]


def _grasp(drives: Sequence[Drive], frame: Frame, found: str | None) -> list[str]:
    surface = "guess: the roots of the fingers; the base has no shapes"
    if frame.on_palm:
        surface = "guess: the surface of the palm, where the fingertips meet"
    turned = found or "guess: z to the half-closed fingertips, x along their motion"
    closing = ", ".join(quoted(drive.link.joint) for drive in drives if drive.closes)
    lines = [
        "# The grasp frame in the frame of the base link: z out of the palm, x along the closing fingers.",
        "[grasp]",
        f"xyz = {_quantity(frame.xyz, 'm', found or surface)}",
        f"rpy = {_quantity(frame.rpy, 'rad', turned)}",
        f"center = {_quantity(frame.center, 'm', found or 'guess: where the fingertips meet')}",
        f"closing = [{closing}]",
    ]
    if frame.places is not None:
        source = "guess: an object may be anywhere between the jaw that moves and the other one"
        lines.append(f"closing_range = {_quantity(frame.places, 'm', source)}")
    lines += ["", "[[grasp.preshapes]]", 'name = "open"']
    for drive in drives:
        if drive.closes and abs(drive.opened) < _OPEN * (drive.limits[1] - drive.limits[0]):
            continue
        position = drive.opened if drive.closes else drive.neutral
        source = "guess: the fingertip stands up from the palm" if drive.closes else "guess: 0 in the URDF"
        quantity = _quantity(position, drive.link.unit, found or source)
        lines.append(f"positions.{_key(drive.link.joint)} = {quantity}")
    if frame.width is not None:
        source = "guess: between the open pads, less 1 mm on both sides"
        lines += [f"width = {_quantity([0.0, frame.width], 'm', source)}", 'quarter = "always"']
    return lines
