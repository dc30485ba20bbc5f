"""Fit the weights of the planner's ranking to simulated grasps of procedural training objects.

For each object the planner's best poses and some random ones are tried. The run records the ranking's features of each
pose (named by `graspbox.planning.rank_weights`) and whether it succeeded. The weights come from a logistic regression
with one intercept per object, so that it ranks poses within objects; held-out figures come from six folds over objects.
An interrupted run resumes; a complete one is only fitted. Begin a new one after a change of planner or physics.

    python scripts/fit_ranking.py --out out/ranking

Put each printed number into the row of its name: for the ReFlex into the table ``TERMS`` of
``env/plan/src/rank/score.rs``, whose weights apply to every hand without its own; for another hand into
``[grasp.ranking]`` of its ``hand.toml``. To try another term, add a row with weight 0 to ``TERMS``, build, and fit.
Needs the extra ``cli``.
"""

import zlib
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.progress import track

import graspbox
from graspbox import Hand
from graspbox._common.programs import run_program
from graspbox._common.runs import Run
from graspbox.cli.common import console, find_hand, print_table
from graspbox.errors import ConfigError
from graspbox.object_sets import ObjectSpec
from graspbox.planning import rank_weights
from ranking.regression import FOLDS, fit, held_out, judge


def collect(spec: ObjectSpec, hand: Hand, top: int, others: int, seed: int) -> dict[str, Any]:
    """Try the `top` best poses of an object and `others` random ones; returns its row."""
    scene = graspbox.Scene(spec.load(), hand=hand)
    rest = scene.world_from_object
    plan = graspbox.plan(scene.mesh, hand=hand, world_from_object=rest, seed=seed, features=True).best()
    random = np.random.default_rng([seed, zlib.crc32(spec.name.encode())])
    below = np.arange(min(top, len(plan)), len(plan))
    chosen = np.concatenate([np.arange(len(plan))[:top], np.sort(random.permutation(below)[:others])])
    out = scene.simulate(plan.poses[chosen], plan.preshape[chosen])
    assert plan.features is not None
    return {
        "name": spec.name,
        "rank": chosen.tolist(),
        "features": plan.features[chosen].tolist(),
        "success": out.success.tolist(),
    }


def report(rows: list[dict[str, Any]], hand: Hand, ridge: float, seed: int) -> None:
    """Fit the weights; print them next to the present ones, and the quality of each order of poses."""
    rows = [row for row in rows if row["success"]]
    features = np.array([x for row in rows for x in row["features"]])
    success = np.array([float(x) for row in rows for x in row["success"]])
    objects = np.repeat(np.arange(len(rows)), [len(row["success"]) for row in rows])
    mixed = sum(0 < sum(row["success"]) < len(row["success"]) for row in rows)
    if mixed < FOLDS:
        raise ConfigError(
            f"{mixed} of {len(rows)} objects have successes and failures; it takes {FOLDS} to fit: name more objects"
        )
    present = rank_weights(hand)
    fitted = fit(features, success, objects, ridge)
    weights = [(name, f"{old:.2f}", f"{new:.2f}") for (name, old), new in zip(present.items(), fitted, strict=True)]
    print_table(f"weights of the ranking for {hand.name}", ("term", "present", "fitted"), weights)
    scores = {
        "fitted, held out": held_out(features, success, objects, ridge, seed),
        "present weights": features @ np.array(list(present.values())),
        "random order": np.random.default_rng(seed).random(len(success)),
        "best possible": success,
    }
    judged = {name: judge(score, success, objects) for name, score in scores.items()}
    title = f"{len(rows)} objects, {int(success.sum())} successes among {len(success)} poses"
    cells = [(name, f"{row['first']:.1%}", f"{row['pairs']:.1%}") for name, row in judged.items()]
    print_table(title, ("order by", "first pose succeeds", "pairs in order"), cells)


def main(
    out: Annotated[Path, typer.Option(help="Folder of the run; objects already tried are skipped.")],
    objects: Annotated[str, typer.Option(help="Object set; its training split is used.")] = "procedural:2000-2003",
    hand: Annotated[str, typer.Option(help="Hand: a name, or its two files with a comma between.")] = "reflex",
    top: Annotated[int, typer.Option(min=0, help="The planner's best poses of each object.")] = 8,
    others: Annotated[int, typer.Option(min=0, help="Random other poses of each object.")] = 24,
    ridge: Annotated[float, typer.Option(min=0.01, help="Ridge on the weights of standardized features.")] = 8.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of plans, random poses and folds.")] = 0,
) -> None:
    """Try poses, fit the weights of the ranking, and print them with their held-out figures."""
    tried = find_hand(hand)
    specs = graspbox.object_sets.load(objects, split="train")
    settings = {"hand": tried.name, "top": top, "others": others, "seed": seed, "terms": list(rank_weights(tried))}
    with Run(out, settings) as run:
        rows = run.rows("objects")
        known = {row["name"] for row in rows}
        missing = [spec for spec in specs if spec.name not in known]
        for spec in track(missing, description="trying poses", console=console):
            rows.append(collect(spec, tried, top, others, seed))
    report([row for row in rows if row["name"] in set(specs.names)], tried, ridge, seed)


if __name__ == "__main__":
    run_program(partial(typer.run, main))
