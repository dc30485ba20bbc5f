"""Links and joints of a URDF in the core's order, for checks and guesses.

The core reads the same file strictly and names every wrong line, so this reader replaces missing and unreadable numbers
by zeros. It has no collision geometry: `graspbox.Hand.shapes` gives the boxes.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.rotations import rotation_from_euler
from graspbox.errors import HandError

__all__ = ["Joint", "Link", "Tree", "read_tree"]

Floats = NDArray[np.float64]

#: Greatest size of a URDF, characters, as in the core.
_LIMIT = 1 << 20
#: Step of numeric derivatives, rad or m.
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Link:
    """A link: mass (kg), centre of mass (3,) (m), inertia about it (3, 3) (kg m2), link frame; names of its shapes."""

    name: str
    mass: float
    center: Floats
    inertia: Floats
    colliders: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links, which are given by their indices; rad, m, N m or N, and their rates per second.

    ``mimic`` names the joint that it follows, with ratio and offset. ``effort`` and ``velocity`` are 0 if absent.
    """

    name: str
    kind: str
    parent: int
    child: int
    parent_from_joint: Floats
    axis: Floats
    limits: tuple[float, float]
    effort: float
    velocity: float
    mimic: tuple[str, float, float] | None

    @property
    def unit(self) -> str:
        """Unit of its position."""
        return "m" if self.kind == "prismatic" else "rad"

    def motion(self, position: float) -> Floats:
        """Return the (4, 4) motion of its child at a position, rad or m."""
        pose = np.eye(4)
        if self.kind == "prismatic":
            pose[:3, 3] = position * self.axis
        elif self.kind != "fixed":
            x, y, z = self.axis
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            pose[:3, :3] += np.sin(position) * cross + (1.0 - np.cos(position)) * cross @ cross
        return pose


@dataclass(frozen=True, eq=False)
class Tree:
    """Links and joints, depth first from the base: joint i moves link i + 1."""

    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = field(default=())

    @cached_property
    def moving(self) -> tuple[Joint, ...]:
        """Joints that move, in the order of the rows of `graspbox.Hand.joint_frames`."""
        return tuple(joint for joint in self.joints if joint.kind != "fixed")

    @cached_property
    def independent(self) -> tuple[Joint, ...]:
        """Joints that move and follow no other, in the order of `graspbox.Hand.joints`."""
        return tuple(joint for joint in self.moving if joint.mimic is None)

    @cached_property
    def body_of(self) -> tuple[int, ...]:
        """For each link, the row in `moving` of the joint that carries it; -1 for the palm."""
        rows = {joint.child: row for row, joint in enumerate(self.moving)}
        found = [-1] * len(self.links)
        for joint in self.joints:
            found[joint.child] = rows.get(joint.child, found[joint.parent])
        return tuple(found)

    def parent_body(self, row: int) -> int:
        """Return the row of the joint that carries the parent of a moving joint; -1 for the palm."""
        return self.body_of[self.moving[row].parent]

    def body_name(self, row: int) -> str:
        """Return the name of the first link of a rigid body, by its row in `moving`; -1 for the palm."""
        return self.links[0 if row < 0 else self.moving[row].child].name

    def led(self, leader: int) -> list[tuple[Joint, float]]:
        """Return the joints that an independent joint moves, itself first, with their ratios to it."""
        own = self.independent[leader]
        followers = [(j, j.mimic[1]) for j in self.moving if j.mimic is not None and j.mimic[0] == own.name]
        return [(own, 1.0), *followers]

    def link_poses(self, positions: ArrayLike) -> Floats:
        """Return the poses (n, 4, 4) of the links in the base's frame.

        Parameters
        ----------
        positions : (c,) array_like
            Positions of the independent joints, rad or m.
        """
        values = np.asarray(positions, dtype=np.float64)
        at = {joint.name: float(value) for joint, value in zip(self.independent, values, strict=True)}
        poses = np.tile(np.eye(4), (len(self.links), 1, 1))
        for joint in self.joints:
            position = at.get(joint.name, 0.0)
            if joint.mimic is not None:
                leader, ratio, offset = joint.mimic
                position = ratio * at.get(leader, 0.0) + offset
            poses[joint.child] = poses[joint.parent] @ joint.parent_from_joint @ joint.motion(position)
        return poses

    def inertia_of(self, leader: int, positions: ArrayLike) -> float:
        """Return the inertia that an independent joint moves at `positions` (c,), kg m2 or kg; no armature."""
        values = np.asarray(positions, dtype=np.float64)
        step = np.zeros(len(values))
        step[leader] = _STEP
        before, after = self.link_poses(values - step), self.link_poses(values + step)
        total = 0.0
        for link, first, second in zip(self.links, before, after, strict=True):
            speed = ((second - first) @ np.append(link.center, 1.0))[:3] / (2 * _STEP)
            turn = (second[:3, :3] - first[:3, :3]) @ first[:3, :3].T / (2 * _STEP)
            rate = first[:3, :3].T @ np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
            total += link.mass * float(speed @ speed) + float(rate @ link.inertia @ rate)
        return total


