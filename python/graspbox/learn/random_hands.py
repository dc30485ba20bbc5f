"""Random hands for training: parallel jaws, and fingers with joints, as URDF and ``hand.toml``.

The URDF of a hand is sampled from its family by its number; `guess_hand` describes it, as any URDF.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from graspbox.errors import ConfigError, HandError
from graspbox.hand_tools.checking import check_hand
from graspbox.hand_tools.guessing import guess_hand
from graspbox.hands import Hand, corners_of

__all__ = ["FAMILIES", "random_hand"]

#: Density of all links, kg/m3: plastic with motors.
_DENSITY = 1200.0
#: Hands that are sampled until one has no error.
_TRIES = 20

Random = np.random.Generator


@dataclass(frozen=True)
class _Box:
    """A collision box of a link: name, middle and size, link frame, metres."""

    name: str
    center: tuple[float, float, float]
    size: tuple[float, float, float]


def random_hand(family: str, number: int) -> Hand:
    """Sample a random hand, determined by its family and number.

    Samples that fail a check of `graspbox.hand_tools.check_hand`, such as fingers that do not meet, are replaced.

    Parameters
    ----------
    family : {"jaws", "fingers"}
        ``jaws``: two parallel fingers on rails, one motor. ``fingers``: two to six fingers of one to three links around
        a palm, or in two rows that face each other, with a motor per finger or per joint.

    Raises ConfigError for an unknown family or a negative number; HandError if no sample passes the checks.
    """
    if family not in FAMILIES:
        raise ConfigError(f"there is no family of hands {family!r}; choose from {', '.join(FAMILIES)}")
    if number < 0:
        raise ConfigError(f"the number of a hand is {number}; it must be 0 or more")
    for attempt in range(_TRIES):
        rng = np.random.default_rng([list(FAMILIES).index(family), number, attempt])
        name = f"{family}-{number}"
        with tempfile.TemporaryDirectory() as folder:
            urdf = Path(folder) / f"{name}.urdf"
            urdf.write_text(FAMILIES[family](name, rng))
            try:
                hand = Hand(urdf.read_text(), guess_hand(urdf).text)
            except HandError:
                continue
        if _forward(hand) and all(finding.severity == "note" for finding in check_hand(hand, trials=False).findings):
            return hand
    raise HandError(f"{_TRIES} samples of {family} {number} fail the checks; take another number")


def _forward(hand: Hand) -> bool:
    """Whether the open fingers are before the palm: those that curl far can be understood the wrong way round."""
    opened = hand.open(min(hand.preshapes.values()))
    return bool(corners_of(hand, opened, "fingers")[:, 2].mean() > corners_of(hand, opened, "palm")[:, 2].mean())


def _jaws(name: str, rng: Random) -> str:
    """Write the URDF of two parallel jaws that close along x."""
    stroke, length = rng.uniform(0.02, 0.055), rng.uniform(0.035, 0.09)
    width, thickness, force = rng.uniform(0.012, 0.035), rng.uniform(0.008, 0.018), _between(rng, 10.0, 80.0)
    robot = ET.Element("robot", name=name)
    body = (2 * (stroke + thickness) + 0.02, max(width + 0.02, rng.uniform(0.04, 0.08)), 0.06)
    _link(robot, "palm", [_Box("palm", (0.0, 0.0, -0.03), body)])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        pad = 0.3 * thickness
        boxes = [
            _Box(
                f"{side}_body", (sign * (pad + 0.35 * thickness), 0.0, 0.5 * length), (0.7 * thickness, width, length)
            ),
            _Box(f"{side}_pad", (sign * 0.5 * pad, 0.0, 0.6 * length), (pad, width, 0.8 * length)),
        ]
        _link(robot, side, boxes)
        joint = _joint(robot, f"{side}_rail", "prismatic", ("palm", side), (0, 0, 0), (0, 0, 0), (sign, 0, 0))
        limits = {"lower": 0.0, "upper": stroke, "effort": 2 * force, "velocity": max(stroke, 0.05)}
        ET.SubElement(joint, "limit", {key: _text(value) for key, value in limits.items()})
        if side == "right":
            ET.SubElement(joint, "mimic", joint="left_rail")
    return ET.tostring(robot, encoding="unicode")


def _fingers(name: str, rng: Random) -> str:
    """Write the URDF of fingers with joints around the z axis of the palm."""
    robot = ET.Element("robot", name=name)
    thickness, width = rng.uniform(0.012, 0.02), rng.uniform(0.012, 0.022)
    roots, size = _roots(rng, width)
    links = int(rng.integers(1, 4))
    shares = rng.uniform(0.7, 1.3, links)
    lengths = rng.uniform(0.06, 0.11) * shares / shares.sum()
    lean, force, coupled = rng.uniform(-0.1, 0.5), _between(rng, 4.0, 30.0), bool(rng.random() < 0.7)
    travel = [rng.uniform(1.0, 1.5) + lean, *rng.uniform(0.4, 1.3, links - 1) / max(1, links - 1) ** 0.5]
    _link(robot, "palm", [_Box("palm", (0.0, 0.0, -0.03), (*size, 0.06))])
    for finger, (x, y, yaw) in enumerate(roots):
        parent = "palm"
        for number in range(links):
            child, length = f"finger_{finger}_{number}", float(lengths[number])
            boxes = [
                _Box(f"{child}_body", (-0.25 * thickness, 0.0, 0.5 * length), (0.5 * thickness, width, length)),
                _Box(f"{child}_pad", (0.25 * thickness, 0.0, 0.5 * length), (0.5 * thickness, width, 0.9 * length)),
            ]
            _link(robot, child, boxes)
            origin, turn = ((x, y, 0.0), (0.0, -lean, yaw)) if not number else ((0, 0, lengths[number - 1]), (0, 0, 0))
            joint = _joint(robot, f"{child}_joint", "revolute", (parent, child), origin, turn, (0, 1, 0))
            effort = force * float(lengths[number:].sum())
            # Rounded, a joint that follows another one may pass its end.
            limits = {"lower": 0.0, "upper": travel[number] + 1e-4, "effort": effort, "velocity": 2.0 * travel[number]}
            ET.SubElement(joint, "limit", {key: _text(value) for key, value in limits.items()})
            if number and coupled:
                ratio = _text(travel[number] / travel[0])
                ET.SubElement(joint, "mimic", joint=f"finger_{finger}_0_joint", multiplier=ratio)
            parent = child
    return ET.tostring(robot, encoding="unicode")


def _roots(rng: Random, width: float) -> tuple[list[tuple[float, float, float]], tuple[float, float]]:
    """Sample where fingers leave the palm, (x, y, direction), and the size of the palm, metres and radians."""
    radius = rng.uniform(0.025, 0.045)
    if rng.random() < 0.3:
        count = int(rng.integers(3, 5))
        angles = np.arange(count) * 2 * np.pi / count
        roots = [(radius * np.cos(a), radius * np.sin(a), a + np.pi) for a in angles]
        return [(float(x), float(y), float(a)) for x, y, a in roots], (2 * radius + 0.02, 2 * radius + 0.02)
    many = int(rng.integers(1, 5))
    few = int(rng.integers(1, min(many, 2) + 1))
    apart = width + rng.uniform(0.003, 0.03)

    def row(count: int, x: float, yaw: float) -> list[tuple[float, float, float]]:
        return [(x, apart * (i - 0.5 * (count - 1)), yaw) for i in range(count)]

    size = (2 * radius + 0.02, max(apart * (many - 1) + width, 0.05))
    return [*row(many, radius, float(np.pi)), *row(few, -radius, 0.0)], size


#: Families, by name: a function of the hand's name and random numbers that writes its URDF.
FAMILIES: dict[str, Callable[[str, Random], str]] = {"jaws": _jaws, "fingers": _fingers}


def _between(rng: Random, low: float, high: float) -> float:
    """Sample a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _text(*values: float) -> str:
    return " ".join(f"{float(value):.6g}" for value in values)


