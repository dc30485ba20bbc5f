"""Helpers of the environment tests: cheap objects, and actions that lead to contact."""

import itertools
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets, planning
from graspbox.configs import CamerasConfig
from graspbox.envs.coding import encode_action, object_pose
from graspbox.envs.expert import ExpertGrasp, planned
from graspbox.envs.scripted import MotionOptions
from graspbox.envs.settings import Control, Fingers
from graspbox.simulation.layouts import Arrangement

#: Objects whose convex parts are known exactly: they are ready within milliseconds.
OBJECTS = ("procedural:ball:0-1", "procedural:can:0-1", "procedural:box:0-1")
#: Grasp-v0 with one number per actuator and an action each 0.05 s, as `pressing` acts.
EACH: dict[str, Any] = {"fingers": "each", "control_freq": 20.0}
#: Every meaning of an action of Grasp-v0 without an arm: control mode and fingers.
ACTING = tuple(itertools.product((mode for mode in get_args(Control) if mode != "joint_velocity"), get_args(Fingers)))
#: Every kind of task: an id, and keywords of the environment.
TASKS: dict[str, tuple[str, dict[str, Any]]] = {
    "Grasp": ("graspbox/Grasp-v0", EACH),
    "Grasp, target": ("graspbox/Grasp-v0", {**EACH, "layout": "pile", "objects_per_scene": (2, 3)}),
    "GraspPose": ("graspbox/GraspPose-v0", {}),
    "GraspPose, target": ("graspbox/GraspPose-v0", {"layout": "packed", "objects_per_scene": (2, 3)}),
    "Clear": ("graspbox/Clear-v0", {"layout": "packed", "objects_per_scene": (2, 3)}),
}
#: Those that are stepped in closed loop, and those whose step is a decision.
LOOPS = tuple(name for name, (env_id, _) in TASKS.items() if env_id == "graspbox/Grasp-v0")
DECISIONS = tuple(name for name in TASKS if name not in LOOPS)
#: Small images; 36 pixels are the least that Stable-Baselines3 takes without a warning.
CAMERAS = CamerasConfig(image_size=(36, 40), voxels=16)


def pressing(steps: int, count: int, seed: int = 0, motors: int = 3) -> NDArray[np.float32]:
    """Twist actions (steps, count, 7 + motors) of `EACH`: they shake the hand, move it ahead, and close it."""
    rng = np.random.default_rng(seed)
    actions = rng.uniform(-0.2, 0.2, (steps, count, 7 + motors))
    actions[:, :, 2] = 1.0
    actions[:, :, 6:-1] = np.where(np.arange(steps) % 25 > 12, 1.0, -1.0)[:, None, None]
    return actions.astype(np.float32)


def lower(actions: NDArray[np.float32], control: str) -> NDArray[np.float32]:
    """Let actions (..., k) of a control mode move the hand down to the table; how it closes stays as it is."""
    actions = actions.copy()
    if control == "target_pose":
        actions[..., 2:9] = [-1, 1, 0, 0, 0, -1, 0]
    else:
        # The palm faces down: ahead of the hand, and along the world's axis.
        actions[..., 2] = -1.0 if control == "top_down" else 1.0
    return actions


def columns_of(info: dict[str, Any]) -> set[str]:
    """Names of the entries of a vector info, masks left aside."""
    return {name for name in info if not name.startswith("_")}


def expert_actions(env: Any, seed: int) -> list[NDArray[np.float32]]:
    """Let the scripted expert do an episode of a single Grasp-v0 that observes its state; its actions, to the end."""
    state, info = env.reset(seed=seed)
    mesh = env.objects[env.objects.names.index(info["object"])].load()
    plan = planned(mesh, state, seed=seed)
    core = env.unwrapped._core
    options = MotionOptions(control=core.control, fingers=core.config.fingers, control_freq=core.config.control_freq)
    expert, actions, done = ExpertGrasp(state, plan.poses[0], plan.preshape[0], **options), [], False
    while not done and not expert.finished:
        actions.append(expert.act(state))
        state, _, done, _, _ = env.step(actions[-1])
    return actions


class Experts:
    """Scripted experts for environments that observe their states: `act` begins anew where an episode does."""

    def __init__(self, objects: object_sets.ObjectSet, count: int, **settings: Any) -> None:
        self._objects = objects
        self._settings = settings
        self._experts: list[ExpertGrasp | None] = [None] * count

    def act(self, states: NDArray[np.float32], names: NDArray[Any], starts: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Choose actions (num_envs, k) from states, names of the objects, and where episodes begin."""
        for i in np.flatnonzero(starts):
            mesh = self._objects[self._objects.names.index(names[i])].load()
            plan = planned(mesh, states[i], control=self._settings.get("control", "twist"))
            self._experts[i] = ExpertGrasp(states[i], plan.poses[0], plan.preshape[0], **self._settings)
        return np.stack([expert.act(state) for expert, state in zip(self._experts, states, strict=True) if expert])


def best_grasp(objects: object_sets.ObjectSet, name: str, state: NDArray[np.float32]) -> NDArray[np.float32]:
    """Name the planner's first pose as an action of GraspPose-v0, for an object as its state says that it lies."""
    plan = planning.plan(objects[objects.names.index(name)].load(), world_from_object=object_pose(state))
    return encode_action(object_pose(state) @ plan.poses[0], plan.preshape[0])


def over_the_highest(scene: Arrangement, hand: str = "reflex") -> NDArray[np.float32]:
    """Name the planner's first pose, of the target or of the object that reaches highest, as a decision.

    Zeros, which are infeasible, where nothing is left or there is no pose.
    """
    if not len(scene):
        return np.zeros_like(encode_action(np.eye(4), 0.0, hand=hand))
    tops = [
        float((mesh.vertices @ pose[2, :3]).max() + pose[2, 3])
        for mesh, pose in zip(scene.meshes, scene.world_from_objects, strict=True)
    ]
    index = int(np.argmax(tops)) if scene.target is None else scene.target
    pose = scene.world_from_objects[index]
    plan = planning.plan(scene.meshes[index], hand=hand, world_from_object=pose, neighbours=scene.without(index)).best(
        1
    )
    if not len(plan):
        return np.zeros_like(encode_action(np.eye(4), 0.0, hand=hand))
    return encode_action(pose @ plan.poses[0], float(plan.preshape[0]), hand=hand)
