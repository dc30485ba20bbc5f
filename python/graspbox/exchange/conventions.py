"""Names and frames of hands in other programs.

| frame | origin | axes | formats |
|---|---|---|---|
| ``hand`` | grasp frame, on the palm | z approach, x along which the fingers close | graspbox |
| ``base`` | base link of the URDF | of the base link | Isaac Grasp, DexGraspBench |
| ``gripper`` | base link of the URDF | of the base link, or as `CONVENTIONS` says | ACRONYM, GraspGen |
| ``vgn`` | on the palm, as `CONVENTIONS` says | z approach, y along which the fingers close | VGN, GIGA |

The grasp frame in the base link is an entry of ``hand.toml``, so your own hand needs no row in `CONVENTIONS`.

The order of joints in the arrays of this package is that of `graspbox.Hand.joints` for independent joints. Files that
with all joints (DexGraspBench) list them in the order of the hand's URDF: depth first from the base link, children in
the order of the file, as MuJoCo orders them when it reads this URDF.
"""

import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspbox._common.rotations import rotation_from_euler
from graspbox._core import Hand

__all__ = ["CONVENTIONS", "Convention", "Frame", "Mechanism", "convention_of", "frame_from_hand", "mechanism_of"]

Array = NDArray[np.float64]
Frame = Literal["base", "gripper", "vgn"]


@dataclass(frozen=True)
class Convention:
    """Names and frame of a hand in other programs.

    Attributes
    ----------
    gripper : str
        Name of the hand in data sets.
    prefix : str
        Prefix of the names of links and joints of graspbox's URDF in other programs.
    axes : {"base", "grasp"}
        Axes of the frame ``gripper``: those of the base link, or of the grasp frame.
    vgn : float
        Height of the origin of the frame ``vgn`` over that of the grasp frame, along z, metres.
    """

    gripper: str
    prefix: str = ""
    axes: Literal["base", "grasp"] = "base"
    vgn: float = 0.0


#: Hands with another name or frame in other programs, by their name in graspbox. In ACRONYM and GraspGen the
#: fingers of the Franka Hand close along x, while they move along y of its link ``panda_hand``. Those of the Robotiq
#: gripper close along x of its base link; GraspGen writes its grippers as ``robotiq_2f_140``. VGN's frame is 0.065 m in
#: front of the flange (``config/panda.yaml`` of ``ethz-asl/vgn``), the grasp frame 0.066 m.
CONVENTIONS = {
    "panda_gripper": Convention("panda", prefix="panda_", axes="grasp", vgn=-0.001),
    "robotiq_2f_85": Convention("robotiq_2f_85", prefix="robotiq_85_"),
}


