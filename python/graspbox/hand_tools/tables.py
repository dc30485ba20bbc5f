"""The text of a guessed ``hand.toml``."""

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.hand_tools.urdf import Joint, Tree

__all__ = ["Drive", "Frame", "minimal", "quoted", "write"]

Floats = NDArray[np.float64]

#: Deflection of a servo under its full load: rad, m.
_GIVES = {"rad": 0.05, "m": 0.003}
#: Natural frequency of a servo with its joint, rad/s; the armature follows from it.
_FREQUENCY = {"rad": 200.0, "m": 600.0}
#: Time constant of force control, seconds, and time in which a hand closes.
_SETTLES, _CLOSES = 0.05, 1.0
#: Digits of numbers in the file; rounded further, the angles of a grasp frame break its symmetries.
_DIGITS = 7
_PAD, _BARE = 1.0, 0.4


@dataclass(frozen=True, eq=False)
class Drive:
    """The servo of an independent joint, which is at offset + ratio x position.

    ``neutral`` is the actuator's position of a joint that does not close; ``load_stated`` says whether the load is the
    URDF's effort; ``speed`` is the URDF's, if it has a believable one.
    """

    joint: Joint
    limits: tuple[float, float]
    closes: bool
    ratio: float
    offset: float
    neutral: float
    load: float
    load_stated: bool
    speed: float | None
    inertia: float


@dataclass(frozen=True, eq=False)
class Frame:
    """The grasp frame in the base's frame, the grasp centre in it, and the width between open fingers that face."""

    xyz: Floats
    rpy: Floats
    center: Floats
    width: float | None
    on_palm: bool


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
    if isinstance(value, int | float):
        return f'{{ value = {_number(value)}, unit = "{unit}", source = {quoted(source)} }}'
    text = f"[{', '.join(_number(float(one)) for one in value)}]"
    return f'{{ value = {text}, unit = "{unit}", source = {quoted(source)} }}'


def minimal(tree: Tree) -> str:
    """Write the least file with which a URDF loads; its grasp frame is that of the base."""
    drives = [Drive(joint, (0.0, 1.0), True, 1.0, 0.0, 0.0, 1.0, False, None, 1.0) for joint in tree.independent]
    frame = Frame(np.zeros(3), np.zeros(3), np.zeros(3), None, False)
    return write("hand", "", (), drives, frame, ())


def write(
    name: str, urdf: str, pads: Sequence[str], drives: Sequence[Drive], frame: Frame, review: Sequence[str]
) -> str:
    """Write the file.

    Parameters
    ----------
    name, urdf : str
        Names of the hand and of its URDF.
    pads : sequence of str
        Names of the shapes that are pads.
    drives : sequence of Drive
        One servo per independent joint.
    frame : Frame
        The grasp frame.
    review : sequence of str
        Guesses to review.
    """
    lines = _head(urdf, review)
    lines += [f"name = {quoted(name)}", "", "# guess: the shapes that touch objects; all others are bare."]
    lines += ["pads = [", *(f"    {quoted(pad)}," for pad in pads), "]", "", "[friction]"]
    lines.append(f"pad = {_quantity(_PAD, '1', 'guess: rubber on a dry object')}")
    lines.append(f"bare = {_quantity(_BARE, '1', 'guess: plastic or metal on a dry object')}")
    for drive in drives:
        lines += ["", *_joint(drive)]
    for drive in drives:
        lines += ["", *_actuator(drive)]
    lines += ["", *_grasp(drives, frame), ""]
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
    lines.append("# Then run `graspbox hand check` with both files, and give every number its true source.")
    return ["".join(c if c.isprintable() else "?" for c in line) for line in lines]


def _stiffness(drive: Drive) -> float:
    return drive.load / _GIVES[drive.joint.unit]


def _armature(drive: Drive) -> float:
    return _stiffness(drive) / _FREQUENCY[drive.joint.unit] ** 2


def _damping(drive: Drive) -> float:
    return 2 * math.sqrt(_stiffness(drive) * (_armature(drive) + drive.inertia))


