"""What a training run with Stable-Baselines3 needs: environments, evaluation on held-out objects, checkpoints.

``scripts/train_sb3.py`` puts these together; a run's folder holds

| file | what |
|---|---|
| ``evaluations.jsonl`` | the settings, then a row for each evaluation (a `graspbox.resume_log.ResumeLog`) |
| ``references.json`` | what random actions, zero actions and the planner reach in the same episodes |
| ``checkpoint/`` | model, replay buffer, statistics of `VecNormalize`, time: all that a resumed run needs |
| ``best/`` | the model of the best evaluation, without the replay buffer |
| ``tensorboard/`` | curves |
"""

import json
import shutil
import time
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from graspbox.errors import ConfigError
from graspbox.resume_log import ResumeLog
from graspbox.sb3.ppo import PPO
from graspbox.sb3.vec_env import VecEnv

__all__ = ["ALGORITHMS", "Linear", "Run", "evaluate", "load", "make_env", "normalized", "save"]

#: What can be trained, by name.
ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC, "td3": TD3}


def make_env(env_id: str, num_envs: int, **settings: Any) -> VecMonitor:
    """Make environments side by side that say how long their episodes were and what they paid."""
    return VecMonitor(VecEnv.make(env_id, num_envs, **settings))


def normalized(env: Any, gamma: float, *, observations: bool, reward: bool, training: bool) -> Any:
    """Scale vectors of observations, and rewards, by what has been seen of them; images stay as they are."""
    space = env.observation_space
    keys = None
    if isinstance(space, gymnasium.spaces.Dict):
        keys = [name for name, box in space.items() if len(box.shape or ()) == 1]
        observations = observations and bool(keys)
    elif len(space.shape) != 1:
        observations = False
    if not observations and not reward:
        return env
    return VecNormalize(
        env, training, norm_obs=observations, norm_reward=reward and training, gamma=gamma, norm_obs_keys=keys
    )


def evaluate(policy: Any, env: Any, episodes: int, seed: int) -> dict[str, Any]:
    """Let a policy act, deterministically, in the episodes that a seed gives.

    Parameters
    ----------
    policy : object with ``predict``
        As Stable-Baselines3's.
    env : VecEnv
        What `make_env` made.
    episodes : int
        How many; each environment has its share, so that short episodes count no more than long ones.
    seed : int
        Seed of the first environment.

    Returns
    -------
    dict
        Shares of ``success`` and ``secure``, their standard error, mean ``return`` and ``length``, ``episodes``, and
        how often each ``failure`` occurred.
    """
    ends: list[dict[str, Any]] = []

    def look(found: dict[str, Any], _: dict[str, Any]) -> None:
        if found["done"]:
            ends.append(found["info"])

    env.seed(seed)
    returns, lengths = evaluate_policy(
        policy, env, n_eval_episodes=episodes, callback=look, return_episode_rewards=True
    )
    success = float(np.mean([end["is_success"] for end in ends]))
    failures = sorted(end["failure"] for end in ends if not end["is_success"])
    return {
        "success": success,
        "error": float(np.sqrt(success * (1 - success) / episodes)),
        "secure": float(np.mean([end["is_secure"] for end in ends])),
        "return": float(np.mean(returns)),
        "length": float(np.mean(lengths)),
        "episodes": episodes,
        "failures": {name: failures.count(name) for name in dict.fromkeys(failures)},
    }


def _fresh(folder: Path, write: Callable[[Path], None]) -> None:
    """Replace a folder as a whole: whenever this is interrupted, a complete one remains, here or beside."""
    new, old = (folder.with_name(folder.name + end) for end in (".new", ".old"))
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    write(new)
    if folder.exists():
        shutil.rmtree(old, ignore_errors=True)
        folder.rename(old)
    new.rename(folder)
    shutil.rmtree(old, ignore_errors=True)


def save(model: BaseAlgorithm, folder: Path, seconds: float, *, buffer: bool = True) -> None:
    """Save all that a resumed run needs."""

    def write(new: Path) -> None:
        model.save(new / "model.zip")
        statistics = model.get_vec_normalize_env()
        if statistics is not None:
            statistics.save(str(new / "normalize.pkl"))
        if buffer and isinstance(model, OffPolicyAlgorithm):
            model.save_replay_buffer(new / "replay_buffer.pkl")
        (new / "progress.json").write_text(json.dumps({"timesteps": model.num_timesteps, "seconds": seconds}))

    _fresh(folder, write)


