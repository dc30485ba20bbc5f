"""Attempts among several objects, in MuJoCo: a second judge of rounds of clearing.

The objects begin where they lie before the attempt. The open hand approaches along its z and pushes aside what it
touches, as in the core: at the same speed, with the same protective stop. It then closes, lifts and holds, as in
`replay`; an attempt succeeds if any object is held.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox.configs import TrialConfig
from graspbox.envs.coding import codec
from graspbox.errors import ConfigError
from graspbox.evaluation.results import wilson
from graspbox.hands import HandLike, load_hand
from graspbox.simulation.layouts import Arrangement
from graspbox.tools.scene_export.contents import ObjectData, WallData, objects_of, walls_of
from graspbox.tools.scene_export.mjcf import CARRIAGE_INERTIA
from validation.mujoco.compare import check_patch, describe
from validation.mujoco.replay import Outcome, Replay, run_grasp
from validation.mujoco.scene import Numerics, build_heap

__all__ = ["HeapJudge", "replay_attempt"]

#: Of the core's approach (``env/episode/src/approach.rs``): speed (m/s), force of the protective stop (N), and time
#: constant of its filter (s).
SPEED, STOP_FORCE, FORCE_TIME = 0.2, 60.0, 0.02
#: Attempts that wait for a thread.
_WAITING = 64


class _Approach(Replay):
    """An attempt: the carriage first slides along the hand's z, then vertically."""

    def arrive(self, direction: NDArray[np.float64], standoff: float) -> bool:
        """Move the open hand to its pose, from `standoff` metres behind; False if something is in its way."""
        model, data, dt = self.model, self.data, self.dt
        place, dof = self._carriage
        joint = int(model.joint("carriage").id)
        model.jnt_axis[joint] = direction
        data.qpos[place] = -standoff
        mujoco.mj_forward(model, data)
        if not self.is_feasible():
            return False
        steps, force = max(1, round(standoff / SPEED / dt)), 0.0
        for step in range(steps):
            left = standoff * (1.0 - (step + 1) / steps)
            self.drive.apply(model, data, closes=False)
            data.qfrc_applied[dof] = CARRIAGE_INERTIA * (SPEED - data.qvel[dof]) / dt
            mujoco.mj_step(model, data)
            data.qpos[place], data.qvel[dof] = -left, SPEED
            force += (float(data.qfrc_constraint[dof]) - force) * dt / (FORCE_TIME + dt)
            if not abs(force) < STOP_FORCE:
                return False
        model.jnt_axis[joint] = (0.0, 0.0, 1.0)
        data.qpos[place], data.qvel[dof] = 0.0, 0.0
        mujoco.mj_forward(model, data)
        return True

    def attempt(self, direction: NDArray[np.float64], standoff: float) -> Outcome:
        """Approach, close, lift and hold; where the approach ends, the hand may press on something."""
        if not self.arrive(direction, standoff):
            return Outcome(False, "infeasible", 0.0, np.inf, (0, 0), 0.0, self.data.time)
        return run_grasp(self)


def replay_attempt(
    hand: graspbox.Hand,
    items: Sequence[ObjectData],
    walls: Sequence[WallData],
    world_from_hand: NDArray[np.float64],
    preshape: float,
    numerics: Numerics | None = None,
    *,
    patch: float = 0.0,
) -> Outcome:
    """Try a grasp among objects and walls in MuJoCo.

    Parameters
    ----------
    hand : Hand
        The hand.
    items : sequence of ObjectData
        The objects, one or more, where they lie.
    walls : sequence of WallData
        Fixed boxes.
    world_from_hand : (4, 4) float64
        Pose of the grasp frame at which closing begins, metres.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    numerics : Numerics, optional
        MuJoCo's settings.
    patch : float
        Mean distance of a contact area from its middle, metres; 0: contacts are points.
    """
    scene = build_heap(describe(hand), items, walls, numerics, patch=patch)
    return _Approach(scene, world_from_hand, preshape).attempt(world_from_hand[:3, 2], TrialConfig.standoff)


class HeapJudge:
    """Tries the attempts of rounds of clearing in MuJoCo, in threads, and counts how they compare with the core's.

    Parameters
    ----------
    hand : str, Hand or pair of paths
        The hand of the rounds.
    numerics : Numerics, optional
        MuJoCo's settings.
    patch : float
        As for `replay_attempt`.

    Raises
    ------
    ConfigError
        If `patch` is out of range.
    """

    def __init__(self, hand: HandLike, numerics: Numerics | None = None, *, patch: float = 0.0) -> None:
        check_patch(patch)
        self._hand, self._numerics, self._patch = load_hand(hand), numerics, patch
        self._codec = codec("grasp_pose", self._hand)
        self._pool = ThreadPoolExecutor(os.cpu_count())
        self._attempts: list[tuple[bool, Future[Outcome]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=True)

    def __call__(self, before: Arrangement, action: NDArray[np.float32], info: Mapping[str, Any]) -> None:
        """Try an attempt: the scene before it, the action, and the info after it."""
        waiting = [future for _, future in self._attempts if not future.done()]
        if len(waiting) >= _WAITING:
            waiting[0].exception()
        self._attempts.append((bool(info["is_success"]), self._pool.submit(self._try, before, action)))

    def _try(self, before: Arrangement, action: NDArray[np.float32]) -> Outcome:
        try:
            pose, preshape = self._codec.decode_grasp(action)
        except ConfigError:
            return Outcome(False, "infeasible", 0.0, np.inf, (0, 0), 0.0, 0.0)
        scene = graspbox.Scene.of(before, hand=self._hand)
        items, walls = objects_of(scene), walls_of(scene)
        return replay_attempt(self._hand, items, walls, pose, preshape, self._numerics, patch=self._patch)

    def to_json(self) -> dict[str, Any]:
        """Wait for all attempts; return MuJoCo's success rate with its Wilson 95 % interval, and the agreement."""
        outcomes = [(ours, future.result()) for ours, future in self._attempts]
        succeeded = sum(theirs.success for _, theirs in outcomes)
        failures: dict[str, int] = {}
        for _, theirs in outcomes:
            if theirs.failure:
                failures[theirs.failure] = failures.get(theirs.failure, 0) + 1
        count = max(1, len(outcomes))
        return {
            "attempts": len(outcomes),
            "success_rate": round(succeeded / count, 4),
            "success_interval": [round(x, 4) for x in wilson(succeeded, count)],
            "equal": sum(ours == theirs.success for ours, theirs in outcomes),
            "only_core": sum(ours and not theirs.success for ours, theirs in outcomes),
            "only_mujoco": sum(theirs.success and not ours for ours, theirs in outcomes),
            "failures": failures,
        }
