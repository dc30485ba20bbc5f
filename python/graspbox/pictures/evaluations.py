"""Pictures of evaluations: rates with confidence intervals, and reliability diagrams."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from graspbox._common.colors import COLORS
from graspbox.errors import ConfigError
from graspbox.evaluation.results import reliability, wilson
from graspbox.pictures.files import Figure, PathLike, check_path, write

_SUCCESS, _SECURE = COLORS[:2]


def save_rates(path: PathLike, title: str, panels: Mapping[str, Mapping[str, tuple[int, int, int]]]) -> None:
    """Plot rates of success and secure holds, with 95 % intervals (Wilson).

    Parameters
    ----------
    panels : mapping of str to mapping of str to (int, int, int)
        Panels from left to right by title; each maps the names of its rows, from top to bottom, to the numbers of
        trials, successes and secure holds. Panels share rows; a row missing in a panel is left empty there.

    Raises
    ------
    ConfigError, FileError
        As `check_path`; also if there are no rows.
    """
    target = check_path(path)
    names = list(dict.fromkeys(name for rows in panels.values() for name in rows))
    if not names:
        raise ConfigError("there are no rows to plot; pass at least one")
    size = (2.4 + 3.6 * len(panels), 1.1 + 0.36 * len(names))
    figure = Figure(figsize=size, layout="constrained", dpi=120)
    for axes, (panel, rows) in zip(
        figure.subplots(1, len(panels), sharey=True, squeeze=False)[0], panels.items(), strict=True
    ):
        _bars(axes, [names.index(name) for name in rows], list(rows.values()))
        axes.set_title(panel, fontsize=9)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
    figure.suptitle(title, fontsize=10)
    handles, parts = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, parts, loc="outside lower right", ncols=2, frameon=False, fontsize=8)
    write(figure, target)


def _bars(axes: Any, places: Sequence[int], rows: Sequence[tuple[int, int, int]]) -> None:
    """Plot two bars per row: success and secure holds."""
    for offset, part, color, label in ((-0.19, 1, _SUCCESS, "success"), (0.19, 2, _SECURE, "secure")):
        rates = np.array([100.0 * row[part] / row[0] for row in rows])
        bounds = 100.0 * np.array([wilson(row[part], row[0]) for row in rows]).reshape(-1, 2).T
        errors = np.clip([rates - bounds[0], bounds[1] - rates], 0.0, None)
        axes.barh(np.array(places) + offset, rates, 0.36, xerr=errors, color=color, ecolor="0.3", label=label)
        for place, rate in zip(places, rates, strict=True):
            axes.text(1.0, place + offset, f"{rate:.0f}", va="center", ha="left", color="white", fontsize=7)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of trials, %")
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)


def save_reliability(
    path: PathLike, title: str, rows: Mapping[str, tuple[Sequence[float], Sequence[bool]]], bins: int = 10
) -> None:
    """Plot a reliability diagram: observed success rate over predicted probability, without bins under five trials.

    Parameters
    ----------
    rows : mapping of str to two sequences
        Predicted probabilities, and whether the trials succeeded, by name.
    bins : int
        Bins of equal width.

    Raises
    ------
    ConfigError, FileError
        As `save_rates`.
    """
    target = check_path(path)
    if not rows:
        raise ConfigError("there are no rows to plot; pass at least one")
    figure = Figure(figsize=(5.0, 5.0), layout="constrained", dpi=120)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot([0, 1], [0, 1], color="0.6", linewidth=1.0, linestyle="--", label="calibrated")
    for i, (name, (stated, held)) in enumerate(rows.items()):
        probabilities, true = np.asarray(stated, dtype=np.float64), np.asarray(held, dtype=np.bool_)
        color = f"C{i}"
        rates = reliability(probabilities, true, bins)
        x, y = [b.stated for b in rates], [b.rate for b in rates]
        errors = np.array([(b.rate - b.low, b.high - b.rate) for b in rates]).reshape(-1, 2).T.clip(0.0)
        above.errorbar(x, y, errors, marker="o", markersize=4, linewidth=1.2, capsize=2, color=color, label=name)
        below.hist(probabilities, bins=bins, range=(0.0, 1.0), histtype="step", color=color)
    above.set(ylabel="share that succeeded", xlim=(0, 1), ylim=(0, 1))
    above.set_title(title, fontsize=10)
    above.legend(fontsize=8, frameon=False)
    below.set(xlabel="stated probability of success", ylabel="trials")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    write(figure, target)
