"""Reinforcement learning runs with Stable-Baselines3: the model, its demonstrations, and the run (`train`).

A run with demonstrations records successful episodes of the scripted expert, and samples half of each batch from them
(`DemonstratedBuffer`; Ball, Smith, Kostrikov, Levine, "Efficient Online Reinforcement Learning with Offline Data",
2023). The expert uses the objects' meshes; the trained policy does not.
"""

import math
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer

from graspbox import policies
from graspbox._common.files import dumps, write_text
from graspbox._common.runs import Run
from graspbox.data.episodes import Demonstrations, record
from graspbox.envs.settings import GraspConfig
from graspbox.errors import ConfigError, GraspboxError
from graspbox.learn.sb3.checks import check_arguments
from graspbox.learn.sb3.running import (
    ALGORITHMS,
    RunCallback,
    has_checkpoint,
    load,
    make_env,
    make_held_out,
    model_arguments,
    normalized,
)
from graspbox.learn.sb3.runs import next_commands
from graspbox.learn.sb3.settings import EVALUATION_SEED, Parameters, Sb3Settings
from graspbox.learn.training.options import TrainingOutcome
from graspbox.pictures import playback
from graspbox.policies.base import is_closed_loop
from graspbox.policies.published.configs import ACTING
from graspbox.sb3.policy import evaluate_baselines

__all__ = ["train"]

#: Seed of demonstrations, whose episodes differ from those of training and evaluation.
_DEMONSTRATION_SEED = 20_000


def _demonstrated(settings: Sb3Settings, parameters: Parameters, run: Run) -> Path:
    """Record the demonstrations of a run, unless it has them; returns their folder."""
    folder, wanted = run.folder / "demonstrations", parameters.demonstrations
    moves = is_closed_loop(settings.env)
    env = {name: getattr(GraspConfig, name) for name in ACTING if moves} | dict(parameters.env)
    obs, objects = env.pop("obs", "state"), env.pop("objects", "procedural")
    found = record(
        "expert" if moves else "planner",
        folder,
        settings.env,
        objects,
        wanted,
        obs=obs,
        seed=_DEMONSTRATION_SEED,
        keep="success",
        split="train",
        progress=lambda kept, _: run.report(f"{kept} of {wanted} demonstrations", kept / wanted),
        **env,
    )
    run.log(f"{wanted} demonstrations; success rate of the expert {wanted / found.trials:.0%}")
    return folder


def _replay(model: Any, folder: Path) -> None:
    """Give an off-policy model demonstrations to replay, and their statistics."""
    shown = Demonstrations(folder)
    env = model.get_env()
    size = sum(episode.steps for episode in shown.episodes)
    buffer = ReplayBuffer(size, env.observation_space, env.action_space, device=model.device, n_envs=1)
    (name,) = shown.observations
    for episode in shown.read():
        seen = episode.observations[name]
        for t, action in enumerate(episode.actions):
            info = {"TimeLimit.truncated": bool(episode.truncated[t] and not episode.terminated[t])}
            done = np.array([episode.terminated[t] or episode.truncated[t]])
            buffer.add(seen[t][None], seen[t + 1][None], action[None], episode.rewards[t : t + 1], done, [info])
    statistics = model.get_vec_normalize_env()
    if statistics is not None and statistics.norm_obs:
        statistics.obs_rms.update(buffer.observations[:, 0])
    model.replay_buffer.demonstrations = buffer


