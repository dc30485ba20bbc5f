"""Boxes on an object, hand poses around it, and how the boxes depend on the planner's thresholds."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from graspbox.meshes import Mesh
from graspbox.pictures.solids import COLORS, FAILURE, OBJECT, SUCCESS, UNTRIED, box_edges, place
from graspbox.pictures.view import Camera, Floats, PosedHand, Solid, View, pixels, write
from graspbox.planning import Box, Plan, decompose
from graspbox.simulation import Hand, Outcomes, load_hand

#: The reference study's thresholds (figures 2.3 and 2.4): share of the face's area, and least volume of a child, m3.
AREA_GAINS = (0.8, 0.9, 0.95, 0.98)
MIN_VOLUMES = (1.25e-1, 1.25e-2, 1.25e-3, 1.25e-4, 1.25e-5, 1.25e-6)
#: Length of the arrow that stands for a pose, metres.
_ARROW = 0.045
#: The hand stands where the arrows are: they shine through it.
_HAND_OPACITY = 0.6


def moved(box: Box, pose: Floats) -> Box:
    """Move a box by a pose (4, 4)."""
    return Box(place(box.center, pose), pose[:3, :3] @ box.axes, box.half_extents)


def arrows(poses: Floats) -> Floats:
    """Take each pose (n, 4, 4) as an arrow along the hand's approach that ends at the palm: segments (3 n, 2, 3)."""
    tips, way, side = poses[:, :3, 3], poses[:, :3, 2], poses[:, :3, 1]
    barbs = [tips - 0.2 * _ARROW * way + s * 0.1 * _ARROW * side for s in (-1, 1)]
    return np.concatenate([np.stack([start, tips], axis=1) for start in (tips - _ARROW * way, *barbs)])


def save_plan(
    path: Path,
    mesh: Mesh,
    plan: Plan,
    outcomes: Outcomes | None = None,
    *,
    hand: str | Hand = "reflex",
    count: int = 20,
    camera: Camera | None = None,
) -> None:
    """Write a picture: the boxes on the object as it rests, and its best poses with the open hand at the first.

    Parameters
    ----------
    path : Path
        The picture's file; its ending names the format.
    mesh, plan : Mesh, Plan
        The object, and what was planned for it.
    outcomes : Outcomes, optional
        What came of the plan's best poses, in their order; colours them.
    hand : str or Hand
        The hand to draw.
    count : int
        Most poses to draw.
    camera : Camera, optional
        From where to look; by default so that the first hand stands beside the object, not before it.
    """
    best = plan.best(count)
    world_from_object = plan.world_from_object
    poses = world_from_object @ best.poses
    if camera is None:
        camera = Camera.across(poses[0, :3, 2]) if len(best) else Camera()
    surface = Solid(mesh, OBJECT, world_from_object)
    boxes = [moved(box, world_from_object) for box in plan.tree]
    corners = np.concatenate([box.corners() for box in boxes])
    figure = Figure(figsize=(9, 4.5), dpi=140)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.07, top=0.91, wspace=0.03)
    view = View([surface], camera, shown=corners, size=pixels(left), ground=True)
    view.show(left)
    for index, box in enumerate(boxes):
        view.lines(left, box_edges(box), COLORS[index % len(COLORS)], width=1.6, hidden=0.35)
    left.set_title(f"{mesh.name}: {len(boxes)} boxes, {plan.tree.volume * 1e6:.0f} cm³", fontsize=10)

    lines = arrows(poses)
    shown, first = [corners, lines.reshape(-1, 3)], None
    if len(best):
        first = PosedHand(load_hand(hand), poses[0], float(best.preshape[0]))
        shown.append(first.corners())
    view = View(
        [surface],
        camera,
        shown=np.concatenate(shown),
        size=pixels(right),
        hand=first,
        opacity=_HAND_OPACITY,
        ground=True,
    )
    view.show(right)
    told = f"the best {len(best)} poses; the open hand at the first"
    if outcomes is None:
        view.lines(right, lines, UNTRIED, width=1.3, hidden=0.7)
    else:
        ok = np.tile(outcomes.success[: len(best)], 3)
        view.lines(right, lines[~ok], FAILURE, width=1.3, hidden=0.7)
        view.lines(right, lines[ok], SUCCESS, width=1.3, hidden=0.7)
        _tell_colors(figure)
        told = f"{int(ok.sum()) // 3} of the best {len(best)} poses succeed; the open hand at the first"
    right.set_title(told, fontsize=10)
    write(figure, path, palette=False)


