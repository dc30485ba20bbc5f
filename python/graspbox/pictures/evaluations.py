"""Pictures of rates: with confidence intervals, reliability diagrams, and what an arm reaches around its base."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.colors import COLORS
from graspbox.arms import BasePlace, ReachMap
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


def save_reach_map(
    path: PathLike,
    reach_map: ReachMap,
    *,
    place: BasePlace | None = None,
    workspace: tuple[float, float, float, float] | None = None,
) -> None:
    """Plot which share of typical grasps an arm reaches around its base: of all, from above and from the side.

    Parameters
    ----------
    place : BasePlace, optional
        Where the base stands relative to the `workspace`, which is outlined then.
    workspace : (float, float, float, float), optional
        Its lower and its upper corner, x and y, metres.

    Raises
    ------
    ConfigError, FileError
        As `check_path`; also if one of place and workspace is missing.
    """
    target = check_path(path)
    if (place is None) != (workspace is None):
        raise ConfigError("place and workspace belong together; pass both or none")
    panels = {"all grasps": reach_map.share, "from above": reach_map.above, "from the side": reach_map.side}
    shown = {name: rows for name, rows in panels.items() if not np.isnan(rows).any()}
    figure = Figure(figsize=(0.9 + 3.3 * len(shown), 3.6), layout="constrained", dpi=120)
    half = 0.5 * (reach_map.x[1] - reach_map.x[0])
    # The robot's x axis points up, its y axis to the left, as one who stands behind it sees the table.
    extent = (reach_map.y[-1] + half, reach_map.y[0] - half, reach_map.x[0] - half, reach_map.x[-1] + half)
    for axes, (name, rows) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True):
        seen = 100.0 * rows.T[::-1, ::-1]
        axes.imshow(seen, extent=extent, cmap="viridis", vmin=0.0, vmax=100.0, interpolation="nearest")
        axes.plot([0.0], [0.0], marker="^", color="white", markeredgecolor="black", markersize=9)
        if place is not None and workspace is not None:
            x, y = _in_frame_of(place, workspace)
            axes.plot(y, x, color="#d55e00", linewidth=1.8)
        axes.set_title(name, fontsize=9)
        axes.set_xlabel("y / m", fontsize=8)
        axes.tick_params(labelsize=7)
    figure.axes[0].set_ylabel("x / m (front)", fontsize=8)
    bar = figure.colorbar(figure.axes[0].images[0], ax=figure.axes, shrink=0.85)
    bar.set_label("share of grasps reached, %", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    figure.suptitle(f"{reach_map.arm} with {reach_map.hand}, base {reach_map.height:g} m over the table", fontsize=10)
    write(figure, target)


def _in_frame_of(
    place: BasePlace, workspace: tuple[float, float, float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the outline of a workspace, x and y (5,), in the frame of the base."""
    left, low, right, high = workspace
    corners = np.array([[left, low], [right, low], [right, high], [left, high], [left, low]])
    local = (corners - place.pose[:2, 3]) @ place.pose[:2, :2]
    return local[:, 0], local[:, 1]
