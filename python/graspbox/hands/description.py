"""A hand as plain values, as the core read it: links with their joints and shapes, tendons, actuators and sensors.

A joint is given by the index of the link that it moves. Links are depth first from the base, children in the order of
the file: parents before children.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.rotations import rotation_about
from graspbox._core import Hand

Array = NDArray[np.float64]

#: Index of the base in `HandDescription.links`.
BASE = 0


@dataclass(frozen=True, eq=False)
class Shape:
    """A collision primitive of a link."""

    name: str
    #: ``box`` (half extents), ``cylinder`` (radius, half length) or ``sphere`` (radius); metres, in MuJoCo's order.
    kind: str
    size: tuple[float, ...]
    #: Pose of the shape, (4, 4), link frame.
    link_from_shape: Array
    #: Whether its surface is a pad's, and its friction factor.
    pad: bool
    friction: float


@dataclass(frozen=True)
class Spring:
    """Spring, damping, armature and stops of a joint; SI units, per rad or m."""

    stiffness: float
    reference: float
    damping: float
    armature: float
    stop_stiffness: float


@dataclass(frozen=True, eq=False)
class Link:
    """A link, with the joint that moves it relative to its parent."""

    #: Place among the links, and that of the parent; -1 for that of the base.
    index: int
    parent: int
    name: str
    #: Pose at joint position 0, (4, 4), parent's frame.
    parent_from_link: Array
    #: Name of the joint (empty for the base), its kind (``fixed``, ``revolute`` or ``prismatic``), (3,) axis of length
    #: 1, and limits in rad or m.
    joint: str
    kind: str
    axis: Array
    limits: tuple[float, float]
    #: Greatest force (N m or N) and speed (rad/s or m/s) that the URDF states; 0 for none.
    effort: float
    velocity: float
    #: For a mimic joint: the joint that it follows, ratio and offset.
    mimic: tuple[int, float, float] | None
    #: Whether the real joint has an encoder.
    encoder: bool
    mass: float
    #: Centre of mass (3,), metres, and inertia about it (3, 3), kg m2; link frame.
    center: Array
    inertia: Array
    shapes: tuple[Shape, ...]
    spring: Spring

    @property
    def moves(self) -> bool:
        """Whether its joint moves."""
        return self.kind != "fixed"

    @property
    def unit(self) -> str:
        """Unit of the position of its joint."""
        return "m" if self.kind == "prismatic" else "rad"


@dataclass(frozen=True)
class Tendon:
    """A tendon with its moment arms at joints, from base to tip; SI units."""

    name: str
    arms: tuple[tuple[int, float], ...]
    stiffness: float
    damping: float
    max_tension: float


@dataclass(frozen=True)
class Actuator:
    """Winds a tendon or drives joints; SI units."""

    name: str
    #: Index of the tendon and radius of its spool, or None.
    spool: tuple[int, float] | None
    #: Driven joints: joint, ratio, offset.
    joints: tuple[tuple[int, float, float], ...]
    #: Stiffness and damping of a servo; None for a rigid drive and for a spool.
    servo: tuple[float, float] | None
    #: Speed of position commands, travel, the load at which closing stops, and speed of force commands per load error.
    speed: float
    travel: tuple[float, float]
    load_limit: float
    force_gain: float
    #: Whether it closes the hand.
    closes: bool


@dataclass(frozen=True, eq=False)
class Sensor:
    """A tactile sensor: index of its link; position (m) and outward unit normal (3,), link frame."""

    link: int
    position: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class HandDescription:
    """A hand; its sensors are in the order of the observation ``tactile``."""

    name: str
    links: tuple[Link, ...]
    tendons: tuple[Tendon, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[Sensor, ...]
    #: Index of the actuator whose position is the preshape, if there is one, and its limits.
    preshape: int | None
    preshape_limits: tuple[float, float]
    #: Positions of actuators, by index, for each named preshape.
    named: tuple[dict[int, float], ...]
    #: Pose of the grasp frame, (4, 4), base frame.
    base_from_hand: Array
    #: Friction factors of pads and of all other shapes.
    pad_friction: float
    bare_friction: float
    #: Names of each two shapes that pass through each other.
    no_contact: frozenset[frozenset[str]]
    #: Rigid bodies that overlap in the open hand, each two by the indices of their first links: all of their shapes
    #: pass through each other.
    overlapping: tuple[tuple[int, int], ...]

    @property
    def moving(self) -> tuple[Link, ...]:
        """Links whose joints move, in the order of the rows of `graspbox.Hand.joint_frames`."""
        return tuple(link for link in self.links if link.moves)

    @property
    def carriers(self) -> tuple[int, ...]:
        """For each link, the row in `moving` of the joint that carries it; -1 for the palm."""
        rows = {link.index: row for row, link in enumerate(self.moving)}
        carriers: list[int] = []
        for link in self.links:
            carriers.append(rows.get(link.index, carriers[link.parent] if carriers else -1))
        return tuple(carriers)

    def open_positions(self, preshape: float) -> list[float]:
        """Return the positions of the actuators of the open hand."""
        positions = [actuator.travel[0] for actuator in self.actuators]
        if self.preshape is not None:
            positions[self.preshape] = preshape
        elif self.named:
            for index, position in self.named[round(preshape)].items():
                positions[index] = position
        return positions

    @cached_property
    def _drives(self) -> dict[int, tuple[int, float, float]]:
        """Actuator, ratio and offset of each driven joint."""
        driven = ((index, joint) for index, actuator in enumerate(self.actuators) for joint in actuator.joints)
        return {link: (index, ratio, offset) for index, (link, ratio, offset) in driven}

    def _is_rigid(self, link: int) -> bool:
        mimic = self.links[link].mimic
        if mimic is not None:
            return self._is_rigid(mimic[0])
        return link in self._drives and self.actuators[self._drives[link][0]].servo is None

    def start_position(self, link: int, positions: list[float]) -> float:
        """Return the position of a link's joint where a trial begins, rad or m.

        Driven joints are where their actuators' `positions` put them, mimic joints follow, and all others are at 0.
        """
        mimic = self.links[link].mimic
        if mimic is not None:
            return mimic[1] * self.start_position(mimic[0], positions) + mimic[2]
        if link not in self._drives:
            return 0.0
        index, ratio, offset = self._drives[link]
        position = ratio * positions[index] + offset
        low, high = self.links[link].limits
        return min(max(position, low), high) if self._is_rigid(link) else position

    def free(self) -> list[int]:
        """Return the indices of links with dynamic joints: neither fixed nor driven rigidly."""
        return [link.index for link in self.moving if not self._is_rigid(link.index)]


def independent(links: tuple[Link, ...]) -> tuple[Link, ...]:
    """Return the links whose joints move and follow no other, in the order of `graspbox.Hand.joints`."""
    return tuple(link for link in links if link.moves and link.mimic is None)


def passing_links(hand: Hand) -> tuple[str, ...]:
    """Return the links that overlap in the open hand, as "A and B": they pass through each other."""
    described = describe(hand)
    return tuple(f"{described.links[a].name} and {described.links[b].name}" for a, b in described.overlapping)


@lru_cache(maxsize=64)
def describe(hand: Hand) -> HandDescription:
    """Return all that the files of a hand say; arrays are read-only."""
    rows = dict(hand.description)
    rows["pad_friction"], rows["bare_friction"] = rows.pop("friction")
    rows["links"] = _links(rows["links"])
    rows["tendons"] = tuple(Tendon(**{**one, "arms": tuple(one["arms"])}) for one in rows["tendons"])
    rows["actuators"] = tuple(Actuator(**{**one, "joints": tuple(one["joints"])}) for one in rows["actuators"])
    rows["sensors"] = tuple(Sensor(s["link"], _array(s["position"]), _array(s["normal"])) for s in rows["sensors"])
    rows["named"] = tuple(map(dict, rows["named"]))
    rows["no_contact"] = frozenset(map(frozenset, rows["no_contact"]))
    rows["overlapping"] = tuple(rows["overlapping"])
    rows["base_from_hand"] = _array(rows["base_from_hand"])
    return HandDescription(**rows)


def describe_urdf(text: str, name: str) -> tuple[Link, ...]:
    """Return the links of a URDF, without springs and friction; `name` is that of the file in errors.

    Raises
    ------
    HandError
        If it describes no hand; the message lists every wrong line.
    """
    return _links(_core.describe_urdf(text, name) or [])


def describe_wrong_urdf(text: str) -> tuple[Link, ...] | None:
    """Return links even if their numbers are out of range, such as millimetres; None without a tree of links."""
    rows = _core.describe_urdf(text, "", anyway=True)
    return None if rows is None else _links(rows)


def _array(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _links(rows: list[dict[str, Any]]) -> tuple[Link, ...]:
    links = []
    for one in rows:
        shapes = (
            Shape(**{**each, "size": tuple(each["size"]), "link_from_shape": _array(each["link_from_shape"])})
            for each in one["shapes"]
        )
        arrays = {key: _array(one[key]) for key in ("parent_from_link", "axis", "center", "inertia")}
        links.append(Link(**{**one, **arrays, "shapes": tuple(shapes), "spring": Spring(**one["spring"])}))
    return tuple(links)


def joint_motion(link: Link, position: float) -> Array:
    """Return the motion (4, 4) of a link's joint from position 0, in the joint's frame."""
    motion = np.eye(4)
    if link.kind == "prismatic":
        motion[:3, 3] = link.axis * position
    else:
        motion[:3, :3] = rotation_about(link.axis, position)
    return motion
