"""Models of Stable-Baselines3 as policies, and the evaluation records of a run."""

from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from graspbox import evaluation, policies
from graspbox.envs import GOAL_IDS
from graspbox.errors import ConfigError
from graspbox.evaluation import Evaluation
from graspbox.policies import Actions, Policy
from graspbox.policies.base import is_closed_loop

__all__ = ["ModelPolicy", "evaluate_baselines", "summary"]

#: Baselines of a trained policy.
BASELINES = ("random", "zero", "planner")


class ModelPolicy(Policy):
    """The deterministic actions of a model.

    Parameters
    ----------
    model : BaseAlgorithm
        PPO, SAC, TD3 or another algorithm of Stable-Baselines3.
    statistics : VecNormalize, optional
        Scales the observations; its statistics are read, not updated.
    name : str
        Name in results.
    """

    def __init__(self, model: BaseAlgorithm, statistics: VecNormalize | None = None, name: str = "policy") -> None:
        self.model, self.statistics, self.name = model, statistics, name

    def act(self, observation: Any) -> Actions:
        """Scale the observations and predict."""
        if self.statistics is not None:
            observation = self.statistics.normalize_obs(observation)
        actions, _ = self.model.predict(observation, deterministic=True)
        return np.asarray(actions, dtype=np.float32)


def summary(found: Evaluation) -> dict[str, Any]:
    """Summarize an evaluation for the log of a run.

    Returns
    -------
    dict
        Shares of ``success`` and ``secure``, their 95 % intervals ``ci95`` and ``secure_ci95`` (Wilson), mean
        ``return`` and ``length``, number of ``episodes``, and number of ``failures`` by kind.

    Raises
    ------
    ConfigError
        If there is no trial, since no object could be used.
    """
    trials = found.trials
    if not trials:
        why = "; ".join(f"{name}: {reason}" for name, reason in found.refused.items()) or "none is left"
        raise ConfigError(
            f"there is no trial of {found.policy}, since no object can be used ({why}); name other objects"
        )
    return {
        "success": found.rate,
        "ci95": list(found.ci95),
        "secure": found.secure / len(trials),
        "secure_ci95": list(found.secure_ci95),
        "return": float(np.mean([trial.reward for trial in trials])),
        "length": float(np.mean([trial.steps for trial in trials])),
        "episodes": len(trials),
        "failures": found.failures,
    }


def evaluate_baselines(env_id: str, num_envs: int, episodes: int, seed: int, **settings: Any) -> dict[str, Any]:
    """Return the `summary` of random actions, zero actions and the planner on the trials of a policy, by name.

    `settings` are those of `graspbox.evaluation.evaluate`; ``obs`` is ``"state"``, and the planner decides on poses. It
    has no part in goal tasks.
    """
    keywords = {**settings, "obs": "state", "trials": episodes, "seed": seed, "num_envs": num_envs}
    found = {}
    for name in BASELINES if env_id not in GOAL_IDS else BASELINES[:2]:
        policy = policies.load(name)
        if name == "planner" and not is_closed_loop(env_id):
            keywords = {key: value for key, value in keywords.items() if key != "control"}
        found[name] = summary(evaluation.evaluate(policy, env_id, **keywords))
    return found
