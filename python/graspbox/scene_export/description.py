"""Reader for the two files of a hand, independent of the core.

The URDF (links, joints, collision shapes, masses) and the ``hand.toml`` (springs, tendons, actuators, preshapes,
friction) are converted to plain values, for exported scenes and for the replay of trials in MuJoCo. The core checks the
files; this module does not repeat its checks.
"""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Index of the base in `HandDescription.links`.
BASE = 0


@dataclass(frozen=True)
class Shape:
    """A collision primitive of a link."""

    name: str
    #: ``box`` (half extents), ``cylinder`` (radius, half length) or ``sphere`` (radius); metres, in MuJoCo's order.
    kind: str
    size: tuple[float, ...]
    #: Pose of the shape, (4, 4), link frame.
    link_from_shape: Array
    #: Friction factor of the surface.
    friction: float


@dataclass(frozen=True)
class Spring:
    """Spring, damping, armature and stops of a joint; SI units, per rad or m."""

    stiffness: float = 0.0
    reference: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    stop_stiffness: float = 0.0


@dataclass(frozen=True)
class Link:
    """A link of the hand, with the joint to its parent (none for the base)."""

    name: str
    parent: int
    #: Pose at joint position 0, (4, 4), parent's frame.
    parent_from_link: Array
    #: Name of the joint, its kind (``fixed``, ``revolute`` or ``prismatic``), (3,) axis, and limits in rad or m.
    joint: str
    kind: str
    axis: Array
    limits: tuple[float, float]
    #: For a mimic joint: name of the joint that it follows, ratio and offset.
    mimic: tuple[str, float, float] | None
    mass: float
    #: Centre of mass (3,), metres, and inertia about it (3, 3), kg m2; link frame.
    center: Array
    inertia: Array
    shapes: tuple[Shape, ...]
    spring: Spring = Spring()


@dataclass(frozen=True)
class Tendon:
    """A tendon with its moment arms at joints, which are given by the indices of their child links; SI units."""

    name: str
    arms: tuple[tuple[int, float], ...]
    stiffness: float
    damping: float
    max_tension: float


@dataclass(frozen=True)
class Actuator:
    """Winds a tendon or drives joints, which are given by the indices of their child links; SI units."""

    name: str
    #: Index of the tendon and radius of its spool, or None.
    spool: tuple[int, float] | None
    #: Driven joints: link, ratio, offset.
    joints: tuple[tuple[int, float, float], ...]
    #: Stiffness and damping of a servo; None for a rigid drive and for a spool.
    servo: tuple[float, float] | None
    #: Speed of position commands, travel, and the load at which closing stops.
    speed: float
    travel: tuple[float, float]
    load_limit: float
    #: Whether it closes the hand.
    closes: bool


@dataclass(frozen=True)
class HandDescription:
    """A hand; links are ordered with parents before children."""

    name: str
    links: tuple[Link, ...]
    tendons: tuple[Tendon, ...]
    actuators: tuple[Actuator, ...]
    #: Index of the actuator whose position is the preshape, if there is one, and its limits.
    preshape: int | None
    preshape_limits: tuple[float, float]
    #: Positions of actuators, by index, for each named preshape.
    named: tuple[dict[int, float], ...]
    #: Pose of the grasp frame, (4, 4), base frame.
    base_from_hand: Array

    def open_positions(self, preshape: float) -> list[float]:
        """Return the positions of the actuators of the open hand."""
        positions = [actuator.travel[0] for actuator in self.actuators]
        if self.preshape is not None:
            positions[self.preshape] = preshape
        elif self.named:
            for index, position in self.named[round(preshape)].items():
                positions[index] = position
        return positions

    def rigid_position(self, link: int, positions: list[float]) -> float | None:
        """Return the position of a link's joint if it is driven rigidly, directly or as a mimic joint; else None."""
        mimic = self.links[link].mimic
        if mimic is not None:
            leader = self.rigid_position(self.index(mimic[0]), positions)
            return None if leader is None else mimic[1] * leader + mimic[2]
        for actuator, position in zip(self.actuators, positions, strict=True):
            if actuator.servo is None:
                for driven, ratio, offset in actuator.joints:
                    if driven == link:
                        low, high = self.links[link].limits
                        return min(max(ratio * position + offset, low), high)
        return None

    def start_position(self, link: int, positions: list[float]) -> float:
        """Return the position of a link's joint where a trial begins, rad or m.

        Driven joints are where their actuators' `positions` put them, mimic joints follow, and all others are at 0.
        """
        rigid = self.rigid_position(link, positions)
        if rigid is not None:
            return rigid
        mimic = self.links[link].mimic
        if mimic is not None:
            return mimic[1] * self.start_position(self.index(mimic[0]), positions) + mimic[2]
        for actuator, position in zip(self.actuators, positions, strict=True):
            for driven, ratio, offset in actuator.joints:
                if driven == link:
                    return ratio * position + offset
        return 0.0

    def index(self, joint: str) -> int:
        """Return the index of the child link of a joint."""
        (found,) = [i for i, link in enumerate(self.links) if link.joint == joint]
        return found

    def free(self) -> list[int]:
        """Return the indices of links with dynamic joints: neither fixed nor driven rigidly."""
        positions = self.open_positions(self.preshape_limits[0])
        moving = [i for i, link in enumerate(self.links) if link.joint and link.kind != "fixed"]
        return [i for i in moving if self.rigid_position(i, positions) is None]


