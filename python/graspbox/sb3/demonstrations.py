"""Demonstrations: what the scripted expert does, to learn from beside, or before, what a learner does itself.

An off-policy learner draws half of each batch from the expert's successful episodes (`DemonstratedBuffer`; Ball, Smith,
Kostrikov, Levine, "Efficient Online Reinforcement Learning with Offline Data", 2023). An on-policy one begins as a copy
of the expert (`clone`). The expert knows the objects' meshes; the policy that learns from it does not.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from graspbox.errors import ConfigError
from graspbox.sb3.references import PLANNED, Planner

__all__ = ["DemonstratedBuffer", "clone", "demonstrate"]

#: The expert takes, of so many of the planner's best poses, the nearest one: a policy can only copy what its
#: observations tell, and which of several equal poses the planner names first they do not.
_CHOICES = 40
#: Cloning: rows of a batch, and weight of the error of values beside that of actions.
_BATCH, _VALUE_SHARE = 256, 0.1


class DemonstratedBuffer(ReplayBuffer):  # type: ignore[misc]
    """A replay buffer, a share of whose samples are demonstrations, once there are any.

    Parameters
    ----------
    *args, **kwargs
        As Stable-Baselines3's.
    share : float
        Share of a batch that `demonstrations` give.
    """

    def __init__(self, *args: Any, share: float = 0.5, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.share = share
        self.demonstrations: ReplayBuffer | None = None

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """Draw a batch."""
        shown = round(batch_size * self.share)
        if self.demonstrations is None or not shown:
            return super().sample(batch_size, env=env)
        parts = super().sample(batch_size - shown, env=env), self.demonstrations.sample(shown, env=env)
        rows: list[list[Any]] = [[part for part in pair if part is not None] for pair in zip(*parts, strict=True)]
        return ReplayBufferSamples(*(torch.cat(pair) if pair else None for pair in rows))


def demonstrate(
    env: Any,
    env_id: str,
    episodes: int,
    seed: int,
    *,
    step: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> tuple[ReplayBuffer, float]:
    """Let the expert act until it has succeeded in so many episodes; episodes that fail are left out.

    Parameters
    ----------
    env : VecEnv
        What `graspbox.sb3.running.make_env` made, not normalized.
    env_id : str
        Its id.
    episodes : int
        How many.
    seed : int
        Seed of the first environment.
    step : callable
        Called with the number of successes so far.
    **settings
        The environment's keywords, ``control`` and ``frame_skip`` among them.

    Returns
    -------
    buffer, rate
        All transitions, and the share of the expert's episodes that succeeded.

    Raises
    ------
    ConfigError
        If the environment does not observe its state, or the expert hardly ever succeeds.
    """
    if not isinstance(env.observation_space, spaces.Box) or settings.get("obs", "state") != "state":
        raise ConfigError("demonstrations need obs='state'; the expert looks at nothing else")
    named = {name: settings[name] for name in PLANNED if name in settings}
    expert = Planner(env, env_id, choices=_CHOICES, **named)
    rows: list[tuple[Any, ...]] = []
    open_rows: list[list[tuple[Any, ...]]] = [[] for _ in range(env.num_envs)]
    ended, succeeded = 0, 0
    env.seed(seed)
    seen, starts = env.reset(), np.ones(env.num_envs, dtype=bool)
    while succeeded < episodes:
        actions, _ = expert.predict(seen, episode_start=starts)
        following, rewards, starts, infos = env.step(actions)
        for i, info in enumerate(infos):
            last = info["terminal_observation"] if starts[i] else following[i]
            open_rows[i].append((seen[i], last, actions[i], rewards[i], starts[i], info))
            if starts[i]:
                ended += 1
                if info["is_success"] and succeeded < episodes:
                    succeeded += 1
                    rows += open_rows[i]
                open_rows[i] = []
        seen = following
        step(succeeded)
        if ended >= 20 + 10 * episodes:
            raise ConfigError(f"the expert succeeded in {succeeded} of {ended} episodes; let it show other objects")
    buffer = ReplayBuffer(len(rows), env.observation_space, env.action_space, device="cpu", n_envs=1)
    for observation, last, action, reward, done, info in rows:
        buffer.add(observation[None], last[None], action[None], np.array([reward]), np.array([done]), [info])
    return buffer, succeeded / ended


def clone(model: Any, buffer: ReplayBuffer, epochs: int, *, seed: int = 0) -> tuple[float, float]:
    """Train the policy of an on-policy model to act as the demonstrations do, and its values to tell their returns.

    Parameters
    ----------
    model : OnPolicyAlgorithm
        As Stable-Baselines3's PPO; what `VecNormalize` has seen scales the observations.
    buffer : ReplayBuffer
        What `demonstrate` gave.
    epochs : int
        How often each step is looked at.
    seed : int
        Seed of the order.

    Returns
    -------
    trained, held_out : float
        Mean squared error of the actions in the last epoch; held out is every tenth step.
    """
    scaled = buffer._normalize_obs(buffer.observations[: buffer.size(), 0], model.get_vec_normalize_env())
    observations = torch.as_tensor(scaled, dtype=torch.float32, device=model.device)
    actions = torch.as_tensor(buffer.actions[: buffer.size(), 0], device=model.device)
    returns = torch.as_tensor(_returns(buffer, model.gamma), device=model.device)
    held_out = torch.arange(len(actions), device=model.device) % 10 == 0
    rows = torch.nonzero(~held_out)[:, 0]
    order = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.Adam(model.policy.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs)

    def errors(batch: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        means = model.policy.get_distribution(observations[batch]).distribution.mean
        values = model.policy.predict_values(observations[batch])[:, 0]
        return ((means - actions[batch]) ** 2).mean(), ((values - returns[batch]) ** 2).mean()

    for _ in range(epochs):
        sums: list[float] = []
        for batch in torch.split(rows[torch.randperm(len(rows), generator=order)], _BATCH):
            error, of_value = errors(batch)
            optimizer.zero_grad()
            loss = error + _VALUE_SHARE * of_value / (1.0 + returns.var())
            torch.autograd.backward(loss)
            optimizer.step()
            sums.append(error.item())
        schedule.step()
    with torch.no_grad():
        return float(np.mean(sums)), errors(torch.nonzero(held_out)[:, 0])[0].item()


def _returns(buffer: ReplayBuffer, gamma: float) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Sum up what each step and those after it in its episode paid, discounted."""
    rewards, dones = buffer.rewards[: buffer.size(), 0], buffer.dones[: buffer.size(), 0]
    returns: np.ndarray[Any, np.dtype[np.float32]] = np.zeros_like(rewards)
    following = 0.0
    for i in range(len(rewards) - 1, -1, -1):
        following = returns[i] = rewards[i] + gamma * following * (1.0 - dones[i])
    return returns