def train(settings: Sb3Settings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train sb3``.

    Raises
    ------
    ConfigError
        If the folder holds another run, or if the parameters are inconsistent.
    """
    began, parameters = time.monotonic(), settings.read_parameters()
    check_arguments(ALGORITHMS[settings.algorithm], parameters.model)
    held = {**parameters.env, "split": settings.evaluate}
    num_envs = min(parameters.num_envs, settings.episodes)
    with settings.run(echo) as run:
        run.log(command)
        begun, seconds = has_checkpoint(run.folder), run.seconds
        test = make_held_out(settings.env, num_envs, **held)
        model = _resumed(settings, run) if begun else _model(settings, parameters, run)
        with closing(test), closing(model.get_env()):
            if settings.baselines:
                found = evaluate_baselines(settings.env, num_envs, settings.episodes, EVALUATION_SEED, **held)
                write_text(run.folder / "baselines.json", dumps(found) + "\n")
            spent = (time.monotonic() - began) / 60
            callback = RunCallback(
                run,
                test,
                steps=parameters.steps,
                every=math.ceil(parameters.steps / settings.evaluations),
                episodes=settings.episodes,
                seed=EVALUATION_SEED,
                minutes=None if settings.minutes is None else settings.minutes - spent,
                every_minutes=None if settings.minutes is None else settings.minutes / settings.evaluations,
            )
            before = model.num_timesteps
            callback.learn(model, begun=begun)
        if settings.video and not callback.interrupted:
            _record_video(settings, run)
        rate = (model.num_timesteps - before) / (run.seconds - seconds)
        return _outcome(settings, callback, round(rate, 1))


def _record_video(settings: Sb3Settings, run: Run) -> None:
    """Write the video of a run; one that cannot be made is told, since the policy is complete without it."""
    file = run.folder / "video.webp"
    try:
        playback.record_video(policies.load(str(run.folder)), file, episodes=settings.video, seed=EVALUATION_SEED)
    except GraspboxError as error:
        run.log(f"there is no video: {error}")
    else:
        run.log(f"video of {settings.video} episodes: {file}")


def _logs(settings: Sb3Settings, run: Run) -> dict[str, str]:
    return {"tensorboard_log": str(run.folder / "tensorboard"), "device": settings.device}


def _resumed(settings: Sb3Settings, run: Run) -> Any:
    """Load the model of a run, with its environments."""
    return load(ALGORITHMS[settings.algorithm], run.folder / "checkpoint", **_logs(settings, run))


def _model(settings: Sb3Settings, parameters: Parameters, run: Run) -> Any:
    """Create the model of a run, with its environments and demonstrations."""
    algorithm = ALGORITHMS[settings.algorithm]
    env = make_env(settings.env, parameters.num_envs, **{**parameters.env, "split": "train"})
    env = normalized(env, float(parameters.model.get("gamma", 0.99)), **parameters.normalize)
    if parameters.demonstrations and len(env.observation_space.shape or ()) != 1:
        raise ConfigError(
            f"env.obs is {parameters.env.get('obs')!r}; {settings.algorithm} replays demonstrations of one vector only"
        )
    arguments = model_arguments(algorithm, parameters.model, env, parameters.demonstrations)
    try:
        model = algorithm(env=env, seed=settings.seed, **arguments, **_logs(settings, run))
    except (AssertionError, AttributeError, RuntimeError, TypeError, ValueError) as error:
        raise ConfigError(f"{algorithm.__name__} refuses the values of model: {error}") from error
    if parameters.demonstrations:
        _replay(model, _demonstrated(settings, parameters, run))
    return model


def _outcome(settings: Sb3Settings, callback: RunCallback, rate: float) -> TrainingOutcome:
    """Summarize a run."""
    last, target = callback.last, settings.target
    result = {
        "folder": str(settings.out),
        "interrupted": callback.interrupted,
        "timesteps": callback.model.num_timesteps,
        "seconds": round(callback.run.seconds, 1),
        "steps_per_s": rate,
        "success": last["success"] if last else None,
        "ci95": last["ci95"] if last else None,
        "best": callback.best if last else None,
        "target": target,
        "reached": None if target is None or last is None else last["success"] >= target,
    }
    status = 130 if callback.interrupted else 1 if result["reached"] is False else 0
    shown = [f"{name}: {value}" for name, value in result.items()]
    return TrainingOutcome(result, "\n".join([*shown, next_commands(settings.out)]), status)
