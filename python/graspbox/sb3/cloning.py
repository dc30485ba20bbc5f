"""Behaviour cloning: what a loop needs that teaches a model of Stable-Baselines3 to act as demonstrations show.

``scripts/clone_sb3.py`` is such a loop; `graspbox.sb3.fine_tuning` goes on from its result.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor

from graspbox.demonstrations import KEEP, Demonstrations
from graspbox.errors import ConfigError

__all__ = ["ClonedSteps", "actor_parameters", "cloning_loss", "held_out", "mean_actions", "observe"]

#: Standard deviation, as its logarithm, of the exploring actions of a cloned stochastic actor, and the weight of the
#: squared distance from it. SAC's usual target for the entropy is -1 per entry of an action, that of a normal
#: distribution with a logarithm of -2.4.
_LOG_STD, _STD_WEIGHT = -2.4, 1e-3


class ClonedSteps(torch.utils.data.Dataset[tuple[Any, Tensor]]):  # type: ignore[misc]
    """Steps of demonstrations, in memory: observations as the environment gives them, and actions.

    An index may be a list: a batch is read at once. Pass a ``BatchSampler`` as ``sampler`` of a ``DataLoader``.

    Parameters
    ----------
    demonstrations : Demonstrations
        Where they come from.
    obs : str or sequence of str
        Observations, as the keyword of the environment names them: a name gives tensors, several give mappings.
    keep : {"secure", "success", "all"}
        Which episodes to take.
    episodes : int, optional
        Take the first ones only.

    Attributes
    ----------
    episode : (steps,) int64 array
        Episode of each step, from 0.

    Raises
    ------
    ConfigError
        If there are no such observations or not so many such episodes.
    """

    def __init__(
        self, demonstrations: Demonstrations, obs: Any, keep: str = "secure", episodes: int | None = None
    ) -> None:
        if keep not in KEEP:
            raise ConfigError(f"keep is {keep!r}; choose from {', '.join(KEEP)}")
        self._single = isinstance(obs, str)
        names = (obs,) if isinstance(obs, str) else tuple(obs)
        worth: Any = KEEP[keep]
        seen, actions, _, self.episode = demonstrations.steps(names, chosen=worth, limit=episodes)
        self.observations = {name: torch.from_numpy(np.ascontiguousarray(rows)) for name, rows in seen.items()}
        self.actions = torch.from_numpy(np.ascontiguousarray(actions))

    def __len__(self) -> int:
        return len(self.actions)

    def __getitem__(self, index: Any) -> tuple[Any, Tensor]:
        rows = {name: values[index] for name, values in self.observations.items()}
        return next(iter(rows.values())) if self._single else rows, self.actions[index]

    def arrays(self) -> Any:
        """All observations as an environment gives them: an array, or a dictionary of arrays."""
        rows = {name: values.numpy() for name, values in self.observations.items()}
        return next(iter(rows.values())) if self._single else rows


def observe(statistics: VecNormalize, steps: ClonedSteps) -> None:
    """Take the statistics that scale observations from demonstrations, for good.

    Statistics that changed later would change what a cloned policy does.
    """
    if statistics.norm_obs:
        seen = steps.arrays()
        if isinstance(statistics.obs_rms, dict):
            for name, found in statistics.obs_rms.items():
                found.update(seen[name])
        else:
            statistics.obs_rms.update(seen)
    statistics.training = False


def _scaled(model: BaseAlgorithm, observations: Any) -> Any:
    """Tensors as the policy takes them."""
    numbers: Any = (
        {name: values.numpy() for name, values in observations.items()}
        if isinstance(observations, dict)
        else observations.numpy()
    )
    statistics = model.get_vec_normalize_env()
    if statistics is not None:
        numbers = statistics.normalize_obs(numbers)
    tensors, _ = model.policy.obs_to_tensor(numbers)
    return tensors


def mean_actions(model: BaseAlgorithm, observations: Any) -> tuple[Tensor, Tensor | None]:
    """Mean actions, in [-1, 1] but for an unsquashed policy's, and the log of their standard deviation if learned.

    Parameters
    ----------
    model : BaseAlgorithm
        PPO, SAC or TD3.
    observations : tensor, or mapping of tensors
        As the environment gives them.

    Returns
    -------
    means : (rows, k) tensor
        What a deterministic policy does.
    log_std : (rows, k) tensor, optional
        Of an actor that predicts it.
    """
    policy: Any = model.policy
    scaled = _scaled(model, observations)
    if not isinstance(model, OffPolicyAlgorithm):
        return policy.get_distribution(scaled).distribution.mean, None
    if not hasattr(policy.actor, "log_std"):
        return policy.actor(scaled), None
    means, log_std, _ = policy.actor.get_action_dist_params(scaled)
    return torch.tanh(means), log_std


def cloning_loss(model: BaseAlgorithm, observations: Any, actions: Tensor) -> tuple[Tensor, Tensor]:
    """Loss to minimize, and the mean squared error of the actions that it is made of."""
    means, log_std = mean_actions(model, observations)
    error = ((means - actions.to(means.device)) ** 2).mean()
    if log_std is None:
        return error, error
    return error + _STD_WEIGHT * ((log_std - _LOG_STD) ** 2).mean(), error


def actor_parameters(model: BaseAlgorithm) -> list[torch.nn.Parameter]:
    """List what decides the actions: all of an on-policy model but what its value function alone uses."""
    policy: Any = model.policy
    if isinstance(model, OffPolicyAlgorithm):
        return list(policy.actor.parameters())
    parts = [policy.mlp_extractor.value_net, policy.value_net]
    if not policy.share_features_extractor:
        parts.append(policy.vf_features_extractor)
    of_value = {id(parameter) for part in parts for parameter in part.parameters()}
    return [parameter for parameter in policy.parameters() if id(parameter) not in of_value]


def held_out(episode: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which steps are held out of cloning: those of every tenth episode."""
    aside: NDArray[np.bool_] = episode % 10 == 9
    return aside
