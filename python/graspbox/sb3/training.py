"""Makes the model of a training run: its algorithm's arguments, its policy class, its demonstrations.

``scripts/train_sb3.py`` combines this with `graspbox.sb3.running`.
"""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from graspbox.sb3.demonstrations import DemonstratedBuffer, clone, demonstrate
from graspbox.sb3.extractors import Extractor
from graspbox.sb3.running import Linear, make_env

__all__ = ["DEMONSTRATION_SEED", "add_demonstrations", "model_arguments"]

#: Demonstrations have other episodes than training and evaluations.
DEMONSTRATION_SEED = 20_000


def model_arguments(algorithm: Any, given: dict[str, Any], env: Any, demonstrations: int) -> dict[str, Any]:
    """Arguments of an algorithm from its entry in the parameter file.

    Names of classes become classes, ``linear_X`` becomes a schedule, and the policy and its features extractor are
    chosen by the observation space.

    Parameters
    ----------
    algorithm : type
        A value of `graspbox.sb3.running.ALGORITHMS`.
    given : dict
        The entry ``model`` of the parameters.
    env : VecEnv
        The training environment.
    demonstrations : int
        Number of demonstrations; an off-policy algorithm with any gets a `DemonstratedBuffer`.
    """
    policy = dict(given.get("policy_kwargs", {}))
    if "activation_fn" in policy:
        policy["activation_fn"] = getattr(torch.nn, policy["activation_fn"])
    space = env.observation_space
    named = isinstance(space, gymnasium.spaces.Dict)
    if any(len(box.shape) > 1 for box in (space.values() if named else [space])):
        policy.setdefault("features_extractor_class", Extractor)
    found = {**given, "policy": "MultiInputPolicy" if named else "MlpPolicy", "policy_kwargs": policy}
    if demonstrations and issubclass(algorithm, OffPolicyAlgorithm):
        found["replay_buffer_class"] = DemonstratedBuffer
    if "learning_rate" in found:
        found["learning_rate"] = _rate(found["learning_rate"])
    if "action_noise" in found:
        size = env.action_space.shape
        found["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, found["action_noise"]))
    return found


def _rate(value: Any) -> Any:
    """Make a number or a schedule; YAML reads 1e-3, without a point, and linear_1e-3 as strings."""
    if not isinstance(value, str):
        return value
    return Linear(float(value.removeprefix("linear_"))) if value.startswith("linear_") else float(value)


def add_demonstrations(
    model: Any,
    env_id: str,
    num_envs: int,
    episodes: int,
    *,
    clone_epochs: int,
    seed: int,
    step: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> str:
    """Fill the demonstrated part of a replay buffer, or, for an on-policy model, clone the expert.

    Parameters
    ----------
    model : BaseAlgorithm
        The model, before training.
    env_id, num_envs, **settings
        As for `graspbox.sb3.running.make_env`.
    episodes : int
        Successful episodes of the expert.
    clone_epochs : int
        Passes over them when cloning.
    seed : int
        Seed of the order in which cloning sees them.
    step : callable
        Called with the number of successes so far.

    Returns
    -------
    str
        A sentence about the demonstrations and the error of the clone.
    """
    stage = make_env(env_id, num_envs, **settings)
    buffer, rate = demonstrate(stage, episodes, DEMONSTRATION_SEED, step=step)
    stage.close()
    told = f"{buffer.size()} steps of demonstrations; success rate of the expert {rate:.0%}"
    statistics = model.get_vec_normalize_env()
    if statistics is not None and statistics.norm_obs:
        statistics.obs_rms.update(buffer.observations[: buffer.size(), 0])
    if isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer.demonstrations = buffer
        return told
    if statistics is not None:
        # Statistics that changed later would change what the cloned policy does.
        statistics.training = False
    trained, held_out = clone(model, buffer, clone_epochs, seed=seed)
    return f"{told}; cloned with a mean squared action error of {trained:.4f}, held out {held_out:.4f}"
