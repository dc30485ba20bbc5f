"""Train a policy with Stable-Baselines3 on graspbox's environments, and evaluate it on objects it has not seen.

    python scripts/train_sb3.py ppo out/train/ppo
    python scripts/train_sb3.py sac out/train/sac --env graspbox/GraspPose-v0 --evaluate test --baselines
    python scripts/train_sb3.py sac out/train/sac --env graspbox/GraspPose-v0 --resume --steps 48000
    python scripts/train_sb3.py ppo out/train/tuned --clone out/clone --set env.reward=firm
    python scripts/plot_sb3.py out/train/ppo
    python scripts/evaluate_sb3.py out/train/ppo

A run ends after its number of steps, which is in ``scripts/sb3.yaml`` like all parameters; ``--steps`` and
``--set model.gamma=0.98`` replace one. ``--resume`` continues an interrupted run from its checkpoint, and extends a
finished one where ``--steps`` is larger; its episodes begin anew, and a learning rate that falls to zero starts again
at the share of the new total that remains. Ctrl-C ends a run after its current step and saves it (twice: at once,
keeping the last checkpoint). The files of a run's folder are documented in `graspbox.sb3.running`.

With ``--clone`` a run begins with the policy of ``clone_sb3.py``; it must have the same observations and networks. Its
value function learns alone for the first ``value_warmup`` steps, and a cloning loss, whose weight falls from
``clone_weight`` to zero within ``clone_steps``, keeps it near its demonstrations.

Exit status: 0 for a run that came to its end and, with ``--target``, reached it; 1 for one that did not reach it, 2 for
wrong arguments, 130 for an interrupted run.

Needs the extras ``cli`` and ``train``.
"""

import json
import math
import signal
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
import yaml

from graspbox import sb3
from graspbox.cli.common import console, print_json, progress
from graspbox.errors import ConfigError, GraspboxError
from graspbox.resume_log import ResumeLog
from graspbox.sb3.parameters import Parameters
from graspbox.sb3.parameters import read_parameters as read_entry

PARAMETERS = Path(__file__).with_name("sb3.yaml")
ALGORITHMS = ("ppo", "sac", "td3")
#: Evaluations have other episodes than training, whatever its seed.
EVALUATION_SEED = 10_000


