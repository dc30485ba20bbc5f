"""An object, alone or among others, with its boxes, planned poses coloured by outcome, and the trace of any trial."""

from dataclasses import dataclass
from typing import ClassVar, get_args

import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.meshes import Mesh
from graspbox.models.scenes import PlacedObjects
from graspbox.outcomes import FailureKind, Outcomes
from graspbox.planning import Box, Plan, plan
from graspbox.simulation import Scene
from graspbox.viewer.drawn_hand import DrawnHand, PoseSet
from graspbox.viewer.geometry import COLORS, FAILURE, SUCCESS, UNTRIED, Floats
from graspbox.viewer.page import Page
from graspbox.viewer.player import Player
from graspbox.viewer.surroundings import DrawnSurroundings

__all__ = ["ObjectPage", "PlannedObject"]

#: Poses per call of the simulation: results arrive after each.
_CHUNK = 16
#: Names in the filter of outcomes.
_ALL, _UNTRIED, _FAILED = "all", "not tried", "failure"
#: Infeasible poses are drawn up to this number, the best first.
_MOST_INFEASIBLE = 10_000
#: Colour of infeasible poses.
_INFEASIBLE = (190, 175, 190)
#: A kind of failure for poses without an outcome.
_NONE = "?"


@dataclass(frozen=True, eq=False)
class PlannedObject:
    """An object with its known grasps.

    Attributes
    ----------
    mesh : Mesh
        The object.
    plan : Plan or None
        Its poses; by default the page plans.
    outcomes : Outcomes or None
        One row per pose of the plan.
    scene : Scene or None
        Where the object is at rest, with its hand; by default it is alone on the table.
    """

    mesh: Mesh
    plan: Plan | None = None
    outcomes: Outcomes | None = None
    scene: Scene | None = None


