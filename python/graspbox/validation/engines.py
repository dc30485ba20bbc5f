"""Comparison of the physics engines: labels and speed on the same planner poses.

For each object in turn, the best poses are tried with each engine and with each at half its time step, so that changes
of the machine's speed affect all runs. Rates are trials per second of CPU time.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import graspbox
from graspbox import object_sets
from graspbox.configs import PhysicsConfig
from graspbox.validation.agreement import kappa

#: A mix of shapes without mesh files.
DEFAULT_OBJECTS = (
    "procedural:ball:2",
    "procedural:box:2",
    "procedural:can:2",
    "procedural:mug:2",
    "procedural:bottle:2",
    "procedural:bowl:2",
)

_HALF = PhysicsConfig().dt / 2

#: Settings of the runs to compare, by name.
RUNS = {
    "newton": PhysicsConfig(engine="newton"),
    "newton, half dt": PhysicsConfig(engine="newton", dt=_HALF),
    "rapier": PhysicsConfig(engine="rapier"),
    "rapier, half dt": PhysicsConfig(engine="rapier", dt=_HALF),
}

#: Pairs of runs whose labels are compared.
PAIRS = (("newton", "rapier"), ("newton", "newton, half dt"), ("rapier", "rapier, half dt"))


@dataclass(frozen=True)
class EngineRow:
    """Results of one run of trials.

    Attributes
    ----------
    name : str
        Engine and time step.
    trials, succeeded, secure : int
        Numbers of trials, successes and secure holds.
    trials_per_second, simulated_per_second : float
        Trials, and simulated seconds, per second of CPU time.
    unconverged_per_million : float
        Steps in which the solver did not converge, per million steps; 0 for rapier, which does not measure it.
    """

    name: str
    trials: int
    succeeded: int
    secure: int
    trials_per_second: float
    simulated_per_second: float
    unconverged_per_million: float


@dataclass(frozen=True)
class Agreement:
    """Agreement of the labels of two runs: the share of equal labels, and Cohen's kappa."""

    first: str
    second: str
    share: float
    kappa: float


def compare(objects: Sequence[str], poses: int, seed: int) -> tuple[list[EngineRow], list[Agreement]]:
    """Try the planner's best `poses` for every object in every run.

    Returns
    -------
    rows : list of EngineRow
        One per entry of `RUNS`.
    agreements : list of Agreement
        One per entry of `PAIRS`.
    """
    outcomes: dict[str, list[graspbox.Outcomes]] = {name: [] for name in RUNS}
    seconds = dict.fromkeys(RUNS, 0.0)
    for item in (item for name in objects for item in object_sets.load(name)):
        rest = graspbox.Scene(item.load())
        plan = graspbox.plan(rest.mesh, world_from_object=rest.world_from_object, seed=seed).best(poses)
        for name, physics in RUNS.items():
            scene = graspbox.Scene(rest.mesh, world_from_object=rest.world_from_object, physics=physics)
            start = time.process_time()
            outcomes[name].append(scene.simulate(plan.poses, plan.preshape))
            seconds[name] += time.process_time() - start
    rows = [_row(name, outcomes[name], seconds[name]) for name in RUNS]
    labels = {name: np.concatenate([o.success for o in outcomes[name]]) for name in RUNS}
    agreements = [
        Agreement(a, b, float(np.mean(labels[a] == labels[b])), kappa(labels[a], labels[b])) for a, b in PAIRS
    ]
    return rows, agreements


def _row(name: str, outcomes: Sequence[graspbox.Outcomes], seconds: float) -> EngineRow:
    def total(field: str) -> float:
        return float(sum(getattr(o, field).sum() for o in outcomes))

    trials, simulated = sum(len(o) for o in outcomes), total("time")
    return EngineRow(
        name=name,
        trials=trials,
        succeeded=int(total("success")),
        secure=int(total("secure")),
        trials_per_second=trials / seconds,
        simulated_per_second=simulated / seconds,
        unconverged_per_million=1e6 * total("unconverged_steps") / (simulated / RUNS[name].dt),
    )


def markdown(rows: Sequence[EngineRow], agreements: Sequence[Agreement]) -> str:
    """Write both tables."""
    lines = ["| engine | succeeded | secure | trials/s | simulated s/s | unconverged steps per million |"]
    lines.append("|---|---|---|---|---|---|")
    for r in rows:
        counts = f"{r.succeeded} of {r.trials} | {r.secure}"
        rates = f"{r.trials_per_second:.1f} | {r.simulated_per_second:.0f} | {r.unconverged_per_million:.0f}"
        lines.append(f"| {r.name} | {counts} | {rates} |")
    lines += ["", "| labels | equal | kappa |", "|---|---|---|"]
    lines += [f"| {a.first} and {a.second} | {100 * a.share:.1f} % | {a.kappa:.2f} |" for a in agreements]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Compare the engines on some objects; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m graspbox.validation engines", description=__doc__)
    parser.add_argument("--objects", nargs="+", default=list(DEFAULT_OBJECTS), metavar="SPEC", help="object sets")
    parser.add_argument("--poses", type=int, default=20, help="poses per object")
    parser.add_argument("--seed", type=int, default=0, help="seed of the planner")
    parser.add_argument("--json", action="store_true", help="print the tables as JSON")
    args = parser.parse_args(arguments)
    if args.poses < 1:
        parser.error(f"--poses is {args.poses}; give 1 or more")
    rows, agreements = compare(args.objects, args.poses, args.seed)
    tables: dict[str, Any] = {"engines": [asdict(r) for r in rows], "agreements": [asdict(a) for a in agreements]}
    print(json.dumps(tables) if args.json else markdown(rows, agreements))
    return 0
