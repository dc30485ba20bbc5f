"""Policies whose critic observes something else than they do: in training the state, which a real robot does not have.

An actor that sees images learns from a critic that knows where the object is (Pinto, Andrychowicz, Welinder, Zaremba,
Abbeel, "Asymmetric actor critic for image-based robot learning", RSS 2018). The model's space has the observations of
both; only those of the actor are needed to act.
"""

from typing import Any

from gymnasium import spaces
from sb3_contrib import TQC
from sb3_contrib.tqc.policies import MultiInputPolicy as TQCPolicy
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from stable_baselines3.sac.policies import MultiInputPolicy as SACPolicy
from stable_baselines3.td3.policies import MultiInputPolicy as TD3Policy

__all__ = ["POLICIES"]


class _Apart:
    """What the policies share: which of the observations the actor has, and which the critic.

    Parameters
    ----------
    space, *args, **kwargs
        As of the policy of Stable-Baselines3; `space` is a ``Dict``.
    actor_obs, critic_obs : sequence of str
        Names of observations.
    """

    def __init__(self, space: spaces.Dict, *args: Any, actor_obs: Any, critic_obs: Any, **kwargs: Any) -> None:
        self.actor_obs, self.critic_obs = tuple(actor_obs), tuple(critic_obs)
        super().__init__(space, *args, **kwargs)  # type: ignore[call-arg]

    @property
    def critic_only(self) -> tuple[str, ...]:
        """Observations without which the policy acts."""
        return tuple(name for name in self.critic_obs if name not in self.actor_obs)

    def _extractor(self, names: tuple[str, ...]) -> BaseFeaturesExtractor:
        own: Any = self
        seen = spaces.Dict({name: own.observation_space[name] for name in names})
        return own.features_extractor_class(seen, **own.features_extractor_kwargs)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        own: Any = super()
        return {**own._get_constructor_parameters(), "actor_obs": self.actor_obs, "critic_obs": self.critic_obs}


class _OffPolicy(_Apart):
    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        own: Any = super()
        return own.make_actor(features_extractor or self._extractor(self.actor_obs))

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        own: Any = super()
        return own.make_critic(features_extractor or self._extractor(self.critic_obs))


class _SAC(_OffPolicy, SACPolicy):  # type: ignore[misc]
    """Of SAC."""


class _TD3(_OffPolicy, TD3Policy):  # type: ignore[misc]
    """Of TD3."""


class _TQC(_OffPolicy, TQCPolicy):  # type: ignore[misc]
    """Of TQC."""


class _PPO(_Apart, MultiInputActorCriticPolicy):  # type: ignore[misc]
    """Of PPO."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, share_features_extractor=False, **kwargs)

    def _build(self, lr_schedule: Any) -> None:
        self.features_extractor = self.pi_features_extractor = self._extractor(self.actor_obs)
        self.vf_features_extractor = self._extractor(self.critic_obs)
        super()._build(lr_schedule)

    def _build_mlp_extractor(self) -> None:
        """Make the hidden layers; Stable-Baselines3 has one number of features for both networks."""
        actor, critic = (
            MlpExtractor(one.features_dim, self.net_arch, self.activation_fn, self.device)
            for one in (self.pi_features_extractor, self.vf_features_extractor)
        )
        actor.value_net, actor.latent_dim_vf = critic.value_net, critic.latent_dim_vf
        self.mlp_extractor = actor


#: Policies by their algorithm.
POLICIES: dict[type, Any] = {PPO: _PPO, SAC: _SAC, TD3: _TD3, TQC: _TQC}
