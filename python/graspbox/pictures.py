"""Pictures (extra ``cli``): boxes and hand poses on an object.

Every function draws on matplotlib axes that it is given, in the object's frame and in metres; ``save_*`` make a
figure and write it.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from graspbox.meshes import Mesh
from graspbox.planning import Box, Plan
from graspbox.simulation import Hand, Outcomes, load_hand

#: Most faces that are drawn (a scanned YCB mesh has 16,384); of a larger mesh an even choice, which lets light through.
_MAX_FACES = 20_000
#: Direction that the light comes from, object frame.
_LIGHT = np.array([0.4, -0.5, 0.77])
_EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))
_SIDES = (
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
)
_OBJECT, _HAND = "#b8bcc4", "#6f8fb8"
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#000000")
_SUCCESS, _FAILURE, _UNTRIED = "#009e73", "#d55e00", "#555555"


def mesh_triangles(mesh: Mesh) -> NDArray[np.float64]:
    """Take the surface as triangles (n, 3, 3); of a large mesh, an even choice of them."""
    faces = mesh.faces
    triangles: NDArray[np.float64] = mesh.vertices[faces[:: max(1, -(-len(faces) // _MAX_FACES))]]
    return triangles


def box_triangles(box: Box) -> NDArray[np.float64]:
    """Take the sides of a box as triangles (12, 3, 3)."""
    triangles: NDArray[np.float64] = box.corners()[np.array(_SIDES)]
    return triangles


def hand_triangles(hand: Hand, object_from_hand: NDArray[np.float64], preshape: float) -> NDArray[np.float64]:
    """Take the open hand's collision shapes, as boxes, as triangles (n, 3, 3)."""
    zeros = np.zeros(hand.fingers)
    poses, halves, _ = hand.shapes(preshape, zeros, zeros)
    boxes = (Box(p[:3, 3], p[:3, :3], half) for p, half in zip(object_from_hand @ poses, halves, strict=True))
    return np.concatenate([box_triangles(box) for box in boxes])


def draw_solids(axes: Any, solids: list[tuple[NDArray[np.float64], str]], *, alpha: float = 1.0) -> None:
    """Draw shaded triangles, each solid in its colour; drawn together, so that they hide each other as they should."""
    triangles = np.concatenate([t for t, _ in solids])
    base = np.concatenate([np.tile(to_rgb(color), (len(t), 1)) for t, color in solids])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.abs(normals / np.maximum(lengths, 1e-30) @ _LIGHT)
    colors = np.clip(base * (0.35 + 0.65 * light[:, None]), 0, 1)
    axes.add_collection3d(Poly3DCollection(triangles, facecolors=colors, edgecolors="none", alpha=alpha))


def draw_box(axes: Any, box: Box, *, color: str = "black", width: float = 1.0) -> None:
    """Draw the edges of a box."""
    corners = box.corners()
    axes.add_collection3d(Line3DCollection([corners[list(edge)] for edge in _EDGES], colors=color, linewidths=width))


def draw_poses(axes: Any, poses: NDArray[np.float64], colors: list[str], *, length: float = 0.05) -> None:
    """Draw each pose as an arrow along the hand's approach that ends at the palm."""
    if not len(poses):
        return
    tips, ways = poses[:, :3, 3], poses[:, :3, 2] * length
    lines = np.stack([tips - ways, tips], axis=1)
    axes.add_collection3d(Line3DCollection(lines, colors=colors, linewidths=1.4))
    axes.scatter(*tips.T, c=colors, s=8, depthshade=False)


def fit_view(axes: Any, points: NDArray[np.float64]) -> None:
    """Show all points (n, 3) with equal scales and without clutter."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, reach = (low + high) / 2, float((high - low).max()) / 2 * 1.05
    for set_limits, center in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        set_limits(center - reach, center + reach)
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()


def save_plan(
    path: Path,
    mesh: Mesh,
    plan: Plan,
    outcomes: Outcomes | None = None,
    *,
    hand: str | Hand = "reflex",
    count: int = 20,
) -> None:
    """Write a picture: the boxes on the object, and its best poses with the open hand at the first.

    Parameters
    ----------
    path : Path
        The picture's file; its ending names the format.
    mesh, plan : Mesh, Plan
        The object, and what was planned for it.
    outcomes : Outcomes, optional
        What came of the plan's poses; colours them green and red.
    hand : str or Hand
        The hand to draw.
    count : int
        Most poses to draw.
    """
    best = plan.best(count)
    figure = Figure(figsize=(9, 4.5), dpi=150)
    left, right = (figure.add_subplot(1, 2, i, projection="3d") for i in (1, 2))
    surface = mesh_triangles(mesh)
    draw_solids(left, [(surface, _OBJECT)], alpha=0.6)
    for index, box in enumerate(plan.tree):
        draw_box(left, box, color=_COLORS[index % len(_COLORS)], width=1.5)
    corners = np.concatenate([box.corners() for box in plan.tree])
    fit_view(left, corners)
    left.set_title(f"{mesh.name}: {len(plan.tree)} boxes", fontsize=9)
    solids, shown = [(surface, _OBJECT)], [corners]
    if len(best):
        solids.append((hand_triangles(load_hand(hand), best.poses[0], float(best.preshape[0])), _HAND))
        shown += [solids[-1][0].reshape(-1, 3), best.poses[:, :3, 3] - 0.05 * best.poses[:, :3, 2]]
    draw_solids(right, solids, alpha=0.85)
    colors = [_UNTRIED] * len(best)
    if outcomes is not None:
        colors = [_SUCCESS if ok else _FAILURE for ok in outcomes.success[: len(best)]]
    draw_poses(right, best.poses, colors)
    fit_view(right, np.concatenate(shown))
    told = "" if outcomes is None else f", {int(outcomes.success[: len(best)].sum())} succeed"
    right.set_title(f"the best {len(best)} poses{told}; the open hand at the first", fontsize=9)
    figure.subplots_adjust(left=0, right=1, bottom=0, top=0.94, wspace=0)
    figure.savefig(path)
