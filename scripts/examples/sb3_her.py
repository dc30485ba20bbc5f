"""Hindsight experience replay with SAC of Stable-Baselines3 in a goal task.

    pip install 'graspbox[train]'
    python scripts/examples/sb3_her.py --seed 1
    python scripts/examples/sb3_her.py --env-id graspbox/Place-v0 --steps 200000 --num-envs 8

Observations are normalized, as is usual for goal tasks. Every tenth of the run prints the success rate of the policy
without noise, at the end of 50 episodes whose seeds the training does not have.
"""

from typing import Annotated, Any

import gymnasium
import torch
import typer
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from graspbox.sb3 import VecEnv

#: Objects of Place-v0.
OBJECTS = ["procedural:box:0-99", "procedural:can:0-99", "procedural:ball:0-99"]


class Evaluation(BaseCallback):  # type: ignore[misc]
    """Prints the success rate ten times in a run."""

    def __init__(self, envs: gymnasium.vector.VectorEnv[Any, Any, Any], steps: int) -> None:
        super().__init__()
        self._envs, self._every, self.rates = envs, max(1, steps // 10), dict[int, float]()

    def _on_step(self) -> bool:
        if self.num_timesteps // self._every > len(self.rates):
            self.rates[self.num_timesteps] = rate = self.success()
            print(f"{self.num_timesteps} steps: success {rate:.0%}", flush=True)
        return True

    def success(self) -> float:
        """Return the share of the episodes whose last step has success."""
        scales = self.model.get_vec_normalize_env()
        seen, info = self._envs.reset(seed=10_000)
        truncated = [False]
        while not any(truncated):
            actions, _ = self.model.predict(scales.normalize_obs(seen), deterministic=True)
            seen, _, _, truncated, info = self._envs.step(actions)
        return float(info["is_success"].mean())


def main(
    env_id: Annotated[str, typer.Option(help="Id of the goal task.")] = "graspbox/Reach-v0",
    objects: Annotated[list[str] | None, typer.Option(help="Object set of Place-v0; may be repeated.")] = None,
    steps: Annotated[int, typer.Option(help="Steps of all environments together.")] = 2500,
    num_envs: Annotated[int, typer.Option(help="Environments of the training.")] = 1,
    first: Annotated[int, typer.Option(help="Random steps before the first update.")] = 500,
    units: Annotated[int, typer.Option(help="Units of each of the two hidden layers.")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the learner.")] = 1,
    trials: Annotated[int, typer.Option(help="Episodes of an evaluation.")] = 50,
) -> dict[int, float]:
    """Train; returns the success rates by the number of steps."""
    torch.set_num_threads(1)
    keywords: dict[str, Any] = {"objects": objects or OBJECTS} if env_id.endswith("Place-v0") else {}
    env = VecNormalize(VecEnv.make(env_id, num_envs, **keywords), norm_reward=False)
    held: Any = gymnasium.make_vec(env_id, num_envs=trials, autoreset_mode="Disabled", **keywords)
    model = SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        # Random steps show the whole workspace; a policy of few updates stays at its border.
        learning_starts=max(first, 51 * num_envs),
        gamma=0.95,
        tau=0.05,
        learning_rate=1e-3,
        ent_coef="auto_0.1",
        gradient_steps=-1,
        policy_kwargs={"net_arch": [units, units]},
        seed=seed,
        device="cpu",
    )
    evaluation = Evaluation(held, steps)
    model.learn(steps, callback=evaluation)
    return evaluation.rates


if __name__ == "__main__":
    typer.run(main)
