"""PPO of RLlib whose environments are stepped on the nodes of a Ray cluster, apart from the processes of RLlib.

Each node runs a server of environments; each runner of RLlib has one vector environment, spread over all of them. A
runner needs little CPU time then, and a server that dies costs no episode.

    pip install 'graspbox[rllib]'                     # on every node; see rllib_ppo.py for RLlib's pin of Gymnasium
    ray start --head; ray start --address=HEAD:6379   # on the first node; on each other one
    python scripts/examples/rllib_remote.py

Without a cluster the example starts one, of only this machine.
"""

from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env
from rllib_ppo import train

from graspbox.tools.remote import RayServers


def make(settings: dict[str, Any]) -> VectorEnv[Any, Any, Any]:
    """Make the environments of a runner in its process; the prefix of the id imports graspbox there."""
    return gymnasium.make_vec("graspbox:graspbox/Grasp-v0", **settings)


def main(iterations: int = 3, runners: int = 1, cpus_per_server: int = 1) -> None:
    """Train on environments of servers."""
    register_env("grasp", make)
    with RayServers(cpus_per_server=cpus_per_server) as servers:
        print("servers:", *servers.remote.urls)
        settings = {"objects": "procedural:can:0-9", "reward": "dense", "remote": servers.remote}
        config = (
            PPOConfig()
            .environment("grasp", env_config=settings)
            .env_runners(
                num_env_runners=runners, num_envs_per_env_runner=8, gym_env_vectorize_mode="vector_entry_point"
            )
        )
        train(config, iterations)


if __name__ == "__main__":
    main()