def read_tree(text: str) -> Tree:
    """Read a URDF.

    Raises
    ------
    HandError
        If it is too large, is not XML, or has a document type declaration.
    """
    if len(text) > _LIMIT:
        raise HandError(f"the URDF has {len(text)} characters; give at most {_LIMIT}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise HandError("the URDF has a document type declaration; remove it")
    try:
        robot = ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        raise HandError(f"the URDF is not XML: {error}") from None
    elements = {link.get("name", ""): link for link in robot.findall("link")}
    below: dict[str, list[tuple[ET.Element, str]]] = {}
    children = set()
    for joint in robot.findall("joint"):
        parent, child = (_attribute(joint.find(end), "link") for end in ("parent", "child"))
        if parent in elements and child in elements:
            below.setdefault(parent, []).append((joint, child))
            children.add(child)
    roots = [name for name in elements if name not in children]
    links: list[Link] = []
    joints: list[Joint] = []
    stack: list[tuple[str, int, ET.Element | None]] = [(roots[0], -1, None)] if roots else []
    index: dict[str, int] = {}
    while stack:
        name, above, element = stack.pop()
        if name in index:
            continue
        index[name] = len(links)
        links.append(_link(name, elements[name]))
        if element is not None:
            joints.append(_joint(element, above, index[name]))
        stack += [(child, index[name], joint) for joint, child in reversed(below.get(name, []))]
    return Tree(tuple(links), tuple(joints))


def _attribute(element: ET.Element | None, name: str, default: str = "") -> str:
    return default if element is None else element.get(name, default)


def _number(element: ET.Element | None, name: str, default: float = 0.0) -> float:
    try:
        value = float(_attribute(element, name))
    except ValueError:
        return default
    return value if np.isfinite(value) else default


def _triple(element: ET.Element | None, name: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Floats:
    words = _attribute(element, name).split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    return values if values.shape == (3,) and np.isfinite(values).all() else np.array(default)


def _pose(element: ET.Element | None) -> Floats:
    pose = np.eye(4)
    pose[:3, 3] = _triple(element, "xyz")
    pose[:3, :3] = rotation_from_euler(_triple(element, "rpy")[None])[0]
    return pose


def _link(name: str, element: ET.Element) -> Link:
    inertial = element.find("inertial")
    origin, mass, moments = (None if inertial is None else inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    keys = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
    own = np.array([[_number(moments, key) for key in row] for row in keys])
    pose = _pose(origin)
    colliders = enumerate(element.findall("collision"))
    names = tuple(collider.get("name") or f"{name}_{number}" for number, collider in colliders)
    return Link(name, _number(mass, "value"), pose[:3, 3], pose[:3, :3] @ own @ pose[:3, :3].T, names)


def _joint(element: ET.Element, parent: int, child: int) -> Joint:
    limit, mimic, kind = element.find("limit"), element.find("mimic"), element.get("type", "fixed")
    axis = _triple(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(axis))
    follows = None
    if mimic is not None:
        follows = (mimic.get("joint", ""), _number(mimic, "multiplier", 1.0), _number(mimic, "offset"))
    return Joint(
        name=element.get("name", ""),
        kind=kind,
        parent=parent,
        child=child,
        parent_from_joint=_pose(element.find("origin")),
        axis=axis / length if length > 0 else np.array([1.0, 0.0, 0.0]),
        limits=(_number(limit, "lower"), _number(limit, "upper")),
        effort=_number(limit, "effort"),
        velocity=_number(limit, "velocity"),
        mimic=follows,
    )
