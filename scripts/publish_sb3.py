"""Publish a policy of Stable-Baselines3: a folder that ``graspbox evaluate`` runs without torch, with its scores.

    python scripts/publish_sb3.py out/student --out policies/student
    python scripts/publish_sb3.py out/ppo --out policies/ppo --best \
        --objects procedural:unseen:0-19 --objects ycb/test

Takes the folder of a run of ``graspbox train sb3``, ``clone`` or ``student``. The ONNX file includes all
transformations of observations and actions; nothing is published unless it acts like the model on observations of the
environment. The folder is then evaluated, and its card has the training commands and the scores.

Exit status: 0, 2 for unusable arguments, 130 after Ctrl-C.

Needs the extras ``cli`` and ``train``, and ``ycb`` for these objects.
"""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
import yaml

from graspbox import learn
from graspbox._common.options import parse
from graspbox._common.programs import run_program
from graspbox.cli.common import console, print_json, progress
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation import MAX_TRIALS
from graspbox.learn.recipes.cards.networks import ObjectSetScore, measure, object_set, write_network_card
from graspbox.learn.sb3.histories import history, learned_from, settings_of, shown
from graspbox.learn.sb3.settings import PARAMETERS

LICENCE = Path(__file__).parents[1] / "LICENSE"


@dataclass(frozen=True)
class Settings:
    """Arguments of one publication."""

    run: Annotated[Path, typer.Argument()]
    """Folder of the run."""
    out: Path
    """Folder of the policy; its name is the policy's."""
    best: bool = False
    """The model of the best evaluation instead of the last one."""
    objects: tuple[str, ...] = ("procedural:unseen:0-19", "ycb/test")
    """Object sets to measure on; /SPLIT keeps one split."""
    trials: int = 1000
    """Trials on each of them."""
    seed: int = 0
    """Seed of the trials."""
    num_envs: int = 16
    """Environments stepped in parallel; results do not depend on it."""
    parameters: Path = PARAMETERS
    """File of parameters; differences of the run appear in its command on the card."""
    json: bool = False
    """Print JSON, and nothing else, on standard output."""


def publish(settings: Settings, command: str) -> list[ObjectSetScore]:
    """Export, evaluate and describe a policy; returns its scores."""
    if not 1 <= settings.trials <= MAX_TRIALS:
        raise ConfigError(f"--trials is {settings.trials}; give 1 to {MAX_TRIALS}")
    if settings.seed < 0:
        raise ConfigError(f"--seed is {settings.seed}; give 0 or more")
    if not settings.objects:
        raise ConfigError("--objects is empty; name one set or more")
    for name in settings.objects:
        object_set(name)
    learn.require("stable_baselines3")
    import torch

    from graspbox.learn.sb3.export import export_policy
    from graspbox.learn.sb3.running import load_policy

    run = settings_of(settings.run)
    checkpoint = "best" if settings.best else "checkpoint"
    steps = history(settings.run, settings.parameters, checkpoint)
    torch.set_num_threads(1)
    config = export_policy(
        settings.out,
        settings.out.name,
        load_policy(run["algorithm"], settings.run / checkpoint),
        algorithm=run["algorithm"],
        env_id=run["id"],
        env=run["env"],
        policy_kwargs=run["model"].get("policy_kwargs", {}),
        learned_from=learned_from([step.objects for step in steps], run["evaluate"] if settings.best else None),
        licence=LICENCE,
    )
    with progress() as bar:
        task = bar.add_task(config.name, total=settings.trials * len(settings.objects))
        scores = measure(
            str(settings.out),
            settings.objects,
            settings.trials,
            settings.seed,
            progress=lambda done: bar.update(task, completed=done),
            num_envs=settings.num_envs,
        )
    rows = [score.row() for score in scores]
    write_network_card(settings.out, config, steps, rows, seed=settings.seed, command=command)
    return scores


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and publish; returns the exit status."""
    line = sys.argv[1:] if arguments is None else arguments
    settings = parse(Settings, line, text=__doc__)
    try:
        words = [shown(Path(word)) if Path(word).is_absolute() else word for word in line]
        scores = publish(settings, shlex.join(["python", "scripts/publish_sb3.py", *words]))
    except (GraspboxError, OSError, yaml.YAMLError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    except KeyboardInterrupt:
        return 130
    rows = [{"set": score.objects, **score.result.to_json()} for score in scores]
    if settings.json:
        print_json(rows)
    else:
        for row in rows:
            print(f"{row['set']}: {row['succeeded']} of {row['trials']} succeed, {row['secure']} secure")
        print(settings.out / "README.md")
    return 0


if __name__ == "__main__":
    run_program(main)
