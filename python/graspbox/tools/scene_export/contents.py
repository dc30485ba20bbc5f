"""Contents of an exported scene, in plain values: objects, walls, the hand, and where they are when a trial begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from graspbox._common.rotations import quaternion_from_rotation
from graspbox._core import Mesh
from graspbox.configs import PhysicsConfig
from graspbox.hands.description import BASE, Array, HandDescription, joint_motion
from graspbox.simulation import Scene
from graspbox.simulation.layouts import Arrangement

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
class WallData:
    """A fixed box with the friction of the table."""

    #: Pose, (4, 4), and half extents, (3,), metres.
    world_from_wall: Array
    half_extents: Array


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
        return {link.index: hand.start_position(link.index, positions) for link in hand.moving}

    @property
    def world_from_links(self) -> list[Array]:
        """Pose of every link, each (4, 4)."""
        joints, poses = self.joints, [self.world_from_base]
        for link in self.hand.links[BASE + 1 :]:
            poses.append(poses[link.parent] @ link.parent_from_link @ joint_motion(link, joints.get(link.index, 0.0)))
        return poses


@dataclass(frozen=True)
class SceneData:
    """An exported scene: objects and walls on the table, and perhaps a hand that is about to grasp."""

    #: One or more, in the order of `graspbox.Scene.of`.
    objects: tuple[ObjectData, ...]
    start: Start | None
    walls: tuple[WallData, ...] = ()
    #: Index of the object that is to be grasped; None if any of them may be.
    target: int | None = None
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)


def object_title(objects: Sequence[ObjectData]) -> str:
    """Return the name of one object, or the number of several."""
    return objects[0].name if len(objects) == 1 else f"{len(objects)} objects"


def object_names(count: int) -> list[str]:
    """Return the names of the objects in the files of a scene of `count`."""
    return ["object"] if count == 1 else [f"object_{number}" for number in range(count)]


def wall_names(count: int) -> list[str]:
    """Return the names of the walls in the files of a scene."""
    return [f"wall_{number}" for number in range(count)]


def object_data(scene: Scene) -> ObjectData:
    """Describe the object of a scene; of several, that of `graspbox.Scene.target`."""
    body, rest = scene.body, np.array(scene.world_from_object)
    return ObjectData(scene.name, body.parts, body.mass, body.center_of_mass, body.inertia, rest, scene.mesh)


def objects_of(scene: Scene) -> tuple[ObjectData, ...]:
    """Describe the objects of a scene, in the order of `graspbox.Scene.of`; they need not fit the hand."""
    objects = [
        object_data(Scene.of(Arrangement.of_one(mesh, pose), hand=scene.hand, physics=scene.physics))
        for mesh, pose in zip(scene.others, scene.world_from_others, strict=True)
    ]
    objects.insert(scene.target, object_data(scene))
    return tuple(objects)


def walls_of(scene: Scene) -> tuple[WallData, ...]:
    """Describe the walls of a scene."""
    walls = zip(scene.world_from_walls, scene.wall_half_extents, strict=True)
    return tuple(WallData(pose, half) for pose, half in walls)


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a (3, 3) rotation."""
    return np.asarray(quaternion_from_rotation(np.asarray(rotation)[None])[0])
