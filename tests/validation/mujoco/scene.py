"""A compiled model of a trial: the MJCF of `graspbox.tools.scene_export.mjcf`, and the indices of its parts.

`replay` sets the poses of the hand's base and rigidly driven links, moves the spools, and prescribes the carriage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.hands.description import BASE, HandDescription
from graspbox.tools.scene_export.contents import ObjectData, WallData, object_names
from graspbox.tools.scene_export.mjcf import Numerics, mujoco_actuators, scene_model

__all__ = ["Numerics", "ObjectData", "Scene", "add_patch", "build", "build_heap", "indexed"]


@dataclass
class Scene:
    """A compiled model and the indices of its parts."""

    model: mujoco.MjModel
    hand: HandDescription
    numerics: Numerics
    #: Masks over geoms.
    is_object: NDArray[np.bool_]
    is_scenery: NDArray[np.bool_]
    is_hand: NDArray[np.bool_]
    base_body: int
    #: The objects, one or more, and their bodies.
    objects: tuple[ObjectData, ...]
    object_bodies: tuple[int, ...]
    #: Address in ``qpos`` and index in ``qvel`` of each dynamic joint, by the index of its link.
    joints: dict[int, tuple[int, int]] = field(default_factory=dict)
    #: MuJoCo's actuators for each of the hand's actuators: one per tendon or driven joint, none for a rigid drive.
    actuators: list[list[int]] = field(default_factory=list)
    #: Before the names of the hand's parts in the model.
    prefix: str = ""

    @property
    def object(self) -> ObjectData:
        """The first object."""
        return self.objects[0]

    @property
    def object_body(self) -> int:
        """Body of the first object."""
        return self.object_bodies[0]


def build(
    hand: HandDescription,
    item: ObjectData,
    physics: PhysicsConfig | None = None,
    numerics: Numerics | None = None,
    *,
    patch: float = 0.0,
) -> Scene:
    """Compile the model of one object and the hand; gravity and friction are those of `physics`.

    With a `patch`, contacts also resist turning about their normal, as an area would whose mean distance from its
    middle is `patch` metres. Without it they are points: an object that two of them hold turns about the line between.
    """
    physics, numerics = physics or PhysicsConfig(), numerics or Numerics()
    if physics.friction.object != 1.0:
        # Only then does the factor of the other surface equal the coefficient.
        raise ConfigError(f"friction.object is {physics.friction.object}; the MuJoCo model needs 1")
    model = mujoco.MjModel.from_xml_string(scene_model([item], [], hand, physics, numerics))
    add_patch(model, patch)
    return indexed(model, hand, [item], numerics)


def add_patch(model: mujoco.MjModel, patch: float) -> None:
    """Let contacts resist turning about their normal: see `build`."""
    if patch > 0.0:
        model.geom_condim[:] = 4
        model.geom_friction[:, 1] = patch * model.geom_friction[:, 0]


def build_heap(
    hand: HandDescription,
    items: Sequence[ObjectData],
    walls: Sequence[WallData],
    numerics: Numerics | None = None,
    *,
    patch: float = 0.0,
) -> Scene:
    """Compile the model of one or more objects, walls and the hand, with default physics."""
    numerics = numerics or Numerics()
    model = mujoco.MjModel.from_xml_string(scene_model(items, walls, hand, PhysicsConfig(), numerics))
    add_patch(model, patch)
    return indexed(model, hand, items, numerics)


def indexed(
    model: mujoco.MjModel,
    hand: HandDescription,
    items: Sequence[ObjectData],
    numerics: Numerics,
    prefix: str = "",
) -> Scene:
    """Find the parts of a compiled model by their names; those of the hand have a prefix."""
    names = [model.geom(i).name for i in range(model.ngeom)]
    is_object = np.array([n.startswith("object_") for n in names])
    is_scenery = np.array([n == "table" or n.startswith("wall_") for n in names])
    scene = Scene(
        model=model,
        hand=hand,
        numerics=numerics,
        is_object=is_object,
        is_scenery=is_scenery,
        is_hand=~(is_object | is_scenery),
        base_body=model.body(prefix + hand.links[BASE].name).id,
        objects=tuple(items),
        object_bodies=tuple(int(model.body(name).id) for name in object_names(len(items))),
        prefix=prefix,
    )
    for link in hand.free():
        joint = model.joint(prefix + hand.links[link].joint)
        scene.joints[link] = (int(joint.qposadr[0]), int(joint.dofadr[0]))
    for index in range(len(hand.actuators)):
        scene.actuators.append([model.actuator(prefix + name).id for name in mujoco_actuators(hand, index)])
    return scene
