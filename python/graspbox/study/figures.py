"""Figures 3.19 to 3.27 of the study, reproduced; needs matplotlib (extra ``cli``).

`training_figure` is one of 3.19 to 3.26: loss, translation error and orientation error over iterations of one network
with one loss. `normalized_figure` is 3.27: the orientation errors of all losses, each as a share of its greatest value.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.runs import Rows
from graspbox.errors import ConfigError
from graspbox.pictures.files import Figure, check_path, write

__all__ = ["Curve", "normalized_figure", "read_curve", "training_figure"]

#: Columns of the logs in the figures: name in the log, title, factor, unit.
_PANELS = (
    ("loss", "training error", 1.0, "weighted sum per sample"),
    ("position_error", "translation error", 100.0, "cm"),
    ("rotation_error", "orientation error", 1.0, "unit of the loss"),
)
#: Window over which curves are averaged, as a share of the number of iterations.
_SMOOTH = 0.02
_TRAIN, _VALIDATION = "#0072b2", "#d55e00"


@dataclass(frozen=True, eq=False)
class Curve:
    """Logs of a training run: losses (n,) of iterations, metrics of validations, by name; ``step`` is the iteration."""

    train: Mapping[str, NDArray[np.float64]]
    validation: Mapping[str, NDArray[np.float64]]


def read_curve(folder: Path) -> Curve:
    """Read the log of a training's folder, which must have a validation."""
    rows = list(Rows(folder / "losses.jsonl"))
    tests = [row for row in rows if "loss" in row]
    if not tests:
        raise ConfigError(f"{str(folder)!r} has no row of a validation in losses.jsonl; train the network first")
    names = [name for name in tests[0] if name.startswith("train_")]
    train = {name.removeprefix("train_"): np.array([row[name] for row in rows]) for name in names}
    validation = {name: np.array([row[name] for row in tests]) for name in tests[0] if name not in names}
    return Curve({"step": np.array([row["step"] for row in rows]), **train}, validation)


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average over a window that is shorter at the ends."""
    half = max(1, round(_SMOOTH * len(values) / 2))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    low, high = np.maximum(at - half, 0), np.minimum(at + half + 1, len(values))
    return np.asarray((sums[high] - sums[low]) / (high - low))


def _style(axes: Any) -> None:
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def training_figure(path: Path, title: str, curves: Mapping[str, Curve]) -> None:
    """Plot training, translation and orientation error over iterations; each curve has its own column of panels.

    Raises
    ------
    ConfigError, FileError
        If the path does not name an image file, or cannot be written.
    """
    target = check_path(path)
    figure = Figure(figsize=(4.6 * len(curves) + 0.6, 7.2), dpi=110, layout="constrained")
    grid = figure.subplots(len(_PANELS), len(curves), squeeze=False, sharex="col")
    for column, (name, curve) in enumerate(curves.items()):
        for row, (key, label, factor, unit) in enumerate(_PANELS):
            axes = grid[row, column]
            at, values = curve.train["step"], factor * curve.train[key]
            axes.plot(at, values, color=_TRAIN, alpha=0.25, lw=0.7)
            axes.plot(at, _smooth(values), color=_TRAIN, label="training batches, smoothed")
            held = factor * curve.validation[key]
            axes.plot(curve.validation["step"], held, color=_VALIDATION, marker=".", label="validation")
            axes.set_ylabel(f"{label}\n({unit})", fontsize=8)
            axes.set_ylim(bottom=0.0)
            _style(axes)
        grid[0, column].set_title(name, fontsize=10)
        grid[-1, column].set_xlabel("iteration", fontsize=9)
    grid[0, -1].legend(fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=11)
    write(figure, target)


def normalized_figure(path: Path, panels: Mapping[str, Sequence[tuple[str, float, Curve]]]) -> None:
    """Plot the orientation errors of all losses in one figure, each divided by its greatest value.

    `panels` are the losses of each panel by its title: name, greatest value and curve. Raises as `training_figure`.
    """
    target = check_path(path)
    wide = min(2, len(panels))
    deep = -(-len(panels) // wide)
    figure = Figure(figsize=(5.2 * wide + 0.4, 3.4 * deep + 0.8), dpi=110, layout="constrained")
    grid = figure.subplots(deep, wide, squeeze=False, sharey=True)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, (title, losses) in zip(grid.flat, panels.items(), strict=False):
        for name, greatest, curve in losses:
            values = _smooth(curve.train["rotation_error"] / greatest)
            (line,) = axes.plot(curve.train["step"], values, label=name)
            held = curve.validation["rotation_error"] / greatest
            axes.plot(curve.validation["step"], held, ls="", marker=".", color=line.get_color())
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("iteration", fontsize=9)
        axes.set_ylim(0.0, 1.0)
        _style(axes)
        axes.legend(fontsize=8, frameon=False, ncols=2)
    for axes in grid[:, 0]:
        axes.set_ylabel("orientation error / greatest value", fontsize=9)
    figure.suptitle("orientation errors of all losses: lines are training batches, dots the validation", fontsize=11)
    write(figure, target)