def rotation_from_rpy(rpy: tuple[float, float, float]) -> Array:
    """Return the (3, 3) rotation of URDF's roll, pitch, yaw (rad; about fixed x, then y, then z)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _numbers(text: str) -> list[float]:
    return [float(x) for x in text.split()]


def _triple(text: str) -> tuple[float, float, float]:
    x, y, z = _numbers(text)
    return x, y, z


def _pose(element: ET.Element | None) -> Array:
    pose = np.eye(4)
    if element is not None:
        pose[:3, 3] = _triple(element.get("xyz", "0 0 0"))
        pose[:3, :3] = rotation_from_rpy(_triple(element.get("rpy", "0 0 0")))
    return pose


def _shape(element: ET.Element, pads: set[str], friction: dict[str, float]) -> Shape:
    name = element.get("name", "")
    geometry = element.find("geometry")
    if geometry is None or len(geometry) != 1:
        raise ValueError(f"collision {name!r} must have one geometry")
    shape = geometry[0]
    size: tuple[float, ...]
    if shape.tag == "box":
        size = tuple(0.5 * x for x in _triple(shape.attrib["size"]))
    elif shape.tag == "cylinder":
        size = (float(shape.attrib["radius"]), 0.5 * float(shape.attrib["length"]))
    elif shape.tag == "sphere":
        size = (float(shape.attrib["radius"]),)
    else:
        raise ValueError(f"collision {name!r} is a {shape.tag!r}; only boxes, cylinders and spheres are supported")
    return Shape(name, shape.tag, size, _pose(element.find("origin")), friction["pad" if name in pads else "bare"])


def _shapes(link: ET.Element, pads: set[str], friction: dict[str, float]) -> tuple[Shape, ...]:
    """Read a link's shapes; one without a name is named after the link."""
    shapes = (_shape(element, pads, friction) for element in link.findall("collision"))
    return tuple(s if s.name else replace(s, name=f"{link.attrib['name']}_collision_{i}") for i, s in enumerate(shapes))


def _inertial(element: ET.Element) -> tuple[float, Array, Array]:
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    moments = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or moments is None:
        raise ValueError(f"link {element.get('name')!r} needs an inertial with mass and inertia")
    get = {key: float(value) for key, value in moments.attrib.items()}
    inertia = np.array(
        [
            [get["ixx"], get["ixy"], get["ixz"]],
            [get["ixy"], get["iyy"], get["iyz"]],
            [get["ixz"], get["iyz"], get["izz"]],
        ]
    )
    pose = _pose(inertial.find("origin"))
    turn = pose[:3, :3]
    return float(mass.attrib["value"]), pose[:3, 3], turn @ inertia @ turn.T