def load(
    algorithm: type[BaseAlgorithm], folder: Path, env: Any, *, buffer: bool = True, **settings: Any
) -> tuple[Any, float]:
    """Load what `save` wrote; the model and the seconds it has been trained for.

    Episodes begin anew: with the environment's present seed, not where they stood. Without `buffer` a model is to act,
    not to go on learning.

    Raises
    ------
    ConfigError
        If there is nothing to load.
    """
    found = folder if folder.exists() else folder.with_name(folder.name + ".old")
    if not (found / "progress.json").is_file():
        raise ConfigError(f"there is no checkpoint in {str(folder.parent)!r}; begin a run without --resume")
    statistics = found / "normalize.pkl"
    if statistics.is_file():
        env = VecNormalize.load(str(statistics), env.venv)
    model = algorithm.load(found / "model.zip", env=env, **settings)
    if buffer and isinstance(model, OffPolicyAlgorithm):
        model.load_replay_buffer(found / "replay_buffer.pkl")
    return model, float(json.loads((found / "progress.json").read_text())["seconds"])


class Run(BaseCallback):  # type: ignore[misc]
    """Evaluates, saves, and ends a run.

    Parameters
    ----------
    folder : Path
        The run's folder.
    env : VecEnv
        Held-out episodes: what `make_env` made, wrapped by `normalized` if the model's environment is.
    log : ResumeLog
        Takes a row for each evaluation.
    every, episodes : int
        Steps between two evaluations, and their length. Every evaluation goes with a checkpoint.
    seed : int
        Seed of the evaluations: all see the same episodes.
    minutes : float, optional
        The run ends after so much time; evaluations count.
    seconds : float
        Time that the run has taken before.
    step : callable
        Called with the number of steps and the last evaluation, if any, after each step.
    values_first : int
        For so many steps an on-policy model learns its values alone: a policy that was cloned knows more than they do,
        and would be led astray by them.
    """

    def __init__(
        self,
        folder: Path,
        env: Any,
        log: ResumeLog,
        *,
        every: int,
        episodes: int,
        seed: int,
        minutes: float | None = None,
        seconds: float = 0.0,
        step: Callable[[int, dict[str, Any] | None], None] = lambda *_: None,
        values_first: int = 0,
    ) -> None:
        super().__init__()
        self.values_first = values_first
        self.folder, self.env, self.log = folder, env, log
        self.every, self.episodes, self.seed, self.minutes = every, episodes, seed, minutes
        self.interrupted, self._evaluation = False, 0.0
        self._before, self._began, self._step = seconds, time.monotonic(), step

    @property
    def seconds(self) -> float:
        """Time that the run has taken, that before it was resumed included."""
        return self._before + time.monotonic() - self._began

    @property
    def last(self) -> dict[str, Any] | None:
        """The last evaluation."""
        return self.log.rows[-1] if self.log.rows else None

    @property
    def best(self) -> float:
        """Best share of successes so far."""
        return max((row["success"] for row in self.log.rows), default=-1.0)

    def interrupt(self, *_: Any) -> None:
        """End the run after this step; a signal handler."""
        self.interrupted = True

    def save(self) -> None:
        """Write the checkpoint."""
        save(self.model, self.folder / "checkpoint", self.seconds)

    def evaluate(self) -> None:
        """Evaluate now, and write the checkpoint."""
        began = time.monotonic()
        statistics = self.model.get_vec_normalize_env()
        if statistics is not None and statistics.norm_obs:
            self.env.obs_rms = deepcopy(statistics.obs_rms)
        found = evaluate(self.model, self.env, self.episodes, self.seed)
        row = {"timesteps": self.model.num_timesteps, "seconds": round(self.seconds, 1), **found}
        if found["success"] > self.best:
            save(self.model, self.folder / "best", self.seconds, buffer=False)
        self.save()
        # A row tells of a checkpoint that exists: a resumed run does not write it again.
        self.log.append(row)
        for name in ("success", "secure", "return", "length"):
            self.logger.record(f"eval/{name}", found[name])
        self.logger.dump(self.model.num_timesteps)
        self._evaluation = time.monotonic() - began

    def _on_training_start(self) -> None:
        # The curve begins with what the policy is worth before it learns.
        if self.last is None:
            self.evaluate()

    def _on_rollout_start(self) -> None:
        if self.values_first:
            policy: Any = self.model.policy
            learns = self.num_timesteps >= self.values_first
            for part in (
                *policy.mlp_extractor.policy_net.parameters(),
                *policy.action_net.parameters(),
                policy.log_std,
            ):
                part.requires_grad_(learns)

    def _on_step(self) -> bool:
        if self.interrupted:
            return False
        due = self.last["timesteps"] if self.last else 0
        if self.num_timesteps >= due + self.every:
            self.evaluate()
        self._step(self.num_timesteps, self.last)
        # The last evaluation takes as long as the one before, and counts.
        return self.minutes is None or self.seconds + self._evaluation < 60 * self.minutes


class Linear:
    """Falls from a value to zero as the remaining share of a run does."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, remaining: float) -> float:
        """Value where this share of the run remains."""
        return self.start * remaining
