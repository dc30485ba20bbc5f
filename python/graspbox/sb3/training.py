"""Reinforcement learning runs with Stable-Baselines3: the model, its demonstrations, and the run (`train`).

An off-policy learner samples half of each batch from successful episodes of the scripted expert (`DemonstratedBuffer`;
Ball, Smith, Kostrikov, Levine, "Efficient Online Reinforcement Learning with Offline Data", 2023). An on-policy learner
is initialized by cloning them, or recorded demonstrations. The expert uses the objects' meshes; the trained policy
does not.
"""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from torch.utils.data import TensorDataset

from graspbox import policies
from graspbox._common.files import dumps, write_text
from graspbox.errors import ConfigError
from graspbox.policies import Task
from graspbox.policies.goals import plain_settings
from graspbox.sb3.cloning import CloningTerm, begin_as, imitate, settings_of_clone, steps_of
from graspbox.sb3.goal_env import goal_base, with_goals
from graspbox.sb3.policy import ModelPolicy, evaluate_baselines
from graspbox.sb3.running import (
    ALGORITHMS,
    RunCallback,
    has_checkpoint,
    load,
    make_env,
    make_held_out,
    model_arguments,
    normalized,
)
from graspbox.sb3.settings import EVALUATION_SEED, Parameters, Sb3Settings
from graspbox.training.options import Outcome
from graspbox.training.runs import Run
from graspbox.training.trainer import TrainConfig

__all__ = ["add_demonstrations", "demonstrate", "train"]

#: Seed of demonstrations, whose episodes differ from those of training and evaluation.
_DEMONSTRATION_SEED = 20_000
#: Cloning of the expert: batch size, and weight of the value loss relative to the action loss.
_BATCH, _VALUE_SHARE = 256, 0.1


def demonstrate(
    env: Any, episodes: int, seed: int, *, step: Callable[[int], None] = lambda _: None
) -> tuple[ReplayBuffer, float]:
    """Run the expert until a number of episodes succeeded; failed episodes are left out.

    In ``Grasp-v0`` the demonstrator is the policy ``expert``, in ``GraspPose-v0`` it is ``planner``.

    Parameters
    ----------
    env : VecEnv
        Made by `graspbox.sb3.running.make_env`, not normalized; it observes ``state``.
    episodes : int
        Number of successful episodes to collect.
    seed : int
        Seed of the first environment.
    step : callable
        Called with the number of successes so far.

    Returns
    -------
    buffer, rate
        All transitions, and the expert's success rate.

    Raises
    ------
    ConfigError
        If the environment does not observe ``state``, or the expert fails in 20 + 9 times `episodes` episodes.
    """
    task = Task.of(env.unwrapped.env)
    if task.obs != "state":
        raise ConfigError(f"the environments have obs={task.obs!r}; demonstrations need obs='state'")
    expert = policies.load("expert" if task.closed_loop else "planner")
    expert.bind(task)
    rows: list[tuple[Any, ...]] = []
    open_rows: list[list[tuple[Any, ...]]] = [[] for _ in range(env.num_envs)]
    ended, succeeded = 0, 0
    env.seed(seed)
    seen, starts = env.reset(), np.ones(env.num_envs, dtype=bool)
    while succeeded < episodes:
        objects = np.array([info["object"] for info in env.unwrapped.reset_infos], dtype=object)
        expert.reset(mask=starts, info={"object": objects})
        actions = expert.act(seen)
        following, rewards, starts, infos = env.step(actions)
        for i, info in enumerate(infos):
            last = info["terminal_observation"] if starts[i] else following[i]
            open_rows[i].append((seen[i], last, actions[i], rewards[i], starts[i], info))
            if starts[i]:
                ended += 1
                if info["is_success"] and succeeded < episodes:
                    succeeded += 1
                    rows += open_rows[i]
                open_rows[i] = []
        seen = following
        step(succeeded)
        if ended >= 20 + 10 * episodes:
            raise ConfigError(f"the expert succeeded in {succeeded} of {ended} episodes; demonstrate other objects")
    buffer = ReplayBuffer(len(rows), env.observation_space, env.action_space, device="cpu", n_envs=1)
    for observation, last, action, reward, done, info in rows:
        buffer.add(observation[None], last[None], action[None], np.array([reward]), np.array([done]), [info])
    return buffer, succeeded / ended


