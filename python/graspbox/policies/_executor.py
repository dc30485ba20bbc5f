"""Execution of a grasp chosen from one depth image: as one action of ``GraspPose-v0``, or by scripted motions."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.configs import TrialConfig
from graspbox.envs.coding import Codec, encode_action
from graspbox.envs.scripted import MotionOptions, ScriptedGrasp, ScriptedMotion, ScriptedRelease
from graspbox.perception.finder import FoundGrasp
from graspbox.policies._hand_view import HandView
from graspbox.policies.base import Task

__all__ = ["Executor", "GraspExecutor", "PoseExecutor", "executor_of"]

#: An environment's row of each observation.
Row = Mapping[str, Any]


class PoseExecutor:
    """Executes grasps in ``GraspPose-v0``: each is one action."""

    def __init__(self, hand: Hand, num_envs: int) -> None:
        self._hand = hand
        self._next: list[NDArray[np.float32] | None] = [None] * num_envs

    def begin(self, env: int) -> None:
        """Begin an episode in one environment."""
        self._next[env] = None

    def ready(self, env: int, row: Row) -> bool:
        """Return True: no hand is in the image, so it can always look."""
        del env, row
        return True

    def start(self, env: int, grasp: FoundGrasp | None, row: Row) -> None:
        """Encode a grasp as an action."""
        del row
        if grasp is not None:
            self._next[env] = encode_action(grasp.world_from_hand, grasp.preshape, hand=self._hand)

    def act(self, env: int, row: Row) -> NDArray[np.float32] | None:
        """Return the action, once."""
        del row
        action, self._next[env] = self._next[env], None
        return action


class GraspExecutor:
    """Executes grasps in ``Grasp-v0`` by scripted motions (`graspbox.envs.scripted`).

    The hand first leaves the camera's image, so that it is not mistaken for part of the object.
    """

    def __init__(self, task: Task, hand: Hand, view: HandView) -> None:
        self._view, self._preshape = view, hand.preshape_limits[0]
        self._proprio = Codec(task.control, hand, "proprio")
        self._options = MotionOptions(
            control=task.control, fingers=task.fingers, hand=hand, control_freq=task.control_freq
        )
        self._motions: list[ScriptedMotion | None] = [None] * task.num_envs

    def begin(self, env: int) -> None:
        """Begin an episode in one environment."""
        self._motions[env] = None

    def ready(self, env: int, row: Row) -> bool:
        """Return whether the camera's view is free of the hand; until then `act` moves the hand out of the image."""
        if self._motions[env] is None:
            hand, preshape = self._hand_pose(row), self._preshape_of(row)
            if stops := self._view.leave(hand, preshape):
                self._motions[env] = ScriptedMotion([hand, *stops], preshape, **self._options)
        motion = self._motions[env]
        return motion is None or motion.finished

    def start(self, env: int, grasp: FoundGrasp | None, row: Row) -> None:
        """Begin to execute a grasp, if there is one."""
        self._motions[env] = None if grasp is None else self.grasping(grasp, self._hand_pose(row))

    def act(self, env: int, row: Row) -> NDArray[np.float32] | None:
        """Choose the next action of the current motion."""
        motion = self._motions[env]
        if motion is None:
            return None
        return motion.follow(self._hand_pose(row), self._proprio.column(row["proprio"], "actuator"))

    def grasping(self, grasp: FoundGrasp, world_from_hand: NDArray[np.float64]) -> ScriptedGrasp:
        """Make the motion from ``world_from_hand`` (4, 4) to a grasp, which then closes and lifts."""
        return ScriptedGrasp(world_from_hand, grasp.world_from_hand, grasp.preshape, grasp.top, **self._options)

    def closing_time(self, env: int) -> float | None:
        """Return the seconds since the hand began to close, negative before; None if no grasp is being executed."""
        motion = self._motions[env]
        return motion.time - motion.closes_at if isinstance(motion, ScriptedGrasp) else None

    def release(self, env: int, grasp: FoundGrasp, row: Row) -> None:
        """Begin to release a grasp: lower the hand, open it, back off and leave the image."""
        goal = grasp.world_from_hand
        behind = goal.copy()
        behind[:3, 3] -= TrialConfig().standoff * behind[:3, 2]
        stops = self._view.leave(behind, grasp.preshape)
        self._motions[env] = ScriptedRelease(self._hand_pose(row), goal, grasp.preshape, stops, **self._options)

    def _hand_pose(self, row: Row) -> NDArray[np.float64]:
        """Read ``world_from_hand`` (4, 4) off an environment's row of ``proprio``."""
        return self._proprio.pose(row["proprio"], "hand")

    def _preshape_of(self, row: Row) -> float:
        """Read the hand's current preshape; without a preshape actuator it is the lower limit."""
        if "preshape" not in self._proprio.names:
            return self._preshape
        return float(self._proprio.column(row["proprio"], "preshape")[0])


Executor = PoseExecutor | GraspExecutor


def executor_of(task: Task, hand: Hand, view: HandView) -> Executor:
    """Make the executor for some environments; parameters as of `GraspExecutor`."""
    return GraspExecutor(task, hand, view) if task.closed_loop else PoseExecutor(hand, task.num_envs)
