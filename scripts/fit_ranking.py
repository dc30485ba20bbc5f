"""Fit the weights of the planner's ranking to simulated grasps of procedural training objects.

For each object the planner's best poses and some random ones are tried. The run records the ranking's features of each
pose (named by `graspbox.planning.rank_weights`) and whether it succeeded. The weights come from a logistic regression
with one intercept per object, so that it ranks poses within objects; held-out figures come from six folds over objects.
An interrupted run resumes; a complete one is only fitted. Begin a new one after a change of planner or physics.

    python scripts/fit_ranking.py --out out/ranking

Put each printed number into the row of its name: for the ReFlex into the table ``TERMS`` of
``env/plan/src/rank/score.rs``, whose weights hold for every hand that gives none; for another hand into
``[grasp.ranking]`` of its ``hand.toml``. To try another term, add a row with weight 0 to ``TERMS``, build, and fit.
Needs the extra ``cli``.
"""

import json
import sys
import zlib
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

import graspbox
from graspbox import Hand
from graspbox.cli.common import find_hand
from graspbox.errors import GraspboxError
from graspbox.object_sets import ObjectSpec
from graspbox.planning import rank_weights
from graspbox.programs import run_program
from graspbox.training.runs import Run

Array = NDArray[np.float64]

FOLDS = 6
#: Ridge on the intercepts; it keeps those of objects without a success, or without a failure, finite.
INTERCEPT_RIDGE = 0.3
#: Standard deviation below which a feature is uninformative.
NEARLY_CONSTANT = 0.02


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


def fit(features: Array, success: Array, objects: NDArray[np.int64], ridge: float) -> Array:
    """Fit the weights (k,) to features (n, k), success (n,) of 0 and 1, and object numbers (n,).

    `ridge` applies to the weights of standardized features.
    """
    scale = features.std(axis=0)
    # A feature that hardly varies gets no weight.
    scale[scale < NEARLY_CONSTANT] = np.inf
    indicators = (objects[:, None] == np.unique(objects)).astype(np.float64)
    x = np.hstack([(features - features.mean(axis=0)) / scale, indicators])
    penalty = np.concatenate([np.full(features.shape[1], ridge), np.full(indicators.shape[1], INTERCEPT_RIDGE)])
    w = np.zeros(x.shape[1])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ w, -30.0, 30.0)))
        gradient = x.T @ (p - success) + penalty * w
        step = np.linalg.solve((x.T * (p * (1.0 - p))) @ x + np.diag(penalty), gradient)
        w -= step
        if np.abs(step).max() < 1e-9:
            break
    weights: Array = w[: features.shape[1]] / scale
    return weights


def judge(score: Array, success: Array, objects: NDArray[np.int64]) -> dict[str, float]:
    """Evaluate a score: success rate of the first pose per object, and share of its pairs in the right order."""
    first, pairs = [], []
    for number in np.unique(objects):
        mine = objects == number
        first.append(success[mine][np.argmax(score[mine])])
        good, bad = score[mine & (success == 1)], score[mine & (success == 0)]
        if len(good) and len(bad):
            pairs.append(np.mean((good[:, None] > bad) + 0.5 * (good[:, None] == bad)))
    return {"first": float(np.mean(first)), "pairs": float(np.mean(pairs))}


def held_out(features: Array, success: Array, objects: NDArray[np.int64], ridge: float, seed: int) -> Array:
    """Score each object by weights fitted without it."""
    fold = np.random.default_rng(seed).permutation(objects.max() + 1) % FOLDS
    score = np.zeros(len(success))
    for k in range(FOLDS):
        out = fold[objects] == k
        score[out] = features[out] @ fit(features[~out], success[~out], objects[~out], ridge)
    return score


def report(rows: list[dict[str, Any]], hand: Hand, ridge: float, seed: int) -> dict[str, Any]:
    """Fit the weights and evaluate them; returns all figures."""
    rows = [row for row in rows if row["success"]]
    features = np.array([x for row in rows for x in row["features"]])
    success = np.array([float(x) for row in rows for x in row["success"]])
    objects = np.repeat(np.arange(len(rows)), [len(row["success"]) for row in rows])
    mixed = sum(0 < sum(row["success"]) < len(row["success"]) for row in rows)
    if mixed < FOLDS:
        raise graspbox.errors.ConfigError(
            f"{mixed} of {len(rows)} objects have successes and failures; it takes {FOLDS} to fit: name more objects"
        )
    present = np.array(list(rank_weights(hand).values()))
    random = np.random.default_rng(seed).random(len(success))
    judged = {
        "fitted, held out": held_out(features, success, objects, ridge, seed),
        "present weights": features @ present,
        "random order": random,
        "best possible": success,
    }
    weights = fit(features, success, objects, ridge)
    return {
        "objects": len(rows),
        "poses": len(success),
        "successes": int(success.sum()),
        "weights": dict(zip(rank_weights(hand), weights.tolist(), strict=True)),
        "judged": {name: judge(score, success, objects) for name, score in judged.items()},
    }


def show(facts: dict[str, Any], hand: Hand) -> None:
    """Print the new and the current weights, and the quality of each order."""
    console = Console()
    weights = Table("term", "present", "fitted", title=f"weights of the ranking for {hand.name}")
    for (name, present), fitted in zip(rank_weights(hand).items(), facts["weights"].values(), strict=True):
        weights.add_row(name, f"{present:.2f}", f"{fitted:.2f}")
    judged = Table("order by", "first pose succeeds", "pairs in order")
    for name, row in facts["judged"].items():
        judged.add_row(name, f"{row['first']:.1%}", f"{row['pairs']:.1%}")
    console.print(weights)
    console.print(judged)
    console.print(f"{facts['objects']} objects, {facts['successes']} successes among {facts['poses']} poses")


def main(
    out: Annotated[Path, typer.Option(help="Folder of the run; objects already tried are skipped.")],
    objects: Annotated[str, typer.Option(help="Object set; its training split is used.")] = "procedural:2000-2003",
    hand: Annotated[str, typer.Option(help="Hand: a name, or its two files with a comma between.")] = "reflex",
    top: Annotated[int, typer.Option(min=0, help="The planner's best poses of each object.")] = 8,
    others: Annotated[int, typer.Option(min=0, help="Random other poses of each object.")] = 24,
    ridge: Annotated[float, typer.Option(min=0.01, help="Ridge on the weights of standardized features.")] = 8.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of plans, random poses and folds.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Try poses, fit the weights of the ranking, and print them with their held-out figures."""
    try:
        tried = find_hand(hand)
        terms = list(rank_weights(tried))
        specs = graspbox.object_sets.load(objects, split="train")
        settings = {"hand": tried.name, "top": top, "others": others, "seed": seed, "terms": terms}
        with Run(out, settings) as run:
            rows = run.rows("objects")
            known = {row["name"] for row in rows}
            missing = [spec for spec in specs if spec.name not in known]
            for spec in track(missing, description="trying poses", console=Console(stderr=True)):
                rows.append(collect(spec, tried, top, others, seed))
        names = set(specs.names)
        facts = report([row for row in rows if row["name"] in names], tried, ridge, seed)
    except GraspboxError as error:
        print(f"fit_ranking: {error}", file=sys.stderr)
        raise typer.Exit(2) from None
    if as_json:
        print(json.dumps(facts))
    else:
        show(facts, tried)


if __name__ == "__main__":
    run_program(partial(typer.run, main))
