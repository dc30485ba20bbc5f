"""Demonstrations of the scripted expert, for learning from them.

Off-policy learners sample half of each batch from the expert's successful episodes (`DemonstratedBuffer`; Ball, Smith,
Kostrikov, Levine, "Efficient Online Reinforcement Learning with Offline Data", 2023). An on-policy learner is
initialized by behaviour cloning (`clone`). The expert knows the objects' meshes; the policy that learns from it does
not.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from graspbox import policies
from graspbox.errors import ConfigError
from graspbox.policies import Task

__all__ = ["DemonstratedBuffer", "clone", "demonstrate"]

#: Cloning: batch size, and weight of the value loss relative to the action loss.
_BATCH, _VALUE_SHARE = 256, 0.1


class DemonstratedBuffer(ReplayBuffer):  # type: ignore[misc]
    """A replay buffer that samples a share of each batch from demonstrations, once it has any.

    Parameters
    ----------
    *args, **kwargs
        As Stable-Baselines3's.
    share : float
        Share of a batch that comes from `demonstrations`.
    """

    def __init__(self, *args: Any, share: float = 0.5, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.share = share
        self.demonstrations: ReplayBuffer | None = None

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """Sample a batch."""
        shown = round(batch_size * self.share)
        if self.demonstrations is None or not shown:
            return super().sample(batch_size, env=env)
        parts = super().sample(batch_size - shown, env=env), self.demonstrations.sample(shown, env=env)
        rows: list[list[Any]] = [[part for part in pair if part is not None] for pair in zip(*parts, strict=True)]
        return ReplayBufferSamples(*(torch.cat(pair) if pair else None for pair in rows))


def demonstrate(
    env: Any, episodes: int, seed: int, *, step: Callable[[int], None] = lambda _: None
) -> tuple[ReplayBuffer, float]:
    """Run the expert until it has succeeded in a number of episodes; failed episodes are left out.

    In ``Grasp-v0`` the demonstrator is the policy ``expert``, in ``GraspPose-v0`` it is ``planner``.

    Parameters
    ----------
    env : VecEnv
        Made by `graspbox.sb3.running.make_env`, not normalized; it observes ``state``.
    episodes : int
        Number of successful episodes to collect.
    seed : int
        Seed of the first environment.
    step : callable
        Called with the number of successes so far.

    Returns
    -------
    buffer, rate
        All transitions, and the expert's success rate.

    Raises
    ------
    ConfigError
        If the environment does not observe ``state``, or the expert fails in 20 + 9 times `episodes` episodes.
    """
    task = Task.of(env.unwrapped.env)
    if task.obs != "state":
        raise ConfigError(f"the environments have obs={task.obs!r}; demonstrations need obs='state'")
    expert = policies.load("expert" if task.closed_loop else "planner")
    expert.bind(task)
    rows: list[tuple[Any, ...]] = []
    open_rows: list[list[tuple[Any, ...]]] = [[] for _ in range(env.num_envs)]
    ended, succeeded = 0, 0
    env.seed(seed)
    seen, starts = env.reset(), np.ones(env.num_envs, dtype=bool)
    while succeeded < episodes:
        objects = np.array([info["object"] for info in env.unwrapped.reset_infos], dtype=object)
        expert.reset(mask=starts, info={"object": objects})
        actions = expert.act(seen)
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
            raise ConfigError(f"the expert succeeded in {succeeded} of {ended} episodes; demonstrate other objects")
    buffer = ReplayBuffer(len(rows), env.observation_space, env.action_space, device="cpu", n_envs=1)
    for observation, last, action, reward, done, info in rows:
        buffer.add(observation[None], last[None], action[None], np.array([reward]), np.array([done]), [info])
    return buffer, succeeded / ended


def clone(model: Any, buffer: ReplayBuffer, epochs: int, *, seed: int = 0) -> tuple[float, float]:
    """Train the policy of an on-policy model on the demonstrated actions, and its value function on their returns.

    Parameters
    ----------
    model : OnPolicyAlgorithm
        Such as Stable-Baselines3's PPO; the statistics of its `VecNormalize` scale the observations.
    buffer : ReplayBuffer
        Demonstrations, from `demonstrate`.
    epochs : int
        Passes over the demonstrations.
    seed : int
        Seed of the order of batches.

    Returns
    -------
    trained, held_out : float
        Mean squared error of the actions in the last epoch; every tenth step is held out.
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
    """Discounted return of every step to the end of its episode."""
    rewards, dones = buffer.rewards[: buffer.size(), 0], buffer.dones[: buffer.size(), 0]
    returns: np.ndarray[Any, np.dtype[np.float32]] = np.zeros_like(rewards)
    following = 0.0
    for i in range(len(rewards) - 1, -1, -1):
        following = returns[i] = rewards[i] + gamma * following * (1.0 - dones[i])
    return returns
