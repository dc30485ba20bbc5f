"""Privileged baselines: the planner's first pose, and the scripted expert."""

import contextlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox._core import Mesh
from graspbox.envs import GOAL_IDS, SINGLE_OBJECT_IDS, expert
from graspbox.envs.coding import encode_action, hand_pose, object_pose
from graspbox.envs.scripted import MotionOptions
from graspbox.errors import ConfigError, PathError
from graspbox.policies.base import SCRIPTED, Actions, Policy, Task
from graspbox.simulation import load_hand
from graspbox.simulation.layouts import Arrangement

__all__ = ["MAX_PRESS", "Expert", "KnownObject", "KnownObjects", "Planner"]

#: `PlanConfig.max_press` where attempts push neighbours aside, metres: of grasps that press deeper hardly any succeeds.
MAX_PRESS = 0.005

#: Among how many of the planner's best poses the expert chooses.
_CHOICES = 40
#: Among how many an arm looks for one to which it has a path.
_CARRIED = 50
#: A horizontal distance of a pose from the object that costs the expert as much as a turn of the hand by one radian,
#: metres.
_ASIDE = 0.05
#: Meshes that a policy keeps.
_MESHES = 128


class KnownObject(NamedTuple):
    """The object of an episode, and its neighbours; None without any."""

    mesh: Mesh
    around: Arrangement | None


class KnownObjects:
    """The objects of some environments, by name; raises ConfigError if there are several in a scene."""

    def __init__(self, task: Task) -> None:
        if task.layout != "single":
            raise ConfigError(f"layout is {task.layout!r}, but a policy that knows meshes by name needs 'single'")
        self._objects = task.objects
        self._indices = {name: i for i, name in enumerate(task.objects.names)}
        #: Loads the mesh of an object by its name; the last ones are kept.
        self.mesh = lru_cache(_MESHES)(self._load)

    def _load(self, name: str) -> Mesh:
        if name not in self._indices:
            raise ConfigError(f"there is no object {name!r} in the set {self._objects.name!r} of the policy")
        return self._objects[self._indices[name]].load()

    def name_in(self, info: Mapping[str, Any], policy: str) -> str:
        """Return the name of an episode's object in its info; errors, if it lacks, name the policy."""
        if "object" not in info:
            raise ConfigError(f"the policy {policy!r} needs info['object'], the object's name; pass info to reset")
        # With info='numeric' it is an index.
        entry = info["object"]
        return entry if isinstance(entry, str) else self._objects.names[int(entry)]


