"""Pictures of evaluations: rates with their intervals, and how far stated probabilities are true."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.evaluation.results import wilson
from graspbox.pictures.files import Figure, PathLike, check_path, write

__all__ = ["save_rates", "save_reliability"]

_SUCCESS, _SECURE = "#0072b2", "#d55e00"
#: Fewest trials of a bin that is shown.
_FEWEST = 5


def save_rates(path: PathLike, title: str, rows: Mapping[str, tuple[int, int, int]]) -> None:
    """Draw success and secure holds, with 95 % intervals (Wilson).

    Parameters
    ----------
    path : str or PathLike
        The picture.
    title : str
        Over it.
    rows : mapping of str to (int, int, int)
        Trials, successes, secure ones; from top to bottom.

    Raises
    ------
    ConfigError, FileError
        If there are no rows, or `path` cannot be written.
    """
    target = check_path(path)
    if not rows:
        raise ConfigError("there is nothing to draw; give a row")
    figure = Figure(figsize=(7.0, 1.1 + 0.36 * len(rows)), layout="constrained", dpi=120)
    axes = figure.add_subplot()
    places = np.arange(len(rows))
    for offset, part, color, label in ((-0.19, 1, _SUCCESS, "success"), (0.19, 2, _SECURE, "secure")):
        rates = np.array([100.0 * row[part] / row[0] for row in rows.values()])
        bounds = 100.0 * np.array([wilson(row[part], row[0]) for row in rows.values()]).T
        errors = np.clip([rates - bounds[0], bounds[1] - rates], 0.0, None)
        axes.barh(places + offset, rates, 0.36, xerr=errors, color=color, ecolor="0.3", label=label)
        for place, rate in zip(places, rates, strict=True):
            axes.text(1.0, place + offset, f"{rate:.0f}", va="center", ha="left", color="white", fontsize=7)
    axes.set_yticks(places, list(rows))
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of trials, %")
    axes.set_title(title, fontsize=10)
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
    figure.legend(loc="outside lower right", ncols=2, frameon=False, fontsize=8)
    write(figure, target)


def save_reliability(
    path: PathLike, title: str, rows: Mapping[str, tuple[Sequence[float], Sequence[bool]]], bins: int = 10
) -> None:
    """Draw the true share of successes over the stated probability; bins of fewer than five trials are left out.

    Parameters
    ----------
    path : str or PathLike
        The picture.
    title : str
        Over it.
    rows : mapping of str to two sequences
        Stated probabilities, and whether the trials succeeded, by name.
    bins : int
        Bins of equal width.

    Raises
    ------
    ConfigError, FileError
        If there are no rows, or `path` cannot be written.
    """
    target = check_path(path)
    if not rows:
        raise ConfigError("there is nothing to draw; give a row")
    figure = Figure(figsize=(5.0, 5.0), layout="constrained", dpi=120)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot([0, 1], [0, 1], color="0.6", linewidth=1.0, linestyle="--", label="calibrated")
    for i, (name, (stated, held)) in enumerate(rows.items()):
        probabilities, true = np.asarray(stated, dtype=np.float64), np.asarray(held, dtype=np.bool_)
        color = f"C{i}"
        x, y, errors = _bins(probabilities, true, bins)
        above.errorbar(x, y, errors, marker="o", markersize=4, linewidth=1.2, capsize=2, color=color, label=name)
        below.hist(probabilities, bins=bins, range=(0.0, 1.0), histtype="step", color=color)
    above.set(ylabel="share that succeeded", xlim=(0, 1), ylim=(0, 1))
    above.set_title(title, fontsize=10)
    above.legend(fontsize=8, frameon=False)
    below.set(xlabel="stated probability of success", ylabel="trials")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    write(figure, target)


def _bins(
    probabilities: NDArray[np.float64], held: NDArray[np.bool_], bins: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Give mean stated probability, share of successes and its interval (2, b) of each bin with enough trials."""
    bin_of = np.minimum((probabilities * bins).astype(np.int64), bins - 1)
    found = [np.flatnonzero(bin_of == b) for b in range(bins)]
    found = [rows for rows in found if len(rows) >= _FEWEST]
    stated = np.array([probabilities[rows].mean() for rows in found])
    true = np.array([held[rows].mean() for rows in found])
    bounds = np.array([wilson(int(held[rows].sum()), len(rows)) for rows in found]).reshape(-1, 2).T
    return stated, true, np.clip(np.stack([true - bounds[0], bounds[1] - true]), 0.0, None)
