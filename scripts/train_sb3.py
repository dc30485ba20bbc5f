"""Train a policy with Stable-Baselines3 on graspbox's environments, and evaluate it on objects it has not seen.

    python scripts/train_sb3.py ppo out/train/ppo
    python scripts/train_sb3.py sac out/train/sac --minutes 45 --evaluate test --references
    python scripts/train_sb3.py ppo out/train/ppo --resume
    python scripts/plot_sb3.py out/train/ppo
    python scripts/evaluate_sb3.py out/train/ppo

The parameters stand in ``scripts/sb3.yaml``; ``--set model.gamma=0.98`` replaces one. Ctrl-C ends a run after the step
that it is in and saves it (twice: at once, leaving the last checkpoint); ``--resume`` goes on from the checkpoint, with
episodes that begin anew. What a run's folder holds: `graspbox.sb3.running`. Exit status: 0 for a run that came to its
end and, with ``--target``, reached it; 1 for one that did not reach it, 2 for arguments that cannot be, 130 for one
that was interrupted.

Needs the extras ``cli`` and ``train``.
"""

import inspect
import json
import signal
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import gymnasium
import numpy as np
import torch
import typer
import yaml
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from graspbox.cli.common import console, print_json, progress
from graspbox.errors import ConfigError, GraspboxError
from graspbox.resume_log import ResumeLog
from graspbox.sb3 import Extractor
from graspbox.sb3.demonstrations import DemonstratedBuffer, clone, demonstrate
from graspbox.sb3.references import references
from graspbox.sb3.running import ALGORITHMS, Linear, Run, load, make_env, normalized

PARAMETERS = Path(__file__).with_name("sb3.yaml")
#: Evaluations take other episodes than training, whatever its seed.
EVALUATION_SEED = 10_000
DEMONSTRATION_SEED = 20_000


@dataclass(frozen=True)
class Settings:
    """One run."""

    algorithm: Annotated[str, typer.Argument(help="ppo, sac or td3.")]
    folder: Annotated[Path, typer.Argument(help="The run's folder.")]
    env: Annotated[str, typer.Option(help="Id of the environment.")] = "graspbox/Grasp-v0"
    parameters: Annotated[Path, typer.Option(help="Parameters by algorithm and environment.")] = PARAMETERS
    set: Annotated[list[str] | None, typer.Option(help="Replace a parameter: model.gamma=0.98, env.obs=depth")] = None
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0
    minutes: Annotated[float | None, typer.Option(min=0, help="End after so much time, evaluations included.")] = None
    evaluate: Annotated[str, typer.Option(help="Split that evaluations take; training takes `train`.")] = "validation"
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of an evaluation.")] = 100
    references: Annotated[bool, typer.Option(help="Evaluate random actions, zero actions and the planner too.")] = False
    target: Annotated[float | None, typer.Option(min=0, max=1, help="Successes that the end must show.")] = None
    resume: Annotated[bool, typer.Option(help="Go on with the run in the folder, if there is one.")] = False
    torch_threads: Annotated[int, typer.Option(min=1, help="Threads of the networks; small ones are fast on one.")] = 1
    device: Annotated[str, typer.Option(help="Where the networks are: cpu, cuda.")] = "cpu"
    json: Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on standard output.")] = False


@dataclass(frozen=True)
class Parameters:
    """What ``scripts/sb3.yaml`` says for an algorithm and an environment."""

    #: Steps of all environments together.
    timesteps: int
    num_envs: int
    #: Steps between two evaluations, each with a checkpoint.
    every: int
    #: Whether vectors of observations, and rewards, are scaled by what has been seen of them.
    normalize: dict[str, bool]
    #: Keywords of the environment.
    env: dict[str, Any]
    #: Keywords of the algorithm.
    model: dict[str, Any]
    #: Successful episodes of the scripted expert: sac and td3 learn from them beside their own, ppo begins as a copy.
    demonstrations: int = 0
    #: How often each step of them is looked at to begin as their copy.
    clone_epochs: int = 60
    #: For so many steps after that only the values learn, not the policy.
    values_first: int = 0