class ObjectPage(Page):
    """Page of an object; `content` is a `PlannedObject`."""

    title: ClassVar[str] = "object"

    def build(self) -> None:
        """Draw the object and its planned poses; trials begin in the background."""
        content: PlannedObject = self.content
        self.scene = scene = content.scene or self._alone()
        self._hand = hand = scene.hand
        self.rest = scene.world_from_object
        low, high = content.mesh.bounds
        size = float(np.linalg.norm(high - low))
        self.canvas.look(self.rest[:3, 3] + (0.0, 0.0, 0.3 * size), max(2.5 * size, 0.5))
        self.canvas.table()
        self.node = self.canvas.frame("/object", self.rest)
        self.mesh_node = self.canvas.mesh("/object/mesh", content.mesh)
        self.around = DrawnSurroundings(self.canvas, scene)
        self.plan = content.plan or self._planned()
        count = len(self.plan)
        #: Failure of each pose; empty for a success, ``?`` where it was not tried.
        self.failure = np.full(count, _NONE, dtype=object)
        self.failure[~self.plan.feasible] = "infeasible"
        self.secure = np.zeros(count, dtype=np.bool_)
        if content.outcomes is not None:
            self._take(np.arange(count), content.outcomes)
        self._boxes()
        self._controls()
        self.hand = DrawnHand(self.canvas, "/hand", hand)
        self.hand.visible = False
        self.player = Player(self.canvas, self.hand, self.node, self.around.others)
        poses = self.rest @ self.plan.poses
        self.poses = PoseSet(self.canvas, "/poses", hand, poses, self.plan.preshape, self.select)
        self.refresh()
        if content.outcomes is None:
            self.canvas.background(lambda: self.simulate(self.options.poses))

    def _alone(self) -> Scene:
        """Let the object come to rest alone on the table."""
        known: Plan | None = self.content.plan
        hand = load_hand(self.options.hand if known is None else known.hand_name or self.options.hand)
        start = None if known is None else known.world_from_object
        return Scene(self.content.mesh, hand=hand, world_from_object=start)

    def _planned(self) -> Plan:
        """Plan grasps of the object where it is at rest."""
        scene = self.scene
        walls = scene.world_from_walls, scene.wall_half_extents
        others = PlacedObjects(scene.others, scene.world_from_others, *walls)
        seed, rest = self.options.seed, self.rest
        return plan(scene.mesh, hand=scene.hand, seed=seed, world_from_object=rest, neighbours=others)

    def _boxes(self) -> None:
        """Draw the boxes of the plan, each in its colour."""
        leaves: list[Box] = list(self.plan.tree)
        colors = [COLORS[index % len(COLORS)] for index in range(len(leaves))]
        corners = np.array([box.corners() for box in leaves])
        self.box_node = self.canvas.boxes("/object/boxes", corners, colors)

    def _controls(self) -> None:
        gui, scores = self.canvas.gui, self._scores()
        leaves = len(self.plan.tree)
        names = [_ALL, *map(str, range(leaves)), "whole"]
        outcomes = (_ALL, "success", "secure", _FAILED, _UNTRIED, *get_args(FailureKind))
        with gui.add_folder("Show", expand_by_default=False):
            self.show_object = gui.add_checkbox("object", True)
            self.show_boxes = gui.add_checkbox("boxes", True)
            self.show_poses = gui.add_checkbox("poses", True)
            self.show_infeasible = gui.add_checkbox("infeasible poses", False)
        with gui.add_folder("Filter"):
            self.box = gui.add_dropdown("box", names, initial_value=_ALL)
            self.outcome = gui.add_dropdown("outcome", outcomes, initial_value=_ALL)
            low, high = (float(scores.min()), float(scores.max())) if len(scores) else (0.0, 1.0)
            high = max(high, low + 1e-3)
            step = round((high - low) / 200, 6) or 1e-3
            most = max(len(self.plan), 1)
            self.best = gui.add_slider("best", 1, most, 1, min(max(self.options.poses, 1), most), hint="poses by rank")
            self.score = gui.add_multi_slider("score", low, high + step, step, (low, high + step))
            self.shown = gui.add_markdown("")
        with gui.add_folder("Trial"):
            self.rank = gui.add_number("pose", 1, min=1, max=max(len(self.plan), 1), step=1, hint="rank in the plan")
            self.try_it = gui.add_button("show this trial", hint="or click a pose in the scene")
            self.next = gui.add_button("next shown pose")
            self.verdict = gui.add_markdown("")
            self.rest_button = gui.add_button("simulate all feasible poses")
        self.canvas.on(self.show_object, self.show_boxes, call=self._toggle)
        filters = (self.show_poses, self.show_infeasible, self.box, self.outcome, self.best, self.score)
        self.canvas.on(*filters, call=self.refresh)
        self.canvas.on(self.try_it, call=lambda: self.select(int(self.rank.value) - 1))
        self.canvas.on(self.next, call=self._next)
        self.canvas.on(self.rest_button, call=lambda: self.canvas.background(lambda: self.simulate(len(self.plan))))

    def _scores(self) -> Floats:
        scores = self.plan.score[self.plan.feasible]
        return scores if len(scores) else self.plan.score

    def _toggle(self) -> None:
        self.mesh_node.visible, self.box_node.visible = self.show_object.value, self.show_boxes.value

    def mask(self) -> NDArray[np.bool_]:
        """Return which poses the filters keep, (n,)."""
        found = np.ones(len(self.plan), dtype=np.bool_)
        wanted = self.outcome.value
        if wanted in ("success", "secure"):
            found &= self.failure == ""
            if wanted == "secure":
                found &= self.secure
        elif wanted == _FAILED:
            found &= (self.failure != "") & (self.failure != _NONE)
        elif wanted == _UNTRIED:
            found &= self.failure == _NONE
        elif wanted != _ALL:
            found &= self.failure == wanted
        if not self.show_infeasible.value and wanted != "infeasible":
            found &= self.plan.feasible
        if self.box.value != _ALL:
            found &= self.plan.box == (len(self.plan.tree) if self.box.value == "whole" else int(self.box.value))
        low, high = self.score.value
        ranked = (self.plan.score >= low - 1e-9) & (self.plan.score <= high + 1e-9)
        found &= ranked | ~self.plan.feasible
        found[int(self.best.value) :] = False
        extra = np.flatnonzero(found & ~self.plan.feasible)[_MOST_INFEASIBLE:]
        found[extra] = False
        return found & bool(self.show_poses.value)

    def refresh(self) -> None:
        """Show the poses that the filters keep, in the colours of their outcomes."""
        with self.canvas.lock:
            colors = np.tile(np.array(FAILURE, dtype=np.uint8), (len(self.plan), 1))
            colors[self.failure == ""] = SUCCESS
            colors[self.failure == _NONE] = UNTRIED
            colors[self.failure == "infeasible"] = _INFEASIBLE
            mask = self.mask()
            self.poses.show(mask, colors)
            tried = self.plan.feasible & (self.failure != _NONE)
            won = int((self.failure == "").sum())
            rate = f"{won} succeed, {int(self.secure.sum())} secure" if tried.any() else "none tried yet"
            self.shown.content = f"{int(mask.sum())} of {len(self.plan)} poses shown"
            self.canvas.say(
                f"**{self.content.mesh.name}**, {self.scene.body.mass:.3g} kg, hand {self._hand.name}  \n"
                f"{len(self.plan.tree)} boxes; {len(self.plan)} poses, {int(self.plan.feasible.sum())} feasible  \n"
                f"{int(tried.sum())} tried: {rate}"
            )

    def simulate(self, count: int) -> None:
        """Try feasible poses, the best `count` of the plan, in chunks; outcomes colour them as they arrive."""
        waiting = np.flatnonzero(self.plan.feasible)[:count]
        waiting = waiting[self.failure[waiting] == _NONE]
        for first in range(0, len(waiting), _CHUNK):
            if self.canvas.closed.is_set():
                return
            rows = waiting[first : first + _CHUNK]
            outcomes = self.scene.simulate(self.plan.poses[rows], self.plan.preshape[rows])
            with self.canvas.lock:
                self._take(rows, outcomes)
            self.refresh()

    def _take(self, rows: NDArray[np.int64], outcomes: Outcomes) -> None:
        self.failure[rows] = np.where(outcomes.success, "", outcomes.failure)
        self.secure[rows] = outcomes.secure

    def _next(self) -> None:
        """Show the trial of the next pose that the filters keep."""
        kept = np.flatnonzero(self.mask())
        if not len(kept):
            raise ConfigError("the filters keep no pose; widen them")
        after = kept[kept > int(self.rank.value) - 1]
        self.select(int(after[0] if len(after) else kept[0]))

    def select(self, index: int) -> None:
        """Run and show the trial of a pose of the plan."""
        if not 0 <= index < len(self.plan):
            raise ConfigError(f"the pose {index + 1} does not exist; choose from 1 to {len(self.plan)}")
        config = graspbox.TrialConfig()
        outcomes, trace = self.scene.trace(self.plan.poses[index], float(self.plan.preshape[index]), config=config)
        outcome = outcomes[0]
        with self.canvas.lock:
            self.rank.value = index + 1
            self._take(np.array([index]), outcomes)
            self.hand.visible = True
            pose = self.rest @ self.plan.poses[index]
            self.hand.pose(pose, self._hand.open(float(self.plan.preshape[index])))
            self.canvas.move(self.node, self.rest)
            self.around.rest()
            self.player.load(trace)
            self.show_poses.value = False
            won = "success, secure" if outcome.secure else "success, not secure"
            told = won if outcome.success else outcome.failure
            box = int(self.plan.box[index])
            self.verdict.content = (
                f"pose {index + 1}: **{told}**  \nlift {100 * outcome.lift:.1f} cm, "
                f"score {self.plan.score[index]:.3g}, box {'whole' if box == len(self.plan.tree) else box}, "
                f"preshape {self.plan.preshape[index]:.2f}"
            )
            self.refresh()

    def close(self) -> None:
        """Stop the player."""
        if hasattr(self, "player"):
            self.player.stop()
