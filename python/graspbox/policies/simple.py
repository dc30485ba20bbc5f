"""Baselines that look at nothing: random and zero actions."""

from typing import Any

import numpy as np

from graspbox.policies.base import Actions, Policy, Task

__all__ = ["Random", "Zero"]


class Zero(Policy):
    """Zero actions."""

    name = "zero"

    def act(self, observation: Any) -> Actions:
        """Give zeros."""
        del observation
        return self._zeros()


class Random(Policy):
    """Actions sampled uniformly from the action space; every environment has its own random stream."""

    name = "random"

    def _bind(self, task: Task) -> None:
        self._streams = [np.random.default_rng() for _ in range(task.num_envs)]

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del info
        if seed is not None:
            self._streams[env] = np.random.default_rng(seed)

    def act(self, observation: Any) -> Actions:
        """Sample an action per environment."""
        del observation
        space = self.task.action_space
        return np.stack([stream.uniform(space.low, space.high) for stream in self._streams]).astype(np.float32)
