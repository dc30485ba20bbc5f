"""Baselines without observations: random and zero actions."""

from typing import Any

import numpy as np

from graspbox.policies.base import Actions, Policy, SeededPolicy

__all__ = ["Random", "Zero"]


class Zero(Policy):
    """Zero actions."""

    name = "zero"

    def act(self, observation: Any) -> Actions:
        """Return zeros."""
        del observation
        return self._zeros()


class Random(SeededPolicy):
    """Actions sampled uniformly from the action space."""

    name = "random"

    def act(self, observation: Any) -> Actions:
        """Sample an action per environment."""
        del observation
        space = self.task.action_space
        return np.stack([stream.uniform(space.low, space.high) for stream in self._streams]).astype(np.float32)
