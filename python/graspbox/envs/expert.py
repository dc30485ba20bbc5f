"""A scripted expert for ``graspbox/Grasp-v0``: it takes the hand to a planned pose by ordinary actions alone.

The way of the hand: straight up, over and turned at a height that clears the object, down to a place 0.10 m behind the
pose, in along the hand's z; then it closes for 1.3 s, rises 0.2 m in 1 s, and holds. That is the trial of
`graspbox.simulate`, with the approach for real. Every motion is a minimum-jerk curve within the hand's limits.

>>> import gymnasium, graspbox
>>> from graspbox.envs.expert import Expert, planned
>>> env = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0").unwrapped
>>> state, info = env.reset(seed=0)
>>> plan = planned(env.objects[0].load(), state)
>>> expert = Expert(state, plan.poses[0], plan.preshape[0])
>>> done = False
>>> while not done and not expert.finished:
...     state, reward, done, _, info = env.step(expert.act(state))
>>> info["is_success"]
True
"""

from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import planning
from graspbox._core import Hand, Mesh
from graspbox.envs import spaces
from graspbox.envs.coding import Codec, object_pose, rotation_vector
from graspbox.simulation import load_hand

__all__ = ["Expert", "planned"]

Pose = NDArray[np.float64]

#: Shares of the hand's greatest speeds that a curve's peak may have: the servo needs some to catch up.
_SPEED_SHARE = 0.9
#: A minimum-jerk curve's peak speed is this many times its mean.
_PEAK = 1.875
#: The hand is this far above the object's highest point on its way, metres: the length of a finger, and some.
_CLEARANCE = 0.20
#: The pose is approached from this far behind, along the hand's -z, metres; as in the planner and in a trial.
_STANDOFF = 0.10
#: Closing, rising and holding as a trial has them: seconds, metres; fingers close at the hand's default speed, rad/s.
_CLOSE_TIME, _LIFT_TIME, _LIFT_HEIGHT, _HOLD_TIME, _CLOSE_SPEED = 1.3, 1.0, 0.20, 1.0, 3.0


def _pose(position: ArrayLike, rotation: ArrayLike) -> Pose:
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = position, rotation
    return pose


