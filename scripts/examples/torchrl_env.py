"""The single environment in TorchRL's `GymWrapper`: a rollout of random actions as a TensorDict.

    pip install torchrl
    python scripts/examples/torchrl_env.py

TorchRL's own vector environments (``ParallelEnv``) take a function that makes an environment: `make`.
"""

import gymnasium
from torchrl.envs import GymWrapper, RewardSum, TransformedEnv

import graspbox  # noqa: F401 (registers the environments)


def make(objects: str = "procedural:can:0-9") -> TransformedEnv:
    """Make an environment that records its return."""
    env = gymnasium.make("graspbox/Grasp-v0", objects=objects, obs=("proprio", "depth"), reward="dense")
    return TransformedEnv(GymWrapper(env), RewardSum())


def main() -> None:
    """Roll out 50 steps."""
    env = make()
    env.set_seed(0)
    rollout = env.rollout(50)
    print(rollout)
    print("rewards:", rollout["next", "episode_reward"][-1].item())


if __name__ == "__main__":
    main()
