"""Planning a grasp in three panels: the object's boxes, the best-ranked grasp poses, and one simulated grasp."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from graspbox._common.colors import FAILURE, NOT_SIMULATED, OBJECT, OBJECTS, SUCCESS
from graspbox.errors import ConfigError
from graspbox.meshes import Mesh, Surroundings
from graspbox.meshes.shapes import Floats
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hands import PosedHand, glyphs
from graspbox.pictures.solids import Solid, box_edges, colored_boxes, place_box, solids_of
from graspbox.pictures.sweeps import count_boxes
from graspbox.pictures.trials import ABOVE, Trial
from graspbox.pictures.view import Camera, View
from graspbox.planning import Plan
from graspbox.simulation import Hand, Outcomes, Scene, load_hand
from graspbox.simulation.neighbours import Neighbours

#: Greatest number of objects in a gallery.
_MOST = 8


@dataclass(frozen=True, eq=False)
class GraspExample:
    """An object, its plan and its outcomes; for the fields see `save_plan`."""

    mesh: Mesh
    plan: Plan
    outcomes: Outcomes | None = None
    trial: Trial | None = None
    neighbours: Surroundings | None = None

    @classmethod
    def run(cls, scene: Scene, plan: Plan) -> "GraspExample":
        """Simulate every pose of a plan; the example shows the best-ranked success, else the first pose."""
        return cls.of(scene, plan, scene.simulate(plan.poses, plan.preshape))

    @classmethod
    def of(cls, scene: Scene, plan: Plan, outcomes: Outcomes) -> "GraspExample":
        """Use known outcomes of a plan; the example shows the best-ranked success, else the first pose."""
        trial = Trial.run(scene, plan, int(np.argmax(outcomes.success))) if len(outcomes) else None
        return cls(scene.mesh, plan, outcomes, trial, Neighbours.of(scene))

    def around(self, poses: Floats | None = None) -> list[Solid]:
        """Return the neighbours at rest, or at `poses` (k, 4, 4), and the walls."""
        if (around := self.neighbours) is None:
            return []
        rest = around.world_from_objects if poses is None else poses
        return solids_of(Neighbours(around.meshes, rest, around.world_from_walls, around.wall_half_extents))

    def captions(self, count: int) -> tuple[str, str, str]:
        """Return the captions of the panels: boxes, the best `count` poses, the grasp."""
        tree, best = self.plan.tree, self.plan.best(count)
        boxes = f"{count_boxes(len(tree))}, {tree.volume * 1e6:.0f} cm³"
        return boxes, self._poses_caption(len(best)), self._grasp_caption(len(best))

    def _poses_caption(self, shown: int) -> str:
        noun = "the best pose" if shown == 1 else f"the best {shown} poses"
        if self.outcomes is None:
            return f"{noun}, not simulated"
        succeeded = int(self.outcomes.success[:shown].sum())
        if shown == 1:
            return f"{noun} {'succeeds' if succeeded else 'fails'}"
        return f"{succeeded} of {noun} succeed"

    def _grasp_caption(self, shown: int) -> str:
        if self.trial is not None:
            index, failure = self.trial.index, self.trial.outcome.failure[0]
            return f"pose {index + 1}{' (bold)' if index < shown else ''} simulated: {failure or 'held'}"
        if not shown:
            return "no feasible pose"
        if self.outcomes is None:
            return "open hand at pose 1, not simulated"
        return f"open hand at pose 1: {self.outcomes.failure[0] or 'succeeds'}"


def save_plan(
    path: PathLike,
    mesh: Mesh,
    plan: Plan,
    outcomes: Outcomes | None = None,
    *,
    trial: Trial | None = None,
    hand: str | Hand = "reflex",
    count: int = 20,
    camera: Camera | None = None,
    neighbours: Surroundings | None = None,
) -> None:
    """Save three panels: the boxes of an object at rest, its best poses, and a grasp; errors also as `check_path`.

    Parameters
    ----------
    outcomes : Outcomes, optional
        Outcomes of the plan's best poses, in order, for the colours of the poses.
    trial : Trial, optional
        A trial of this plan, of which the last sample is shown; by default the open hand is shown at the first pose.
    count : int
        Greatest number of poses to show.
    camera : Camera, optional
        Viewing direction; by default one in which the first hand is next to the object, not in front of it.
    neighbours : Surroundings, optional
        Other objects and walls, as for `graspbox.plan`, drawn grey; of a trial, those of its scene, in the order of its
        others, where the trial left them.

    Raises
    ------
    ConfigError
        If there are fewer outcomes than poses to show, or a trial has another number of neighbours.
    """
    target = check_path(path)
    figure = Figure(figsize=(11, 4.1), dpi=130)
    panels = figure.subplots(1, 3)
    figure.subplots_adjust(left=0.005, right=0.995, bottom=0.065, top=0.84, wspace=0.03)
    _column(panels, GraspExample(mesh, plan, outcomes, trial, neighbours), OBJECT, load_hand(hand), count, camera)
    figure.suptitle(mesh.name, fontsize=12, weight="bold")
    _legend(figure, simulated=outcomes is not None)
    write(figure, target, palette=False)


def save_gallery(
    path: PathLike, examples: Sequence[GraspExample], *, hand: str | Hand = "reflex", count: int = 20
) -> None:
    """Save one column of panels per object, for 1 to 8 objects, as `save_plan` shows each; errors as there."""
    target = check_path(path)
    if not 1 <= len(examples) <= _MOST:
        raise ConfigError(f"{len(examples)} examples; pass 1 to {_MOST}")
    loaded = load_hand(hand)
    figure = Figure(figsize=(2.75 * len(examples), 8.8), dpi=115)
    panels = figure.subplots(3, len(examples), squeeze=False, gridspec_kw={"height_ratios": (1.0, 1.0, 1.25)})
    figure.subplots_adjust(left=0.004, right=0.996, bottom=0.035, top=0.925, wspace=0.03, hspace=0.1)
    for index, example in enumerate(examples):
        _column(panels[:, index], example, OBJECTS[index % len(OBJECTS)], loaded, count, None)
        panels[0, index].annotate(
            example.mesh.name, (0.5, 1.15), xycoords="axes fraction", ha="center", fontsize=11, weight="bold"
        )
    _legend(figure, simulated=any(example.outcomes is not None for example in examples))
    write(figure, target, palette=False)


def _column(panels: Any, example: GraspExample, color: str, hand: Hand, count: int, camera: Camera | None) -> None:
    """Fill three panels with an example, all from one viewing direction."""
    best, outcomes = example.plan.best(count), example.outcomes
    if outcomes is not None and len(outcomes) < len(best):
        raise ConfigError(
            f"{len(outcomes)} outcomes for {len(best)} poses; simulate all that are shown, or lower count"
        )
    world_from_object = example.plan.world_from_object
    poses = world_from_object @ best.poses
    posed, at_end, around_at_end = _grasp(example, poses, best.preshape, hand)
    around = example.around()
    if camera is None:
        elevation = {"elevation": ABOVE} if around else {}
        camera = Camera() if posed is None else Camera.across(posed.world_from_hand[:3, 2], **elevation)
    surface, size = Solid(example.mesh, color, world_from_object), pixels(panels[0])
    boxes = [place_box(box, world_from_object) for box in example.plan.tree]
    lines = glyphs(hand, poses, best.preshape)
    corners = [*(box.corners() for box in boxes), lines.reshape(-1, 3), *(solid.points for solid in around)]
    view = View([surface, *around], camera, shown=np.concatenate(corners), size=size, table=True)
    for axes in panels[:2]:
        view.show(axes)
    for box, ink in colored_boxes(boxes):
        view.lines(panels[0], box_edges(box), ink, width=1.5, hidden=0.3)
    inks, simulated = _inks(len(best), outcomes), None if example.trial is None else example.trial.index
    # Far poses first, so that nearer ones cover them; the simulated pose last.
    order = np.argsort(-view.lens.project(poses[:, :3, 3])[:, 2], kind="stable")
    for index in sorted(order, key=lambda i: i == simulated):
        width, hidden = (2.6, 0.5) if index == simulated else (1.3, 0.2)
        view.lines(panels[1], lines[index], inks[index], width=width, hidden=hidden, halo=0.8)
    solids = [Solid(example.mesh, color, at_end), *around_at_end]
    View(solids, camera, size=pixels(panels[2]), hand=posed, table=True).show(panels[2])
    for axes, caption in zip(panels, example.captions(count), strict=True):
        axes.set_title(caption, fontsize=9.5, pad=3)


def _grasp(
    example: GraspExample, poses: Floats, preshape: Floats, hand: Hand
) -> tuple[PosedHand | None, Floats, list[Solid]]:
    """Return hand, object's pose and neighbours at the trial's last sample, else of the open hand at the first pose."""
    trial = example.trial
    if trial is not None and len(trial.trace.time):
        others = trial.trace.world_from_others[-1]
        known = 0 if example.neighbours is None else len(example.neighbours.meshes)
        if example.neighbours is not None and known != len(others):
            raise ConfigError(f"{known} neighbours of a trial with {len(others)}; pass those of its scene")
        return trial.posed(hand, -1), trial.trace.world_from_object[-1], example.around(others)
    posed = PosedHand.open(hand, poses[0], float(preshape[0])) if len(poses) else None
    return posed, example.plan.world_from_object, example.around()


def _inks(count: int, outcomes: Outcomes | None) -> list[str]:
    """Choose the colour of each pose by its outcome."""
    if outcomes is None:
        return [NOT_SIMULATED] * count
    return [SUCCESS if success else FAILURE for success in outcomes.success[:count]]


def _legend(figure: Figure, *, simulated: bool) -> None:
    height = 0.1 / figure.get_figheight()
    if not simulated:
        figure.text(0.5, height, "grasp poses, not simulated", color=NOT_SIMULATED, fontsize=10, ha="center")
        return
    figure.text(0.49, height, "grasp pose succeeds", color=SUCCESS, fontsize=10, ha="right")
    figure.text(0.51, height, "grasp pose fails", color=FAILURE, fontsize=10, ha="left")
