"""Components of runs with Stable-Baselines3: environments, models, evaluation on held-out objects, checkpoints.

The directory of a run (`graspbox._common.runs`) holds

| file | contents |
|---|---|
| ``settings.json`` | settings that determine the run |
| ``evaluations.jsonl`` | a row per evaluation |
| ``losses.jsonl`` | losses, and returns and lengths of training episodes, as Stable-Baselines3 logs them |
| ``baselines.json`` | random actions, zero actions and the planner on the same trials |
| ``checkpoint/`` | model, replay buffer, statistics, environments, random states: a resumed run loses nothing |
| ``best/`` | the model of the best evaluation, without the replay buffer |
| ``tensorboard/`` | curves |
| ``video.webp`` | episodes of ``best`` with held-out objects |
"""

import json
import pickle
import random
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC, TD3, HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize, VecTransposeImage

from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.evaluation import run_trials, trial_seeds
from graspbox.policies import Task
from graspbox.sb3.extractors import Extractor
from graspbox.sb3.policy import ModelPolicy, summary
from graspbox.sb3.vec_env import VecEnv

__all__ = [
    "ALGORITHMS",
    "DemonstratedBuffer",
    "Linear",
    "RunCallback",
    "has_checkpoint",
    "load",
    "load_policy",
    "make_env",
    "make_held_out",
    "model_arguments",
    "normalized",
    "save",
]

#: About the greatest number of rows of losses of a run.
_MOST_ROWS = 1000
#: Algorithms by name.
ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC, "td3": TD3, "tqc": TQC}


def make_env(env_id: str, num_envs: int, **settings: Any) -> VecEnv:
    """Make the environments of a training."""
    return VecEnv.make(env_id, num_envs, **settings)


def normalized(env: Any, gamma: float, *, observations: bool, reward: bool) -> Any:
    """Scale vector observations, and rewards, by running statistics; images are unchanged."""
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
    """Replace a folder atomically: after an interruption a complete one remains, here or as ``.old``."""
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
    """Save the policy, the time that the training took, and with `buffer` everything that a resumed run needs."""

    def write(new: Path) -> None:
        model.save(new / "model.zip")
        statistics = model.get_vec_normalize_env()
        if statistics is not None:
            statistics.save(str(new / "normalize.pkl"))
        if buffer and isinstance(model, OffPolicyAlgorithm):
            model.save_replay_buffer(new / "replay_buffer.pkl")
        if buffer:
            returns = None if statistics is None else statistics.returns
            state = {"env": _plain(model.get_env()), "returns": returns, "random": _random_states()}
            (new / "state.pkl").write_bytes(pickle.dumps(state))
        (new / "progress.json").write_text(json.dumps({"timesteps": model.num_timesteps, "seconds": seconds}))

    _fresh(folder, write)


def load(algorithm: type[BaseAlgorithm], folder: Path, **settings: Any) -> Any:
    """Load a checkpoint with its environments, to go on as if the training had not been interrupted.

    Raises
    ------
    ConfigError
        If there is no checkpoint, or one of a former version, without the environments.
    """
    found = _checkpoint(folder)
    if not (found / "state.pkl").is_file():
        raise ConfigError(f"the checkpoint {str(found)!r} is of a former version; train in another folder")
    state = pickle.loads((found / "state.pkl").read_bytes())
    env, statistics = state["env"], found / "normalize.pkl"
    if statistics.is_file():
        env = VecNormalize.load(str(statistics), env)
        env.returns = state["returns"]
    model = algorithm.load(found / "model.zip", env=env, force_reset=False, **settings)
    if isinstance(model, OffPolicyAlgorithm):
        # The episodes in it go on.
        model.load_replay_buffer(found / "replay_buffer.pkl", truncate_last_traj=False)
    _set_random_states(state["random"])
    return model


def _plain(env: Any) -> Any:
    """Return the environments without `VecNormalize`, which has a file of its own, and the turning of images."""
    while isinstance(env, VecNormalize | VecTransposeImage):
        env = env.venv
    return env


def _random_states() -> tuple[Any, ...]:
    return random.getstate(), np.random.get_state(), torch.get_rng_state()  # noqa: NPY002 (what Stable-Baselines3 uses)


def _set_random_states(states: tuple[Any, ...]) -> None:
    random.setstate(states[0])
    np.random.set_state(states[1])  # noqa: NPY002
    torch.set_rng_state(states[2])


