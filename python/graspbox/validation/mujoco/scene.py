"""A compiled model of a trial: the MJCF of `graspbox.scene_export.mjcf`, and the indices of its parts.

`replay` sets the poses of the hand's base and rigidly driven links, moves the spools, and prescribes the carriage.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.scene_export.contents import ObjectData
from graspbox.scene_export.description import BASE, HandDescription
from graspbox.scene_export.mjcf import Numerics, mujoco_actuators, trial_model

__all__ = ["Numerics", "ObjectData", "Scene", "build", "indexed"]


@dataclass
class Scene:
    """A compiled model and the indices of its parts."""

    model: mujoco.MjModel
    hand: HandDescription
    object: ObjectData
    numerics: Numerics
    #: Masks over geoms.
    is_object: NDArray[np.bool_]
    is_scenery: NDArray[np.bool_]
    is_hand: NDArray[np.bool_]
    base_body: int
    object_body: int
    #: Address in ``qpos`` and index in ``qvel`` of each dynamic joint, by the index of its link.
    joints: dict[int, tuple[int, int]] = field(default_factory=dict)
    #: MuJoCo's actuators for each of the hand's actuators: one per tendon or driven joint, none for a rigid drive.
    actuators: list[list[int]] = field(default_factory=list)


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
    model = mujoco.MjModel.from_xml_string(trial_model(hand, item, physics, numerics))
    if patch > 0.0:
        model.geom_condim[:] = 4
        model.geom_friction[:, 1] = patch * model.geom_friction[:, 0]
    return indexed(model, hand, item, numerics)


def indexed(model: mujoco.MjModel, hand: HandDescription, item: ObjectData, numerics: Numerics) -> Scene:
    """Find the parts of a compiled model by their names."""
    names = [model.geom(i).name for i in range(model.ngeom)]
    is_object = np.array([n.startswith("object_") for n in names])
    is_scenery = np.array([n == "table" for n in names])
    scene = Scene(
        model=model,
        hand=hand,
        object=item,
        numerics=numerics,
        is_object=is_object,
        is_scenery=is_scenery,
        is_hand=~(is_object | is_scenery),
        base_body=model.body(hand.links[BASE].name).id,
        object_body=model.body("object").id,
    )
    for link in hand.free():
        joint = model.joint(hand.links[link].joint)
        scene.joints[link] = (int(joint.qposadr[0]), int(joint.dofadr[0]))
    for index in range(len(hand.actuators)):
        scene.actuators.append([model.actuator(name).id for name in mujoco_actuators(hand, index)])
    return scene
