"""Reads the two files of a hand independently of the core, which shares only these files.

The URDF (links, joints, boxes, masses) and the ``hand.toml`` (tendons, springs, motors, friction) become plain values.
Checks that the core makes are not repeated here.
"""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
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
    #: ``box`` (half extents), ``cylinder`` (radius, half length) or ``sphere`` (radius); metres, as MuJoCo sizes them.
    kind: str
    size: tuple[float, ...]
    #: (4, 4), link frame.
    link_from_shape: Array
    #: Friction factor of its surface.
    friction: float


@dataclass(frozen=True)
class Link:
    """A rigid part of the hand, with the joint that carries it (none for the base)."""

    name: str
    parent: int
    #: (4, 4), parent's frame at angle 0.
    parent_from_link: Array
    #: Joint's name, (3,) axis, and limits in rad.
    joint: str
    axis: Array
    limits: tuple[float, float]
    mass: float
    #: (3,) metres, and (3, 3) kg m2 about it; link frame.
    center: Array
    inertia: Array
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class Finger:
    """Two joints on one tendon; SI units. A joint has the index of its child link."""

    name: str
    #: The link that the preshape turns, and its sign.
    swivel: tuple[int, float] | None
    proximal: int
    distal: int
    arms: tuple[float, float]
    spool_radius: float
    stiffness: float
    damping: float
    max_tension: float
    #: Springs of the proximal and the distal joint: N m/rad, and rest angle in rad.
    stiffnesses: tuple[float, float]
    rests: tuple[float, float]
    #: Proximal and distal, N m s/rad.
    joint_damping: tuple[float, float]
    armature: float
    stop_stiffness: float
    #: Spool: speed of a position command (rad/s) and travel (rad).
    speed: float
    travel: tuple[float, float]


@dataclass(frozen=True)
class HandDescription:
    """A hand; parent links come before their children."""

    name: str
    links: tuple[Link, ...]
    fingers: tuple[Finger, ...]
    #: (4, 4): the grasp frame in the base's frame.
    base_from_hand: Array


def rotation_from_rpy(rpy: tuple[float, float, float]) -> Array:
    """Give the (3, 3) rotation of URDF's roll, pitch, yaw (rad; about fixed x, then y, then z)."""
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
        raise ValueError(f"collision {name!r}: the judge knows boxes, cylinders and spheres, not {shape.tag!r}")
    return Shape(name, shape.tag, size, _pose(element.find("origin")), friction["pad" if name in pads else "bare"])


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


def _links(robot: ET.Element, pads: set[str], friction: dict[str, float]) -> tuple[Link, ...]:
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
        shapes = tuple(_shape(e, pads, friction) for e in elements[name].findall("collision"))
        pose, axis, limits, joint_name = np.eye(4), np.array([1.0, 0.0, 0.0]), (0.0, 0.0), ""
        if joint is not None:
            pose, joint_name = _pose(joint.find("origin")), joint.attrib["name"]
            found, limit = joint.find("axis"), joint.find("limit")
            if found is not None:
                axis = np.array(_triple(found.attrib["xyz"]))
            if limit is not None:
                limits = (float(limit.attrib["lower"]), float(limit.attrib["upper"]))
        links.append(Link(name, parent, pose, joint_name, axis, limits, mass, center, inertia, shapes))
        index = len(links) - 1
        for below in joints.get(name, []):
            child = below.find("child")
            assert child is not None
            visit(child.attrib["link"], index, below)

    visit(base, BASE, None)
    return tuple(links)


def _value(table: dict[str, Any], key: str) -> Any:
    return table[key]["value"]


def _finger(entry: dict[str, Any], table: dict[str, Any], index: dict[str, int]) -> Finger:
    tendon, flexure = table["tendons"][entry["tendon"]], table["flexures"][entry["flexure"]]
    (motor,) = [m for m in table["motors"] if m["drives"] == entry["name"]]
    swivel = entry.get("swivel")
    low, high = _value(motor, "travel")
    return Finger(
        name=entry["name"],
        swivel=None if swivel is None else (index[swivel["joint"]], float(_value(swivel, "sign"))),
        proximal=index[entry["proximal"]],
        distal=index[entry["distal"]],
        arms=(_value(tendon, "proximal_arm"), _value(tendon, "distal_arm")),
        spool_radius=_value(tendon, "spool_radius"),
        stiffness=_value(tendon, "stiffness"),
        damping=_value(tendon, "damping"),
        max_tension=_value(tendon, "max_tension"),
        stiffnesses=(_value(flexure, "proximal_stiffness"), _value(flexure, "stiffness")),
        rests=(_value(flexure, "proximal_rest"), _value(flexure, "rest")),
        joint_damping=(_value(flexure, "proximal_damping"), _value(flexure, "distal_damping")),
        armature=_value(flexure, "armature"),
        stop_stiffness=_value(flexure, "stop_stiffness"),
        speed=_value(motor, "default_speed"),
        travel=(float(low), float(high)),
    )


def read_hand(urdf: str, toml: str) -> HandDescription:
    """Read a hand.

    Parameters
    ----------
    urdf, toml : str
        The text of its URDF and of its ``hand.toml``.
    """
    table = tomllib.loads(toml)
    friction = {key: float(_value(table["friction"], key)) for key in ("pad", "bare")}
    links = _links(ET.fromstring(urdf), set(table["pads"]), friction)
    index = {link.joint: i for i, link in enumerate(links)}
    base_from_hand = np.eye(4)
    base_from_hand[:3, 3] = _value(table["base_from_hand"], "xyz")
    base_from_hand[:3, :3] = rotation_from_rpy(_value(table["base_from_hand"], "rpy"))
    fingers = tuple(_finger(entry, table, index) for entry in table["fingers"])
    return HandDescription(table["name"], links, fingers, base_from_hand)