def _link(robot: ET.Element, name: str, boxes: list[_Box]) -> None:
    """Add a link of boxes; its mass is that of all of them, in the box around them."""
    low = np.min([np.subtract(box.center, np.multiply(0.5, box.size)) for box in boxes], axis=0)
    high = np.max([np.add(box.center, np.multiply(0.5, box.size)) for box in boxes], axis=0)
    mass = _DENSITY * float(sum(np.prod(box.size) for box in boxes))
    square = (high - low) ** 2
    moments = mass / 12.0 * (square.sum() - square)
    link = ET.SubElement(robot, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(*(0.5 * (low + high))))
    ET.SubElement(inertial, "mass", value=_text(mass))
    diagonal = {f"i{axis}{axis}": _text(moment) for axis, moment in zip("xyz", moments, strict=True)}
    ET.SubElement(inertial, "inertia", {**diagonal, "ixy": "0", "ixz": "0", "iyz": "0"})
    for box in boxes:
        collision = ET.SubElement(link, "collision", name=box.name)
        ET.SubElement(collision, "origin", xyz=_text(*box.center))
        ET.SubElement(ET.SubElement(collision, "geometry"), "box", size=_text(*box.size))


def _joint(
    robot: ET.Element,
    name: str,
    kind: str,
    links: tuple[str, str],
    xyz: tuple[float, float, float],
    rpy: tuple[float, float, float],
    axis: tuple[float, float, float],
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    ET.SubElement(joint, "origin", xyz=_text(*xyz), rpy=_text(*rpy))
    ET.SubElement(joint, "axis", xyz=_text(*axis))
    return joint