def add_demonstrations(
    model: Any,
    env_id: str,
    num_envs: int,
    episodes: int,
    *,
    folder: Path,
    clone_epochs: int,
    seed: int,
    progress: Callable[[str, float], None] = lambda *_: None,
    **settings: Any,
) -> str:
    """Fill the demonstrated part of a replay buffer, or, for an on-policy model, clone the expert.

    Parameters
    ----------
    model : BaseAlgorithm
        The model, before training.
    env_id, num_envs, **settings
        As for `graspbox.sb3.running.make_env`.
    episodes : int
        Successful episodes of the expert.
    folder : Path
        Folder of the cloning.
    clone_epochs : int
        Passes over them when cloning.
    seed : int
        Seed of the order of the demonstrations in cloning.
    progress : callable
        Called with the progress as text, and as a fraction.

    Returns
    -------
    str
        A sentence about the demonstrations and the error of the clone.
    """
    envs = make_env(env_id, num_envs, **settings)
    buffer, rate = demonstrate(
        envs,
        episodes,
        _DEMONSTRATION_SEED,
        step=lambda done: progress(f"{done} of {episodes} demonstrations", done / episodes),
    )
    envs.close()
    told = f"{buffer.size()} steps of demonstrations; success rate of the expert {rate:.0%}"
    statistics = model.get_vec_normalize_env()
    if statistics is not None and statistics.norm_obs:
        statistics.obs_rms.update(buffer.observations[: buffer.size(), 0])
    if isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer.demonstrations = buffer
        return told
    if statistics is not None:
        # Later changes of the statistics would change the actions of the cloned policy.
        statistics.training = False
    error = _clone(model, buffer, folder, clone_epochs, seed, progress)
    return f"{told}; cloned with a mean squared action error of {error:.4f} on steps held out"


def _clone(
    model: Any, buffer: ReplayBuffer, folder: Path, epochs: int, seed: int, progress: Callable[[str, float], None]
) -> float:
    """Train a policy on demonstrated actions, and its value function on their returns; returns the held-out error."""
    scaled = buffer._normalize_obs(buffer.observations[: buffer.size(), 0], model.get_vec_normalize_env())
    returns = _returns(buffer, model.gamma)
    arrays = np.asarray(scaled, dtype=np.float32), buffer.actions[: buffer.size(), 0], returns
    steps = TensorDataset(*(torch.from_numpy(np.ascontiguousarray(rows)) for rows in arrays))
    scale = 1.0 + steps.tensors[2].var().item()
    order = torch.Generator().manual_seed(seed)
    orders: list[torch.Tensor] = []

    def losses(net: Any, batch: tuple[torch.Tensor, ...]) -> dict[str, torch.Tensor]:
        observations, actions, wanted = batch
        means = net.get_distribution(observations).distribution.mean
        values = net.predict_values(observations)[:, 0]
        error, of_value = ((means - actions) ** 2).mean(), ((values - wanted) ** 2).mean()
        return {"minimized": error + _VALUE_SHARE * of_value / scale, "error": error.detach()}

    def epoch(number: int, rows: torch.Tensor) -> torch.Tensor:
        while len(orders) <= number:
            orders.append(rows[torch.randperm(len(rows), generator=order)])
        return orders[number]

    config = TrainConfig(learning_rate=1e-3, batch_size=_BATCH, seed=seed, device=str(model.device))
    found = imitate(
        folder,
        model.policy,
        steps,
        np.arange(len(steps)) % 10 == 0,
        epoch,
        losses,
        config,
        epochs,
        progress=lambda done: progress(f"cloning, step {done.step}", done.share),
    )
    return float(found["error"])


