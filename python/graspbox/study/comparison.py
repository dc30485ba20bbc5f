"""Table 3.1 of the reference study, compared with graspbox.

`StudyRow` is a row of the study's table, `Comparison` compares it with the counts of `graspbox.planner_trials`;
`graspbox.study.comparison_chart` plots it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from graspbox.planner_trials import SetResult

#: YCB cups assumed to be the study's two cups. YCB's ten nested cups run from a (smallest) to j (largest);
#: counted from 1, cup 7 is g and cup 9 is i. The study numbers its cups without giving a size.
CUP_GUESS = "stacking cups 7 and 9 are assumed to be 065-g and 065-i, counting YCB's ten cups from the smallest"


@dataclass(frozen=True)
class StudyRow:
    """One object of the study's table 3.1.

    Attributes
    ----------
    study_name : str
        Name in the study.
    succeeded, tried : int
        Number of poses that succeeded and that were tried.
    ycb_name : str or None
        The corresponding YCB mesh; None if YCB has none.
    """

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
    """Our counts, to compare with the study's.

    Attributes
    ----------
    ours : mapping
        Row of `SetResult.table` by YCB name, for the objects that were evaluated.
    """

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
        rows = [self._row(row) for row in TABLE_3_1 if row.tried or row.ycb_name is not None]
        study = (sum(r.succeeded for r in TABLE_3_1), sum(r.tried for r in TABLE_3_1))
        sums = {key: sum(row[key] for row in self.ours.values()) for key in ("succeeded", "tried", "legacy_succeeded")}
        first = sum(bool(row["first_succeeded"]) for row in self.ours.values())
        ours = (sums["succeeded"], sums["tried"])
        legacy = f"{sums['legacy_succeeded']}/{sums['tried']}"
        total = ("total", _share(*study), _rate(*study), f"{len(self.ours)} objects", _share(*ours), _rate(*ours))
        won = sum(r.succeeded > 0 for r in TABLE_3_1), sum(row["succeeded"] > 0 for row in self.ours.values())
        objects = ("objects with a success", f"{won[0]}/{len(TABLE_3_1)}", "", "", f"{won[1]}/{len(self.ours)}", "")
        return [*rows, (*total, legacy, f"{first}/{len(self.ours)}"), (*objects, "", "")]

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
