"""PPO of TorchRL on the native vector environment, with the numbers of ``graspbox train sb3 ppo``.

    pip install 'graspbox[cli]' torchrl
    python scripts/examples/torchrl_ppo.py --steps 1500000

Autoreset is ``DISABLED``: TorchRL resets the environments that have ended, and keeps their last observations.
Observations and rewards are scaled by running statistics. Every tenth of the run prints the success rate of the
episodes that ended since the last line.
"""

from typing import Annotated, Any

import gymnasium
import torch
import typer
from gymnasium.vector import AutoresetMode
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement, Unbounded
from torchrl.envs import GymWrapper, TransformedEnv, VecNormV2
from torchrl.envs.libs.gym import default_info_dict_reader
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import graspbox  # noqa: F401 (registers the environments)

SIMPLE = ("procedural:box:0-99", "procedural:can:0-99", "procedural:ball:0-99")
GAMMA, LAMBDA, EPOCHS, MINIBATCH, ROLLOUT, RATE = 0.97, 0.95, 5, 512, 32, 7e-4


def make(objects: tuple[str, ...], num_envs: int) -> TransformedEnv:
    """Make the environments."""
    made = gymnasium.make_vec(
        "graspbox/Grasp-v0", num_envs=num_envs, objects=objects, autoreset_mode=AutoresetMode.DISABLED
    )
    env = GymWrapper(made)
    told = Unbounded((num_envs,), dtype=torch.bool)
    env.set_info_dict_reader(default_info_dict_reader(["is_success"], [told]))
    return TransformedEnv(env, VecNormV2(in_keys=["observation"]))


def network(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    """Make two hidden layers of 128 units."""
    layers = [nn.Linear(inputs, 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh(), nn.Linear(128, outputs)]
    for layer, g in ((layers[0], 2**0.5), (layers[2], 2**0.5), (layers[4], gain)):
        nn.init.orthogonal_(layer.weight, g)  # type: ignore[arg-type]
        nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return nn.Sequential(*layers)


def agent(env: TransformedEnv) -> tuple[ProbabilisticActor, ValueOperator]:
    """Make the policy, a normal distribution of actions, and the value function."""
    inputs, outputs = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    means = nn.Sequential(
        network(inputs, outputs, 0.01), AddStateIndependentNormalScale(outputs, scale_mapping="exp", init_value=-0.5)
    )
    actor = ProbabilisticActor(
        TensorDictModule(means, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
    )
    return actor, ValueOperator(network(inputs, 1, 1.0), in_keys=["observation"])


class Returns:
    """Divides rewards by the running standard deviation of discounted returns, as ``VecNormalize`` does."""

    def __init__(self, num_envs: int) -> None:
        self._now, self._sum, self._squares, self._count = torch.zeros(num_envs, 1), 0.0, 0.0, 1e-4

    def scale(self, data: Any) -> None:
        """Scale the rewards of a rollout (environments, steps)."""
        rewards, done = data["next", "reward"], data["next", "done"]
        for t in range(rewards.shape[1]):
            self._now = GAMMA * self._now + rewards[:, t]
            self._sum += float(self._now.sum())
            self._squares += float((self._now**2).sum())
            self._count += len(self._now)
            self._now = self._now * ~done[:, t]
        spread = max(self._squares / self._count - (self._sum / self._count) ** 2, 1e-8) ** 0.5
        data["next", "reward"] = rewards / spread


def main(
    steps: Annotated[int, typer.Option(help="Steps of all environments together.")] = 1_500_000,
    num_envs: Annotated[int, typer.Option(help="Environments.")] = 128,
    objects: Annotated[list[str] | None, typer.Option(help="Object set; may be repeated.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the learner and of the episodes.")] = 1,
) -> dict[int, float]:
    """Train; returns success rates by the number of steps."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    env = make(tuple(objects or SIMPLE), num_envs)
    env.set_seed(seed)
    actor, value = agent(env)
    advantages = GAE(gamma=GAMMA, lmbda=LAMBDA, value_network=value)
    loss = ClipPPOLoss(
        actor, value, entropy_bonus=False, critic_coeff=0.5, loss_critic_type="l2", normalize_advantage=True
    )
    optimizer = torch.optim.Adam(loss.parameters(), lr=RATE, eps=1e-5)
    rollout = num_envs * ROLLOUT
    stored = ReplayBuffer(storage=LazyTensorStorage(rollout), sampler=SamplerWithoutReplacement(), batch_size=MINIBATCH)
    returns, rates, ended, done = Returns(num_envs), dict[int, float](), list[float](), 0
    for data in Collector(env, actor, frames_per_batch=rollout, total_frames=steps):
        done += rollout
        ended += data["next", "is_success"][data["next", "done"].squeeze(-1)].float().flatten().tolist()
        returns.scale(data)
        optimizer.param_groups[0]["lr"] = RATE * max(0.0, 1 - done / steps)
        with torch.no_grad():
            advantages(data)
        stored.extend(data.reshape(-1))
        for _ in range(EPOCHS):
            for batch in stored:
                losses = loss(batch)
                (losses["loss_objective"] + losses["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
                optimizer.zero_grad()
        if done * 10 // steps > len(rates) and ended:
            rates[done], ended = sum(ended) / len(ended), []
            print(f"{done} steps: {rates[done]:.1%} of the episodes succeed", flush=True)
    env.close()
    return rates


if __name__ == "__main__":
    typer.run(main)
