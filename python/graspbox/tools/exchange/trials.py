"""Outcomes and joint positions of grasps that lack them, from trials in simulation."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands.conventions import mechanism_of
from graspbox.meshes import MeshLike
from graspbox.simulation import Scene
from graspbox.tools.exchange.grasps import ExchangeGrasps, own_mesh

__all__ = ["simulated"]

Array = NDArray[np.float64]


def simulated(
    grasps: ExchangeGrasps,
    mesh: MeshLike,
    *,
    joints: bool = True,
    config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
    done: Callable[[int], None] = lambda _: None,
) -> ExchangeGrasps:
    """Try grasps, and fill in unknown outcomes, joint positions, poses and mass of the object.

    Known outcomes are kept. The object settles from its pose in the world, and the grasps get the pose in which it
    comes to rest. Joint positions are those at the end of closing, before the hand lifts; they stay NaN where the hand
    collides on its way (`ExchangeGrasps.closed`).

    Parameters
    ----------
    mesh : Mesh
        The object of the grasps.
    joints : bool
        Whether to record joint positions: trials then run one by one.
    config, physics, num_threads
        As in `graspbox.simulate`.
    done : callable
        Called with the number of grasps tried since the last call.

    Raises
    ------
    SimulationError
        If the object cannot be simulated or does not come to rest.
    ConfigError
        If the grasps are for another mesh; as `graspbox.simulate`.
    """
    tried = replace(
        grasps,
        success=grasps.success.copy(),
        world_from_object=grasps.world_from_object.copy(),
        grasp=grasps.grasp.copy(),
        squeeze=grasps.squeeze.copy(),
    )
    loaded = own_mesh(grasps, mesh)
    worlds, member = np.unique(grasps.world_from_object.reshape(-1, 16), axis=0, return_inverse=True, equal_nan=True)
    for index, start in enumerate(worlds.reshape(-1, 4, 4)):
        rows = np.flatnonzero(member.reshape(-1) == index)
        known = None if np.isnan(start).any() else start
        scene = Scene(loaded, hand=grasps.hand, world_from_object=known, physics=physics)
        tried.world_from_object[rows] = scene.world_from_object
        if joints:
            for row in rows:
                _record(tried, int(row), scene, config)
                done(1)
        else:
            wanted = rows[np.isnan(tried.success[rows])]
            outcomes = scene.simulate(
                grasps.poses[wanted], grasps.preshape[wanted], config=config, num_threads=num_threads
            )
            tried.success[wanted] = outcomes.success
            done(len(rows))
    return replace(tried, mass=loaded.mass)


def _record(grasps: ExchangeGrasps, row: int, scene: Scene, config: TrialConfig) -> None:
    """Run one trial with its trace."""
    outcome, trace = scene.trace(grasps.poses[row], float(grasps.preshape[row]), config=config)
    if np.isnan(grasps.success[row]):
        grasps.success[row] = outcome.success[0]
    if not len(trace.time):
        return
    sample = int(np.searchsorted(trace.time, config.close_time - 1e-9))
    if sample >= len(trace.time):
        raise ConfigError(f"the trial of grasp {row} ended before the hand had closed; pass another close_time")
    joints = trace.joints[sample : sample + 1]
    grasps.grasp[row] = joints[0]
    grasps.squeeze[row] = mechanism_of(scene.hand).commanded(joints, trace.actuators[sample : sample + 1])[0]
