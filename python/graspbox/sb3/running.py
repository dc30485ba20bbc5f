"""Parts of a training run with Stable-Baselines3: environments, evaluation on held-out objects, checkpoints.

``scripts/train_sb3.py`` combines them. The folder of a run holds

| file | contents |
|---|---|
| ``evaluations.jsonl`` | the settings, then a row per evaluation (a `graspbox.resume_log.ResumeLog`) |
| ``baselines.json`` | random actions, zero actions and the planner on the same trials |
| ``checkpoint/`` | model, replay buffer, statistics of `VecNormalize`, time: all that a resumed run needs |
| ``best/`` | the model of the best evaluation, without the replay buffer |
| ``tensorboard/`` | curves |
"""

import json
import pickle
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from graspbox.errors import ConfigError
from graspbox.evaluation import run_trials, trial_seeds
from graspbox.policies import Policy, Task
from graspbox.resume_log import ResumeLog
from graspbox.sb3.goal_env import make_vec
from graspbox.sb3.policy import ModelPolicy, summary
from graspbox.sb3.ppo import PPO
from graspbox.sb3.vec_env import VecEnv

__all__ = ["ALGORITHMS", "Linear", "Run", "load", "load_policy", "make_env", "make_held_out", "normalized", "save"]

#: Algorithms by name.
ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC, "td3": TD3}


def make_env(env_id: str, num_envs: int, **settings: Any) -> VecMonitor:
    """Make environments that record the length and return of their episodes; keywords as `goal_env.make_vec` has."""
    return VecMonitor(VecEnv(make_vec(env_id, num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **settings)))


def normalized(env: Any, gamma: float, *, observations: bool, reward: bool) -> Any:
    """Scale vector observations, and rewards, by running statistics; images stay as they are."""
    space = env.observation_space
    keys = None
    if isinstance(space, gymnasium.spaces.Dict):
        keys = [name for name, box in space.items() if len(box.shape or ()) == 1]
        observations = observations and bool(keys)
    elif len(space.shape) != 1:
        observations = False
    if not observations and not reward:
        return env
    return VecNormalize(env, norm_obs=observations, norm_reward=reward, gamma=gamma, norm_obs_keys=keys)


def make_held_out(env_id: str, num_envs: int, **settings: Any) -> VectorEnv[Any, Any, Any]:
    """Make the environments of evaluations; `graspbox.evaluation.run_trials` resets them."""
    return gymnasium.make_vec(env_id, num_envs=num_envs, autoreset_mode=AutoresetMode.DISABLED, **settings)


def _fresh(folder: Path, write: Callable[[Path], None]) -> None:
    """Replace a folder atomically: if this is interrupted, a complete one remains, here or as ``.old``."""
    new, old = (folder.with_name(folder.name + end) for end in (".new", ".old"))
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    write(new)
    if folder.exists():
        shutil.rmtree(old, ignore_errors=True)
        folder.rename(old)
    new.rename(folder)
    shutil.rmtree(old, ignore_errors=True)


def save(
    model: BaseAlgorithm,
    folder: Path,
    seconds: float,
    *,
    buffer: bool = True,
    also: Callable[[Path], None] = lambda _: None,
) -> None:
    """Save all that a resumed run needs; `also` writes more into the folder."""

    def write(new: Path) -> None:
        model.save(new / "model.zip")
        statistics = model.get_vec_normalize_env()
        if statistics is not None:
            statistics.save(str(new / "normalize.pkl"))
        if buffer and isinstance(model, OffPolicyAlgorithm):
            model.save_replay_buffer(new / "replay_buffer.pkl")
        (new / "progress.json").write_text(json.dumps({"timesteps": model.num_timesteps, "seconds": seconds}))
        also(new)

    _fresh(folder, write)


def load(algorithm: type[BaseAlgorithm], folder: Path, env: Any, **settings: Any) -> tuple[Any, float]:
    """Load a checkpoint to continue training: the model, and the seconds it has been trained for.

    Episodes begin anew, with the environment's present seed.

    Raises
    ------
    ConfigError
        If there is no checkpoint.
    """
    found = _checkpoint(folder)
    statistics = found / "normalize.pkl"
    if statistics.is_file():
        env = VecNormalize.load(str(statistics), env.venv)
    model = algorithm.load(found / "model.zip", env=env, **settings)
    if isinstance(model, OffPolicyAlgorithm):
        model.load_replay_buffer(found / "replay_buffer.pkl")
    return model, float(json.loads((found / "progress.json").read_text())["seconds"])


def load_policy(name: str, folder: Path, device: str = "cpu") -> ModelPolicy:
    """Load a checkpoint as a policy that acts but does not learn; it needs no replay buffer.

    Parameters
    ----------
    name : str
        Algorithm, one of `ALGORITHMS`; the policy has this name too.
    folder : Path
        A folder that `save` wrote.
    device : str
        Where the networks run.

    Raises
    ------
    ConfigError
        If there is no checkpoint.
    """
    found = _checkpoint(folder)
    statistics = found / "normalize.pkl"
    scales = pickle.loads(statistics.read_bytes()) if statistics.is_file() else None
    return ModelPolicy(ALGORITHMS[name].load(found / "model.zip", device=device), scales, name)


