"""A scripted expert for ``graspbox/Grasp-v0``: it moves the hand to a planned pose by ordinary actions alone.

The hand rises, moves over and turns at a height that clears the object, descends to the standoff behind the pose, and
approaches along its z; then it closes, lifts and holds. That is the trial of `graspbox.simulate` (standoff, times and
lift height are those of `graspbox.TrialConfig`), with a simulated approach. Every motion is a minimum-jerk curve within
the hand's limits.

`graspbox.policies` has this expert as a policy for many environments: ``load("expert")``.

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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import planning
from graspbox._core import Hand, Mesh
from graspbox.configs import TrialConfig
from graspbox.envs import spaces
from graspbox.envs.coding import Codec, codec, object_pose
from graspbox.envs.motion import Motion
from graspbox.errors import ConfigError
from graspbox.simulation import load_hand

__all__ = ["Expert", "ScriptedGrasp", "planned"]

Pose = NDArray[np.float64]

#: A motion's peak speed, as a share of the hand's limit; the arm's controller needs the rest to catch up.
_SPEED_SHARE = 0.9
#: Height of the hand above the object's highest point on the way, metres: longer than the fingers of any hand here.
_CLEARANCE = 0.20


def planned(
    mesh: Mesh,
    state: ArrayLike,
    *,
    control: str = "twist",
    hand: str | Hand | tuple[str, str] = "reflex",
    **settings: Any,
) -> planning.Plan:
    """Plan grasps of an object at its present pose; feasible poses only, best first.

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


class ScriptedGrasp:
    """Moves the hand to a pose, closes it, lifts and holds; it knows nothing of the object but its height.

    Parameters
    ----------
    world_from_hand : (4, 4) array_like
        Where the hand is, metres.
    goal : (4, 4) array_like
        Grasp pose, ``world_from_hand``.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    top : float
        Height of the highest point that the hand must clear on its way, metres.
    control : {"twist", "delta_pose", "target_pose"}
        The control mode of the environment.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    frame_skip : int
        That of the environment.
    trial : TrialConfig
        Standoff, times of closing, lifting and holding, and lift height.
    """

    def __init__(
        self,
        world_from_hand: ArrayLike,
        goal: ArrayLike,
        preshape: float,
        top: float,
        *,
        control: str = "twist",
        hand: str | Hand | tuple[str, str] = "reflex",
        frame_skip: int = 1,
        trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    ) -> None:
        loaded = load_hand(hand)
        found = spaces.tables(loaded)
        self._control, self._frame_skip = control, frame_skip
        self._period = found["control_period"] * frame_skip
        self._ceiling = found["workspace"][1][2]
        # Limits of a step are those of a twist for one control period.
        twist = {row["name"]: row["high"] for row in found["actions"]["twist"]}
        self._limits = twist["linear"], twist["angular"]
        self._encode = codec(control, loaded).encode_action
        self._preshape = float(preshape)
        self._close_speeds = np.array(loaded.closing_speeds)
        self._steps = 0
        start = np.asarray(world_from_hand, dtype=np.float64)
        self._motions = self._path(start, np.asarray(goal, dtype=np.float64), top, trial)
        self._reference = start
        self._closes_at = sum(motion.duration for motion in self._motions[:-2])
        self._length = sum(motion.duration for motion in self._motions) + trial.hold_time

    @property
    def finished(self) -> bool:
        """Whether all motions and the hold after them are over."""
        return self._steps * self._period >= self._length

    def _path(self, start: Pose, goal: Pose, top: float, trial: TrialConfig) -> list[Motion]:
        """Motions from the start pose to the end of the lift; during the last but one the hand rests and closes."""
        behind = goal.copy()
        behind[:3, 3] -= trial.standoff * goal[:3, 2]
        height = min(max(top + _CLEARANCE, behind[2, 3]), self._ceiling)
        raised, above = start.copy(), behind.copy()
        raised[2, 3] = max(height, start[2, 3])
        above[2, 3] = height
        stops = [start, raised, above, behind, goal]
        speeds = [_SPEED_SHARE * limit for limit in self._limits]
        motions = [Motion.within(a, b, *speeds) for a, b in pairwise(stops)]
        lifted = goal.copy()
        lifted[2, 3] += trial.lift_height
        return [*motions, Motion(goal, goal, trial.close_time), Motion(goal, lifted, trial.lift_time)]

    def _wanted(self, time: float) -> Pose:
        """Desired ``world_from_hand``, `time` seconds after the episode began."""
        for motion in self._motions:
            if time <= motion.duration:
                return motion.at(time)
            time -= motion.duration
        return self._motions[-1].end

    def follow(self, world_from_hand: Pose) -> NDArray[np.float32]:
        """Choose the next action (k,), from where the hand is now, ``world_from_hand`` (4, 4)."""
        now = self._steps * self._period
        self._steps += 1
        wanted = self._wanted(now + self._period)
        # A twist leads from where the hand is, a step from where the last one led.
        start = world_from_hand if self._control == "twist" else self._reference
        self._reference = wanted
        return self._encode(
            wanted,
            self._preshape,
            actuator_speed=self._close_speeds if now >= self._closes_at - 1e-9 else 0.0,
            world_from_start=start,
            frame_skip=self._frame_skip,
        )


class Expert(ScriptedGrasp):
    """Drives one episode: moves the hand to a planned pose, closes it, lifts and holds.

    Parameters
    ----------
    state : (n,) array_like
        First observation ``state`` of the episode.
    object_from_hand : (4, 4) array_like
        Grasp pose.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    control : {"twist", "delta_pose", "target_pose"}
        The control mode of the environment.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    frame_skip : int
        That of the environment.
    trial : TrialConfig
        Standoff, times of closing, lifting and holding, and lift height; without a shake, which no action can
        command.

    Raises
    ------
    ConfigError
        If the state is not one of that control mode and hand, or the trial ends with a shake.
    """

    def __init__(
        self,
        state: ArrayLike,
        object_from_hand: ArrayLike,
        preshape: float,
        *,
        control: str = "twist",
        hand: str | Hand | tuple[str, str] = "reflex",
        frame_skip: int = 1,
        trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    ) -> None:
        if trial.shake is not None:
            raise ConfigError("trial.shake is given, but an expert does not shake; give a TrialConfig without it")
        loaded = load_hand(hand)
        self._codec = Codec(control, loaded)
        goal = self._codec.pose(state, "object") @ np.asarray(object_from_hand, dtype=np.float64)
        start, top = self._codec.pose(state, "hand"), self._top(state)
        super().__init__(start, goal, preshape, top, control=control, hand=loaded, frame_skip=frame_skip, trial=trial)

    def _top(self, state: ArrayLike) -> float:
        """Height of the top of the object's bounds above the table, metres."""
        hand_from_object = self._codec.pose(state, "object_in_hand")
        middle = np.linalg.inv(hand_from_object) @ np.append(self._codec.column(state, "bounds_center"), 1.0)
        world_from_object = self._codec.pose(state, "object")
        reach = np.abs(world_from_object[2, :3]) @ self._codec.column(state, "half_extents")
        return float(world_from_object[2] @ middle + reach)

    def act(self, state: ArrayLike) -> NDArray[np.float32]:
        """Choose the next action.

        Parameters
        ----------
        state : (n,) array_like
            The current observation ``state``; only the hand pose that the arm measures is read.

        Returns
        -------
        (k,) float32
        """
        return self.follow(self._codec.pose(state, "hand"))
