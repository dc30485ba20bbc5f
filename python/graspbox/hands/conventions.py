"""Names and frames of hands in other programs.

| frame | origin | axes | formats |
|---|---|---|---|
| ``hand`` | grasp frame, on the palm | z approach, x along which the fingers close | graspbox |
| ``base`` | base link of the URDF | of the base link | Isaac Grasp, DexGraspBench |
| ``gripper`` | base link of the URDF | of the base link, or as `CONVENTIONS` says | ACRONYM, GraspGen |
| ``vgn`` | on the palm, as `CONVENTIONS` says | z approach, y along which the fingers close | VGN, GIGA |

The grasp frame in the base link is an entry of ``hand.toml``, so your own hand needs no row in `CONVENTIONS`.

The order of joints in the arrays of this package is that of `graspbox.Hand.joints` for independent joints. Files
with all joints (DexGraspBench) list them in the order of the hand's URDF: depth first from the base link, children in
the order of the file, as MuJoCo orders them when it reads this URDF.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.hands.description import BASE, describe, independent
from graspbox.hands.loading import HandLike, load_hand

__all__ = ["CONVENTIONS", "Convention", "Frame", "Mechanism", "convention_of", "frame_from_hand", "mechanism_of"]

Array = NDArray[np.float64]
Frame = Literal["base", "gripper", "vgn"]


@dataclass(frozen=True)
class Convention:
    """Names and frame of a hand in other programs.

    Attributes
    ----------
    gripper, prefix : str
        Name of the hand in data sets, and prefix of the names of links and joints of graspbox's URDF.
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


class Mechanism:
    """Joints and actuators of a hand, in arrays.

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

    def __init__(self, hand: Hand) -> None:
        self._described = described = describe(hand)
        self.base_link = described.links[BASE].name
        self.base_from_hand = described.base_from_hand
        self.joints = tuple(link.joint for link in described.moving)
        self.limits = np.asarray(hand.joint_limits, dtype=np.float64).reshape(-1, 2)
        self._columns = {link.index: column for column, link in enumerate(independent(described.links))}
        self._own = [self.joints.index(name) for name in hand.joints]
        leaders = [link.mimic or (link.index, 1.0, 0.0) for link in described.moving]
        self._leaders = [self._columns[leader] for leader, _, _ in leaders]
        self._ratios, self._offsets = np.array([row[1:] for row in leaders]).reshape(-1, 2).T

    def all_positions(self, independent: Array) -> Array:
        """Return the positions (n, m) of all joints from those (n, c) of the independent joints, rad or m."""
        return np.asarray(self._ratios * independent[:, self._leaders] + self._offsets)

    def independent_positions(self, positions: Array) -> Array:
        """Return the positions (n, c) of the independent joints from those (n, m) of all joints, rad or m."""
        return positions[:, self._own]

    def commanded(self, independent: Array, actuators: Array) -> Array:
        """Return where the actuators, at positions (n, a), would move the independent joints (n, c) in free space.

        A joint that a servo drives goes to the servo's command. The joints of a tendon move on, in proportion to its
        moment arms, until the tendon is as long as its spool has wound. All stay within their limits; other joints stay
        where they are.
        """
        targets = independent.copy()
        driven = list(zip(self._described.actuators, actuators.T, strict=True))
        for actuator, position in driven:
            for link, ratio, offset in actuator.joints if actuator.servo is not None else ():
                targets[:, self._columns[link]] = ratio * position + offset
        for actuator, position in driven:
            if actuator.spool is not None:
                tendon, radius = actuator.spool
                arms = np.zeros(len(self._columns))
                for link, arm in self._described.tendons[tendon].arms:
                    arms[self._columns[link]] = arm
                excess = np.maximum(radius * position - independent @ arms, 0.0)
                targets += np.outer(excess / float(arms @ arms), arms)
        return np.clip(targets, self.limits[:, 0], self.limits[:, 1])


@lru_cache(maxsize=64)
def mechanism_of(hand: Hand) -> Mechanism:
    """Return joints and actuators of a hand."""
    return Mechanism(hand)


def frame_from_hand(hand: HandLike, frame: Frame) -> Array:
    """Return the pose (4, 4) of the grasp frame in the frame ``base``, ``gripper`` or ``vgn`` of a hand, metres.

    Raises
    ------
    ConfigError
        If there is no such frame, or no such hand (`graspbox.load_hand`).
    """
    hand = load_hand(hand)
    if frame not in get_args(Frame):
        raise ConfigError(f"there is no frame {frame!r}; choose from {', '.join(get_args(Frame))}")
    if frame == "vgn":
        return np.array(
            [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -convention_of(hand).vgn], [0, 0, 0, 1]]
        )
    base_from_hand = mechanism_of(hand).base_from_hand
    if frame == "base" or convention_of(hand).axes == "base":
        return base_from_hand.copy()
    base_from_gripper = np.eye(4)
    base_from_gripper[:3, :3] = base_from_hand[:3, :3]
    return np.asarray(np.linalg.inv(base_from_gripper) @ base_from_hand)