def _returns(buffer: ReplayBuffer, gamma: float) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Discounted return from every step to the end of its episode."""
    rewards, dones = buffer.rewards[: buffer.size(), 0], buffer.dones[: buffer.size(), 0]
    returns: np.ndarray[Any, np.dtype[np.float32]] = np.zeros_like(rewards)
    following = 0.0
    for i in range(len(rewards) - 1, -1, -1):
        following = returns[i] = rewards[i] + gamma * following * (1.0 - dones[i])
    return returns


def train(settings: Sb3Settings, command: str, echo: Callable[[str], None]) -> Outcome:
    """Run ``graspbox train sb3``.

    Raises
    ------
    ConfigError
        If the folder holds another run, or if the parameters are inconsistent.
    """
    began, parameters = time.monotonic(), settings.read_parameters()
    with settings.run(echo) as run:
        run.log(command)
        begun = has_checkpoint(run.folder)
        seconds = run.seconds
        held = {**parameters.env, "split": settings.evaluate}
        num_envs = min(parameters.num_envs, settings.episodes)
        env = make_env(settings.env, parameters.num_envs, **{**parameters.env, "split": "train"})
        env = normalized(env, float(parameters.model.get("gamma", 0.99)), **parameters.normalize)
        base = goal_base(held)
        test = make_held_out(settings.env, num_envs, **(held if base is None else plain_settings(held, base)))
        try:
            model = _model(settings, parameters, env, run, begun)
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
                value_warmup=parameters.value_warmup if parameters.demonstrations else 0,
                policy=lambda model, statistics: with_goals(ModelPolicy(model, statistics), held, base)[0],
            )
            _keep_near_clone(settings, parameters, model)
            before = model.num_timesteps
            callback.learn(model, begun=begun)
        finally:
            env.close()
            test.close()
        rate = (model.num_timesteps - before) / (run.seconds - seconds)
        return _outcome(settings, callback, round(rate, 1))


def _model(settings: Sb3Settings, parameters: Parameters, env: Any, run: Run, begun: bool) -> Any:
    """Load the model of a run, or create one with its demonstrations."""
    algorithm = ALGORITHMS[settings.algorithm]
    logs = {"tensorboard_log": str(run.folder / "tensorboard"), "device": settings.device}
    if begun:
        return load(algorithm, run.folder / "checkpoint", env, settings.seed, **logs)
    arguments = model_arguments(algorithm, parameters.model, env, parameters.demonstrations)
    if parameters.demonstrations and settings.algorithm == "ppo" and parameters.normalize["reward"]:
        raise ConfigError("a cloned policy needs the statistics of its demonstrations; set normalize.reward=false")
    model = algorithm(env=env, seed=settings.seed, **arguments, **logs)
    if settings.clone is not None:
        begin_as(model, settings.clone)
    if parameters.demonstrations:
        told = add_demonstrations(
            model,
            settings.env,
            parameters.num_envs,
            parameters.demonstrations,
            folder=run.folder / "cloning",
            clone_epochs=parameters.clone_epochs,
            seed=settings.seed,
            progress=run.report,
            **{**parameters.env, "split": "train"},
        )
        run.log(told)
    return model


def _keep_near_clone(settings: Sb3Settings, parameters: Parameters, model: Any) -> None:
    """Warm up the value function of a clone, and add the cloning loss."""
    if settings.clone is None:
        return
    CloningTerm(
        model,
        steps_of(settings_of_clone(settings.clone)),
        weight=parameters.clone_weight,
        decay=parameters.clone_steps,
        warmup=parameters.value_warmup,
        seed=settings.seed + model.num_timesteps,
    )


def _outcome(settings: Sb3Settings, callback: RunCallback, rate: float) -> Outcome:
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
    return Outcome(result, "\n".join(f"{name}: {value}" for name, value in result.items()), status)
