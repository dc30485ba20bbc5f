"""PPO of RLlib on the single environment, in two processes.

RLlib pins an older Gymnasium than the one that graspbox is tested with; graspbox runs on both. pip obeys the pin:

    pip install 'graspbox[rllib]'
    python scripts/examples/rllib_ppo.py

To keep the newer Gymnasium instead, override the pin: ``uv pip install 'graspbox[rllib]' --override overrides.txt``,
with the line ``gymnasium>=1.1`` in that file; or, with pip, ``pip install -U --no-deps gymnasium`` afterwards.
"""

from typing import Any

import gymnasium
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env


def make(settings: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make an environment in a process of RLlib; the prefix of the id imports graspbox there."""
    return gymnasium.make("graspbox:graspbox/Grasp-v0", **settings)


def train(config: PPOConfig, iterations: int) -> None:
    """Train for a number of iterations, with the numbers of ``graspbox train sb3 ppo``."""
    config = config.training(
        train_batch_size_per_learner=4096, minibatch_size=512, num_epochs=5, gamma=0.97, lambda_=0.95, lr=7e-4
    ).debugging(seed=0)
    algorithm = config.build_algo()
    for _ in range(iterations):
        results = algorithm.train()["env_runners"]
        print("steps", results["num_env_steps_sampled_lifetime"], "return", results.get("episode_return_mean"))
    algorithm.stop()


def main(iterations: int = 3, runners: int = 2) -> None:
    """Train on environments of two processes."""
    register_env("grasp", make)
    settings = {"objects": "procedural:can:0-9", "num_threads": 1}
    config = PPOConfig().environment("grasp", env_config=settings)
    train(config.env_runners(num_env_runners=runners, num_envs_per_env_runner=4), iterations)


if __name__ == "__main__":
    main()
