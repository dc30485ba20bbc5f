"""A grasp from above by the object's pose, without its shape: it succeeds sometimes.

Tests of adapters run it in another program's loop and in graspbox's own, and compare every trial.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.envs.coding import Codec
from graspbox.envs.scripted import MotionOptions, ScriptedGrasp
from graspbox.policies import Actions, Policy, Task

__all__ = ["TopDown", "TopDownGrasp"]

#: How far the hand stays above the middle of the object, metres.
_ABOVE = 0.06


class TopDownGrasp:
    """One episode.

    Parameters
    ----------
    control : str
        The control mode; ``grasp_pose`` is that of ``GraspPose-v0``.
    fingers, control_freq
        Those of the environment.
    """

    def __init__(self, control: str, fingers: str = "synergy", control_freq: float = 5.0) -> None:
        self._codec, self._control = Codec(control, fingers=fingers), control
        self._options = MotionOptions(control=control, fingers=fingers, control_freq=control_freq)
        self._grasp: ScriptedGrasp | None = None

    def act(self, state: ArrayLike) -> NDArray[np.float32]:
        """Choose the next action from the observation ``state``."""
        values = np.asarray(state, dtype=np.float32)
        if self._control == "grasp_pose":
            return self._codec.encode_action(self._goal(values), 0.0)
        if self._grasp is None:
            start = self._codec.pose(values, "hand")
            goal = self._goal(values)
            self._grasp = ScriptedGrasp(start, goal, 0.0, goal[2, 3] + 0.1, **self._options)
        return self._grasp.follow(self._codec.pose(values, "hand"))

    def _goal(self, state: NDArray[np.float32]) -> NDArray[np.float64]:
        """Grasp pose: over the object's centre of mass, palm down."""
        center = np.append(self._codec.column(state, "center_of_mass"), 1.0)
        if self._control != "grasp_pose":
            # In closed loop the hand's frame has it.
            center = self._codec.pose(state, "hand") @ center
        goal = np.diag([1.0, -1.0, -1.0, 1.0])
        goal[:3, 3] = center[:3]
        goal[2, 3] += _ABOVE
        return goal


class TopDown(Policy):
    """The same for graspbox's own loop."""

    name = "top_down"
    obs = ("state",)

    def _bind(self, task: Task) -> None:
        self._grasps = [self._made() for _ in range(task.num_envs)]

    def _made(self) -> TopDownGrasp:
        control = self.task.control if self.task.closed_loop else "grasp_pose"
        return TopDownGrasp(control, self.task.fingers, self.task.control_freq)

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del seed, info
        self._grasps[env] = self._made()

    def act(self, observation: Any) -> Actions:
        """Choose an action per environment."""
        states = observation if isinstance(self.task.obs, str) else observation["state"]
        return np.stack([grasp.act(state) for grasp, state in zip(self._grasps, states, strict=True)])
