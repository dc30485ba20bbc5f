"""PPO in one file, in the style of CleanRL, on the native vector environment; its only learning library is torch.

    python scripts/examples/cleanrl_ppo.py --steps 1500000

The numbers are those of ``graspbox train sb3 ppo``. Autoreset is ``SAME_STEP``, so that every step is a transition;
truncated episodes bootstrap from the value of their last observation. Needs the extras ``cli`` and ``train``.
"""

import time
from typing import Annotated, Any

import gymnasium
import numpy as np
import torch
import typer
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn

import graspbox  # noqa: F401 (registers the environments)

GAMMA, LAMBDA, CLIP, EPOCHS, MINIBATCHES, VALUE = 0.97, 0.95, 0.2, 5, 8, 0.5
SIMPLE = ("procedural:box:0-99", "procedural:can:0-99", "procedural:ball:0-99")


class Scale:
    """Running mean and variance of rows: of observations, which they scale, or of returns, which scale rewards."""

    def __init__(self, size: int) -> None:
        self.mean, self.square, self.count = np.zeros(size), np.ones(size), 1e-4

    @property
    def spread(self) -> Any:
        """The standard deviation."""
        return np.sqrt(np.maximum(self.square - self.mean**2, 1e-8))

    def learn(self, rows: Any) -> None:
        """Update the statistics."""
        share = len(rows) / (self.count + len(rows))
        self.mean += share * (rows.mean(0) - self.mean)
        self.square += share * ((rows**2).mean(0) - self.square)
        self.count += len(rows)

    def __call__(self, seen: Any, learn: bool = True) -> Tensor:
        """Scale observations (rows, size); with `learn` they update the statistics first."""
        if learn:
            self.learn(seen)
        return torch.as_tensor(np.clip((seen - self.mean) / self.spread, -10, 10), dtype=torch.float32)


class Agent(nn.Module):
    """A normal distribution of actions, and a value."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()

        def mlp(last: int, gain: float) -> nn.Sequential:
            layers = [nn.Linear(inputs, 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh(), nn.Linear(128, last)]
            for layer, g in ((layers[0], 2**0.5), (layers[2], 2**0.5), (layers[4], gain)):
                nn.init.orthogonal_(layer.weight, g)
                nn.init.zeros_(layer.bias)
            return nn.Sequential(*layers)

        self.mean, self.value = mlp(outputs, 0.01), mlp(1, 1.0)
        self.log_std = nn.Parameter(torch.full((outputs,), -0.5))

    def policy(self, seen: Tensor) -> torch.distributions.Normal:
        """Distribution of the actions (rows, outputs)."""
        return torch.distributions.Normal(self.mean(seen), self.log_std.exp())


def advantages(rewards: Tensor, values: Tensor, after: Tensor, dones: Tensor) -> Tensor:
    """Generalised advantage estimates (steps, envs); `after` is the value of the state after each step."""
    result, last = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        last = rewards[t] + GAMMA * after[t] - values[t] + GAMMA * LAMBDA * (1 - dones[t]) * last
        result[t] = last
    return result


def update(agent: Agent, optimizer: torch.optim.Optimizer, batch: dict[str, Tensor]) -> float:
    """Improve the agent on one rollout; returns the last value loss."""
    rows = len(batch["gain"])
    for order in (torch.randperm(rows) for _ in range(EPOCHS)):
        for part in order.chunk(MINIBATCHES):
            seen, actions, old, gain, target = (batch[n][part] for n in ("seen", "actions", "logp", "gain", "target"))
            policy = agent.policy(seen)
            ratio = (policy.log_prob(actions).sum(1) - old).exp()
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            surrogate = torch.minimum(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            error = ((agent.value(seen)[:, 0] - target) ** 2).mean()
            loss = -surrogate + VALUE * error
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()
    return float(error.detach())


def main(
    env_id: Annotated[str, typer.Option(help="Id of the environment.")] = "graspbox/Grasp-v0",
    objects: Annotated[list[str] | None, typer.Option(help="Object set; may be repeated.")] = None,
    steps: Annotated[int, typer.Option(help="Steps of all environments together.")] = 1_500_000,
    num_envs: Annotated[int, typer.Option(help="Environments.")] = 128,
    rollout: Annotated[int, typer.Option(help="Steps per environment between two updates.")] = 32,
    learning_rate: Annotated[float, typer.Option(help="Learning rate; falls linearly to zero.")] = 7e-4,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
) -> None:
    """Train; prints a line per update."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    envs: Any = gymnasium.make_vec(
        env_id, num_envs, objects=objects or SIMPLE, split="train", autoreset_mode=AutoresetMode.SAME_STEP
    )
    scale, paid, discounted = Scale(envs.single_observation_space.shape[0]), Scale(1), np.zeros(num_envs)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimizer = torch.optim.Adam(agent.parameters(), lr=learning_rate, eps=1e-5)
    seen, returns, ends = scale(envs.reset(seed=seed)[0]), np.zeros(num_envs), []
    updates, began = steps // (num_envs * rollout), time.monotonic()
    for number in range(updates):
        optimizer.param_groups[0]["lr"] = learning_rate * (1 - number / updates)
        history: list[tuple[Tensor, ...]] = []
        for _ in range(rollout):
            with torch.no_grad():
                policy = agent.policy(seen)
                actions = policy.sample()
                observations, rewards, terminated, truncated, infos = envs.step(actions.clamp(-1, 1).numpy())
                now, done = scale(observations), terminated | truncated
                after = agent.value(now)[:, 0]
                for i in np.flatnonzero(done):
                    last = scale(infos["final_obs"][i][None], learn=False)
                    after[i] = 0.0 if terminated[i] else agent.value(last)[0, 0]
                value = agent.value(seen)[:, 0]
            discounted = GAMMA * discounted + rewards
            paid.learn(discounted[:, None])
            discounted[done] = 0.0
            reward = torch.as_tensor(np.clip(rewards / paid.spread, -10, 10), dtype=torch.float32)
            over = torch.as_tensor(done, dtype=torch.float32)
            history.append((seen, actions, policy.log_prob(actions).sum(1), value, reward, over, after))
            seen, returns = now, returns + rewards
            ends += [(returns[i], infos["final_info"]["is_success"][i]) for i in np.flatnonzero(done)]
            returns[done] = 0.0
        observed, acted, logp, values, reward, over, after = (torch.stack(part) for part in zip(*history, strict=True))
        gain = advantages(reward, values, after, over)
        batch = {"seen": observed, "actions": acted, "logp": logp, "gain": gain, "target": gain + values}
        error = update(agent, optimizer, {name: part.flatten(0, 1) for name, part in batch.items()})
        ends, done_steps = ends[-100:], (number + 1) * num_envs * rollout
        summary = np.mean(ends, axis=0) if ends else (np.nan, np.nan)
        rate = done_steps / (time.monotonic() - began)
        print(
            f"{done_steps} steps, return {summary[0]:.2f}, success {summary[1]:.2f}, {error=:.3f}, {rate:.0f} steps/s"
        )
    envs.close()


if __name__ == "__main__":
    typer.run(main)