def read_parameters(settings: Settings) -> Parameters:
    """Read the parameters of an algorithm and an environment, and replace some."""
    if settings.algorithm not in ALGORITHMS:
        raise ConfigError(f"there is no algorithm {settings.algorithm!r}; choose from {', '.join(ALGORITHMS)}")
    found = yaml.safe_load(settings.parameters.read_text())
    try:
        values = found[settings.algorithm][settings.env]
    except (KeyError, TypeError):
        where = str(settings.parameters)
        raise ConfigError(f"{where!r} has no entry {settings.algorithm!r}, {settings.env!r}; add one") from None
    for change in settings.set or ():
        path, equals, value = change.partition("=")
        *parents, name = path.split(".")
        place = values
        for parent in parents:
            place = place.get(parent) if isinstance(place, dict) else None
        if not equals or not isinstance(place, dict):
            raise ConfigError(f"--set {change!r} names no parameter; write, for example, model.gamma=0.98")
        place[name] = yaml.safe_load(value)
    try:
        return Parameters(**values)
    except TypeError as error:
        raise ConfigError(f"parameters are {', '.join(Parameters.__annotations__)} ({error})") from None


def number(value: Any) -> Any:
    """Read what YAML takes for a string: 1e-3 without a point, and linear_1e-3."""
    if not isinstance(value, str):
        return value
    return Linear(float(value.removeprefix("linear_"))) if value.startswith("linear_") else float(value)


