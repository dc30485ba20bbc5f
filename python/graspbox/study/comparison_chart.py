"""A bar chart of the study's table 3.1 and graspbox's counts; needs matplotlib (extra ``cli``)."""

from typing import Any

import numpy as np

from graspbox.pictures.files import Figure, PathLike, check_path, write
from graspbox.study.comparison import CUP_GUESS, TABLE_3_1, Comparison, StudyRow

#: Counts of successes and of trials.
Count = tuple[int, int]
_STUDY_COLOR, _OUR_COLOR = "#9aa5b1", "#0072b2"


def save_comparison(path: PathLike, comparison: Comparison) -> None:
    """Write a bar chart: the share of poses that succeed per object, the study's and ours, labelled with the counts.

    Rows of the table that neither the study nor we tried are left out.

    Parameters
    ----------
    path : str or PathLike
        Image file; its extension, one of `graspbox.pictures.SUFFIXES`, names the format.
    comparison : Comparison
        The counts.

    Raises
    ------
    ConfigError
        If the path does not name an image file.
    FileError
        If the file cannot be written.
    """
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