def convention_of(hand: Hand) -> Convention:
    """Return the names and the frame of a hand in other programs; by default its own name and base link."""
    return CONVENTIONS.get(hand.name) or Convention(hand.name)


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Joints and actuators of a hand, as its two files list them.

    Attributes
    ----------
    base_link : str
        Root of the URDF.
    base_from_hand : (4, 4) float64
        Grasp frame in the frame of the base link, metres.
    joints : tuple of str
        All m joints that move, depth first from the base link.
    limits : (c, 2) float64
        Limits of the c independent joints, rad or m.
    """

    base_link: str
    base_from_hand: Array
    joints: tuple[str, ...]
    limits: Array
    #: For each joint the column of its independent joint, and its ratio and offset to it.
    _follows: tuple[tuple[int, float, float], ...]
    #: Place of each independent joint among all joints.
    _own: tuple[int, ...]
    #: Per servo: actuator, independent joint, ratio, offset.
    _servos: tuple[tuple[int, int, float, float], ...]
    #: Per spool: actuator, radius (m), and moment arms (c,) of its tendon (m).
    _spools: tuple[tuple[int, float, Array], ...]

    def all_positions(self, independent: Array) -> Array:
        """Return the positions (n, m) of all joints from those (n, c) of the independent joints, rad or m."""
        columns = [ratio * independent[:, column] + offset for column, ratio, offset in self._follows]
        return np.stack(columns, axis=1) if columns else np.zeros((len(independent), 0))

    def independent_positions(self, positions: Array) -> Array:
        """Return the positions (n, c) of the independent joints from those (n, m) of all joints, rad or m."""
        return positions[:, list(self._own)]

    def commanded(self, independent: Array, actuators: Array) -> Array:
        """Return where the actuators would move the joints if nothing were in the way.

        A joint that a servo drives goes to the servo's command. The joints of a tendon move on, in proportion to its
        moment arms, until the tendon is as long as its spool has wound. All stay within their limits; other joints stay
        where they are.

        Parameters
        ----------
        independent : (n, c) float64
            Positions of the independent joints, rad or m.
        actuators : (n, a) float64
            Positions of the actuators, rad or m.
        """
        found = independent.copy()
        for actuator, joint, ratio, offset in self._servos:
            found[:, joint] = ratio * actuators[:, actuator] + offset
        for actuator, radius, arms in self._spools:
            excess = np.maximum(radius * actuators[:, actuator] - independent @ arms, 0.0)
            found += np.outer(excess / float(arms @ arms), arms)
        return np.clip(found, self.limits[:, 0], self.limits[:, 1])


@lru_cache(maxsize=64)
def mechanism_of(hand: Hand) -> Mechanism:
    """Read joints and actuators from the files of a hand, which the core has checked."""
    urdf, toml = hand.files
    robot, table = ET.fromstring(urdf), tomllib.loads(toml)
    children = {child.attrib["link"] for child in robot.iterfind("joint/child")}
    base = next(link.attrib["name"] for link in robot.findall("link") if link.attrib["name"] not in children)
    column = {name: index for index, name in enumerate(hand.joints)}
    joints = list(_depth_first(robot, base))
    follows = []
    for joint in joints:
        mimic = joint.find("mimic")
        name = joint.attrib["name"] if mimic is None else mimic.attrib["joint"]
        ratio, offset = (1.0, 0.0) if mimic is None else (mimic.get("multiplier", "1"), mimic.get("offset", "0"))
        follows.append((column[name], float(ratio), float(offset)))
    names = [joint.attrib["name"] for joint in joints]
    return Mechanism(
        base_link=base,
        base_from_hand=_grasp_frame(table["grasp"]),
        joints=tuple(names),
        limits=np.asarray(hand.joint_limits, dtype=np.float64).reshape(-1, 2),
        _follows=tuple(follows),
        _own=tuple(names.index(name) for name in hand.joints),
        _servos=tuple(_servos(table, column)),
        _spools=tuple(_spools(table, column)),
    )


def _grasp_frame(grasp: dict[str, Any]) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_euler(np.array([grasp["rpy"]["value"]], dtype=np.float64))[0]
    pose[:3, 3] = grasp["xyz"]["value"]
    return pose


def _depth_first(robot: ET.Element, link: str) -> Iterator[ET.Element]:
    """Yield the joints that move, from a link outwards."""
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None and parent.attrib["link"] == link:
            if joint.attrib["type"] != "fixed":
                yield joint
            yield from _depth_first(robot, child.attrib["link"])


def _servos(table: dict[str, Any], column: dict[str, int]) -> Iterator[tuple[int, int, float, float]]:
    for index, actuator in enumerate(table["actuators"]):
        for joint, numbers in actuator.get("servo", {}).get("joints", {}).items():
            offset = numbers.get("offset", {"value": 0.0})["value"]
            yield index, column[joint], float(numbers["ratio"]["value"]), float(offset)


def _spools(table: dict[str, Any], column: dict[str, int]) -> Iterator[tuple[int, float, Array]]:
    for index, actuator in enumerate(table["actuators"]):
        if "spool" in actuator:
            arms = np.zeros(len(column))
            for joint, arm in table["tendons"][actuator["spool"]["tendon"]]["arms"].items():
                arms[column[joint]] = float(arm["value"])
            yield index, float(actuator["spool"]["radius"]["value"]), arms


def frame_from_hand(hand: Hand, frame: Frame) -> Array:
    """Return the pose (4, 4) of the grasp frame in the frame ``base``, ``gripper`` or ``vgn`` of a hand, metres."""
    if frame == "vgn":
        return np.array(
            [
                [0.0, -1.0, 0.0, 0.0],
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, -convention_of(hand).vgn],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    base_from_hand = mechanism_of(hand).base_from_hand
    if frame == "base" or convention_of(hand).axes == "base":
        return base_from_hand.copy()
    base_from_gripper = np.eye(4)
    base_from_gripper[:3, :3] = base_from_hand[:3, :3]
    return np.asarray(np.linalg.inv(base_from_gripper) @ base_from_hand)