def model_settings(algorithm: Any, given: dict[str, Any], env: Any, demonstrations: int) -> dict[str, Any]:
    """Turn names into what the algorithm takes, and choose policy and extractor by the observation."""
    policy = dict(given.get("policy_kwargs", {}))
    if "activation_fn" in policy:
        policy["activation_fn"] = getattr(torch.nn, policy["activation_fn"])
    seen = env.observation_space
    named = isinstance(seen, gymnasium.spaces.Dict)
    if any(len(space.shape) > 1 for space in (seen.values() if named else [seen])):
        policy.setdefault("features_extractor_class", Extractor)
    found = {**given, "policy": "MultiInputPolicy" if named else "MlpPolicy", "policy_kwargs": policy}
    if demonstrations and issubclass(algorithm, OffPolicyAlgorithm):
        found["replay_buffer_class"] = DemonstratedBuffer
    if "learning_rate" in found:
        found["learning_rate"] = number(found["learning_rate"])
    if "action_noise" in found:
        size = env.action_space.shape
        found["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, found["action_noise"]))
    return found


def show(model: Any, settings: Settings, parameters: Parameters) -> None:
    """Let the expert fill the part of the replay buffer that is its own, or clone it where there is none."""
    clones = not isinstance(model, OffPolicyAlgorithm)
    if clones and parameters.normalize["reward"]:
        raise ConfigError("a clone's observations keep the demonstrations' scales; set normalize.reward=false with it")
    keywords = {**parameters.env, "split": "train"}
    stage = make_env(settings.env, parameters.num_envs, **keywords)
    with progress() as bar:
        task = bar.add_task("demonstrations", total=parameters.demonstrations)
        settled = {"step": lambda done: bar.update(task, completed=done), **keywords}
        buffer, rate = demonstrate(stage, settings.env, parameters.demonstrations, DEMONSTRATION_SEED, **settled)
    stage.close()
    console.print(f"{buffer.size()} steps of demonstrations; the expert succeeded in {rate:.0%} of its episodes")
    statistics = model.get_vec_normalize_env()
    if statistics is not None and statistics.norm_obs:
        statistics.obs_rms.update(buffer.observations[: buffer.size(), 0])
    if not clones:
        model.replay_buffer.demonstrations = buffer
        return
    if statistics is not None:
        # Scales that went on to change would change what the policy does.
        statistics.training = False
    with console.status("cloning"):
        errors = clone(model, buffer, parameters.clone_epochs, seed=settings.seed)
    console.print(f"cloned: mean squared error of an action {errors[0]:.4f}, held out {errors[1]:.4f}")


def begin(settings: Settings, parameters: Parameters, env: Any, begun: bool) -> tuple[Any, float]:
    """Load the model of a run, or make one; with the seconds that it has taken so far, demonstrations included."""
    algorithm, began = ALGORITHMS[settings.algorithm], time.monotonic()
    logs = {"tensorboard_log": str(settings.folder / "tensorboard"), "device": settings.device}
    if begun:
        model, seconds = load(algorithm, settings.folder / "checkpoint", env, **logs)
        # Other episodes and actions than those that the run began with.
        model.set_random_seed(settings.seed + model.num_timesteps)
        return model, seconds
    keywords = model_settings(algorithm, parameters.model, env, parameters.demonstrations)
    model = algorithm(env=env, seed=settings.seed, **keywords, **logs)
    if parameters.demonstrations:
        show(model, settings, parameters)
    return model, time.monotonic() - began


def checkpointed(folder: Path) -> bool:
    """Tell whether a folder holds a run that can go on."""
    if any((folder / name).exists() for name in ("checkpoint", "checkpoint.old")):
        return True
    log = folder / "evaluations.jsonl"
    if log.exists() and len(log.read_text().splitlines()) > 1:
        raise ConfigError(f"{str(folder)!r} holds evaluations but no checkpoint to go on from; name another folder")
    return False


def train(settings: Settings) -> int:
    """Train; the exit status."""
    parameters = read_parameters(settings)
    begun = checkpointed(settings.folder)
    if begun and not settings.resume:
        raise ConfigError(f"{str(settings.folder)!r} holds a run; --resume goes on with it, or name another folder")
    what = {"algorithm": settings.algorithm, "id": settings.env, "evaluate": settings.evaluate}
    # A run may go on for longer than it was begun for.
    what |= {"seed": settings.seed, "episodes": settings.episodes, **asdict(replace(parameters, timesteps=0))}
    path = settings.folder / "evaluations.jsonl"
    if not begun:
        # What a run leaves that was interrupted before its first checkpoint.
        path.unlink(missing_ok=True)
    log = ResumeLog(path, what)
    torch.set_num_threads(settings.torch_threads)

    scale = {"gamma": float(parameters.model.get("gamma", 0.99)), **parameters.normalize}
    held_out = {**parameters.env, "split": settings.evaluate}
    eval_envs = min(parameters.num_envs, settings.episodes)
    env = normalized(
        make_env(settings.env, parameters.num_envs, **{**parameters.env, "split": "train"}), **scale, training=True
    )
    test = normalized(make_env(settings.env, eval_envs, **held_out), **scale, training=False)
    model, seconds = begin(settings, parameters, env, begun)
    if settings.references:
        with console.status("references"):
            found = references(settings.env, eval_envs, settings.episodes, EVALUATION_SEED, **held_out)
        (settings.folder / "references.json").write_text(json.dumps(found, indent=2))

    with progress() as bar:
        task = bar.add_task(settings.algorithm, total=parameters.timesteps)

        def step(steps: int, last: dict[str, Any] | None) -> None:
            rate = f", {last['success']:.0%} of held-out episodes succeed" if last else ""
            bar.update(task, completed=steps, description=settings.algorithm + rate)

        run = Run(
            settings.folder,
            test,
            log,
            every=parameters.every,
            episodes=settings.episodes,
            seed=EVALUATION_SEED,
            minutes=settings.minutes,
            seconds=seconds,
            step=step,
            values_first=parameters.values_first if parameters.demonstrations else 0,
        )
        handlers = {number: signal.signal(number, stopper(run)) for number in (signal.SIGINT, signal.SIGTERM)}
        before = model.num_timesteps
        try:
            model.learn(
                max(parameters.timesteps - before, 0), callback=run, tb_log_name="run", reset_num_timesteps=not begun
            )
            if run.interrupted or (run.last and run.last["timesteps"] == model.num_timesteps):
                # What an evaluation saved in the midst of a step did not have that step's transitions.
                run.save()
            else:
                run.evaluate()
        finally:
            for which, handler in handlers.items():
                signal.signal(which, handler)
            env.close()
            test.close()
    return report(settings, run, model.num_timesteps - before, run.seconds - seconds)


def stopper(run: Run) -> Any:
    """Make a signal handler: the first signal ends the run after its step, the second at once."""

    def stop(*_: Any) -> None:
        if run.interrupted:
            raise KeyboardInterrupt
        run.interrupt()
        console.print("saving the run; once more to end at once")

    return stop


def report(settings: Settings, run: Run, steps: int, seconds: float) -> int:
    """Say what came of it; the exit status."""
    last = run.last
    result = {
        "folder": str(settings.folder),
        "interrupted": run.interrupted,
        "timesteps": run.model.num_timesteps,
        "seconds": round(run.seconds, 1),
        "steps_per_s": round(steps / seconds, 1),
        "success": last["success"] if last else None,
        "best": run.best if last else None,
        "target": settings.target,
        "reached": None if settings.target is None or last is None else last["success"] >= settings.target,
    }
    if settings.json:
        print_json(result)
    else:
        for name, value in result.items():
            console.print(f"{name}: {value}")
    if run.interrupted:
        return 130
    return 1 if result["reached"] is False else 0


def main(**values: Any) -> None:
    """Train a policy with Stable-Baselines3 and evaluate it on objects it has not seen."""
    settings = Settings(**values)
    try:
        status = train(settings)
    except (GraspboxError, OSError, yaml.YAMLError) as error:
        console.print(f"error: {error}", markup=False)
        status = 2
    raise typer.Exit(status)


# The dataclass is the command line.
main.__signature__ = inspect.signature(Settings)  # type: ignore[attr-defined]
main.__annotations__ = get_type_hints(Settings, include_extras=True)


if __name__ == "__main__":
    typer.run(main)
