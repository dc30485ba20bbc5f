"""Frames of a hand's links, sensors and tendons, from its two files; the core gives frames of joints alone.

Positions follow `graspbox.Hand.joints`; mimic joints follow their leaders. The core has checked the files.
"""

import tomllib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspbox._common.rotations import rotation_from_euler
from graspbox.hands import Hand
from graspbox.viewer.geometry import Floats

__all__ = ["HandLinks", "Tendon"]

#: Length of a tendon beyond the last joint, metres.
_END = 0.015


@dataclass(frozen=True)
class _Link:
    """A link and the joint to its parent (-1 for the base)."""

    name: str
    parent: int
    parent_from_link: Floats
    joint: str
    kind: str
    axis: Floats
    follows: tuple[str, float, float] | None


@dataclass(frozen=True)
class Tendon:
    """A tendon: indices of the links whose joints it passes, from base to tip, and its moment arms there, metres."""

    name: str
    links: tuple[int, ...]
    arms: tuple[float, ...]


class HandLinks:
    """Links, sensors and tendons of a hand.

    Parameters
    ----------
    hand : Hand
        The hand.

    Attributes
    ----------
    names : list of str
        Names of the links, parents before children.
    sensor_links : (s,) int64
        Index of the link of each tactile sensor, in the order of the observation ``tactile``.
    tendons : list of Tendon
        The tendons, in the order of `graspbox.Hand.tendons`.
    """

    def __init__(self, hand: Hand) -> None:
        urdf, text = hand.files
        self._hand, self._table = hand, tomllib.loads(text)
        self._links = _links(ET.fromstring(urdf))
        self.names = [link.name for link in self._links]
        grasp = self._table["grasp"]
        self._hand_from_base = np.linalg.inv(_pose(grasp["xyz"]["value"], grasp["rpy"]["value"]))
        sensors = self._sensors()
        self.sensor_links = np.array([link for link, _, _ in sensors], dtype=np.int64)
        self._points = np.array([point for _, point, _ in sensors]).reshape(-1, 3)
        self._normals = np.array([normal for _, _, normal in sensors]).reshape(-1, 3)
        self.tendons = [self._tendon(name) for name in hand.tendons]

    def _sensors(self) -> list[tuple[int, Any, Any]]:
        """List link, position and normal of each sensor, in the core's order: link by link, as the file has them."""
        found = [
            (self.names.index(name), entry["position"]["value"], entry["normal"]["value"])
            for entry in self._table.get("sensors", [])
            for name in entry["links"]
        ]
        return sorted(found, key=lambda sensor: sensor[0])

    def _tendon(self, name: str) -> Tendon:
        arms = {joint: float(arm["value"]) for joint, arm in self._table["tendons"][name]["arms"].items()}
        passed = [(index, arms[link.joint]) for index, link in enumerate(self._links) if link.joint in arms]
        return Tendon(name, tuple(index for index, _ in passed), tuple(arm for _, arm in passed))

    def frames(self, positions: ArrayLike) -> Floats:
        """Return the frames of all links with the independent joints at `positions` (c,): hand_from_link (l, 4, 4)."""
        joint_positions = dict(zip(self._hand.joints, np.asarray(positions, dtype=np.float64).tolist(), strict=True))
        frames = np.zeros((len(self._links), 4, 4))
        for index, link in enumerate(self._links):
            parent = self._hand_from_base if link.parent < 0 else frames[link.parent]
            frames[index] = parent @ link.parent_from_link @ _moved(link, self._position(link, joint_positions))
        return frames

    def _position(self, link: _Link, joint_positions: dict[str, float]) -> float:
        if link.follows is None:
            return joint_positions.get(link.joint, 0.0)
        leader, ratio, offset = link.follows
        (found,) = [one for one in self._links if one.joint == leader]
        return ratio * self._position(found, joint_positions) + offset

    def sensors(self, frames: Floats) -> tuple[Floats, Floats]:
        """Return points and outward normals of the sensors, (s, 3) each, hand frame, given the result of `frames`."""
        at = frames[self.sensor_links]
        points = np.einsum("sij,sj->si", at[:, :3, :3], self._points) + at[:, :3, 3]
        return points, np.einsum("sij,sj->si", at[:, :3, :3], self._normals)

    def route(self, tendon: Tendon, frames: Floats) -> Floats:
        """Return a path for a tendon, segments (k, 2, 3), hand frame, metres: at its moment arm from each joint.

        The files of a hand give moment arms and no routes: the side is that on which a pull closes the joint. The path
        branches where the tendon pulls several fingers.
        """
        points: dict[int, Floats] = {}
        segments = []
        for link, arm in zip(tendon.links, tendon.arms, strict=True):
            axis = frames[link][:3, :3] @ self._links[link].axis
            way = self._outward(link, frames)
            side = np.cross(axis, way) if self._links[link].kind != "prismatic" else np.zeros(3)
            points[link] = frames[link][:3, 3] + arm * side / max(float(np.linalg.norm(side)), 1e-9)
            before = self._links[link].parent
            while before >= 0 and before not in points:
                before = self._links[before].parent
            if before >= 0:
                segments.append((points[before], points[link]))
        for link in tendon.links:
            if not any(self._below(other, link) for other in tendon.links):
                way = self._outward(link, frames)
                segments.append((points[link], points[link] + _END * way / max(float(np.linalg.norm(way)), 1e-9)))
        return np.array(segments)

    def _below(self, link: int, above: int) -> bool:
        """Return whether a link descends from another one."""
        link = self._links[link].parent
        while link >= 0 and link != above:
            link = self._links[link].parent
        return link == above

    def _outward(self, link: int, frames: Floats) -> Floats:
        """Return the way from a link's joint to its child's joint, or along x at the tip, hand frame, metres."""
        children = [i for i, one in enumerate(self._links) if one.parent == link]
        for child in children:
            way = frames[child][:3, 3] - frames[link][:3, 3]
            if np.linalg.norm(way) > 1e-4:
                found: Floats = way
                return found
        return 0.02 * np.asarray(frames[link][:3, 0])