def _rotation(vector: Pose) -> Pose:
    """Rotation (3, 3) of an axis times an angle, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


class _Curve:
    """A minimum-jerk motion from one pose to another: a straight line, and a turn about one axis."""

    def __init__(self, start: Pose, end: Pose, duration: float) -> None:
        self._start, self.end, self.duration = start, end, duration
        self._turn = rotation_vector(end[:3, :3] @ start[:3, :3].T)

    @classmethod
    def within(cls, start: Pose, end: Pose, linear: float, angular: float) -> "_Curve":
        """Make the fastest one whose speeds (m/s, rad/s) stay below the given ones."""
        way = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
        turn = float(np.linalg.norm(rotation_vector(end[:3, :3] @ start[:3, :3].T)))
        return cls(start, end, max(_PEAK * way / linear, _PEAK * turn / angular, 0.1))

    def at(self, time: float) -> Pose:
        s = min(max(time / self.duration, 0.0), 1.0)
        share = s * s * s * (10 + s * (6 * s - 15))
        position = self._start[:3, 3] + share * (self.end[:3, 3] - self._start[:3, 3])
        return _pose(position, _rotation(share * self._turn) @ self._start[:3, :3])


def planned(
    mesh: Mesh,
    state: ArrayLike,
    *,
    control: str = "twist",
    hand: str | Hand | tuple[str, str] = "reflex",
    **settings: Any,
) -> planning.Plan:
    """Plan for an object as it lies; the feasible poses alone, the best first.

    Parameters
    ----------
    mesh : Mesh
        The object.
    state : (n,) array_like
        The observation ``state``.
    control : str
        The control mode of the environment.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    **settings
        As for `graspbox.plan`.
    """
    pose = object_pose(state, control=control, hand=hand)
    return planning.plan(mesh, hand=load_hand(hand), world_from_object=pose, **settings).best()


class Expert:
    """Drives one episode to a planned pose.

    Parameters
    ----------
    state : (n,) array_like
        The observation ``state`` with which the episode began.
    object_from_hand : (4, 4) array_like
        Where to grasp.
    preshape : float
        Radians.
    control : {"twist", "delta_pose", "target_pose"}
        The control mode of the environment.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    frame_skip : int
        That of the environment.

    Raises
    ------
    ConfigError
        If the state is not one of that control mode and hand.
    """

    def __init__(
        self,
        state: ArrayLike,
        object_from_hand: ArrayLike,
        preshape: float,
        *,
        control: Literal["twist", "delta_pose", "target_pose"] = "twist",
        hand: str | Hand | tuple[str, str] = "reflex",
        frame_skip: int = 1,
    ) -> None:
        loaded = load_hand(hand)
        found = spaces.tables(loaded)
        self._control, self._frame_skip = control, frame_skip
        self._period = found["control_period"] * frame_skip
        self._ceiling = found["workspace"][1][2]
        # Limits of a step are those of a twist for one control period.
        twist = {row["name"]: row["high"] for row in found["actions"]["twist"]}
        self._limits = twist["linear"], twist["angular"]
        self._codec = Codec(control, loaded)
        self._preshape = float(preshape)
        self._steps = 0
        start = self._codec.pose(state, "hand")
        goal = self._codec.pose(state, "object") @ np.asarray(object_from_hand, dtype=np.float64)
        self._curves = self._way(start, goal, self._top(state))
        self._reference = start
        self._closes_at = sum(curve.duration for curve in self._curves[:-2])
        self._length = sum(curve.duration for curve in self._curves) + _HOLD_TIME

    @property
    def finished(self) -> bool:
        """Whether the way is done, and the hold after it."""
        return self._steps * self._period >= self._length

    def _top(self, state: ArrayLike) -> float:
        """Height of the object's bounds, metres."""
        hand_from_object = self._codec.pose(state, "object_in_hand")
        middle = np.linalg.inv(hand_from_object) @ np.append(self._codec.field(state, "bounds_center"), 1.0)
        world_from_object = self._codec.pose(state, "object")
        reach = np.abs(world_from_object[2, :3]) @ self._codec.field(state, "half_extents")
        return float(world_from_object[2] @ middle + reach)

    def _way(self, start: Pose, goal: Pose, top: float) -> list[_Curve]:
        """Make the curves from start to lift; the last but one stands still and closes."""
        behind = goal.copy()
        behind[:3, 3] -= _STANDOFF * goal[:3, 2]
        height = min(max(top + _CLEARANCE, behind[2, 3]), self._ceiling)
        raised, above = start.copy(), behind.copy()
        raised[2, 3] = max(height, start[2, 3])
        above[2, 3] = height
        stops = [start, raised, above, behind, goal]
        speeds = [_SPEED_SHARE * limit for limit in self._limits]
        curves = [_Curve.within(a, b, *speeds) for a, b in pairwise(stops)]
        lifted = goal.copy()
        lifted[2, 3] += _LIFT_HEIGHT
        return [*curves, _Curve(goal, goal, _CLOSE_TIME), _Curve(goal, lifted, _LIFT_TIME)]

    def _wanted(self, time: float) -> Pose:
        """Where the hand is to be, `time` seconds after the episode began."""
        for curve in self._curves:
            if time <= curve.duration:
                return curve.at(time)
            time -= curve.duration
        return self._curves[-1].end

    def act(self, state: ArrayLike) -> NDArray[np.float32]:
        """Choose the next action.

        Parameters
        ----------
        state : (n,) array_like
            The observation ``state`` now; only what the arm knows of the hand is looked at.

        Returns
        -------
        (k,) float32
        """
        now = self._steps * self._period
        self._steps += 1
        wanted = self._wanted(now + self._period)
        # A twist leads from where the hand is, a step from where the last one led.
        start = self._codec.pose(state, "hand") if self._control == "twist" else self._reference
        self._reference = wanted
        return self._codec.encode_action(
            wanted,
            self._preshape,
            spool_speed=_CLOSE_SPEED if now >= self._closes_at - 1e-9 else 0.0,
            world_from_start=start,
            frame_skip=self._frame_skip,
        )
