"""Fine-tuning: a model of Stable-Baselines3 begins as a clone of demonstrations and goes on to learn from rewards.

``scripts/clone_sb3.py`` makes the clone, ``scripts/train_sb3.py --clone`` goes on from it.
"""

import json
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from graspbox.demonstrations import Demonstrations
from graspbox.errors import ConfigError
from graspbox.sb3.cloning import ClonedSteps, actor_parameters, cloning_loss
from graspbox.sb3.running import load_policy

__all__ = ["CloningTerm", "begin_as", "settings_of", "steps_of"]


def _actor_optimizer(model: BaseAlgorithm) -> torch.optim.Optimizer:
    """Find the optimizer that moves `actor_parameters`."""
    policy: Any = model.policy
    found: torch.optim.Optimizer = policy.actor.optimizer if isinstance(model, OffPolicyAlgorithm) else policy.optimizer
    return found


class CloningTerm:
    """Keeps a policy that began as a clone near its demonstrations while it learns from rewards.

    Before the actor's optimizer steps, the gradient of the cloning loss of a batch of demonstrations is added; its
    weight falls linearly to zero, so that in the end rewards alone decide. While the value function warms up, the actor
    does not move at all: its first advantages would be noise.

    Parameters
    ----------
    model : BaseAlgorithm
        The model; `CloningTerm.remove` ends it.
    steps : ClonedSteps
        Demonstrations.
    weight : float
        Weight at the beginning; the cloning loss is the mean squared error of actions.
    decay : int
        Steps of the environments after which it is zero.
    warmup : int
        Steps of the environments until the actor moves.
    batch : int
        Demonstrated steps that an update sees.
    seed : int
        Seed of the batches.

    Notes
    -----
    The decaying loss is that of Rajeswaran et al., "Learning complex dexterous manipulation with deep reinforcement
    learning and demonstrations", RSS 2018, with a mean squared error in place of the likelihood.
    """

    def __init__(
        self,
        model: BaseAlgorithm,
        steps: ClonedSteps,
        *,
        weight: float,
        decay: int,
        warmup: int = 0,
        batch: int = 128,
        seed: int = 0,
    ) -> None:
        self._model, self._steps, self._batch = model, steps, batch
        self._weight, self._decay, self._warmup = weight, decay, warmup
        self._random = torch.Generator().manual_seed(seed)
        self._moved = actor_parameters(model)
        self._hook = _actor_optimizer(model).register_step_pre_hook(self._before)

    @property
    def weight(self) -> float:
        """Weight of the cloning loss at the present step."""
        left = 1.0 - self._model.num_timesteps / self._decay if self._decay else 0.0
        return self._weight * max(left, 0.0)

    def remove(self) -> None:
        """Leave the model alone."""
        self._hook.remove()

    def _before(self, *_: Any) -> None:
        if self._model.num_timesteps < self._warmup:
            for parameter in self._moved:
                parameter.grad = None
            return
        weight = self.weight
        if not weight:
            return
        rows = torch.randint(len(self._steps), (self._batch,), generator=self._random)
        loss, error = cloning_loss(self._model, *self._steps[rows])
        # Not `loss.backward()`: what else the loss depends on keeps its gradient.
        given = [parameter for parameter in self._moved if parameter.requires_grad]
        for parameter, slope in zip(given, torch.autograd.grad(weight * loss, given, allow_unused=True), strict=True):
            if slope is not None:
                parameter.grad = slope if parameter.grad is None else parameter.grad + slope
        self._model.logger.record("clone/error", error.item())
        self._model.logger.record("clone/weight", weight)


def settings_of(folder: Path) -> dict[str, Any]:
    """Read the settings of a clone off the folder of its run.

    Raises
    ------
    ConfigError
        If there is no clone.
    """
    try:
        first = (folder / "evaluations.jsonl").read_text().splitlines()[0]
        found: dict[str, Any] = json.loads(first)["settings"]
        if not {"algorithm", "id", "env", "clone"} <= set(found):
            raise ValueError
    except (OSError, ValueError, LookupError, TypeError):
        raise ConfigError(f"there is no clone in {str(folder)!r}; scripts/clone_sb3.py makes one") from None
    return found


def steps_of(settings: dict[str, Any]) -> ClonedSteps:
    """Read the demonstrations that a clone has learned from; raises as `ClonedSteps`."""
    clone = settings["clone"]
    return ClonedSteps(Demonstrations(clone["demonstrations"]), settings["env"]["obs"], clone["keep"], clone["shown"])


def begin_as(model: BaseAlgorithm, folder: Path) -> None:
    """Give a new model the policy of a clone, and the statistics that scale its observations, for good.

    The critic of an off-policy model takes the clone's features over.

    Parameters
    ----------
    model : BaseAlgorithm
        Of the clone's algorithm.
    folder : Path
        Folder of the clone's run.

    Raises
    ------
    ConfigError
        If there is no clone, or it is of another algorithm, has other spaces, networks or statistics.
    """
    settings = settings_of(folder)
    clone = load_policy(settings["algorithm"], folder / "checkpoint", str(model.device))
    if type(clone.model) is not type(model):
        raise ConfigError(f"the clone in {str(folder)!r} is a policy of {settings['algorithm']}; train it with that")
    for name in ("observation_space", "action_space"):
        mine, its = getattr(model, name), getattr(clone.model, name)
        if mine != its:
            raise ConfigError(f"the clone in {str(folder)!r} has the {name} {its}, the run has {mine}; set env.obs")
    statistics = model.get_vec_normalize_env()
    if (statistics is None) != (clone.statistics is None):
        raise ConfigError(f"normalize.observations differs from that of the clone in {str(folder)!r}")
    if statistics is not None and clone.statistics is not None:
        if statistics.norm_reward:
            raise ConfigError("a clone needs the statistics of its demonstrations; set normalize.reward=false")
        statistics.obs_rms, statistics.training = clone.statistics.obs_rms, False
    policy: Any = model.policy
    try:
        policy.load_state_dict(clone.model.policy.state_dict())
    except RuntimeError as error:
        first = str(error).splitlines()[-1].strip()
        raise ConfigError(
            f"the clone in {str(folder)!r} has other networks ({first}); give model.policy_kwargs as for the clone"
        ) from None
    if isinstance(model, OffPolicyAlgorithm):
        features = policy.actor.features_extractor.state_dict()
        for critic in (policy.critic, policy.critic_target):
            critic.features_extractor.load_state_dict(features)
