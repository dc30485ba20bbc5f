"""Contents of an exported scene, in plain values: the object, the hand and where both are when a trial begins."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from graspbox._common.rotations import quaternion_from_rotation
from graspbox._core import Mesh
from graspbox.configs import PhysicsConfig
from graspbox.scene_export.description import BASE, Array, HandDescription, Link

__all__ = ["ObjectData", "SceneData", "Start", "joint_motion", "number_text", "quaternion", "rotation_about"]

#: Table top: side and thickness, metres, as in the core (``env/sim/src/scenery.rs``). Its upper face is at z = 0.
TABLE_SIDE, TABLE_THICKNESS = 1.2, 0.1


@dataclass(frozen=True)
class ObjectData:
    """An object to simulate, in its own frame; metres, kilograms."""

    name: str
    #: Convex parts, each (n, 3) points.
    parts: Sequence[Array]
    mass: float
    #: Centre of mass (3,), and inertia about it (3, 3).
    center: Array
    inertia: Array
    #: Resting pose on the table, (4, 4).
    world_from_object: Array
    #: Visual mesh, in the same frame.
    visual: Mesh | None = None

    @property
    def start(self) -> Array:
        """Resting pose (4, 4), raised so that no part is below the table.

        In the core a resting object is up to half a millimetre deep in the table, which would push it up elsewhere.
        """
        pose = self.world_from_object
        lowest = min(float((points @ pose[2, :3]).min()) for points in self.parts) + pose[2, 3]
        raised: Array = pose.copy()
        raised[2, 3] -= min(lowest, 0.0)
        return raised


@dataclass(frozen=True)
class Start:
    """A hand at the start of a trial: open, at a pose, with a preshape."""

    hand: HandDescription
    #: Pose of the grasp frame, (4, 4).
    world_from_hand: Array
    #: See `graspbox.Hand.preshape_limits`.
    preshape: float

    @property
    def world_from_base(self) -> Array:
        """Pose of the hand's base, (4, 4)."""
        return np.asarray(self.world_from_hand @ np.linalg.inv(self.hand.base_from_hand))

    @property
    def joints(self) -> dict[int, float]:
        """Position of every joint that moves, by the index of its link, rad or m."""
        hand = self.hand
        positions = hand.open_positions(self.preshape)
        moving = [i for i, link in enumerate(hand.links) if link.joint and link.kind != "fixed"]
        return {link: hand.start_position(link, positions) for link in moving}

    @property
    def world_from_links(self) -> list[Array]:
        """Pose of every link, each (4, 4)."""
        joints, poses = self.joints, [self.world_from_base]
        for index, link in enumerate(self.hand.links):
            if index != BASE:
                motion = joint_motion(link, joints.get(index, 0.0))
                poses.append(poses[link.parent] @ link.parent_from_link @ motion)
        return poses


@dataclass(frozen=True)
class SceneData:
    """All that an exported scene has: an object, and a hand that is about to grasp it, on the table."""

    object: ObjectData
    start: Start
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)

    @property
    def hand(self) -> HandDescription:
        """The hand."""
        return self.start.hand


def number_text(values: Iterable[float]) -> str:
    """Write numbers for an XML attribute; they are read back bit for bit."""
    return " ".join(repr(float(value)).removesuffix(".0") for value in values)


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a (3, 3) rotation."""
    return np.asarray(quaternion_from_rotation(np.asarray(rotation)[None])[0])


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the (3, 3) rotation by `angle` (rad) about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def joint_motion(link: Link, position: float) -> Array:
    """Return the motion (4, 4) of a link's joint from position 0, in the joint's frame."""
    motion = np.eye(4)
    if link.kind == "prismatic":
        motion[:3, 3] = link.axis * position
    else:
        motion[:3, :3] = rotation_about(link.axis, position)
    return motion
