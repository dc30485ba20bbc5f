"""Measure policies side by side: on unseen objects, under errors, by class of object.

    python scripts/evaluate_policies.py --out out/evaluation --policies random planner policies/depth
    python scripts/evaluate_policies.py --out out/oracle --policies robust_oracle policies/depth --conditions nominal

A policy is an argument of `graspbox.policies.load` (a name or a folder), ``completed_planner=FOLDER`` (the planner on
the output of the completion in a policy's folder), ``nearest=DATA`` (a grasp that held in the most similar scene of a
data set), ``filtered=FOLDER`` or ``unfiltered=FOLDER`` (a head with or without its collision filter), or a variant of a
policy of one depth image: ``refined=FOLDER`` (two refinements), ``unrefined=FOLDER`` (no refinement),
``geometric=FOLDER`` (no head), ``plain=FOLDER`` (neither), ``tolerant=FOLDER`` (expects hand errors of up to 10 mm and
10 degrees), or with ground truth for a component: ``true_completion=FOLDER``, ``true_scorer=FOLDER`` (simulation),
``true_both=FOLDER``. ``--stressed`` names the policies measured under all conditions; the others run under the first
alone.

All policies get the same trials: object, pose and noise follow from the seed, and training objects of any of them are
left out for all. The folder then has ``results.jsonl`` with every trial, ``evaluation.md`` with the tables,
and ``policies.png``, ``conditions.png`` and ``reliability.png``. The same command resumes after an interruption. Exit
status: 0 at the end, 2 for wrong arguments, 130 for an interruption.

Needs the extras ``cli``, and for some policies ``onnx``, ``train``, ``data``, ``ycb``.
"""

import shlex
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import radians, sqrt
from pathlib import Path
from typing import Any

import tyro

from graspbox import evaluation, object_sets, policies
from graspbox._common.files import write_text
from graspbox.artifacts.folders import read_depth_policy
from graspbox.cli.common import console, print_json, progress
from graspbox.envs import IDS
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation.conditions import CONDITIONS, settings_of
from graspbox.evaluation.object_classes import CLASSES, object_classes
from graspbox.evaluation.oracles import DepthOracle, Oracle
from graspbox.evaluation.reports import COLUMNS, Measured, class_table, condition_table, labels, policy_table, pooled
from graspbox.object_sets import learned_sets
from graspbox.perception.perturbations import PoseNoise
from graspbox.programs import run_program
from graspbox.training.runs import Run

#: Settings of the finder by which a variant of a policy differs from its folder.
VARIANTS: dict[str, dict[str, Any]] = {
    "refined": {"refinements": 2},
    "unrefined": {"refinements": 0},
    "geometric": {"predicted": 0},
    "plain": {"refinements": 0, "predicted": 0},
}
#: Standard deviations of the errors of the condition ``hand_10``.
_HAND_10 = PoseNoise(0.01 / sqrt(3), radians(10) / sqrt(3))
#: Components replaced by ground truth (ablation).
ORACLES: dict[str, tuple[Oracle, ...]] = {
    "true_completion": ("completion",),
    "true_scorer": ("scorer",),
    "true_both": ("completion", "scorer"),
}
#: Whether a head has its collision filter.
_HEADS = {"filtered": True, "unfiltered": False}


@dataclass(frozen=True)
class Settings:
    """Arguments of the evaluation."""

    out: Path
    """Folder of the results."""
    policies: tuple[str, ...]
    """Policies, in the order of the tables."""
    stressed: tuple[str, ...] = ()
    """Policies measured under all conditions; by default all folders."""
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    """Conditions, the first of which applies to all policies: see graspbox.evaluation.conditions."""
    objects: tuple[str, ...] = ("procedural:unseen:0-19", "ycb/test")
    """Object sets; /SPLIT keeps one split."""
    trials: int = 1000
    """Trials of each policy, on each object set, under each condition."""
    seeds: tuple[int, ...] = (0,)
    """Seeds; each gives `trials` trials."""
    json: bool = False
    """Print the results as JSON, and nothing else, on standard output."""