@dataclass(frozen=True)
class Settings:
    """Arguments of one run."""

    algorithm: tyro.conf.Positional[str]
    """ppo, sac or td3."""
    folder: tyro.conf.Positional[Path]
    """Folder of the run."""
    env: str = "graspbox/Grasp-v0"
    """Id of the environment."""
    parameters: Path = PARAMETERS
    """File of parameters, by algorithm and environment."""
    clone: Path | None = None
    """Begin with the policy that `clone_sb3.py` left in this folder, instead of with demonstrations of its own."""
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Replace a parameter, for example model.gamma=0.98 or env.obs=depth; may be repeated."""
    steps: int | None = None
    """Steps of all environments together after which the run ends; by default that of the parameters."""
    minutes: float | None = None
    """End this call earlier, after about this time; results then depend on the speed of the machine."""
    evaluations: int = 10
    """Evaluations after the one at the start, evenly spaced in steps (with --minutes also in time)."""
    episodes: int = 100
    """Trials of an evaluation."""
    evaluate: str = "validation"
    """Split of the objects that evaluations take; training takes `train`."""
    seed: int = 0
    """Seed of everything random."""
    baselines: bool = False
    """Evaluate random actions, zero actions and the planner on the same trials."""
    target: float | None = None
    """Success rate that the last evaluation must reach."""
    resume: bool = False
    """Continue the run in the folder, if there is one."""
    torch_threads: int = 1
    """Threads of the networks; one is fastest for small ones."""
    device: str = "cpu"
    """Where the networks run: cpu, cuda."""
    json: bool = False
    """Print JSON, and nothing else, on standard output."""


def check(settings: Settings) -> None:
    """Refuse arguments that are out of range."""
    if settings.algorithm not in ALGORITHMS:
        raise ConfigError(f"there is no algorithm {settings.algorithm!r}; choose from {', '.join(ALGORITHMS)}")
    for name, least in (("steps", 1), ("evaluations", 1), ("episodes", 1), ("torch_threads", 1), ("seed", 0)):
        value = getattr(settings, name)
        if value is not None and value < least:
            raise ConfigError(f"--{name.replace('_', '-')} is {value}; give {least} or more")
    if settings.minutes is not None and not settings.minutes > 0:
        raise ConfigError(f"--minutes is {settings.minutes}; give a positive number")
    if settings.target is not None and not 0 <= settings.target <= 1:
        raise ConfigError(f"--target is {settings.target}; give a rate between 0 and 1")


def read_parameters(settings: Settings) -> Parameters:
    """Read the parameters of a run; a clone takes the place of demonstrations."""
    found = read_entry(settings.parameters, settings.algorithm, settings.env, settings.set, settings.steps)
    return found if settings.clone is None else replace(found, demonstrations=0)


def has_run(folder: Path) -> bool:
    """Whether a folder holds a run that can be continued."""
    if any((folder / name).exists() for name in ("checkpoint", "checkpoint.old")):
        return True
    log = folder / "evaluations.jsonl"
    if log.exists() and len(log.read_text().splitlines()) > 1:
        raise ConfigError(f"{str(folder)!r} holds evaluations but no checkpoint to continue from; name another folder")
    return False


def open_log(settings: Settings, parameters: Parameters, begun: bool) -> ResumeLog:
    """Open the log of evaluations, whose first line holds all that must stay the same when a run is resumed."""
    if begun and not settings.resume:
        raise ConfigError(f"{str(settings.folder)!r} holds a run; continue it with --resume, or name another folder")
    what = {"algorithm": settings.algorithm, "id": settings.env, "evaluate": settings.evaluate}
    # A run may be extended.
    what |= {"seed": settings.seed, "episodes": settings.episodes, **asdict(replace(parameters, steps=0))}
    what |= {"begins_as": None if settings.clone is None else str(settings.clone.resolve())}
    # Before its first checkpoint an interrupted run leaves rows and nothing to resume from.
    return ResumeLog(settings.folder / "evaluations.jsonl", what, fresh=not begun)


def make_model(settings: Settings, parameters: Parameters, env: Any, begun: bool) -> tuple[Any, float]:
    """Load the model of a run, or make one; with its training time so far in seconds, demonstrations included."""
    from graspbox.sb3 import fine_tuning
    from graspbox.sb3.running import ALGORITHMS, load
    from graspbox.sb3.training import add_demonstrations, model_arguments

    algorithm, began = ALGORITHMS[settings.algorithm], time.monotonic()
    logs = {"tensorboard_log": str(settings.folder / "tensorboard"), "device": settings.device}
    if begun:
        model, seconds = load(algorithm, settings.folder / "checkpoint", env, **logs)
        # Other episodes and actions than those that the run began with.
        model.set_random_seed(settings.seed + model.num_timesteps)
        return model, seconds
    arguments = model_arguments(algorithm, parameters.model, env, parameters.demonstrations)
    if parameters.demonstrations and settings.algorithm == "ppo" and parameters.normalize["reward"]:
        raise ConfigError("a cloned policy needs the statistics of its demonstrations; set normalize.reward=false")
    model = algorithm(env=env, seed=settings.seed, **arguments, **logs)
    if settings.clone is not None:
        fine_tuning.begin_as(model, settings.clone)
    if parameters.demonstrations:
        with progress() as bar:
            task = bar.add_task("demonstrations", total=parameters.demonstrations)
            told = add_demonstrations(
                model,
                settings.env,
                parameters.num_envs,
                parameters.demonstrations,
                clone_epochs=parameters.clone_epochs,
                seed=settings.seed,
                step=lambda done: bar.update(task, completed=done),
                **{**parameters.env, "split": "train"},
            )
        console.print(told)
    return model, time.monotonic() - began


def train(settings: Settings) -> int:
    """Train; returns the exit status."""
    began = time.monotonic()
    check(settings)
    parameters = read_parameters(settings)
    sb3.require()
    import torch

    from graspbox.policies.goals import plain_settings
    from graspbox.sb3.goal_env import goal_base, with_goals
    from graspbox.sb3.policy import ModelPolicy, evaluate_baselines
    from graspbox.sb3.running import Run, make_env, make_held_out, normalized

    begun = has_run(settings.folder)
    log = open_log(settings, parameters, begun)
    torch.set_num_threads(settings.torch_threads)
    held_out = {**parameters.env, "split": settings.evaluate}
    eval_envs = min(parameters.num_envs, settings.episodes)
    env = make_env(settings.env, parameters.num_envs, **{**parameters.env, "split": "train"})
    env = normalized(env, float(parameters.model.get("gamma", 0.99)), **parameters.normalize)
    base = goal_base(held_out)
    test = make_held_out(settings.env, eval_envs, **(held_out if base is None else plain_settings(held_out, base)))
    model, seconds = make_model(settings, parameters, env, begun)
    if settings.baselines:
        with console.status("baselines"):
            found = evaluate_baselines(settings.env, eval_envs, settings.episodes, EVALUATION_SEED, **held_out)
        (settings.folder / "baselines.json").write_text(json.dumps(found, indent=2))
    spent = (time.monotonic() - began) / 60
    run = Run(
        settings.folder,
        test,
        log,
        every=math.ceil(parameters.steps / settings.evaluations),
        episodes=settings.episodes,
        seed=EVALUATION_SEED,
        minutes=None if settings.minutes is None else settings.minutes - spent,
        every_minutes=None if settings.minutes is None else settings.minutes / settings.evaluations,
        seconds=seconds,
        value_warmup=parameters.value_warmup if parameters.demonstrations else 0,
        policy=lambda model, statistics: with_goals(ModelPolicy(model, statistics), held_out, base)[0],
    )
    keep_near_clone(settings, parameters, model)
    before = model.num_timesteps
    try:
        learn(model, run, settings.algorithm, parameters.steps, begun)
    finally:
        env.close()
        test.close()
    return report(settings, run, model.num_timesteps - before, run.seconds - seconds)


def keep_near_clone(settings: Settings, parameters: Parameters, model: Any) -> None:
    """Let the value function of a clone warm up, and add the cloning loss to what is minimized."""
    if settings.clone is None:
        return
    from graspbox.sb3.fine_tuning import CloningTerm, settings_of, steps_of

    CloningTerm(
        model,
        steps_of(settings_of(settings.clone)),
        weight=parameters.clone_weight,
        decay=parameters.clone_steps,
        warmup=parameters.value_warmup,
        seed=settings.seed + model.num_timesteps,
    )


def learn(model: Any, run: Any, name: str, steps: int, begun: bool) -> None:
    """Train until the run has its number of steps, with a progress bar and a last evaluation."""
    with progress() as bar:
        task = bar.add_task(name, total=steps)

        def show(done: int, last: dict[str, Any] | None) -> None:
            rate = f", {last['success']:.0%} of held-out trials succeed" if last else ""
            bar.update(task, completed=done, description=name + rate)

        run.on_progress = show
        handlers = {number: signal.signal(number, stopper(run)) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            left = max(steps - model.num_timesteps, 0)
            model.learn(left, callback=run, tb_log_name="run", reset_num_timesteps=not begun)
            if run.interrupted or (run.last and run.last["timesteps"] == model.num_timesteps):
                # A checkpoint that was written within a step lacks that step's transitions.
                run.save()
            else:
                run.evaluate()
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)


def stopper(run: Any) -> Any:
    """Make a signal handler: the first signal ends the run after its current step, the second at once."""

    def stop(*_: Any) -> None:
        if run.interrupted:
            raise KeyboardInterrupt
        run.interrupt()
        console.print("saving the run; press Ctrl-C again to end at once")

    return stop


def report(settings: Settings, run: Any, steps: int, seconds: float) -> int:
    """Print the result of a run; returns the exit status."""
    last = run.last
    result = {
        "folder": str(settings.folder),
        "interrupted": run.interrupted,
        "timesteps": run.model.num_timesteps,
        "seconds": round(run.seconds, 1),
        "steps_per_s": round(steps / seconds, 1),
        "success": last["success"] if last else None,
        "ci95": last["ci95"] if last else None,
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


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and train; returns the exit status."""
    settings = tyro.cli(Settings, args=arguments, description=__doc__)
    try:
        return train(settings)
    except (GraspboxError, OSError, yaml.YAMLError) as error:
        console.print(f"error: {error}", markup=False)
        return 2


if __name__ == "__main__":
    raise SystemExit(main())
