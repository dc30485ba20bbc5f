"""What to compare a policy with: random actions, zero actions, and the planner, in the same episodes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox.envs.coding import encode_action, hand_pose, object_pose
from graspbox.envs.expert import Expert, planned
from graspbox.envs.settings import HandArgument
from graspbox.sb3.running import evaluate, make_env
from graspbox.simulation import load_hand

__all__ = ["PLANNED", "Planner", "Random", "Zero", "references"]

Actions = NDArray[np.float32]

#: A pose this far from over the object counts like one radian of turn, metres.
_ASIDE = 0.05
#: Keywords of an environment that the planner needs to know too.
PLANNED = ("control", "frame_skip", "hand")


class Zero:
    """Zero actions."""

    def __init__(self, env: Any) -> None:
        self.env = env

    def predict(self, *_: Any, **__: Any) -> tuple[Actions, None]:
        """Act, as a policy of Stable-Baselines3 does."""
        return np.zeros((self.env.num_envs, *self.env.action_space.shape), dtype=np.float32), None


class Random(Zero):
    """Actions drawn evenly from the space."""

    def __init__(self, env: Any, seed: int) -> None:
        super().__init__(env)
        self._random = np.random.default_rng(seed)

    def predict(self, *_: Any, **__: Any) -> tuple[Actions, None]:
        """Act, as a policy of Stable-Baselines3 does."""
        space = self.env.action_space
        drawn = self._random.uniform(space.low, space.high, (self.env.num_envs, *space.shape))
        return drawn.astype(np.float32), None


class Planner(Zero):
    """Takes the planner's first pose of each object as it lies; needs ``obs="state"``.

    It knows the object's mesh, which no policy does. Where the planner proposes nothing, it does not act.

    Parameters
    ----------
    env, env_id
        What `graspbox.sb3.running.make_env` made, and its id.
    control, frame_skip
        Those of a closed-loop environment.
    hand : str, Hand or pair of paths
        The environment's.
    choices : int
        In closed loop, of so many of the planner's best poses the one is taken that asks for the least turn of the hand
        and stands most nearly over the object.
    """

    def __init__(
        self,
        env: Any,
        env_id: str,
        *,
        control: str = "twist",
        frame_skip: int = 1,
        hand: HandArgument = "reflex",
        choices: int = 1,
    ) -> None:
        super().__init__(env)
        self._frame_skip, self._choices, self._hand = frame_skip, choices, load_hand(hand)
        self._objects = env.get_attr("objects", 0)[0]
        self._closed_loop, self._control = env_id.startswith("graspbox/Grasp-"), control
        self._experts: list[Expert | None] = [None] * env.num_envs

    def predict(
        self, observation: Actions, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, None]:
        """Act, as a policy of Stable-Baselines3 does."""
        actions, _ = super().predict()
        for i, row in enumerate(observation):
            if self._closed_loop:
                if episode_start[i]:
                    self._experts[i] = self._expert(i, row)
                expert = self._experts[i]
                if expert is not None:
                    actions[i] = expert.act(row)
            else:
                actions[i] = self._decide(i, row, actions[i])
        return actions, None

    def _mesh(self, index: int) -> Any:
        return self._objects[self._objects.names.index(self.env.unwrapped.reset_infos[index]["object"])].load()

    def _expert(self, index: int, state: Actions) -> Expert | None:
        mesh = self._mesh(index)
        plan = planned(mesh, state, control=self._control, hand=self._hand)
        if not len(plan):
            return None
        settings: dict[str, Any] = {"control": self._control, "frame_skip": self._frame_skip, "hand": self._hand}
        chosen = self._nearest(state, plan, mesh.bounds.mean(axis=0)) if self._choices > 1 else 0
        return Expert(state, plan.poses[chosen], plan.preshape[chosen], **settings)

    def _nearest(self, state: Actions, plan: planning.Plan, center: NDArray[np.float64]) -> int:
        """Find, among the best poses, the one that asks for least turn and stands most nearly over the object."""
        lies = object_pose(state, control=self._control, hand=self._hand)
        stands = hand_pose(state, control=self._control, hand=self._hand)
        poses, middle = lies @ plan.poses[: self._choices], lies[:2, :3] @ center + lies[:2, 3]
        traces = np.einsum("nij,ij->n", poses[:, :3, :3], stands[:3, :3])
        turns = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        asides = np.linalg.norm(poses[:, :2, 3] - middle, axis=1)
        return int(np.argmin(turns + asides / _ASIDE))

    def _decide(self, index: int, state: Actions, nothing: Actions) -> Actions:
        pose = object_pose(state, hand=self._hand)
        plan = planning.plan(self._mesh(index), hand=self._hand, world_from_object=pose).best(1)
        if not len(plan):
            return nothing
        return encode_action(pose @ plan.poses[0], plan.preshape[0], hand=self._hand)


def references(env_id: str, num_envs: int, episodes: int, seed: int, **settings: Any) -> dict[str, dict[str, Any]]:
    """Evaluate random actions, zero actions and the planner.

    Parameters
    ----------
    env_id, num_envs, **settings
        As for `graspbox.sb3.running.make_env`; ``obs`` is set to ``"state"``.
    episodes, seed : int
        As for `graspbox.sb3.running.evaluate`.

    Returns
    -------
    dict
        What `graspbox.sb3.running.evaluate` gives, by name: ``random``, ``zero``, ``planner``.
    """
    env = make_env(env_id, num_envs, **{**settings, "obs": "state"})
    planner = Planner(env, env_id, **{name: settings[name] for name in PLANNED if name in settings})
    policies = {"random": Random(env, seed), "zero": Zero(env), "planner": planner}
    found = {name: evaluate(policy, env, episodes, seed) for name, policy in policies.items()}
    env.close()
    return found
