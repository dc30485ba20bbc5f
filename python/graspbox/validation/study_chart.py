"""A bar chart of the study's table 3.1 beside ours; needs matplotlib (extra ``cli``)."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from graspbox.pictures.view import write
from graspbox.validation.study import CUP_GUESS, TABLE_3_1, Comparison


def save_comparison(path: Path, comparison: Comparison) -> None:
    """Write a bar chart: the share of poses that succeed per object, the study's and ours, labelled with the counts.

    Parameters
    ----------
    path : Path
        Image file; its suffix names the format.
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
