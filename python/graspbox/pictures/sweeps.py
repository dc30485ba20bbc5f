"""Dependence of the box decomposition on the planner's thresholds."""

from collections.abc import Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from graspbox._common.colors import OBJECT
from graspbox.errors import ConfigError
from graspbox.meshes import Mesh
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.solids import Solid, box_edges, colored_boxes
from graspbox.pictures.view import Camera, View
from graspbox.planning import BoxTree, decompose

#: Values of ``area_gain`` by fit; the three give different boxes for household objects.
AREA_GAINS: Mapping[str, Sequence[float]] = MappingProxyType({"minimum": (0.9, 0.97, 0.99), "pca": (0.85, 0.93, 0.97)})
#: Values of ``min_volume``, m3. The reference study (figures 2.3 and 2.4) goes up to 0.125 m3, but with larger values
#: than these an object of a hand's size remains one box.
MIN_VOLUMES = (1.25e-4, 4e-5, 1.25e-5, 4e-6)
#: Greatest number of panels.
_MOST_PANELS = 100


def save_sweep(
    path: PathLike,
    mesh: Mesh,
    *,
    fit: Literal["minimum", "pca"] = "minimum",
    area_gains: Sequence[float] | None = None,
    min_volumes: Sequence[float] = MIN_VOLUMES,
    max_boxes: int = 64,
    camera: Camera = Camera(),  # noqa: B008 (frozen)
) -> dict[tuple[float, float], tuple[int, float]]:
    """Save the boxes for each pair of thresholds, as in the reference study's figures 2.3 and 2.4.

    Parameters
    ----------
    fit : {"minimum", "pca"}
        See `graspbox.DecomposeConfig`.
    area_gains : sequence of float, optional
        One per row; by default those of `AREA_GAINS` for the fit.
    min_volumes : sequence of float
        One per column, m3.
    max_boxes : int
        Greatest number of boxes; panels that reach it are marked.

    Returns
    -------
    dict
        Number of boxes and the sum of their volumes, m3, for each (area gain, least volume).

    Raises
    ------
    ConfigError, FileError
        As `check_path`; also for a threshold out of range, or more than 100 pairs.
    """
    target = check_path(path)
    rows = AREA_GAINS[fit] if area_gains is None else area_gains
    pairs = list(product(rows, min_volumes))
    if not 1 <= len(pairs) <= _MOST_PANELS:
        raise ConfigError(f"{len(rows)} area_gains and {len(min_volumes)} min_volumes; pass 1 to {_MOST_PANELS} pairs")
    trees = [decompose(mesh, fit=fit, area_gain=gain, min_volume=least, max_boxes=max_boxes) for gain, least in pairs]
    shape = (len(rows), len(min_volumes))
    figure = Figure(figsize=(2.3 * shape[1] + 0.4, 2.6 * shape[0] + 0.75), dpi=115)
    panels = figure.subplots(*shape, squeeze=False)
    height = figure.get_figheight()
    figure.subplots_adjust(
        left=0.3 / figure.get_figwidth(), right=0.995, bottom=0.005, top=1 - 0.92 / height, wspace=0.04, hspace=0.12
    )
    # All panels share one view, so that every box fits and sizes are comparable.
    corners = np.concatenate([box.corners() for tree in trees for box in tree])
    view = View([Solid(mesh, OBJECT)], camera, shown=corners, size=pixels(panels[0, 0]))
    for axes, tree in zip(panels.flat, trees, strict=True):
        _panel(axes, view, tree, max_boxes)
    _heads(panels, rows, min_volumes)
    figure.suptitle(
        f"{mesh.name}, fit={fit!r}: number of boxes and the sum of their volumes", fontsize=11, y=1 - 0.1 / height
    )
    write(figure, target)
    return {pair: (len(tree), tree.volume) for pair, tree in zip(pairs, trees, strict=True)}


def _panel(axes: Any, view: View, tree: BoxTree, max_boxes: int) -> None:
    view.show(axes)
    width = 1.2 if len(tree) < 20 else 0.7
    for box, color in colored_boxes(tree):
        view.lines(axes, box_edges(box), color, width=width, hidden=0.15)
    capped = " (the maximum)" if len(tree) == max_boxes else ""
    axes.set_title(f"{count_boxes(len(tree))}{capped}, {tree.volume * 1e6:.0f} cm³", fontsize=8.5, pad=2)


def count_boxes(count: int) -> str:
    """Format a number of boxes: "1 box", "2 boxes"."""
    return f"{count} box" if count == 1 else f"{count} boxes"


def _heads(panels: Any, area_gains: Sequence[float], min_volumes: Sequence[float]) -> None:
    """Label columns and rows with their thresholds, volumes in cm3."""
    style: dict[str, Any] = {"xycoords": "axes fraction", "ha": "center", "fontsize": 9, "weight": "bold"}
    for axes, volume in zip(panels[0], min_volumes, strict=True):
        axes.annotate(f"min_volume {volume * 1e6:g} cm³", (0.5, 1.1), **style)
    for axes, gain in zip(panels[:, 0], area_gains, strict=True):
        axes.annotate(f"area_gain {gain:g}", (-0.06, 0.5), va="center", rotation=90, **style)
