"""The deterministic action of a policy of Stable-Baselines3 as one function that ONNX supports.

`graspbox.learn.sb3.export` writes it.
"""

import copy
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.preprocessing import is_image_space, is_image_space_channels_first, preprocess_obs
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor, nn

__all__ = ["ActionGraph", "Scales", "is_transposed"]

#: Mean, standard deviation and clipping of each scaled vector.
Scales = Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64], float]]


class _Input(nn.Module):  # type: ignore[misc]
    """Converts an observation of the environment to the model's input: scaled, and channels first."""

    def __init__(self, channels_first: bool, scale: tuple[NDArray[np.float64], NDArray[np.float64], float] | None):
        super().__init__()
        self._channels_first, self._scaled = channels_first, scale is not None
        if scale is not None:
            for name, value in zip(("mean", "deviation", "clip"), scale, strict=True):
                self.register_buffer(name, torch.as_tensor(np.array(value, dtype=np.float64)))

    def forward(self, values: Tensor) -> Tensor:
        if self._channels_first:
            return values.permute(0, 3, 1, 2)
        if not self._scaled:
            return values
        scaled = (values.double() - self.mean) / self.deviation
        return torch.maximum(torch.minimum(scaled, self.clip), -self.clip).float()


class ActionGraph(nn.Module):  # type: ignore[misc]
    """The deterministic action of a policy, from the environment's observations.

    Parameters
    ----------
    policy : BasePolicy
        Of PPO, SAC, TQC or TD3; only its actor is kept.
    scales : mapping
        Scaling of vector observations, by name.
    names : tuple of str
        Names of the observations.
    """

    outputs = ("action",)
    variadic = True

    def __init__(self, policy: BasePolicy, scales: Scales, names: tuple[str, ...]) -> None:
        super().__init__()
        self.inputs = names
        self._space, self._images = policy.observation_space, policy.normalize_images
        self._named = isinstance(self._space, gymnasium.spaces.Dict)
        boxes = dict(self._space.spaces) if self._named else {names[0]: self._space}
        made = {name: _Input(is_transposed(boxes[name]), scales.get(name)) for name in names}
        self.seen = nn.ModuleDict({f"of_{name}": one for name, one in made.items()})
        self._on_policy, self._tanh = isinstance(policy, ActorCriticPolicy), isinstance(policy, SACPolicy | TQCPolicy)
        self._squashed = policy.squash_output
        if self._on_policy:
            self._tanh = self._squashed
            extractor, self.latent = policy.pi_features_extractor, policy.mlp_extractor.policy_net
            self.head = policy.action_net
        else:
            actor: Any = policy.actor
            extractor = actor.features_extractor
            self.latent, self.head = (actor.latent_pi, actor.mu) if self._tanh else (nn.Identity(), actor.mu)
        self.extractor = _with_plain_pools(extractor)
        for name in ("low", "high"):
            self.register_buffer(name, torch.as_tensor(getattr(policy.action_space, name)), persistent=False)
        self.eval()

    def forward(self, *observations: Tensor) -> Tensor:
        """Return actions (n, k) for observations (n, ...) in the order of `inputs`."""
        pairs = zip(self.inputs, observations, strict=True)
        observation = {name: self.seen[f"of_{name}"](values) for name, values in pairs}
        ready = preprocess_obs(
            observation if self._named else observation[self.inputs[0]], self._space, normalize_images=self._images
        )
        found = self.head(self.latent(self.extractor(ready)))
        if self._tanh:
            found = torch.tanh(found)
        if self._squashed:
            return self.low + 0.5 * (found + 1.0) * (self.high - self.low)
        return torch.maximum(torch.minimum(found, self.high), self.low)


def is_transposed(space: Box) -> bool:
    """Return whether a model takes channels first where its environment has channels last.

    Environments of graspbox have no images with channels first.
    """
    return bool(is_image_space(space) and is_image_space_channels_first(space))


class _Pool3d(nn.Module):  # type: ignore[misc]
    """Replaces ``AdaptiveAvgPool3d``, which the exporter does not support: means over the same parts of each axis."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self._size = size

    def forward(self, values: Tensor) -> Tensor:
        for axis in (2, 3, 4):
            length, n = values.shape[axis], self._size
            parts = [(i * length // n, -(-(i + 1) * length // n)) for i in range(n)]
            means = [values.narrow(axis, low, high - low).mean(axis, keepdim=True) for low, high in parts]
            values = torch.cat(means, dim=axis)
        return values


def _with_plain_pools(extractor: nn.Module) -> nn.Module:
    """Copy a network, with pools that the exporter supports."""
    found = copy.deepcopy(extractor)
    for module in list(found.modules()):
        for name, child in module.named_children():
            if isinstance(child, nn.AdaptiveAvgPool3d):
                sizes = {child.output_size} if isinstance(child.output_size, int) else set(child.output_size)
                if len(sizes) == 1:
                    setattr(module, name, _Pool3d(sizes.pop()))
    return found
