"""Evaluate what ``train_sb3.py`` trained, on objects and episodes of your choice.

    python scripts/evaluate_sb3.py out/train/ppo --split test --episodes 500 --references
    python scripts/evaluate_sb3.py out/train/ppo --best --objects procedural:mug:0-99

A policy is to be judged in episodes by which neither it nor its settings were chosen: other seeds, other objects. Exit
status: 0, or 2 for a folder or arguments that cannot be.

Needs the extras ``cli`` and ``train``.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import torch
import typer

from graspbox.cli.common import Json, console, print_json, print_table
from graspbox.errors import ConfigError, GraspboxError
from graspbox.sb3.references import references
from graspbox.sb3.running import ALGORITHMS, evaluate, load, make_env, normalized

NEEDED = {"algorithm", "id", "env", "model", "normalize", "num_envs"}


def settings_of(folder: Path) -> dict[str, Any]:
    """Read what a run was begun with."""
    try:
        first = (folder / "evaluations.jsonl").read_text().splitlines()[0]
        found: dict[str, Any] = json.loads(first)["settings"]
        missing = NEEDED - set(found)
    except (OSError, ValueError, LookupError, TypeError):
        raise ConfigError(f"there is no run of train_sb3.py in {str(folder)!r}") from None
    if missing or found["algorithm"] not in ALGORITHMS:
        raise ConfigError(f"the run in {str(folder)!r} is of another version of train_sb3.py")
    return found


def measure(folder: Path, best: bool, keywords: dict[str, Any], episodes: int, seed: int) -> dict[str, Any]:
    """Let the policy of a run act."""
    run = settings_of(folder)
    # Small networks are fast on one thread; the others are for the environments.
    torch.set_num_threads(1)
    scale = {"gamma": float(run["model"].get("gamma", 0.99)), **run["normalize"]}
    try:
        made = make_env(run["id"], min(run["num_envs"], episodes), **{**run["env"], **keywords})
    except TypeError as error:
        raise ConfigError(f"the run in {str(folder)!r} is of another version of its environment ({error})") from None
    env = normalized(made, **scale, training=False)
    where = folder / ("best" if best else "checkpoint")
    model, _ = load(ALGORITHMS[run["algorithm"]], where, env, buffer=False, device="cpu")
    scales = model.get_vec_normalize_env()
    if scales is not None:
        # They stay as the policy learned with them.
        scales.training = scales.norm_reward = False
    found = evaluate(model, model.get_env(), episodes, seed)
    model.get_env().close()
    return found


def main(
    folder: Annotated[Path, typer.Argument(help="The run's folder.")],
    best: Annotated[bool, typer.Option(help="The model of the best evaluation instead of the last one.")] = False,
    split: Annotated[str, typer.Option(help="Split of the objects: train, validation or test.")] = "test",
    objects: Annotated[list[str] | None, typer.Option(help="Other objects than the run's.")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="How many.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first environment.")] = 50_000,
    beside: Annotated[
        bool,
        typer.Option("--references", help="Random actions, zero actions and the planner too, in the same episodes."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Evaluate a trained policy."""
    keywords: dict[str, Any] = {"split": split, **({"objects": objects} if objects else {})}
    try:
        with console.status("evaluating"):
            found = {"policy": measure(folder, best, keywords, episodes, seed)}
            if beside:
                run = settings_of(folder)
                envs = min(run["num_envs"], episodes)
                found |= references(run["id"], envs, episodes, seed, **{**run["env"], **keywords})
    except (GraspboxError, OSError, gymnasium.error.Error) as error:
        console.print(f"error: {error}", markup=False)
        raise typer.Exit(2) from None
    if as_json:
        print_json(found)
        return
    names = ("success", "error", "secure", "return", "length")
    rows = [(who, *(f"{row[name]:.3f}" for name in names)) for who, row in found.items()]
    print_table(f"{episodes} episodes, split {split}, seed {seed}", ("", *names), rows)


if __name__ == "__main__":
    typer.run(main)
