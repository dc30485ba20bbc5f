"""Readings of the tactile sensors in a trial, and joint positions in a state of ``Grasp-v0``.

A trace of a trial has no sensors, so the same grasp is executed in ``Grasp-v0``: the hand approaches from the standoff,
follows the trace and closes as fast. Both run the same engine: of the two best poses of each object of
``procedural:2-3``, the sensors are read in 93 of 100; the others begin out of reach of the environment.
"""

import re
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.configs import PhysicsConfig
from graspbox.envs import spaces
from graspbox.envs.coding import Codec
from graspbox.envs.scripted import ScriptedMotion
from graspbox.errors import ConfigError
from graspbox.object_sets import ObjectSpec
from graspbox.outcomes import Trace
from graspbox.simulation import Scene

__all__ = ["felt", "joint_columns", "nothing_felt"]

Floats = NDArray[np.float64]
_CONTROL = "twist"
#: Ways of the straight approach that are tried in turn, metres: the open hand must begin clear of the object.
_STANDOFFS = (0.08, 0.14, 0.20, 0.26)
#: Readings end once the objects of trial and environment are further apart, metres.
_APART = 0.005


def nothing_felt() -> tuple[NDArray[np.int64], Floats]:
    """Return no readings."""
    return np.zeros(0, dtype=np.int64), np.zeros((0, 0))


def joint_columns(codec: Codec, hand: Hand, control: str) -> Callable[[Any], Floats]:
    """Make a function that reads the positions (c,) of the independent joints from a state of ``Grasp-v0``.

    The table of observations says which joints a column holds; joints in none follow from the preshape.
    """
    _, observations = spaces.columns_of(control, spaces.tables(hand))
    places: dict[str, list[int]] = {}
    for row in observations["state"]:
        match = re.fullmatch(r"position of ([\w, ]+)", row["meaning"])
        names = match[1].split(", ") if match else []
        if names and len(names) == row["size"] and set(names) <= set(hand.joints):
            places[row["name"]] = [hand.joints.index(name) for name in names]
    shaped = "preshape" in codec.names

    def read(state: Any) -> Floats:
        low, high = hand.preshape_limits
        preshape = float(codec.column(state, "preshape")[0]) if shaped else low
        joints = np.array(hand.open(min(max(preshape, low), high)))
        for name, joint in places.items():
            joints[joint] = codec.column(state, name)
        return joints

    return read


def felt(
    spec: ObjectSpec, scene: Scene, trace: Trace, preshape: float, physics: PhysicsConfig
) -> tuple[NDArray[np.int64], Floats]:
    """Execute the grasp of a trace in ``Grasp-v0``, and read its tactile sensors.

    Returns
    -------
    (k,) int64
        Samples of the trace at which they were read; none if the hand has no sensors, or the pose is out of reach of
        the environment.
    (k, s) float64
        Force on each sensor, N.
    """
    hand, tables = scene.hand, spaces.tables(scene.hand)
    if "tactile" in tables["absent"]:
        return nothing_felt()
    given: dict[str, Any] = {"scale": spec.scale, "mass": spec.mass, "hand": hand, "physics": physics}
    names = ("state", "tactile")
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects=spec.source, obs=names, **given).unwrapped
    try:
        return _executed(env, scene, trace, preshape, tables["control_period"])
    except ConfigError:
        # The hand would begin outside the workspace, or too near to the object.
        return nothing_felt()
    finally:
        env.close()


def _executed(env: Any, scene: Scene, trace: Trace, preshape: float, period: float) -> tuple[NDArray[np.int64], Floats]:
    hand, codec = scene.hand, Codec(_CONTROL, scene.hand)
    goal = trace.world_from_hand[0]
    behind, seen = _begun(env, scene, goal, preshape)
    approach = ScriptedMotion([behind, goal], preshape, control=_CONTROL, hand=hand)
    while not approach.finished:
        seen, *_ = env.step(approach.follow(codec.pose(seen["state"], "hand")))
    samples, forces = [], []
    for step in range(1, int(trace.time[-1] / period) + 1):
        sample = int(np.abs(trace.time - step * period).argmin())
        action = codec.encode_action(
            trace.world_from_hand[sample],
            preshape,
            actuator_speed=np.array(hand.closing_speeds),
            world_from_start=codec.pose(seen["state"], "hand"),
        )
        seen, _, terminated, _, _ = env.step(action)
        apart = codec.pose(seen["state"], "object")[:3, 3] - trace.world_from_object[sample, :3, 3]
        if np.linalg.norm(apart) > _APART:
            break
        samples.append(sample)
        forces.append(np.asarray(seen["tactile"], dtype=np.float64))
        if terminated:
            break
    return np.array(samples, dtype=np.int64), np.array(forces).reshape(len(samples), -1)


def _begun(env: Any, scene: Scene, goal: Floats, preshape: float) -> tuple[Floats, Any]:
    """Begin an episode with the hand behind a pose; returns the hand's pose, and the observation.

    Raises
    ------
    ConfigError
        If the hand can begin nowhere behind it.
    """
    for standoff in _STANDOFFS:
        behind = goal.copy()
        behind[:3, 3] -= standoff * goal[:3, 2]
        start = {"world_from_object": scene.world_from_object.tolist(), "world_from_hand": behind.tolist()}
        try:
            return behind, env.reset(seed=0, options={**start, "preshape": preshape})[0]
        except ConfigError:
            if standoff == _STANDOFFS[-1]:
                raise
    raise AssertionError