def _tell_colors(figure: Figure) -> None:
    figure.text(0.72, 0.025, "pose succeeds", color=SUCCESS, fontsize=9, ha="right")
    figure.text(0.77, 0.025, "pose fails", color=FAILURE, fontsize=9, ha="left")


def save_sweep(
    path: Path,
    mesh: Mesh,
    *,
    fit: Literal["minimum", "pca"] = "minimum",
    area_gains: Sequence[float] = AREA_GAINS,
    min_volumes: Sequence[float] = MIN_VOLUMES,
    max_boxes: int = 64,
    camera: Camera = Camera(),  # noqa: B008 (frozen)
) -> dict[tuple[float, float], tuple[int, float]]:
    """Write the study's sweep: the boxes for each pair of thresholds, as in its figures 2.3 and 2.4.

    Parameters
    ----------
    path : Path
        The picture's file.
    mesh : Mesh
        The object.
    fit : {"minimum", "pca"}
        How boxes are fitted.
    area_gains : sequence of float
        One row each.
    min_volumes : sequence of float
        One column each, m3.
    max_boxes : int
        Cap on the number of boxes; a panel that reaches it says so.
    camera : Camera
        From where to look, object frame.

    Returns
    -------
    dict
        For each (area gain, least volume): number of boxes, and their volume together in m3.
    """
    shape = (len(area_gains), len(min_volumes))
    figure = Figure(figsize=(1.75 * shape[1] + 0.4, 2.0 * shape[0] + 0.6), dpi=120)
    panels = figure.subplots(*shape, squeeze=False)
    figure.subplots_adjust(left=0.04, right=0.995, bottom=0.005, top=0.88, wspace=0.04, hspace=0.22)
    pairs = list(product(area_gains, min_volumes))
    trees = [decompose(mesh, fit=fit, area_gain=gain, min_volume=least, max_boxes=max_boxes) for gain, least in pairs]
    # One view for all panels, in which every box has its place.
    corners = np.concatenate([box.corners() for tree in trees for box in tree])
    view = View([Solid(mesh, OBJECT)], camera, shown=corners, size=pixels(panels[0, 0]))
    for (row, column), tree in zip(np.ndindex(shape), trees, strict=True):
        axes: Any = panels[row, column]
        view.show(axes)
        width = 1.1 if len(tree) < 20 else 0.6
        for index, box in enumerate(tree):
            view.lines(axes, box_edges(box), COLORS[index % len(COLORS)], width=width, hidden=0.15)
        capped = " (cap)" if len(tree) == max_boxes else ""
        count = "1 box" if len(tree) == 1 else f"{len(tree)} boxes{capped}"
        axes.set_title(f"{count}, {tree.volume * 1e6:.0f} cm³", fontsize=7.5, pad=2)
        if row == 0:
            axes.annotate(
                f"min_volume\n{min_volumes[column]:g} m³",
                (0.5, 1.16),
                xycoords="axes fraction",
                ha="center",
                fontsize=8,
                weight="bold",
            )
        if column == 0:
            at = (-0.09, 0.5)
            text = f"area_gain {area_gains[row]:g}"
            axes.annotate(
                text, at, xycoords="axes fraction", va="center", ha="center", rotation=90, fontsize=8, weight="bold"
            )
    figure.suptitle(f"{mesh.name}, fit={fit!r}: boxes and their volume together", fontsize=10, y=0.99)
    write(figure, path)
    return {pair: (len(tree), tree.volume) for pair, tree in zip(pairs, trees, strict=True)}
