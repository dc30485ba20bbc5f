"""An object with its boxes, the best grasp as a hand, all planned poses as points, and the trace of any trial."""

import math
from dataclasses import dataclass
from typing import ClassVar, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.meshes import Mesh
from graspbox.planning import Plan, plan
from graspbox.simulation import Scene
from graspbox.simulation.neighbours import Neighbours
from graspbox.simulation.outcomes import FailureKind, Outcomes
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import COLORS, FAILURE, SUCCESS, UNTRIED, legend
from graspbox.tools.viewer.grasp_points import GraspPoints
from graspbox.tools.viewer.page import Page
from graspbox.tools.viewer.player import Player
from graspbox.tools.viewer.surroundings import DrawnObjects

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
    """An object; its plan, by default of the page; the scene in which it is at rest, by default only a table."""

    mesh: Mesh
    plan: Plan | None = None
    scene: Scene | None = None


class ObjectPage(Page):
    """Page of an object; `content` is a `PlannedObject`."""

    title: ClassVar[str] = "object"

    def build(self) -> None:
        """Draw the object and its planned poses; trials begin in the background."""
        content: PlannedObject = self.content
        self.scene = scene = content.scene or self._scene_of_object()
        self._hand = hand = scene.hand
        self.rest = scene.world_from_object
        low, high = content.mesh.bounds
        size = float(np.linalg.norm(high - low))
        self.canvas.look(self.rest[:3, 3] + (0.0, 0.0, 0.3 * size), max(2.0 * size, 0.45))
        self.canvas.table()
        self.node = self.canvas.frame("/object", self.rest)
        self.mesh_node = self.canvas.mesh("/object/mesh", content.mesh)
        self.neighbours = Neighbours.of(scene)
        self.around = DrawnObjects(self.canvas, "/others")
        self.around.show(self.neighbours)
        self.plan = content.plan or self._planned()
        count = len(self.plan)
        #: Failure of each pose; empty for a success, ``?`` where it was not tried.
        self.failure = np.full(count, _NONE, dtype=object)
        self.failure[~self.plan.feasible] = "infeasible"
        self.secure = np.zeros(count, dtype=np.bool_)
        corners = np.array([box.corners() for box in self.plan.tree])
        colors = [COLORS[index % len(COLORS)] for index in range(len(corners))]
        self.box_node = self.canvas.boxes("/object/boxes", corners, colors)
        self._controls()
        self.hand = DrawnHand(self.canvas, "/hand", hand)
        #: Pose whose trial is shown; None: the best grasp is shown.
        self.selected: int | None = None
        self.player = Player(self.canvas, self.hand, self.node, self.around.nodes)
        self.poses = GraspPoints(self.canvas, "/poses", self.rest @ self.plan.poses, self.select)
        self.refresh()
        self.canvas.background(lambda: self.simulate(self.options.poses))

    def _scene_of_object(self) -> Scene:
        """Let the object come to rest on the table, without other objects."""
        known: Plan | None = self.content.plan
        hand = load_hand((None if known is None else known.hand_name) or self.options.hand_or())
        start = None if known is None else known.world_from_object
        return Scene(self.content.mesh, hand=hand, world_from_object=start)

    def _planned(self) -> Plan:
        """Plan grasps of the object where it is at rest."""
        seed, around = self.options.seed, self.neighbours
        return plan(self.scene.mesh, hand=self._hand, seed=seed, world_from_object=self.rest, neighbours=around)

    def _controls(self) -> None:
        gui, scores = self.canvas.gui, self.plan.score[self.plan.feasible]
        scores = scores if len(scores) else self.plan.score
        leaves = len(self.plan.tree)
        names = [_ALL, *map(str, range(leaves)), "whole"]
        outcomes = (_ALL, "success", "secure", _FAILED, _UNTRIED, *get_args(FailureKind))
        with gui.add_folder("Show", expand_by_default=False):
            self.show_object = gui.add_checkbox("object", True)
            self.show_boxes = gui.add_checkbox("boxes", True)
            self.show_poses = gui.add_checkbox("points", True, hint="planned poses, at the palm of the hand")
            self.show_infeasible = gui.add_checkbox("infeasible poses", False)
        self.legend = gui.add_html("")
        with gui.add_folder("Points"):
            most = max(len(self.plan), 1)
            self.best = gui.add_slider("number", 1, most, 1, min(max(self.options.poses, 1), most), hint="best first")
            self.box = gui.add_dropdown("box", names, initial_value=_ALL)
            self.outcome = gui.add_dropdown("outcome", outcomes, initial_value=_ALL)
            low, high = (float(scores.min()), float(scores.max())) if len(scores) else (0.0, 1.0)
            # Two decimals: the panel has no room for the labels of longer numbers.
            low, high = math.floor(100 * low) / 100, math.ceil(100 * high) / 100
            self.score = gui.add_multi_slider("score", low, max(high, low + 0.01), 0.01, (low, max(high, low + 0.01)))
            self.shown = gui.add_markdown("")
        with gui.add_folder("Trial"):
            self.rank = gui.add_number("pose", 1, min=1, max=max(len(self.plan), 1), step=1, hint="rank in the plan")
            self.try_it = gui.add_button("show this trial", hint="or click a pose in the scene")
            self.next = gui.add_button("next shown pose")
            self.back = gui.add_button("back to all poses", icon="arrow-left", disabled=True)
            self.verdict = gui.add_markdown("")
            self.rest_button = gui.add_button("simulate all feasible poses")
        self.canvas.on(self.show_object, self.show_boxes, call=self._toggle)
        filters = (self.show_poses, self.show_infeasible, self.box, self.outcome, self.best, self.score)
        self.canvas.on(*filters, call=self.refresh)
        self.canvas.on(self.try_it, call=lambda: self.select(int(self.rank.value) - 1))
        self.canvas.on(self.next, call=self._next)
        self.canvas.on(self.back, call=self.show_all)
        self.canvas.on(self.rest_button, call=lambda: self.canvas.background(lambda: self.simulate(len(self.plan))))

    def _toggle(self) -> None:
        self.mesh_node.visible, self.box_node.visible = self.show_object.value, self.show_boxes.value

    def mask(self) -> NDArray[np.bool_]:
        """Return which poses the filters keep, (n,)."""
        kept = np.ones(len(self.plan), dtype=np.bool_)
        wanted, won, untried = self.outcome.value, self.failure == "", self.failure == _NONE
        chosen = {_ALL: kept, "success": won, "secure": won & self.secure, _UNTRIED: untried, _FAILED: ~won & ~untried}
        kept = chosen[wanted].copy() if wanted in chosen else self.failure == wanted
        if not self.show_infeasible.value and wanted != "infeasible":
            kept &= self.plan.feasible
        if self.box.value != _ALL:
            kept &= self.plan.box == (len(self.plan.tree) if self.box.value == "whole" else int(self.box.value))
        low, high = self.score.value
        ranked = (self.plan.score >= low - 1e-9) & (self.plan.score <= high + 1e-9)
        kept &= ranked | ~self.plan.feasible
        kept[int(self.best.value) :] = False
        extra = np.flatnonzero(kept & ~self.plan.feasible)[_MOST_INFEASIBLE:]
        kept[extra] = False
        return np.asarray(kept & bool(self.show_poses.value))

    def best_grasp(self) -> int | None:
        """Return the first pose that succeeded, else the first that can; None without a feasible pose."""
        for rows in (self.failure == "", self.failure == _NONE, self.plan.feasible):
            if rows.any():
                return int(np.flatnonzero(rows)[0])
        return None

    def show_all(self) -> None:
        """Leave the trial: show the best grasp, and the poses that the filters keep."""
        with self.canvas.lock:
            self.selected = None
            self.player.clear()
            self.canvas.move(self.node, self.rest)
            self.around.show(self.neighbours)
            self.show_poses.value, self.back.disabled, self.verdict.content = True, True, ""
            self.refresh()

    def _show_open_hand(self, index: int | None) -> None:
        """Show the open hand at a pose of the plan; no hand for None."""
        self.hand.visible = index is not None
        if index is not None:
            pose = self.rest @ self.plan.poses[index]
            self.hand.pose(pose, self._hand.open(float(self.plan.preshape[index])))

    def _legend(self) -> str:
        """Return the legend: numbers of feasible poses by outcome, with their colours."""
        won, waiting = self.failure == "", self.failure == _NONE
        failed = self.plan.feasible & ~won & ~waiting
        counts = [(SUCCESS, "succeed", won), (FAILURE, "fail", failed), (UNTRIED, "not tried", waiting)]
        if self.show_infeasible.value:
            counts.append((_INFEASIBLE, "infeasible", ~self.plan.feasible))
        return legend((color, f"{int(rows.sum())} {meaning}") for color, meaning, rows in counts)

    def refresh(self) -> None:
        """Show the poses that the filters keep, in the colours of their outcomes, and the best grasp."""
        with self.canvas.lock:
            colors = np.tile(np.array(FAILURE, dtype=np.uint8), (len(self.plan), 1))
            colors[self.failure == ""] = SUCCESS
            colors[self.failure == _NONE] = UNTRIED
            colors[self.failure == "infeasible"] = _INFEASIBLE
            mask = self.mask()
            self.poses.show(mask, colors)
            if self.selected is None:
                best = self.best_grasp()
                self._show_open_hand(best)
                self.verdict.content = "" if best is None else f"the hand is at pose {best + 1}, the best grasp"
            self.legend.content = self._legend()
            tried = self.plan.feasible & (self.failure != _NONE)
            won = int((self.failure == "").sum())
            rate = f"{won} succeed, {int(self.secure.sum())} secure" if tried.any() else "none succeeds yet"
            hint = "; click one" if mask.any() else ""
            self.shown.content = f"{int(mask.sum())} of {len(self.plan)} poses shown{hint}"
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
        outcomes, trace = self.scene.trace(self.plan.poses[index], float(self.plan.preshape[index]))
        outcome = outcomes[0]
        with self.canvas.lock:
            self.rank.value = index + 1
            self._take(np.array([index]), outcomes)
            self.selected, self.back.disabled = index, False
            self._show_open_hand(index)
            self.canvas.move(self.node, self.rest)
            self.around.show(self.neighbours)
            self.player.load(trace)
            self.show_poses.value = False
            won = "success, secure" if outcome.secure else "success, not secure"
            verdict = won if outcome.success else outcome.failure
            box = int(self.plan.box[index])
            self.verdict.content = (
                f"pose {index + 1}: **{verdict}**  \nlift {100 * outcome.lift:.1f} cm, "
                f"score {self.plan.score[index]:.3g}, box {'whole' if box == len(self.plan.tree) else box}, "
                f"preshape {self.plan.preshape[index]:.2f}"
            )
            self.refresh()

    def close(self) -> None:
        """Stop the player."""
        if hasattr(self, "player"):
            self.player.playback.stop()