def _links(
    robot: ET.Element, pads: set[str], friction: dict[str, float], springs: dict[str, Spring]
) -> tuple[Link, ...]:
    """Order the links from the base outwards: parents before children."""
    elements = {element.attrib["name"]: element for element in robot.findall("link")}
    joints: dict[str, list[ET.Element]] = {}
    children = set()
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            raise ValueError(f"joint {joint.get('name')!r} needs a parent and a child")
        joints.setdefault(parent.attrib["link"], []).append(joint)
        children.add(child.attrib["link"])
    (base,) = [name for name in elements if name not in children]
    links: list[Link] = []

    def visit(name: str, parent: int, joint: ET.Element | None) -> None:
        mass, center, inertia = _inertial(elements[name])
        shapes = _shapes(elements[name], pads, friction)
        pose, axis, limits, joint_name = np.eye(4), np.array([1.0, 0.0, 0.0]), (0.0, 0.0), ""
        kind, follows = "fixed", None
        if joint is not None:
            pose, joint_name, kind = _pose(joint.find("origin")), joint.attrib["name"], joint.attrib["type"]
            mimic = joint.find("mimic")
            if mimic is not None:
                ratio, offset = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
                follows = (mimic.attrib["joint"], ratio, offset)
            found, limit = joint.find("axis"), joint.find("limit")
            if found is not None:
                axis = np.array(_triple(found.attrib["xyz"]))
            if limit is not None:
                limits = (float(limit.attrib["lower"]), float(limit.attrib["upper"]))
        spring = springs.get(joint_name, Spring())
        links.append(
            Link(name, parent, pose, joint_name, kind, axis, limits, follows, mass, center, inertia, shapes, spring)
        )
        index = len(links) - 1
        for below in joints.get(name, []):
            child = below.find("child")
            assert child is not None
            visit(child.attrib["link"], index, below)

    visit(base, BASE, None)
    return tuple(links)


def _value(table: dict[str, Any], key: str) -> Any:
    return table[key]["value"]


def _springs(table: dict[str, Any]) -> dict[str, Spring]:
    springs: dict[str, Spring] = {}
    for name, group in table.get("joints", {}).items():
        numbers = {key: float(_value(group, key)) for key in ("damping", "armature", "stop_stiffness")}
        if "stiffness" in group:
            numbers |= {"stiffness": _value(group, "stiffness"), "reference": _value(group, "spring_reference")}
        springs |= {joint: Spring(**numbers) for joint in group.get("names", [name])}
    return springs


def _tendon(name: str, table: dict[str, Any], index: dict[str, int]) -> Tendon:
    arms = sorted((index[joint], float(arm["value"])) for joint, arm in table["arms"].items())
    numbers = [float(_value(table, key)) for key in ("stiffness", "damping", "max_tension")]
    return Tendon(name, tuple(arms), *numbers)


def _actuator(entry: dict[str, Any], tendons: list[str], index: dict[str, int], closing: list[str]) -> Actuator:
    spool, rigid, servo = (entry.get(key) for key in ("spool", "rigid", "servo"))
    driven = (rigid or servo or {"joints": {}})["joints"]
    low, high = _value(entry, "travel")
    return Actuator(
        name=entry["name"],
        spool=None if spool is None else (tendons.index(spool["tendon"]), float(_value(spool, "radius"))),
        joints=tuple(
            (index[joint], float(_value(numbers, "ratio")), float(numbers.get("offset", {"value": 0.0})["value"]))
            for joint, numbers in driven.items()
        ),
        servo=None if servo is None else (float(_value(servo, "stiffness")), float(_value(servo, "damping"))),
        speed=float(_value(entry, "default_speed")),
        travel=(float(low), float(high)),
        load_limit=float(_value(entry, "load_limit")),
        closes=entry["name"] in closing,
    )


def read_hand(urdf: str, toml: str) -> HandDescription:
    """Read a hand.

    Parameters
    ----------
    urdf, toml : str
        Contents of its URDF and of its ``hand.toml``.
    """
    table = tomllib.loads(toml)
    friction = {key: float(_value(table["friction"], key)) for key in ("pad", "bare")}
    links = _links(ET.fromstring(urdf), set(table.get("pads", [])), friction, _springs(table))
    index = {link.joint: i for i, link in enumerate(links)}
    grasp, tendons = table["grasp"], sorted(table.get("tendons", {}))
    base_from_hand = np.eye(4)
    base_from_hand[:3, 3] = _value(grasp, "xyz")
    base_from_hand[:3, :3] = rotation_from_rpy(_value(grasp, "rpy"))
    names = [entry["name"] for entry in table["actuators"]]
    preshapes = [entry.get("positions", {}) for entry in grasp.get("preshapes", [])]
    coordinate = grasp.get("coordinate")
    low, high = (0.0, max(len(preshapes) - 1, 0)) if coordinate is None else _value(coordinate, "limits")
    return HandDescription(
        name=table["name"],
        links=links,
        tendons=tuple(_tendon(name, table["tendons"][name], index) for name in tendons),
        actuators=tuple(_actuator(entry, tendons, index, grasp["closing"]) for entry in table["actuators"]),
        preshape=None if coordinate is None else names.index(coordinate["actuator"]),
        preshape_limits=(float(low), float(high)),
        named=tuple({names.index(name): float(one["value"]) for name, one in found.items()} for found in preshapes),
        base_from_hand=base_from_hand,
    )
