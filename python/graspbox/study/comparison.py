"""Table 3.1 of the reference study, compared with graspbox.

`save_comparison` and the command need the extra ``cli``.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from graspbox import object_sets
from graspbox._common.files import check_output, write_text
from graspbox._common.options import parse
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.evaluation.planner_trials import SetResult, try_set

#: YCB cups assumed to be the study's two cups. YCB's ten nested cups run from a (smallest) to j (largest);
#: counted from 1, cup 7 is g and cup 9 is i. The study numbers its cups without giving a size.
CUP_GUESS = "stacking cups 7 and 9 are assumed to be 065-g and 065-i, counting YCB's ten cups from the smallest"


@dataclass(frozen=True)
class StudyRow:
    """One object of the study's table 3.1: its name there, counts of poses, and its YCB mesh, None if YCB has none."""

    study_name: str
    succeeded: int
    tried: int
    ycb_name: str | None


#: Table 3.1, in the order of the study.
TABLE_3_1 = (
    StudyRow("soft scrub", 20, 80, "021_bleach_cleanser"),
    StudyRow("yellow plastic chain", 16, 33, "059_chain"),
    StudyRow("chunk light tuna can", 5, 11, "007_tuna_fish_can"),
    StudyRow("plastic wine cup", 0, 0, None),
    StudyRow("stacking cup 9 red", 10, 11, "065-i_cups"),
    StudyRow("power drill", 45, 68, "035_power_drill"),
    StudyRow("scissors", 39, 89, "037_scissors"),
    StudyRow("purple wood block 1 inch", 3, 4, "070-b_colored_wood_blocks"),
    StudyRow("fork", 32, 84, "030_fork"),
    StudyRow("apple", 10, 11, "013_apple"),
    StudyRow("stacking cup 7 yellow", 5, 11, "065-g_cups"),
    StudyRow("plastic nut grey", 0, 0, None),
)
#: Header of the table.
COLUMNS = ("the study's object", "study", "rate", "YCB mesh", "ours", "rate", "legacy", "first")


def study_objects() -> list[str]:
    """Object set names of the YCB meshes in the table, in its order."""
    return [f"ycb:{row.ycb_name}" for row in TABLE_3_1 if row.ycb_name]


@dataclass(frozen=True)
class Comparison:
    """Our counts, to compare with the study's: rows of `SetResult.table` by YCB name, of the evaluated objects."""

    ours: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(cls, result: SetResult) -> "Comparison":
        """Select the objects of the table from an evaluation."""
        wanted = {row.ycb_name for row in TABLE_3_1}
        return cls({row["name"]: row for row in result.table()["objects"] if row["name"] in wanted})

    def counts(self, row: StudyRow) -> tuple[int, int]:
        """Our numbers of successes and trials for a row; (0, 0) without trials."""
        ours = self.ours.get(row.ycb_name or "")
        return (0, 0) if ours is None else (ours["succeeded"], ours["tried"])

    def rows(self) -> list[tuple[str, ...]]:
        """Cells of the table as text, totals last; our totals are over the evaluated objects.

        Objects that neither the study nor we tried are left out.
        """
        study, ours = [(row.succeeded, row.tried) for row in TABLE_3_1], list(self.ours.values())
        counts = [(row["succeeded"], row["tried"]) for row in ours]
        legacy, first = (sum(row[key] for row in ours) for key in ("legacy_succeeded", "first_succeeded"))
        tried, objects = _sum(counts)[1], len(ours)
        won = [f"{sum(s > 0 for s, _ in each)}/{len(each)}" for each in (study, counts)]
        total = (*_cells(*_sum(study)), f"{objects} objects", *_cells(*_sum(counts)), f"{legacy}/{tried}")
        return [
            *(self._row(row) for row in TABLE_3_1 if row.tried or row.ycb_name is not None),
            ("total", *total, f"{first}/{objects}"),
            ("objects with a success", won[0], "", "", won[1], "", "", ""),
        ]

    def _row(self, row: StudyRow) -> tuple[str, ...]:
        left = (row.study_name, *_cells(row.succeeded, row.tried))
        if row.ycb_name is None:
            return (*left, "unavailable", "", "", "", "")
        ours = self.ours.get(row.ycb_name)
        if ours is None:
            return (*left, row.ycb_name, "not run", "", "", "")
        right = (f"{ours['legacy_succeeded']}/{ours['tried']}", "yes" if ours["first_succeeded"] else "no")
        return (*left, row.ycb_name, *_cells(ours["succeeded"], ours["tried"]), *right)

    def markdown(self) -> str:
        """Write the table as Markdown, with the note on the cups."""
        lines = [COLUMNS, ("---", "--:", "--:", "---", "--:", "--:", "--:", "--:"), *self.rows()]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\nsucceeded/tried poses; {CUP_GUESS}.\n"