def check(settings: Settings) -> None:
    """Refuse arguments that do not fit together."""
    for name, given, known in (
        ("conditions", settings.conditions, tuple(CONDITIONS)),
        ("stressed", settings.stressed, settings.policies),
    ):
        if unknown := [one for one in given if one not in known]:
            raise ConfigError(f"--{name} has {', '.join(unknown)}; choose from {', '.join(known)}")
    for name in ("policies", "conditions", "objects", "seeds"):
        if not getattr(settings, name):
            raise ConfigError(f"--{name} is empty; name one")


def load(spec: str) -> policies.Policy:
    """Make a policy."""
    kind, _, path = spec.partition("=")
    if not path:
        return policies.load(spec)
    if kind == "completed_planner":
        return policies.PartialViewPlanner(Path(path))
    if kind in _HEADS:
        return policies.HeadGrasp(Path(path), filtered=_HEADS[kind])
    if kind == "nearest":
        from graspbox.models.nearest_finder import remember
        from graspbox.recipes.learned import of_datasets

        return policies.NearestGrasp(replace(remember(path), learned_from=tuple(of_datasets([Path(path)]))))
    if kind == "tolerant":
        return policies.DepthGrasp(Path(path), hand_error=_HAND_10)
    if kind in VARIANTS:
        finder = read_depth_policy(Path(path)).finder
        return policies.DepthGrasp(Path(path), config=replace(finder, **VARIANTS[kind]))
    if kind in ORACLES:
        return DepthOracle(Path(path), ORACLES[kind])
    known = ", ".join(("completed_planner", *_HEADS, "nearest", "tolerant", *VARIANTS, *ORACLES))
    raise ConfigError(f"there is no policy {spec!r}; choose the prefix before = from {known}")


def jobs(settings: Settings) -> Iterator[dict[str, Any]]:
    """List the measurements, the first condition first."""
    stressed = settings.stressed or tuple(p for p in settings.policies if Path(p).is_dir())
    for n, condition in enumerate(settings.conditions):
        for policy in settings.policies if n == 0 else stressed:
            for objects in settings.objects:
                for seed in settings.seeds:
                    yield {"condition": condition, "policy": policy, "objects": objects, "seed": seed}


def unknown_objects(
    sets: tuple[str, ...], loaded: Iterable[policies.Policy]
) -> tuple[dict[str, object_sets.ObjectSet], dict[str, int]]:
    """Load the objects of each set from which no policy learned; also count the objects left out, if any."""
    learned = sorted({name for policy in loaded for name in policy.learned_from})
    kept, left_out = {}, {}
    for given in sets:
        name, split = object_sets.name_and_split(given)
        found = object_sets.load(name, split=split)
        kept[given] = learned_sets.without(found, learned)
        if not kept[given]:
            raise ConfigError(f"--objects has {given!r}, from which the policies learned; name other objects")
        if missing := len(found) - len(kept[given]):
            left_out[given] = missing
            console.print(f"{missing} of {len(found)} objects of {given} are left out: a policy learned from them")
    return kept, left_out


def measure(
    job: dict[str, Any], policy: policies.Policy, objects: object_sets.ObjectSet, trials: int
) -> dict[str, Any]:
    """Run the trials of one job."""
    title = f"{job['policy']}, {job['objects']}, {job['condition']}, seed {job['seed']}"
    with progress() as bar:
        task = bar.add_task(title, total=trials)
        found = evaluation.evaluate(
            policy,
            objects=objects,
            include_learned=True,
            trials=trials,
            seed=job["seed"],
            progress=lambda done: bar.update(task, completed=done),
            condition=job["condition"],
        )
    console.print(f"{title}: success {found.rate:.1%}, secure {found.secure / trials:.1%}", markup=False)
    return job | {
        "milliseconds": found.ms_per_decision,
        "failures": found.failures,
        "env_id": found.env_id,
        "seeds": [trial.seed for trial in found.trials],
        "kinds": [trial.failure for trial in found.trials],
        "trials": [[getattr(trial, column) for column in COLUMNS] for trial in found.trials],
    }


def classes_of(sets: Iterable[object_sets.ObjectSet]) -> dict[str, tuple[str, ...]]:
    """Name the classes of every object."""
    return {spec.name: object_classes(spec.load()) for objects in sets for spec in objects}


