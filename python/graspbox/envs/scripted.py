"""Scripted motions of the hand in ``Grasp-v0``, executed with ordinary actions and independent of the object.

Every motion is a minimum-jerk curve within the hand's limits.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._core import Hand
from graspbox.configs import TrialConfig
from graspbox.envs import spaces
from graspbox.envs.coding import codec
from graspbox.envs.motion import TimedMotion
from graspbox.simulation import load_hand

__all__ = ["ScriptedGrasp", "ScriptedMotion", "ScriptedRelease"]

Pose = NDArray[np.float64]

#: A motion's peak speed as a share of the hand's limit; the rest lets the arm's controller catch up.
_SPEED_SHARE = 0.9
#: A finger this near to its open position, in seconds of its motion, does not move.
_OPEN = 0.005
#: Clearance between the hand and the object's highest point, metres: longer than the fingers of any hand here.
_CLEARANCE = 0.20


class MotionOptions(TypedDict, total=False):
    """Keywords of `ScriptedMotion`, which its subclasses take too."""

    control: str
    fingers: str
    hand: str | Hand | tuple[str, str]
    control_freq: float


class ScriptedMotion:
    """Moves the hand from pose to pose with its fingers open, or at rest if nobody tells where they are.

    Parameters
    ----------
    stops : sequence of (4, 4) array_like
        Waypoints ``world_from_hand``, the present pose first.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    control : {"twist", "delta_pose", "target_pose", "top_down"}
        The control mode of the environment; ``top_down`` leaves out tilts.
    fingers : {"synergy", "each"}
        As in the environment.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    control_freq : float
        Actions per second, as in the environment.
    """

    def __init__(
        self,
        stops: Sequence[ArrayLike],
        preshape: float,
        *,
        control: str = "twist",
        fingers: str = "synergy",
        hand: str | Hand | tuple[str, str] = "reflex",
        control_freq: float = 5.0,
    ) -> None:
        loaded = load_hand(hand)
        found = spaces.tables(loaded)
        self._control, self._control_freq = control, control_freq
        self._period = 1.0 / control_freq
        self._ceiling = found["workspace"][1][2]
        # Every mode is limited to the speeds of a twist.
        twist = {row["name"]: row["high"] for row in found["actions"]["twist"][fingers]}
        self._limits = twist["linear"], twist["angular"]
        self._encode = codec(control, loaded, fingers).encode_action
        self._preshape = float(preshape)
        self._close_speeds = np.array(loaded.closing_speeds)
        self._open = loaded.open_positions(self._preshape)
        fastest = np.array([row["high"] for row in found["actions"]["twist"]["each"] if row["name"] == "actuator"])
        self._open_speeds = np.where(self._close_speeds > 0, self._close_speeds, fastest)
        self._steps = 0
        poses = [np.asarray(stop, dtype=np.float64) for stop in stops]
        self._motions = self._between(poses)
        self._reference = poses[0]
        self._length = sum(motion.duration for motion in self._motions)

    @property
    def time(self) -> float:
        """Seconds since the motion began."""
        return self._steps * self._period

    @property
    def finished(self) -> bool:
        """Whether the motion has ended."""
        return self.time >= self._length

    def _between(self, stops: Sequence[Pose]) -> list[TimedMotion]:
        """Make the motions from each waypoint to the next."""
        speeds = [_SPEED_SHARE * limit for limit in self._limits]
        return [TimedMotion.within(a, b, *speeds) for a, b in pairwise(stops)]

    def _wanted(self, time: float) -> Pose:
        """Desired ``world_from_hand``, `time` seconds after the start."""
        for motion in self._motions:
            if time <= motion.duration:
                return motion.at(time)
            time -= motion.duration
        return self._motions[-1].end

    def _actuator_speed(self, now: float, actuators: NDArray[np.float64] | None) -> ArrayLike:
        """Speed of each actuator except the preshape's, `now` seconds after the start; positive closes."""
        del now
        return 0.0 if actuators is None else self._opening(actuators)

    def _opening(self, actuators: NDArray[np.float64]) -> NDArray[np.float64]:
        """Speeds with which the fingers open as far as the preshape says, and no farther."""
        left = self._open - actuators
        speeds = np.clip(left * self._control_freq, -self._open_speeds, self._open_speeds)
        return np.where(np.abs(left) > _OPEN * self._open_speeds, speeds, 0.0)

    def follow(self, world_from_hand: Pose, actuators: NDArray[np.float64] | None = None) -> NDArray[np.float32]:
        """Return the next action (k,).

        Parameters
        ----------
        world_from_hand : (4, 4) array
            The present pose of the hand.
        actuators : (a,) array, optional
            The column ``actuator`` of ``proprio``, rad or m.
        """
        now = self.time
        self._steps += 1
        wanted = self._wanted(now + self._period)
        # A twist starts at the present pose, a step at the goal of the last step.
        start = world_from_hand if self._control in ("twist", "top_down") else self._reference
        self._reference = wanted
        return self._encode(
            wanted,
            self._preshape,
            actuator_speed=self._actuator_speed(now, actuators),
            world_from_start=start,
            control_freq=self._control_freq,
        )