def load_policy(name: str, folder: Path, device: str = "cpu") -> ModelPolicy:
    """Load a checkpoint as a policy for inference; it needs no replay buffer.

    Parameters
    ----------
    name : str
        Algorithm, one of `ALGORITHMS`; also the name of the policy.
    folder : Path
        A folder that `save` wrote.
    device : str
        Device of the networks.

    Raises
    ------
    ConfigError
        As `load`.
    """
    found = _checkpoint(folder)
    statistics = found / "normalize.pkl"
    scales = pickle.loads(statistics.read_bytes()) if statistics.is_file() else None
    algorithm = ALGORITHMS[name]
    # Without environments there can be no hindsight.
    unused = {"replay_buffer_class": None, "buffer_size": 1} if issubclass(algorithm, OffPolicyAlgorithm) else {}
    return ModelPolicy(algorithm.load(found / "model.zip", device=device, **unused), scales, name)


def has_checkpoint(run: Path) -> bool:
    """Return whether a run has a checkpoint to resume from.

    Raises
    ------
    ConfigError
        If it has evaluations but no checkpoint.
    """
    if any((run / name).exists() for name in ("checkpoint", "checkpoint.old")):
        return True
    if (run / "evaluations.jsonl").exists():
        raise ConfigError(f"{str(run)!r} holds evaluations but no checkpoint to continue from; name another folder")
    return False


def _checkpoint(folder: Path) -> Path:
    """Return the folder if it is complete, else the previous one that it was about to replace."""
    found = folder if folder.exists() else folder.with_name(folder.name + ".old")
    if not (found / "progress.json").is_file():
        raise ConfigError(f"there is no checkpoint in {str(folder.parent)!r}; train there first")
    return found


class _Stopped(Exception):  # noqa: N818 (no error)
    """Ends the training between two rollouts."""