def _cells(succeeded: int, tried: int) -> tuple[str, str]:
    """Format a count and its rate."""
    return f"{succeeded}/{tried}", f"{succeeded / tried:.0%}" if tried else ""


#: Counts of successes and of trials.
Count = tuple[int, int]
_STUDY_COLOR, _OUR_COLOR = "#9aa5b1", "#0072b2"


def save_comparison(path: str | Path, comparison: Comparison) -> None:
    """Write a bar chart: the share of poses that succeed per object, the study's and ours, labelled with the counts.

    The extension of `path` is one of `graspbox.pictures.SUFFIXES`. Rows that neither the study nor we tried are absent.
    """
    from graspbox.pictures.files import Figure, check_path, write

    target = check_path(path)
    rows = tried_rows(comparison)
    study: list[Count] = [(row.succeeded, row.tried) for row in rows]
    ours = [comparison.counts(row) for row in rows]
    names = [f"{row.study_name}\n{row.ycb_name or 'no YCB mesh'}" for row in rows]
    figure = Figure(figsize=(8.5, 0.43 * len(rows) + 1.6), dpi=110)
    axes = figure.subplots()
    at = -np.arange(len(rows) + 1, dtype=np.float64)
    at[-1] -= 0.4
    _bars(axes, at + 0.2, [*study, _sum(study)], _STUDY_COLOR, "the study (table 3.1)")
    _bars(axes, at - 0.2, [*ours, _sum(ours)], _OUR_COLOR, "graspbox")
    axes.set_yticks(at, [*names, "total"], fontsize=8)
    axes.set_xlim(0, 112)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("poses that succeed (%)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=2, frameon=False, fontsize=9)
    figure.text(0.99, 0.008, CUP_GUESS, ha="right", fontsize=7, color="#666666")
    figure.tight_layout(rect=(0, 0.02, 1, 1))
    write(figure, target)


def tried_rows(comparison: Comparison) -> list[StudyRow]:
    """Rows of table 3.1 that the study or we tried, in its order."""
    return [row for row in TABLE_3_1 if row.tried or comparison.counts(row)[1]]


def _sum(counts: list[Count]) -> Count:
    return sum(s for s, _ in counts), sum(t for _, t in counts)


def _bars(axes: Any, at: np.ndarray[Any, Any], counts: list[Count], color: str, label: str) -> None:
    rates = [100 * s / t if t else 0.0 for s, t in counts]
    axes.barh(at, rates, height=0.38, color=color, label=label)
    for y, rate, (s, t) in zip(at, rates, counts, strict=True):
        axes.text(rate + 1, y, f"{s}/{t}" if t else "not tried", va="center", fontsize=8, color="#333333")


@dataclass(frozen=True)
class Settings:
    """Try the objects of the study, and compare the success of the poses with its table 3.1."""

    poses: int = 20
    """Poses to try per object, best first."""
    seed: int = 0
    """Seed of the plans."""
    threads: int | None = None
    """Threads to use; all by default."""
    out: Path | None = None
    """Folder for table_3_1.md and table_3_1.png."""
    json: bool = False
    """Print our counts as JSON."""

    def __post_init__(self) -> None:
        if self.poses < 1:
            raise ConfigError(f"--poses is {self.poses}; give 1 or more")


def main(arguments: list[str] | None = None) -> int:
    """Try the study's objects and print both tables; the exit status is 1 if an object could not be tried."""
    args = parse(Settings, arguments, "python tests/validate.py study")
    if args.out is not None:
        check_output(args.out / "table_3_1.md")
    result = try_set(
        object_sets.load(study_objects()),
        poses=args.poses,
        seed=args.seed,
        trial=TrialConfig(legacy=True),
        num_threads=args.threads,
    )
    comparison = Comparison.of(result)
    if args.out is not None:
        write_text(args.out / "table_3_1.md", comparison.markdown())
        save_comparison(args.out / "table_3_1.png", comparison)
    print(json.dumps(dict(comparison.ours)) if args.json else comparison.markdown())
    errors = [f"{row.name}: {row.error}" for row in result.objects if row.error]
    for error in errors:
        print(error, file=sys.stderr)
    return 1 if errors else 0