def _joint(drive: Drive) -> list[str]:
    metres = drive.joint.unit == "m"
    damper, spring, inertia = ("N s/m", "N/m", "kg") if metres else ("N m s/rad", "N m/rad", "kg m2")
    return [
        f"[joints.{_key(drive.joint.name)}]",
        "encoder = true",
        f"damping = {_quantity(0.02 * _damping(drive), damper, 'guess: small compared with the damping of the servo')}",
        f"armature = {_quantity(_armature(drive), inertia, 'guess: rotor and gear; keeps the servo slow enough')}",
        f"stop_stiffness = {_quantity(3 * _stiffness(drive), spring, 'guess: three times the stiffness of the servo')}",
    ]


def _actuator(drive: Drive) -> list[str]:
    joint, unit, (low, high) = drive.joint, drive.joint.unit, drive.limits
    metres = unit == "m"
    damper, spring, force = ("N s/m", "N/m", "N") if metres else ("N m s/rad", "N m/rad", "N m")
    gain, ratio = (f"{unit}/(s {force})", "rad/m" if metres else "1")
    span = high - low
    fastest = 2 * span / _CLOSES if drive.speed is None else drive.speed
    usual, limit = min(span / _CLOSES, fastest), "lower" if drive.offset == low else "upper"
    key = f"servo.joints.{_key(joint.name)}"
    way = "this direction brings fingertips together" if drive.closes else "it does not close the hand"
    effort = (
        "URDF: effort of the joint"
        if drive.load_stated
        else "guess: the URDF states no believable effort; 30 N at the fingertip"
    )
    gives = f"guess: gives by {_GIVES[unit]} {unit} under the load"
    zero = "open" if drive.closes else "position 0"
    speed = "guess: twice the usual speed" if drive.speed is None else "URDF: velocity of the joint"
    return [
        "[[actuators]]",
        f"name = {quoted(joint.name)}",
        f"{key}.ratio = {_quantity(drive.ratio, '1', f'guess: {way}')}",
        f"{key}.offset = {_quantity(drive.offset, unit, f'guess: {zero} at the {limit} limit of the URDF')}",
        f"servo.stiffness = {_quantity(_stiffness(drive), spring, gives)}",
        f"servo.damping = {_quantity(_damping(drive), damper, 'guess: critical for the armature and the links')}",
        f"travel = {_quantity([0.0, span], unit, 'guess: from limit to limit in the URDF')}",
        f"default_speed = {_quantity(usual, f'{unit}/s', 'guess: closes in a second, if the motor is that fast')}",
        f"max_speed = {_quantity(max(fastest, usual), f'{unit}/s', speed)}",
        f"ratio = {_quantity(1.0, ratio, 'guess: positions are those of the joint')}",
        f"load_limit = {_quantity(drive.load, force, effort)}",
        f"force_gain = {_quantity(1 / (_SETTLES * _stiffness(drive)), gain, 'guess: time constant 50 ms')}",
    ]


def _grasp(drives: Sequence[Drive], frame: Frame) -> list[str]:
    surface = (
        "the surface of the palm, where the fingertips meet"
        if frame.on_palm
        else "the roots of the fingers; the base has no shapes"
    )
    closing = ", ".join(quoted(drive.joint.name) for drive in drives if drive.closes)
    lines = [
        "# The grasp frame in the frame of the base link: z out of the palm, x along the closing fingers.",
        "[grasp]",
        f"xyz = {_quantity(frame.xyz, 'm', f'guess: {surface}')}",
        f"rpy = {_quantity(frame.rpy, 'rad', 'guess: z to the half-closed fingertips, x along their motion')}",
        f"center = {_quantity(frame.center, 'm', 'guess: where the fingertips meet')}",
        f"closing = [{closing}]",
        "",
        "[[grasp.preshapes]]",
        'name = "open"',
    ]
    lines += [
        f"positions.{_key(drive.joint.name)} = {_quantity(drive.neutral, drive.joint.unit, 'guess: 0 in the URDF')}"
        for drive in drives
        if not drive.closes
    ]
    if frame.width is not None:
        lines.append(
            f"width = {_quantity([0.0, frame.width], 'm', 'guess: between the open pads, less 1 mm on both sides')}"
        )
        lines.append('quarter = "always"')
    return lines
