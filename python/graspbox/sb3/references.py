"""What to compare a policy with: random actions, zero actions, and the planner, in the same episodes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox.envs.expert import Expert, planned
from graspbox.envs.grasp_pose import POSITION_HIGH, POSITION_LOW
from graspbox.sb3.running import evaluate, make_env
from graspbox.simulation import load_hand

__all__ = ["Planner", "Random", "Zero", "references"]

Actions = NDArray[np.float32]


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
    """

    def __init__(self, env: Any, env_id: str, control: str = "twist") -> None:
        super().__init__(env)
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
        plan = planned(self._mesh(index), state, control=self._control)
        return Expert(state, plan.poses[0], plan.preshape[0], control=self._control) if len(plan) else None  # type: ignore[arg-type]

    def _decide(self, index: int, state: Actions, nothing: Actions) -> Actions:
        pose = np.eye(4)
        first, second = state[3:6].astype(np.float64), state[6:9].astype(np.float64)
        pose[:3, :3] = np.stack([first, second, np.cross(first, second)], axis=1)
        pose[:3, 3] = state[:3]
        # Rounded to float32 the columns are no rotation to the planner's taste.
        u, _, v = np.linalg.svd(pose[:3, :3])
        pose[:3, :3] = u @ v
        plan = planning.plan(self._mesh(index), world_from_object=pose).best(1)
        if not len(plan):
            return nothing
        world_from_hand = pose @ plan.poses[0]
        place = (world_from_hand[:3, 3] - POSITION_LOW) / (POSITION_HIGH - POSITION_LOW) * 2 - 1
        low, high = load_hand("reflex").preshape_limits
        share = (plan.preshape[0] - low) / (high - low) * 2 - 1
        return np.concatenate([place, world_from_hand[:3, :2].T.ravel(), [share]]).astype(np.float32)


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
    planner = Planner(env, env_id, settings.get("control", "twist"))
    policies = {"random": Random(env, seed), "zero": Zero(env), "planner": planner}
    found = {name: evaluate(policy, env, episodes, seed) for name, policy in policies.items()}
    env.close()
    return found