def run(settings: Settings, command: str) -> list[Measured]:
    """Run the missing measurements, and write tables and pictures."""
    check(settings)
    loaded = {spec: load(spec) for spec in settings.policies}
    wanted = list(jobs(settings))
    for job in wanted:
        # Checked before the work, not after hours of it.
        settings_of(job["condition"], loaded[job["policy"]].env_id or IDS[0])
    objects, left_out = unknown_objects(settings.objects, loaded.values())
    # Policies added later must leave out the same objects.
    given = {"trials": settings.trials} | ({"left_out": left_out} if left_out else {})
    keys = ("condition", "policy", "objects", "seed")
    with Run(settings.out, given) as run:
        found = run.rows("results")
        done = {tuple(row[key] for key in keys) for row in found}
        for job in wanted:
            if tuple(job.values()) not in done:
                found.append(measure(job, loaded[job["policy"]], objects[job["objects"]], settings.trials))
    order = {tuple(job.values()): n for n, job in enumerate(wanted)}
    kept = [row for row in found if tuple(row[key] for key in keys) in order]
    kept.sort(key=lambda row: order[tuple(row[key] for key in keys)])
    named = labels(settings.policies)
    rows = [Measured.of(row, named[row["policy"]]) for row in kept]
    report(settings, rows, classes_of(objects.values()), command)
    return rows


def report(settings: Settings, rows: list[Measured], classes: dict[str, tuple[str, ...]], command: str) -> None:
    """Write tables and pictures."""
    from graspbox.pictures import save_rates, save_reliability

    first = [row for row in rows if row.condition == settings.conditions[0]]
    others = {row.policy for row in rows if row.condition != settings.conditions[0]}
    stressed = [row for row in rows if row.policy in others]
    meanings = "\n".join(f"- `{name}`: {meaning}" for name, meaning in CLASSES.items())
    seeds = ", ".join(map(str, settings.seeds))
    text = f"# Evaluation\n\n```\n{command}\n```\n\n"
    text += f"In brackets 95 % intervals (Wilson). Seeds of the trials: {seeds}.\n"
    text += f"\n## Policies\n\n{policy_table(first)}\n![policies](policies.png)\n"
    text += f"\n## By class of object\n\n{class_table(first, classes)}\n{meanings}\n"
    if stressed:
        text += f"\n## Conditions\n\n{condition_table(stressed)}\n![conditions](conditions.png)\n"
    if stated := [row for row in first if row.calibration_error is not None]:
        text += "\n## Calibration\n\n![reliability](reliability.png)\n"
    write_text(settings.out / "evaluation.md", text)
    sets: dict[str, dict[str, tuple[int, int, int]]] = {}
    for row in pooled(first, by=lambda r: (r.policy, r.objects)):
        sets.setdefault(row.objects, {})[row.policy] = counts(row)
    save_rates(settings.out / "policies.png", "first attempt", sets)
    if stressed:
        joined = pooled(stressed, by=lambda r: (r.policy, r.condition))
        errors = {f"{r.policy}, {r.condition}": counts(r) for r in joined if r.condition != "shake"}
        save_rates(settings.out / "conditions.png", "under errors", {"all object sets together": errors})
    if stated:
        pairs = {r.policy: (r.confidence, r.success) for r in pooled(stated, by=lambda r: r.policy)}
        save_reliability(settings.out / "reliability.png", "stated and true success", pairs)


def counts(row: Measured) -> tuple[int, int, int]:
    """Count trials, successes, secure holds."""
    return len(row.names), sum(row.success), sum(row.secure)


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and run; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    settings = tyro.cli(Settings, args=given, description=__doc__)
    try:
        rows = run(settings, shlex.join(["python", "scripts/evaluate_policies.py", *given]))
    except KeyboardInterrupt:
        console.print("interrupted; the same command resumes")
        return 130
    except (GraspboxError, OSError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    if settings.json:
        print_json([row.summary() for row in rows])
    else:
        print((settings.out / "evaluation.md").read_text())
    return 0


if __name__ == "__main__":
    run_program(main)