def _checkpoint(folder: Path) -> Path:
    """Find the complete one of a folder and the one that it was about to replace."""
    found = folder if folder.exists() else folder.with_name(folder.name + ".old")
    if not (found / "progress.json").is_file():
        raise ConfigError(f"there is no checkpoint in {str(folder.parent)!r}; begin a run without --resume")
    return found


class Run(BaseCallback):  # type: ignore[misc]
    """Evaluates, saves, and ends a run.

    Parameters
    ----------
    folder : Path
        The run's folder.
    envs : VectorEnv
        Held-out environments, from `make_held_out`.
    log : ResumeLog
        Receives a row per evaluation.
    every : int
        Steps between two evaluations. A checkpoint is written with each of them.
    episodes, seed : int
        Number and seed of the trials of an evaluation; all evaluations have the same trials.
    minutes : float, optional
        The run ends after this time since the callback was made, evaluations included.
    every_minutes : float, optional
        Evaluate also when this time has passed since the last evaluation began, unless evaluations take longer than
        training.
    seconds : float
        Training time before the run was resumed.
    value_warmup : int
        Number of first steps in which an on-policy model learns its value function alone: after cloning the policy is
        better than the value function, whose first advantages would spoil it.
    policy : callable
        Makes the policy that is evaluated of the model and its statistics; by default `ModelPolicy`.
    """

    def __init__(
        self,
        folder: Path,
        envs: VectorEnv[Any, Any, Any],
        log: ResumeLog,
        *,
        every: int,
        episodes: int,
        seed: int,
        minutes: float | None = None,
        every_minutes: float | None = None,
        seconds: float = 0.0,
        value_warmup: int = 0,
        policy: Callable[[BaseAlgorithm, VecNormalize | None], Policy] = ModelPolicy,
    ) -> None:
        super().__init__()
        self._policy = policy
        self.folder, self.log, self.value_warmup = folder, log, value_warmup
        self.every, self.minutes, self.every_minutes = every, minutes, every_minutes
        self._envs, self._seeds = envs, trial_seeds(seed, episodes)
        #: Called after each step with the number of steps and the last evaluation, if any.
        self.on_progress: Callable[[int, dict[str, Any] | None], None] = lambda *_: None
        self.interrupted, self._evaluation = False, 0.0
        self._before, self._began = seconds, time.monotonic()
        self._evaluated = self._began

    @property
    def seconds(self) -> float:
        """Training time in seconds, including that before the run was resumed."""
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
        policy = self._policy(self.model, self.model.get_vec_normalize_env())
        policy.bind(Task.of(self._envs))
        found = summary(run_trials(policy, self._envs, self._seeds))
        row = {"timesteps": self.model.num_timesteps, "seconds": round(self.seconds, 1), **found}
        if found["success"] > self.best:
            save(self.model, self.folder / "best", self.seconds, buffer=False)
        self.save()
        # The row comes after its checkpoint: a resumed run does not repeat it.
        self.log.append(row)
        for name in ("success", "secure", "return", "length"):
            self.logger.record(f"eval/{name}", found[name])
        self.logger.dump(self.model.num_timesteps)
        self._evaluated, self._evaluation = began, time.monotonic() - began

    def _on_training_start(self) -> None:
        # The curve begins with the policy before training.
        if self.last is None:
            self.evaluate()

    def _on_rollout_start(self) -> None:
        if self.value_warmup:
            policy: Any = self.model.policy
            learns = self.num_timesteps >= self.value_warmup
            for part in (
                *policy.mlp_extractor.policy_net.parameters(),
                *policy.action_net.parameters(),
                policy.log_std,
            ):
                part.requires_grad_(learns)

    def _on_step(self) -> bool:
        if self.interrupted:
            return False
        if self._is_due():
            self.evaluate()
        self.on_progress(self.num_timesteps, self.last)
        # The evaluation at the end takes about as long as the one before.
        spent = time.monotonic() - self._began + self._evaluation
        return self.minutes is None or spent < 60 * self.minutes

    def _is_due(self) -> bool:
        """Whether enough steps, or enough time, have passed since the last evaluation."""
        steps = self.num_timesteps - (int(self.last["timesteps"]) if self.last else 0)
        enough: bool = steps >= self.every
        if enough or self.every_minutes is None:
            return enough
        # From start to start; but a run trains for at least as long as it evaluates.
        waited = time.monotonic() - self._evaluated
        return waited >= max(60 * self.every_minutes, 2 * self._evaluation)


class Linear:
    """A schedule that falls linearly from a value to zero over a run."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, remaining: float) -> float:
        """Value where this share of the run remains, 1 at its start and 0 at its end."""
        return self.start * remaining
