"""A scripted expert for ``graspbox/Grasp-v0``: it moves the hand to a planned pose with ordinary actions.

The hand rises, moves and turns at a height that clears the object, descends to the standoff behind the pose, and
approaches along its z; then it closes, lifts and holds. This is the trial of `graspbox.simulate` (with the standoff,
times and lift height of `graspbox.TrialConfig`), with a simulated approach. The motions are in
`graspbox.envs.scripted`.

``graspbox.policies.load("expert")`` returns this expert as a policy for many environments.

>>> import gymnasium, graspbox
>>> from graspbox.envs.expert import ExpertGrasp, planned
>>> env = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0").unwrapped
>>> state, info = env.reset(seed=0)
>>> plan = planned(env.objects[0].load(), state)
>>> expert = ExpertGrasp(state, plan.poses[0], plan.preshape[0])
>>> done = False
>>> while not done and not expert.finished:
...     state, reward, done, _, info = env.step(expert.act(state))
>>> info["is_success"]
True
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import planning
from graspbox._core import Hand, Mesh
from graspbox.configs import TrialConfig
from graspbox.envs.coding import Codec, object_pose
from graspbox.envs.scripted import MotionOptions, ScriptedGrasp
from graspbox.errors import ConfigError
from graspbox.simulation import load_hand

__all__ = ["ExpertGrasp", "planned"]


def planned(
    mesh: Mesh,
    state: ArrayLike,
    *,
    control: str = "twist",
    hand: str | Hand | tuple[str, str] = "reflex",
    **settings: Any,
) -> planning.Plan:
    """Plan grasps of an object at its present pose; returns the feasible poses, best first.

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
        As for `graspbox.plan`: among others, ``neighbours``.
    """
    pose = object_pose(state, control=control, hand=hand)
    return planning.plan(mesh, hand=load_hand(hand), world_from_object=pose, **settings).best()


class ExpertGrasp(ScriptedGrasp):
    """Controls one episode: moves the hand to a planned pose, closes it, lifts and holds.

    Parameters
    ----------
    state : (n,) array_like
        First observation ``state`` of the episode.
    object_from_hand : (4, 4) array_like
        Grasp pose.
    preshape, control, fingers, hand, control_freq
        As for `graspbox.envs.scripted.ScriptedMotion`.
    trial : TrialConfig
        Standoff, lift height, and the times to close, lift and hold; without a shake, which no action can command.
    clears : float
        Height above the table that the hand clears on its way as it does the object, metres: that of its neighbours.

    Raises
    ------
    ConfigError
        If the state does not belong to this control mode and hand, or the trial ends with a shake.
    """

    def __init__(
        self,
        state: ArrayLike,
        object_from_hand: ArrayLike,
        preshape: float,
        *,
        control: str = "twist",
        fingers: str = "synergy",
        hand: str | Hand | tuple[str, str] = "reflex",
        control_freq: float = 5.0,
        trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        clears: float = 0.0,
    ) -> None:
        if trial.shake is not None:
            raise ConfigError("trial.shake is given, but an expert does not shake; give a TrialConfig without it")
        loaded = load_hand(hand)
        self._codec = Codec(control, loaded, fingers=fingers)
        goal = self._codec.pose(state, "object") @ np.asarray(object_from_hand, dtype=np.float64)
        start, top = self._codec.pose(state, "hand"), max(self._top(state), clears)
        options = MotionOptions(control=control, fingers=fingers, hand=loaded, control_freq=control_freq)
        super().__init__(start, goal, preshape, top, trial=trial, **options)

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
            The current observation ``state``; only the hand's pose as the arm measures it is used.

        Returns
        -------
        (k,) float32
            The action.
        """
        return self.follow(self._codec.pose(state, "hand"))
