"""Evaluate a policy of ``graspbox train sb3`` or ``graspbox train clone`` on objects and trials of your choice.

    python scripts/evaluate_sb3.py out/train/ppo --split test --episodes 500 --baselines
    python scripts/evaluate_sb3.py out/train/ppo --best --objects procedural:mug:0-99

Use trials on which neither the policy nor its hyperparameters were selected: other seeds, other objects. Only large
sets have a test split: ``procedural:mug`` has ten objects, none of them in that split; ``procedural:mug:0-99`` has 11.
Exit status: 0, 1 for a file that cannot be read, or 2 for wrong arguments or another folder.

Needs the extras ``cli`` and ``train``.
"""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox import evaluation, learn
from graspbox._common.programs import run_program
from graspbox.cli.common import Json, console, print_json, print_table
from graspbox.learn.sb3.histories import settings_of


def measure(
    folder: Path, keywords: dict[str, Any], episodes: int, seed: int, *, best: bool = False, baselines: bool = False
) -> dict[str, Any]:
    """Evaluate the policy of a run, and the baselines on the same trials; summaries by name."""
    learn.require("stable_baselines3")
    import torch

    from graspbox.learn.sb3.running import load_policy
    from graspbox.sb3.goal_env import with_goals
    from graspbox.sb3.policy import evaluate_baselines, summary

    run = settings_of(folder)
    # Small networks are fastest on one thread; the other threads are for the environments.
    torch.set_num_threads(1)
    policy = load_policy(run["algorithm"], folder / ("best" if best else "checkpoint"))
    policy, settings = with_goals(policy, {**run["env"], **keywords})
    num_envs = run["num_envs"]
    result = evaluation.evaluate(policy, run["id"], trials=episodes, seed=seed, num_envs=num_envs, **settings)
    summaries = {"policy": summary(result)}
    if baselines:
        summaries |= evaluate_baselines(run["id"], num_envs, episodes, seed, **settings)
    return summaries


def main(
    folder: Annotated[Path, typer.Argument(help="The run's folder.")],
    best: Annotated[bool, typer.Option(help="The model of the best evaluation instead of the last one.")] = False,
    split: Annotated[str, typer.Option(help="Split of the objects: train, validation or test.")] = "test",
    objects: Annotated[list[str] | None, typer.Option(help="Other objects than the run's; may be repeated.")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Number of trials.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the trials.")] = 50_000,
    baselines: Annotated[
        bool, typer.Option(help="Random actions, zero actions and the planner too, on the same trials.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Evaluate a trained policy."""
    keywords: dict[str, Any] = {"split": split, **({"objects": objects} if objects else {})}
    with console.status("evaluating"):
        summaries = measure(folder, keywords, episodes, seed, best=best, baselines=baselines)
    if as_json:
        print_json(summaries)
        return
    rows = []
    for who, row in summaries.items():
        intervals = ("{:.3f} to {:.3f}".format(*row[name]) for name in ("ci95", "secure_ci95"))
        success, secure = (
            f"{row[name]:.3f} ({interval})" for name, interval in zip(("success", "secure"), intervals, strict=True)
        )
        rows.append((who, success, secure, f"{row['return']:.3f}", f"{row['length']:.1f}"))
    title = f"{episodes} trials, split {split}, seed {seed}; in brackets 95 % intervals"
    print_table(title, ("", "success", "secure", "return", "length"), rows)


if __name__ == "__main__":
    run_program(partial(typer.run, main))