class ScriptedGrasp(ScriptedMotion):
    """Moves the hand from ``world_from_hand`` (4, 4) to the pose `goal` (4, 4), closes it, lifts and holds.

    The hand clears the height `top`, metres. `trial` has the standoff, the lift height, and the times to close, lift
    and hold; the other arguments are those of `ScriptedMotion`.
    """

    def __init__(
        self,
        world_from_hand: ArrayLike,
        goal: ArrayLike,
        preshape: float,
        top: float,
        *,
        trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        **options: Unpack[MotionOptions],
    ) -> None:
        start = np.asarray(world_from_hand, dtype=np.float64)
        super().__init__([start], preshape, **options)
        #: Grasp pose, ``world_from_hand`` (4, 4).
        self.goal = np.asarray(goal, dtype=np.float64)
        self._motions = self._path(start, self.goal, top, trial)
        #: Times at which the hand starts to close and to lift, seconds.
        self.closes_at = sum(motion.duration for motion in self._motions[:-2])
        self.lifts_at = self.closes_at + trial.close_time
        self._length = self.lifts_at + trial.lift_time + trial.hold_time

    def _path(self, start: Pose, goal: Pose, top: float, trial: TrialConfig) -> list[TimedMotion]:
        """Make the motions from the start pose to the end of the lift; the hand closes during the last but one."""
        behind = goal.copy()
        behind[:3, 3] -= trial.standoff * goal[:3, 2]
        height = min(max(top + _CLEARANCE, behind[2, 3]), self._ceiling)
        raised, above = start.copy(), behind.copy()
        raised[2, 3] = max(height, start[2, 3])
        above[2, 3] = height
        motions = self._between([start, raised, above, behind, goal])
        lifted = goal.copy()
        lifted[2, 3] += trial.lift_height
        return [*motions, TimedMotion(goal, goal, trial.close_time), TimedMotion(goal, lifted, trial.lift_time)]

    def _actuator_speed(self, now: float, actuators: NDArray[np.float64] | None) -> ArrayLike:
        return self._close_speeds if now >= self.closes_at - 1e-9 else super()._actuator_speed(now, actuators)


class ScriptedRelease(ScriptedMotion):
    """Undoes a grasp: lowers the hand to the grasp pose, opens it as fast as it closed, retreats along its -z.

    It starts at ``world_from_hand`` (4, 4); `goal` (4, 4) is the pose at which the hand closed, and `then` has
    waypoints (4, 4) after the retreat. `trial` has the standoff, and the time to close; opening takes as long. The
    other arguments are those of `ScriptedMotion`.
    """

    def __init__(
        self,
        world_from_hand: ArrayLike,
        goal: ArrayLike,
        preshape: float,
        then: Sequence[ArrayLike] = (),
        *,
        trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        **options: Unpack[MotionOptions],
    ) -> None:
        start, low = (np.asarray(pose, dtype=np.float64) for pose in (world_from_hand, goal))
        super().__init__([start], preshape, **options)
        behind = low.copy()
        behind[:3, 3] -= trial.standoff * low[:3, 2]
        lowering = self._between([start, low])
        leaving = self._between([low, behind, *(np.asarray(pose, dtype=np.float64) for pose in then)])
        self._motions = [*lowering, TimedMotion(low, low, trial.close_time), *leaving]
        self._opens_at = lowering[0].duration
        self._length = sum(motion.duration for motion in self._motions)

    def _actuator_speed(self, now: float, actuators: NDArray[np.float64] | None) -> ArrayLike:
        """Open; while the hand is lowered, the actuators keep their positions."""
        if now < self._opens_at - 1e-9:
            return 0.0
        return -self._close_speeds if actuators is None else self._opening(actuators)