def _moved(link: _Link, position: float) -> Floats:
    """Return the motion of a link's joint."""
    pose = np.eye(4)
    if link.kind == "prismatic":
        pose[:3, 3] = link.axis * position
    elif link.kind in ("revolute", "continuous"):
        x, y, z = link.axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        pose[:3, :3] += np.sin(position) * cross + (1 - np.cos(position)) * cross @ cross
    return pose


def _pose(xyz: Any, rpy: Any) -> Floats:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_euler(np.array([rpy], dtype=np.float64))[0]
    pose[:3, 3] = xyz
    return pose


def _origin(element: ET.Element | None) -> Floats:
    if element is None:
        return np.eye(4)
    xyz, rpy = (np.array(element.get(key, "0 0 0").split(), dtype=np.float64) for key in ("xyz", "rpy"))
    return _pose(xyz, rpy)


def _named(element: ET.Element, tag: str, key: str) -> str:
    found = element.find(tag)
    assert found is not None
    return found.attrib[key]


def _links(robot: ET.Element) -> list[_Link]:
    """Order the links from the base outwards, in the order of the file."""
    below: dict[str, list[ET.Element]] = {}
    children = set()
    for joint in robot.findall("joint"):
        below.setdefault(_named(joint, "parent", "link"), []).append(joint)
        children.add(_named(joint, "child", "link"))
    names = [element.attrib["name"] for element in robot.findall("link")]
    (base,) = [name for name in names if name not in children]
    found = [_Link(base, -1, np.eye(4), "", "fixed", np.array([1.0, 0, 0]), None)]
    waiting = [(0, joint) for joint in below.get(base, [])]
    while waiting:
        parent, joint = waiting.pop(0)
        axis, mimic, name = joint.find("axis"), joint.find("mimic"), _named(joint, "child", "link")
        way = np.array([1.0, 0, 0]) if axis is None else np.array(axis.attrib["xyz"].split(), dtype=np.float64)
        follows = None
        if mimic is not None:
            ratio, offset = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
            follows = (mimic.attrib["joint"], ratio, offset)
        pose, kind = _origin(joint.find("origin")), joint.attrib["type"]
        found.append(_Link(name, parent, pose, joint.attrib["name"], kind, way / np.linalg.norm(way), follows))
        # Depth first: the links of a chain follow each other.
        waiting[:0] = [(len(found) - 1, one) for one in below.get(name, [])]
    return found