class Planner(Policy):
    """Grasps at the planner's first-ranked pose of the object as it lies; **privileged**.

    It plans once per episode, with the object's mesh and the observation ``state``, and among others with their meshes
    and poses too (`Task.scenes`). In ``GraspPose-v0`` the pose is the action, on an arm the first one to which it has a
    path (extra ``arm``); in ``Grasp-v0`` the scripted expert (`graspbox.envs.expert`) moves the
    hand there. Without a feasible pose its actions are zeros.
    """

    name = "planner"
    obs: str | tuple[str, ...] | None = "state"
    closed_loop_settings = SCRIPTED
    _names_poses = True

    def _bind(self, task: Task) -> None:
        if task.env_id not in SINGLE_OBJECT_IDS:
            other = "it does not act in goal tasks" if task.env_id in GOAL_IDS else "use 'scene_planner'"
            raise ConfigError(f"the policy {self.name!r} grasps a single object; in {task.env_id!r} {other}")
        self._hand, self._arm = load_hand(task.hand), task.arm_at()
        self._objects: list[str | None] = [None] * task.num_envs
        self._experts: list[expert.ExpertGrasp | None] = [None] * task.num_envs
        self._known = KnownObjects(task) if task.layout == "single" else None

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        # The plan waits for the first observation, which holds the object's pose.
        self._objects[env] = "" if self._known is None else self._known.name_in(info, self.name)
        self._experts[env] = None

    def act(self, observation: Any) -> Actions:
        """Plan if an episode has begun, and move on in the others."""
        states = observation if isinstance(self.task.obs, str) else observation["state"]
        actions = self._zeros()
        for env, state in enumerate(states):
            name, self._objects[env] = self._objects[env], None
            subject = None if name is None else self._subject(env, name)
            if not self.task.closed_loop:
                action = None if subject is None else self._decide(subject, state)
                if action is not None:
                    actions[env] = action
                continue
            if subject is not None:
                self._experts[env] = self._expert(subject, state)
            driver = self._experts[env]
            if driver is not None:
                actions[env] = driver.act(state)
        return actions

    def _subject(self, env: int, name: str) -> KnownObject:
        """Find the object of an episode that begins, and its neighbours."""
        if self._known is not None:
            return KnownObject(self._known.mesh(name), None)
        scene = self.task.scene(env, self.name)
        assert scene.target is not None  # these environments have one
        return KnownObject(scene.meshes[scene.target], scene.without(scene.target))

    def _decide(self, subject: KnownObject, state: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Encode the first-ranked pose, on an arm the first with a path, as an action; None without one."""
        pose = object_pose(state, hand=self._hand)
        mesh, around = subject
        plan = planning.plan(
            mesh, hand=self._hand, world_from_object=pose, neighbours=around, max_press=MAX_PRESS
        ).best(1 if self.task.arm is None else _CARRIED)
        if not len(plan):
            return None
        chosen = self._carried(plan, subject)
        if chosen is None:
            return None
        return encode_action(pose @ plan.poses[chosen], plan.preshape[chosen], hand=self._hand)

    def _carried(self, plan: planning.Plan, subject: KnownObject) -> int | None:
        """Return the first grasp to which the arm has a path, if any; without an arm, the first."""
        if self._arm is None:
            return 0
        arm, base, config = self._arm
        with contextlib.suppress(PathError):
            mesh, around = subject
            return plan.path(arm, base, hand=self._hand, mesh=mesh, neighbours=around, config=config).grasp
        return None

    def _expert(self, subject: KnownObject, state: NDArray[np.float32]) -> expert.ExpertGrasp | None:
        """Make the expert of an episode of ``Grasp-v0``."""
        task, (mesh, around) = self.task, subject
        plan = expert.planned(mesh, state, control=task.control, hand=self._hand, neighbours=around)
        if not len(plan):
            return None
        chosen = self._choose(plan, mesh, state)
        options = MotionOptions(
            control=task.control, fingers=task.fingers, hand=self._hand, control_freq=task.control_freq
        )
        clears = 0.0 if around is None else around.top()
        return expert.ExpertGrasp(state, plan.poses[chosen], plan.preshape[chosen], clears=clears, **options)

    def _choose(self, plan: planning.Plan, mesh: Mesh, state: NDArray[np.float32]) -> int:
        del plan, mesh, state
        return 0


class Expert(Planner):
    """The scripted expert of ``Grasp-v0``, as a demonstrator; **privileged**.

    As `Planner`, but of the planner's 40 best poses it takes the one that needs the least turn of the hand and is most
    nearly above the object. A policy that imitates it can infer that choice from its observations, unlike the planner's
    choice among similar poses.
    """

    name = "expert"
    env_id = "graspbox/Grasp-v0"

    def _bind(self, task: Task) -> None:
        if not task.closed_loop:
            raise ConfigError(f"the policy 'expert' acts in graspbox/Grasp-v0; for {task.env_id!r} load 'planner'")
        super()._bind(task)

    def _choose(self, plan: planning.Plan, mesh: Mesh, state: NDArray[np.float32]) -> int:
        control = self.task.control
        world_from_object = object_pose(state, control=control, hand=self._hand)
        world_from_hand = hand_pose(state, control=control, hand=self._hand)
        center = world_from_object @ np.append(mesh.bounds.mean(axis=0), 1.0)
        poses = world_from_object @ plan.poses[:_CHOICES]
        traces = np.einsum("nij,ij->n", poses[:, :3, :3], world_from_hand[:3, :3])
        turns = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        distances = np.linalg.norm(poses[:, :2, 3] - center[:2], axis=1)
        return int(np.argmin(turns + distances / _ASIDE))
