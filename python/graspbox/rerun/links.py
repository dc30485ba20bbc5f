"""Links of a hand: names, frames and boxes, from its URDF and the core's kinematics."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand

__all__ = ["Link", "boxes_mesh", "link_frames", "links"]

Floats = NDArray[np.float64]
#: Corners of the sides of a box of half sides 1, counter-clockwise from outside: (6, 4, 3).
_SIDES = np.array(
    [
        [[s, -1, -1], [s, s, -s], [s, 1, 1], [s, -s, s]] if a == 0
        else [[-1, s, -1], [-s, s, s], [1, s, 1], [s, s, -s]] if a == 1
        else [[-1, -1, s], [s, -s, s], [1, 1, s], [-s, s, s]]
        for a in range(3)
        for s in (-1.0, 1.0)
    ]
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Link:
    """A link that moves on its own, or the palm.

    Attributes
    ----------
    name : str
        Name of the link in the URDF; ``palm`` for the base.
    boxes : tuple of ((4, 4) float64, (3,) float64)
        Its collision shapes as boxes: poses in the frame of the link's joint (the hand's, for the palm), half sides.
    """

    name: str
    boxes: tuple[tuple[Floats, Floats], ...]


def _transform(element: ElementTree.Element | None) -> Floats:
    """Read the origin of a joint."""
    pose = np.eye(4)
    if element is None:
        return pose
    roll, pitch, yaw = (float(v) for v in element.get("rpy", "0 0 0").split())
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = [float(v) for v in element.get("xyz", "0 0 0").split()]
    return pose


def _moved(joint: ElementTree.Element) -> Floats:
    """Displacement of a joint while all independent joints are at 0: the offset of a mimic joint."""
    mimic = joint.find("mimic")
    value = 0.0 if mimic is None else float(mimic.get("offset", "0"))
    pose = np.eye(4)
    if value == 0.0:
        return pose
    axis = joint.find("axis")
    way = np.array([float(v) for v in ("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split()])
    way = way / np.linalg.norm(way)
    if joint.get("type") == "prismatic":
        pose[:3, 3] = value * way
        return pose
    cross = np.array([[0, -way[2], way[1]], [way[2], 0, -way[0]], [-way[1], way[0], 0]])
    pose[:3, :3] = np.eye(3) + np.sin(value) * cross + (1 - np.cos(value)) * cross @ cross
    return pose


def _walk(
    children: dict[str, list[ElementTree.Element]], link: str, pose: Floats, row: list[int], carrier: int
) -> Iterator[tuple[str, Floats, int]]:
    """Yield links from the root to the tips: name, pose in the base at 0, and row of the joint that carries each."""
    yield link, pose, carrier
    for joint in children.get(link, []):
        child = joint.find("child")
        assert child is not None
        own = carrier
        if joint.get("type") != "fixed":
            row[0] += 1
            own = row[0]
        placed = pose @ _transform(joint.find("origin")) @ _moved(joint)
        yield from _walk(children, str(child.get("link")), placed, row, own)


def link_frames(hand: Hand) -> tuple[dict[str, int], dict[str, Floats]]:
    """Return, for each link of the URDF, its row among the palm and the joints that move, and its frame there.

    Returns
    -------
    dict of str to int
        0 for the palm; else 1 + the row of `graspbox.Hand.joint_frames`.
    dict of str to (4, 4) float64
        Frame of the link in that of its joint, or of the hand for the palm; metres.
    """
    root = ElementTree.fromstring(hand.files[0])
    children: dict[str, list[ElementTree.Element]] = {}
    below = set()
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        assert parent is not None
        assert child is not None
        children.setdefault(str(parent.get("link")), []).append(joint)
        below.add(child.get("link"))
    base = next(str(link.get("name")) for link in root.findall("link") if link.get("name") not in below)
    frames, _, _ = hand.joint_frames(np.zeros(len(hand.joints)))
    found = list(_walk(children, base, np.eye(4), [-1], -1))
    hand_from_base = _hand_from_base(hand)
    rows, offsets = {}, {}
    for name, pose, carrier in found:
        rows[name] = carrier + 1
        placed = hand_from_base @ pose
        offsets[name] = placed if carrier < 0 else np.linalg.inv(frames[carrier]) @ placed
    return rows, offsets


def _hand_from_base(hand: Hand) -> Floats:
    grasp = tomllib.loads(hand.files[1])["grasp"]
    origin = ElementTree.Element("origin")
    for name in ("xyz", "rpy"):
        origin.set(name, " ".join(str(float(v)) for v in grasp[name]["value"]))
    return np.asarray(np.linalg.inv(_transform(origin)))


def links(hand: Hand) -> list[Link]:
    """Return the palm and the links of all joints that move, in the order of `graspbox.Hand.joint_frames`."""
    zero = np.zeros(len(hand.joints))
    shapes, halves, _, carriers = hand.shapes(zero)
    frames, _, _ = hand.joint_frames(zero)
    rows, _ = link_frames(hand)
    names = ["palm"] * (1 + len(frames))
    for name, row in rows.items():
        if row and names[row] == "palm":
            names[row] = name
    found: list[Link] = []
    for row, name in enumerate(names):
        inverse = np.eye(4) if row == 0 else np.linalg.inv(frames[row - 1])
        own = np.flatnonzero(carriers == row - 1)
        found.append(Link(name, tuple((inverse @ shapes[i], halves[i]) for i in own)))
    return found


def boxes_mesh(boxes: tuple[tuple[Floats, Floats], ...]) -> tuple[Floats, NDArray[np.uint32], Floats]:
    """Return vertices (24 n, 3), faces (12 n, 3) and normals (24 n, 3) of boxes, with sharp edges."""
    vertices, normals = [], []
    for pose, half in boxes:
        corners = _SIDES * half
        vertices.append(corners.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3])
        ways = np.repeat(np.concatenate([[-e, e] for e in np.eye(3)]), 4, axis=0)
        normals.append(ways @ pose[:3, :3].T)
    sides = 4 * np.arange(6 * len(boxes))[:, None]
    halves = np.array([0, 1, 2]), np.array([0, 2, 3])
    faces = np.concatenate([sides + half for half in halves]).astype(np.uint32)
    return np.concatenate(vertices), faces, np.concatenate(normals)