class RunCallback(BaseCallback):  # type: ignore[misc]
    """Evaluates, saves and ends a run.

    Parameters
    ----------
    run : Run
        The run; each evaluation adds a row to its ``evaluations``.
    envs : VectorEnv
        Held-out environments, from `make_held_out`.
    steps : int
        Total steps of all environments after which the run ends.
    every : int
        Steps between two evaluations. Each one also writes a checkpoint.
    episodes, seed : int
        Number and seed of the trials of an evaluation; the same trials in all evaluations.
    minutes : float, optional
        Time limit since the callback was created, evaluations included.
    every_minutes : float, optional
        Also evaluate when this time has passed since the last evaluation began, unless evaluations take longer than
        training.
    """

    def __init__(
        self,
        run: Run,
        envs: VectorEnv[Any, Any, Any],
        *,
        steps: int,
        every: int,
        episodes: int,
        seed: int,
        minutes: float | None = None,
        every_minutes: float | None = None,
    ) -> None:
        super().__init__()
        self.run, self.rows, self.steps = run, run.rows("evaluations"), steps
        self.every, self.minutes, self.every_minutes = every, minutes, every_minutes
        self._envs, self._seeds = envs, trial_seeds(seed, episodes)
        self.interrupted, self._evaluation = False, 0.0
        self._began = self._evaluated = time.monotonic()

    @property
    def last(self) -> dict[str, Any] | None:
        """The last evaluation."""
        return self.rows[-1] if self.rows else None

    @property
    def best(self) -> float:
        """Best success rate so far."""
        return max((row["success"] for row in self.rows), default=-1.0)

    def interrupt(self, *_: Any) -> None:
        """End the run after this rollout and its updates, or at once on a second call; a signal handler."""
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        self.run.log("saving the run; press Ctrl-C again to end at once")

    def learn(self, model: BaseAlgorithm, *, begun: bool) -> None:
        """Train a model until the run has its number of steps, or Ctrl-C; evaluates and saves at the end."""
        caught = (signal.SIGINT, signal.SIGTERM) if current_thread() is main_thread() else ()
        handlers = {number: signal.signal(number, self.interrupt) for number in caught}
        try:
            left = max(self.steps - model.num_timesteps, 0)
            with suppress(_Stopped):
                model.learn(left, callback=self, tb_log_name="run", reset_num_timesteps=not begun)
            if self.interrupted or (self.last and self.last["timesteps"] == model.num_timesteps):
                self.save()
            else:
                self.evaluate()
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)

    def save(self) -> None:
        """Write the checkpoint."""
        save(self.model, self.run.folder / "checkpoint", self.run.seconds)

    def evaluate(self) -> None:
        """Evaluate now, and write the checkpoint."""
        began = time.monotonic()
        policy = ModelPolicy(self.model, self.model.get_vec_normalize_env())
        policy.bind(Task.of(self._envs))
        found = summary(run_trials(policy, self._envs, self._seeds))
        row = {"timesteps": self.model.num_timesteps, "seconds": round(self.run.seconds, 1), **found}
        # Of equal success rates, the greater return wins.
        if all((found["success"], found["return"]) > (one["success"], one["return"]) for one in self.rows):
            save(self.model, self.run.folder / "best", self.run.seconds, buffer=False)
        self.save()
        # The row is written after its checkpoint, so that a resumed run does not repeat it.
        self.rows.append(row)
        rates = f"{found['success']:.1%} of {found['episodes']} held-out trials succeed, {found['secure']:.1%} secure"
        self.run.log(f"{self.model.num_timesteps} of {self.steps} steps: {rates}")
        for name in ("success", "secure", "return", "length"):
            self.logger.record(f"eval/{name}", found[name])
        self.logger.dump(self.model.num_timesteps)
        self._evaluated, self._evaluation = began, time.monotonic() - began

    def _on_training_start(self) -> None:
        self.logger.output_formats.append(_LossRows(self.run, self.num_timesteps, self.steps // _MOST_ROWS))
        # The curve starts with the untrained policy.
        if self.last is None:
            self.evaluate()

    def _on_rollout_start(self) -> None:
        # Between rollouts nothing is under way, so that a checkpoint holds everything.
        if self.interrupted or not self._has_time():
            raise _Stopped
        if self._is_due():
            self.evaluate()

    def _on_step(self) -> bool:
        self.run.report(f"{self.num_timesteps} of {self.steps} steps", self.num_timesteps / max(self.steps, 1))
        return True

    def _has_time(self) -> bool:
        """Whether there is time for more than the final evaluation, which takes about as long as the previous one."""
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


class _LossRows(KVWriter):  # type: ignore[misc]
    """Writes what the algorithm logs (losses, returns and lengths of its episodes) to ``losses.jsonl``.

    Rows after the `begun` steps of the checkpoint from which a run resumes are removed; new ones are at least `every`
    steps apart.
    """

    def __init__(self, run: Run, begun: int, every: int) -> None:
        self._run, self._rows, self._every = run, run.rows("losses"), every
        self._rows.keep(lambda row: bool(row["step"] <= begun))
        self._newest: dict[str, float] = {}

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
        """Add a row; evaluations have a file of their own."""
        del key_excluded
        for name, value in key_values.items():
            number = isinstance(value, int | float | np.number) and np.isfinite(value)
            if number and not name.startswith(("eval/", "time/")):
                self._newest[name] = float(value)
        if self._newest and (not self._rows or step - self._rows[-1]["step"] >= self._every):
            self._rows.append({"step": step, "seconds": round(self._run.seconds, 1), **self._newest})
            self._newest = {}

    def close(self) -> None:
        """Nothing is open."""


def model_arguments(algorithm: Any, arguments: dict[str, Any], env: Any, demonstrations: int) -> dict[str, Any]:
    """Build an algorithm's arguments from its entry in the parameter file.

    Names of classes become classes, ``linear_X`` becomes a schedule, and the observation space determines the policy
    and its features extractor.

    Parameters
    ----------
    algorithm : type
        A value of `graspbox.learn.sb3.running.ALGORITHMS`.
    arguments : dict
        The entry ``model`` of the parameters.
    env : VecEnv
        The training environment.
    demonstrations : int
        Number of demonstrations; with any, an off-policy algorithm gets a `DemonstratedBuffer`.
    """
    policy = dict(arguments.get("policy_kwargs", {}))
    if "activation_fn" in policy:
        policy["activation_fn"] = getattr(torch.nn, policy["activation_fn"])
    space = env.observation_space
    named = isinstance(space, gymnasium.spaces.Dict)
    if any(len(box.shape) > 1 for box in (space.values() if named else [space])):
        policy.setdefault("features_extractor_class", Extractor)
    found = {**arguments, "policy": "MultiInputPolicy" if named else "MlpPolicy", "policy_kwargs": policy}
    if "replay_buffer_class" in arguments:
        found["replay_buffer_class"] = HerReplayBuffer
    if demonstrations and issubclass(algorithm, OffPolicyAlgorithm):
        found["replay_buffer_class"] = DemonstratedBuffer
    if "learning_rate" in found:
        found["learning_rate"] = _rate(found["learning_rate"])
    if "action_noise" in found:
        size = env.action_space.shape
        found["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, found["action_noise"]))
    return found


def _rate(value: Any) -> Any:
    """Convert to a number or a schedule; YAML reads 1e-3, without a point, and linear_1e-3 as strings."""
    if not isinstance(value, str):
        return value
    return Linear(float(value.removeprefix("linear_"))) if value.startswith("linear_") else float(value)


class DemonstratedBuffer(ReplayBuffer):  # type: ignore[misc]
    """A replay buffer that samples a share of each batch from demonstrations, if it has any.

    Parameters
    ----------
    *args, **kwargs
        As in Stable-Baselines3.
    share : float
        Share of a batch sampled from `demonstrations`.
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


class Linear:
    """A schedule that falls linearly from a value to zero over a run."""

    def __init__(self, start: float) -> None:
        self.start = start

    def __call__(self, remaining: float) -> float:
        """Value when this share of the run remains, 1 at its start and 0 at its end."""
        return self.start * remaining
