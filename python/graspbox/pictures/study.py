"""The reference study's table 3.1 beside ours."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from graspbox.pictures.view import write
from graspbox.planner_trials import SetResult

#: Why the study's cups are these two: YCB's ten nested cups run from a (smallest) to j (largest), the first of which
#: the study would call 1. So 7 is g and 9 is i: a guess, for the study numbers its cups without a size.
CUP_GUESS = "stacking cups 7 and 9 taken for 065-g and 065-i: a guess, counting YCB's ten cups from the smallest"


@dataclass(frozen=True)
class StudyRow:
    """One object of the study's table 3.1.

    Attributes
    ----------
    study_name : str
        As the study calls it.
    succeeded, tried : int
        Its counts of poses.
    ycb_name : str or None
        The YCB mesh that stands for it; None where there is none.
    """

    study_name: str
    succeeded: int
    tried: int
    ycb_name: str | None


#: Table 3.1, in its order.
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
#: Head of the table.
COLUMNS = ("the study's object", "study", "rate", "YCB mesh", "ours", "rate", "legacy", "first")


def study_objects() -> list[str]:
    """Name the object sets of the table's objects, in its order."""
    return [f"ycb:{row.ycb_name}" for row in TABLE_3_1 if row.ycb_name]


@dataclass(frozen=True)
class Comparison:
    """Ours beside the study's.

    Attributes
    ----------
    ours : mapping
        The row of `SetResult.table` for each YCB name that was evaluated.
    """

    ours: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(cls, result: SetResult) -> "Comparison":
        """Take what belongs to the table from an evaluation."""
        wanted = {row.ycb_name for row in TABLE_3_1}
        return cls({row["name"]: row for row in result.table()["objects"] if row["name"] in wanted})

    def counts(self, row: StudyRow) -> tuple[int, int]:
        """Our successes and trials for a row; 0, 0 where nothing was tried."""
        ours = self.ours.get(row.ycb_name or "")
        return (0, 0) if ours is None else (ours["succeeded"], ours["tried"])

    def rows(self) -> list[tuple[str, ...]]:
        """Lay the table out for reading, totals last (ours over the evaluated objects)."""
        rows = [self._row(row) for row in TABLE_3_1]
        study = (sum(r.succeeded for r in TABLE_3_1), sum(r.tried for r in TABLE_3_1))
        sums = {key: sum(row[key] for row in self.ours.values()) for key in ("succeeded", "tried", "legacy_succeeded")}
        first = sum(bool(row["first_succeeded"]) for row in self.ours.values())
        ours = (sums["succeeded"], sums["tried"])
        legacy = f"{sums['legacy_succeeded']}/{sums['tried']}"
        together = ("together", _share(*study), _rate(*study), f"{len(self.ours)} objects", _share(*ours), _rate(*ours))
        won = sum(r.succeeded > 0 for r in TABLE_3_1), sum(row["succeeded"] > 0 for row in self.ours.values())
        objects = ("objects with a success", f"{won[0]}/{len(TABLE_3_1)}", "", "", f"{won[1]}/{len(self.ours)}", "")
        return [*rows, (*together, legacy, f"{first}/{len(self.ours)}"), (*objects, "", "")]

    def _row(self, row: StudyRow) -> tuple[str, ...]:
        left = (row.study_name, _share(row.succeeded, row.tried), _rate(row.succeeded, row.tried))
        if row.ycb_name is None:
            return (*left, "unavailable", "", "", "", "")
        ours = self.ours.get(row.ycb_name)
        if ours is None:
            return (*left, row.ycb_name, "not run", "", "", "")
        counts = (ours["succeeded"], ours["tried"])
        legacy = _share(ours["legacy_succeeded"], ours["tried"])
        return (
            *left,
            row.ycb_name,
            _share(*counts),
            _rate(*counts),
            legacy,
            "yes" if ours["first_succeeded"] else "no",
        )

    def markdown(self) -> str:
        """Write the table as Markdown, with the note on the cups."""
        lines = [COLUMNS, ("---", "--:", "--:", "---", "--:", "--:", "--:", "--:"), *self.rows()]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\nsucceeded/tried poses; {CUP_GUESS}.\n"


def _share(succeeded: int, tried: int) -> str:
    return f"{succeeded}/{tried}"


def _rate(succeeded: int, tried: int) -> str:
    return f"{succeeded / tried:.0%}" if tried else ""


def save_comparison(path: Path, comparison: Comparison) -> None:
    """Write the table as bars: share of poses that succeed, the study's and ours, with the counts beside them.

    Parameters
    ----------
    path : Path
        The picture's file.
    comparison : Comparison
        The counts.
    """
    study = [(r.study_name, r.succeeded, r.tried) for r in TABLE_3_1]
    ours = [comparison.counts(row) for row in TABLE_3_1]
    study.append(("together", sum(s for _, s, _ in study), sum(t for _, _, t in study)))
    ours.append((sum(s for s, _ in ours), sum(t for _, t in ours)))
    figure = Figure(figsize=(8.5, 6.2), dpi=110)
    axes = figure.subplots()
    at = -np.arange(len(study), dtype=np.float64)
    at[-1] -= 0.4
    series = (
        ([(s, t) for _, s, t in study], 0.2, "#9aa5b1", "the study (table 3.1)"),
        (ours, -0.2, "#0072b2", "graspbox"),
    )
    for counts, shift, color, label in series:
        rates = [100 * s / t if t else 0.0 for s, t in counts]
        axes.barh(at + shift, rates, height=0.38, color=color, label=label)
        for y, rate, (s, t) in zip(at + shift, rates, counts, strict=True):
            axes.text(rate + 1, y, f"{s}/{t}" if t else "not tried", va="center", fontsize=8, color="#333333")
    names = [f"{r.study_name}\n{r.ycb_name or 'no YCB mesh'}" for r in TABLE_3_1]
    axes.set_yticks(at, [*names, "together"], fontsize=8)
    axes.set_xlim(0, 112)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("poses that succeed (%)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, 1.07), ncols=2, frameon=False, fontsize=9)
    figure.text(0.99, 0.008, CUP_GUESS, ha="right", fontsize=7, color="#666666")
    figure.tight_layout(rect=(0, 0.02, 1, 1))
    write(figure, path)
