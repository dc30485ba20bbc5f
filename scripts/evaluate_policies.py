"""Measure policies side by side: on unseen objects, under errors, by class of object.

    python scripts/evaluate_policies.py --out out/evaluation --policies random --policies planner \
        --policies policies/depth
    python scripts/evaluate_policies.py --out out/oracle --policies robust_oracle \
        --policies policies/depth --conditions nominal

A policy is an argument of `graspbox.policies.load` (a name or a folder), or a variant KIND=FOLDER, a policy with a part
left out, added or replaced by ground truth: `graspbox.evaluation.variants` lists the kinds. ``--stressed`` names the
policies measured under all conditions; the others run only under the first.

All policies get the same trials: object, pose and noise follow from the seed, and training objects of any of them are
left out for all. The folder then has ``results.jsonl`` with every trial, ``evaluation.md`` with the tables,
and ``policies.png``, ``conditions.png`` and ``reliability.png``. The same command resumes after an interruption. Exit
status: 0 at the end, 2 for wrong arguments, 130 for an interruption.

Needs the extras ``cli``, and for some policies ``onnx``, ``train``, ``data``, ``ycb``.
"""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from graspbox._common.files import write_text
from graspbox._common.options import parse
from graspbox._common.programs import run_program
from graspbox.cli.common import console, print_json, progress
from graspbox.errors import GraspboxError
from graspbox.evaluation.comparisons import PolicyComparison
from graspbox.evaluation.conditions import CONDITIONS
from graspbox.evaluation.reports import Measured, pooled
from graspbox.hands.loading import hand_like
from graspbox.pictures import save_rates, save_reliability


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
    objects: tuple[str, ...] = PolicyComparison.objects
    """Object sets; /SPLIT keeps one split."""
    trials: int = 1000
    """Trials of each policy, on each object set, under each condition."""
    seeds: tuple[int, ...] = (0,)
    """Seeds; each gives `trials` trials."""
    hand: str | None = None
    """The hand of all policies, by its name or as hand.urdf,hand.toml; by default that of each policy."""
    json: bool = False
    """Print the results as JSON, and nothing else, on standard output."""


def counts(row: Measured) -> tuple[int, int, int]:
    """Count trials, successes, secure holds."""
    return len(row.names), sum(row.success), sum(row.secure)


def save_pictures(folder: Path, first: list[Measured], stressed: list[Measured]) -> None:
    """Draw the rates under the first condition, under errors, and the predicted probabilities against the rates."""
    sets: dict[str, dict[str, tuple[int, int, int]]] = {}
    for row in pooled(first, by=lambda r: (r.policy, r.objects)):
        sets.setdefault(row.objects, {})[row.policy] = counts(row)
    save_rates(folder / "policies.png", "first attempt", sets)
    if stressed:
        joined = pooled(stressed, by=lambda r: (r.policy, r.condition))
        errors = {f"{r.policy}, {r.condition}": counts(r) for r in joined if r.condition != "shake"}
        save_rates(folder / "conditions.png", "under errors", {"all object sets together": errors})
    if stated := [row for row in first if row.calibration_error is not None]:
        pairs = {r.policy: (r.confidence, r.success) for r in pooled(stated, by=lambda r: r.policy)}
        save_reliability(folder / "reliability.png", "stated and true success", pairs)


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and run; returns the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    settings = parse(Settings, words, text=__doc__)
    asked = {name: value for name, value in vars(settings).items() if name not in ("out", "json", "hand")}
    hand = None if settings.hand is None else hand_like(settings.hand)
    try:
        comparison = PolicyComparison(**asked, hand=hand)
        with progress() as bar:
            task = bar.add_task("", total=settings.trials)
            rows, objects = comparison.run(
                settings.out, console.print, lambda title, done: bar.update(task, description=title, completed=done)
            )
        command = shlex.join(["python", "scripts/evaluate_policies.py", *words])
        write_text(settings.out / "evaluation.md", comparison.page(rows, objects, command))
        save_pictures(settings.out, comparison.first(rows), comparison.under_all(rows))
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
