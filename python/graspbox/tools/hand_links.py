"""Links of a hand for views and recordings: their collision boxes, frames, sensors, tendons, and joints of a state.

Positions follow `graspbox.Hand.joints`; mimic joints follow their leaders.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.envs import spaces
from graspbox.envs.coding import Codec
from graspbox.hands import Hand
from graspbox.hands.description import Tendon, describe
from graspbox.meshes.shapes import Floats

#: Length of a tendon beyond the last joint, metres.
_END = 0.015


@dataclass(frozen=True, eq=False)
class LinkBoxes:
    """The collision boxes of the palm, or of a link that moves with the links fixed to it.

    Attributes
    ----------
    name : str
        Name of the link in the URDF; ``palm`` for the base.
    frames : (n, 4, 4) float64
        Poses of the boxes in the frame of the link's joint; of the hand, for the palm; metres.
    half_extents : (n, 3) float64
        Metres.
    pads : (n,) bool
        Whether each is a pad.
    revolute : bool
        Whether the link's joint is revolute.
    """

    name: str
    frames: Floats
    half_extents: Floats
    pads: NDArray[np.bool_]
    revolute: bool


def link_boxes(hand: Hand) -> list[LinkBoxes]:
    """Return the boxes of the palm and of all links that move, in the order of `moving_frames`."""
    zero = np.zeros(len(hand.joints))
    shapes, half_extents, pads, carriers = hand.shapes(zero)
    names = ["palm", *(link.name for link in describe(hand).moving)]
    revolute = [False, *hand.joint_frames(zero)[2].tolist()]
    links = []
    for row, frame in enumerate(moving_frames(hand, zero)):
        own = carriers == row - 1
        frames = np.linalg.inv(frame) @ shapes[own]
        links.append(LinkBoxes(names[row], frames, half_extents[own], pads[own], revolute[row]))
    return links


def moving_frames(hand: Hand, joints: ArrayLike) -> Floats:
    """Return the frames (1 + j, 4, 4) of the palm, which is the identity, and of each joint that moves, hand frame."""
    frames, _, _ = hand.joint_frames(np.ascontiguousarray(joints, dtype=np.float64))
    return np.concatenate([np.eye(4)[None], frames])


class HandLinks:
    """Frames, sensors and tendons of a hand.

    Attributes
    ----------
    names : list of str
        Names of the links, parents before children.
    sensor_links : (s,) int64
        Index of the link of each tactile sensor, in the order of the observation ``tactile``.
    tendons : tuple of Tendon
        The tendons, in the order of `graspbox.Hand.tendons`.
    """

    def __init__(self, hand: Hand) -> None:
        self._hand, described = hand, describe(hand)
        self._links, self.tendons = described.links, described.tendons
        self.names = [link.name for link in self._links]
        self.sensor_links = np.array([sensor.link for sensor in described.sensors], dtype=np.int64)
        self._points = np.array([sensor.position for sensor in described.sensors]).reshape(-1, 3)
        self._normals = np.array([sensor.normal for sensor in described.sensors]).reshape(-1, 3)

    def frames(self, joints: ArrayLike) -> Floats:
        """Return hand_from_link (l, 4, 4) of all links with the independent joints at positions (c,)."""
        return self._hand.link_frames(np.ascontiguousarray(joints, dtype=np.float64))

    def sensors(self, frames: Floats) -> tuple[Floats, Floats]:
        """Return points and outward normals of the sensors, (s, 3) each, hand frame, from the result of `frames`."""
        at = frames[self.sensor_links]
        points = np.einsum("sij,sj->si", at[:, :3, :3], self._points) + at[:, :3, 3]
        return points, np.einsum("sij,sj->si", at[:, :3, :3], self._normals)

    def route(self, tendon: Tendon, frames: Floats) -> Floats:
        """Return a path for a tendon, segments (k, 2, 3), hand frame, metres: at its moment arm from each joint.

        The files of a hand define moment arms and no routes: the side is that on which a pull closes the joint. The
        path branches where the tendon pulls several fingers.
        """
        points: dict[int, Floats] = {}
        segments = []
        for index, arm in tendon.arms:
            link, outward = self._links[index], self._outward(index, frames)
            side = np.zeros(3) if link.kind == "prismatic" else np.cross(frames[index][:3, :3] @ link.axis, outward)
            points[index] = frames[index][:3, 3] + arm * _unit(side)
            before = link.parent
            while before >= 0 and before not in points:
                before = self._links[before].parent
            if before >= 0:
                segments.append((points[before], points[index]))
        for index in points:
            if not any(self._descends(other, index) for other in points):
                segments.append((points[index], points[index] + _END * _unit(self._outward(index, frames))))
        return np.array(segments)

    def _descends(self, link: int, ancestor: int) -> bool:
        link = self._links[link].parent
        while link >= 0 and link != ancestor:
            link = self._links[link].parent
        return link == ancestor

    def _outward(self, link: int, frames: Floats) -> Floats:
        """Return the way from a link's joint to its child's joint, or along x at the tip, hand frame, metres."""
        for child, one in enumerate(self._links):
            way = frames[child][:3, 3] - frames[link][:3, 3]
            if one.parent == link and np.linalg.norm(way) > 1e-4:
                return np.asarray(way)
        return 0.02 * np.asarray(frames[link][:3, 0])


def _unit(way: Floats) -> Floats:
    return way / max(float(np.linalg.norm(way)), 1e-9)


def state_joints(codec: Codec, hand: Hand) -> Callable[[Any], Floats]:
    """Make a function that reads the positions (c,) of the independent joints from a state of ``Grasp-v0``.

    The table of observations names the joints of each column; other joints follow from the preshape and the travel of
    the first actuator.
    """
    # Every control mode has the same columns, but for the length of the last action.
    rows = {row["name"]: row for row in spaces.tables(hand)["observations"]["twist"]["synergy"]["state"]}
    places: dict[str, list[int]] = {}
    for name, row in rows.items():
        joints = row["meaning"].removeprefix("position of ").split(", ")
        if len(joints) == row["size"] and set(joints) <= set(hand.joints):
            places[name] = [hand.joints.index(joint) for joint in joints]

    def read(state: Any) -> Floats:
        low, high = hand.preshape_limits
        preshape = float(codec.column(state, "preshape")[0]) if "preshape" in rows else low
        share = 0.0
        if "actuator" in rows:
            least, most = rows["actuator"]["low"], rows["actuator"]["high"]
            share = float(np.clip((codec.column(state, "actuator")[0] - least) / (most - least), 0.0, 1.0))
        positions = np.array(hand.closed(float(np.clip(preshape, low, high)), share))
        for name, joints in places.items():
            positions[joints] = codec.column(state, name)
        return positions

    return read
