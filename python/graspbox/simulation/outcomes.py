"""Outcomes of grasp trials, one row each, and the recorded trace of a single trial."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.by_value import ByValue

__all__ = ["FailureKind", "Outcome", "Outcomes", "Trace"]

#: Kinds of failure, as in the core.
FailureKind = Literal["infeasible", "no_contact", "slipped", "dropped", "unstable"]


@dataclass(frozen=True, eq=False)
class Outcome(ByValue):
    """Outcome of one trial: a row of `Outcomes`, where the fields are explained."""

    success: bool
    secure: bool
    failure: str
    lift: float
    kindness_rate: float
    legacy_success: bool
    kindness: float
    survives_shake: bool
    shake_shift: float
    time: float
    unconverged_steps: int


@dataclass(frozen=True, eq=False, repr=False)
class Outcomes(ByValue):
    """Outcomes of n trials; arrays of length n.

    ``outcomes[3]`` is an `Outcome`; a slice, a mask or an array of indices selects rows. Two are equal if all their
    values are; NaN equals NaN.

    Attributes
    ----------
    success, secure : (n,) bool
        See `graspbox.simulation`.
    failure : (n,) str
        One of `FailureKind`; empty for a success.
    lift : (n,) float64
        Rise of the object's centre of mass at the end, metres.
    kindness_rate : (n,) float64
        Mean absolute rate of change of the distance between hand and object since lifting began, m/s.
    legacy_success : (n,) bool
        The reference study's success; False where it was not measured (see `kindness`).
    kindness : (n,) float64
        The reference study's kindness: absolute rate of change of the distance between hand and object, summed over the
        samples of the first 2.5 s, one per 10 ms, m/s. NaN for an infeasible pose, and after an early stop; with
        ``TrialConfig(legacy=True)``, early stops wait for it.
    survives_shake : (n,) bool
        Whether the success criterion was met again after the shake; False without a shake (see `shake_shift`).
    shake_shift : (n,) float64
        Shift of the object's centre of mass in the hand's frame over the shake, metres; NaN without a shake, because
        ``TrialConfig(shake=...)`` was not given or the grasp had already failed.
    time : (n,) float64
        Simulated seconds, including the shake.
    unconverged_steps : (n,) int64
        Steps in which the solver did not converge; 0 for rapier, which does not measure it.
    """

    success: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    failure: NDArray[np.str_]
    lift: NDArray[np.float64]
    kindness_rate: NDArray[np.float64]
    legacy_success: NDArray[np.bool_]
    kindness: NDArray[np.float64]
    survives_shake: NDArray[np.bool_]
    shake_shift: NDArray[np.float64]
    time: NDArray[np.float64]
    unconverged_steps: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.success)

    def __repr__(self) -> str:
        return f"Outcomes(trials={len(self)}, succeeded={int(self.success.sum())}, secure={int(self.secure.sum())})"

    @overload
    def __getitem__(self, index: int) -> Outcome: ...
    @overload
    def __getitem__(self, index: slice | NDArray[Any] | list[int]) -> "Outcomes": ...
    def __getitem__(self, index: int | slice | NDArray[Any] | list[int]) -> "Outcome | Outcomes":
        if isinstance(index, int | np.integer):
            return Outcome(**{f.name: getattr(self, f.name)[index].item() for f in fields(self)})
        kept = np.arange(len(self))[index]
        return Outcomes(**{f.name: getattr(self, f.name)[kept] for f in fields(self)})

    def __iter__(self) -> Iterator[Outcome]:
        return (self[i] for i in range(len(self)))

    @property
    def rate(self) -> float:
        """Share of successes; 0 without a trial."""
        return float(self.success.mean()) if len(self) else 0.0

    @classmethod
    def _from_core(cls, arrays: "_core.OutcomeArrays") -> "Outcomes":
        """Make outcomes from the core's arrays."""
        failure = np.array(arrays["failure"], dtype=np.str_)
        rest = {f.name: arrays[f.name] for f in fields(cls) if f.name != "failure"}  # type: ignore[literal-required]
        return cls(failure=failure, **rest)


@dataclass(frozen=True, eq=False)
class Trace(ByValue):
    """A recording of one trial: t samples, one per 10 ms. An infeasible pose has none (t = 0).

    Attributes
    ----------
    time : (t,) float64
        Seconds since closing began.
    distance : (t,) float64
        Distance between the hand frame and the reference study's frame of the scene's object, metres.
    world_from_hand, world_from_object : (t, 4, 4) float64
        Poses of the hand, and of the scene's object (`graspbox.Scene.mesh`) even where a trial grasps another one.
    world_from_others : (t, k, 4, 4) float64
        Poses of the k other objects, in the order of `graspbox.Scene.others`, metres; k = 0 for a single object.
    joints : (t, c) float64
        Positions of the independent joints (`graspbox.Hand.joints`), rad or m.
    actuators, loads : (t, a) float64
        Positions of the actuators (`graspbox.Hand.actuators`), rad or m, and their loads, N or N m.
    tensions : (t, d) float64
        Tension of every tendon (`graspbox.Hand.tendons`), N.
    hand_force : (t,) float64
        Sum of the normal forces between hand and object, N.
    tactile : (t, s) float64
        Force on each tactile sensor, N, in the order of the observation ``tactile``.
    contact_samples : (n,) int64
        Sample of each of the n contact points of the hand with any object in all samples, ascending.
    contact_shapes : (n,) int64
        Index of the hand's shape in `graspbox.Hand.shapes`.
    contact_points, contact_normals : (n, 3) float64
        Positions, metres, and unit normals into the object; world frame.
    contact_forces : (n, 3) float64
        Forces on the object with friction, mean over a time step, world frame, N.
    """

    time: NDArray[np.float64]
    distance: NDArray[np.float64]
    world_from_hand: NDArray[np.float64]
    world_from_object: NDArray[np.float64]
    world_from_others: NDArray[np.float64]
    joints: NDArray[np.float64]
    actuators: NDArray[np.float64]
    loads: NDArray[np.float64]
    tensions: NDArray[np.float64]
    hand_force: NDArray[np.float64]
    tactile: NDArray[np.float64]
    contact_samples: NDArray[np.int64]
    contact_shapes: NDArray[np.int64]
    contact_points: NDArray[np.float64]
    contact_normals: NDArray[np.float64]
    contact_forces: NDArray[np.float64]

    def contacts(self, sample: int) -> slice:
        """Return the rows of the ``contact_`` arrays that belong to a sample."""
        first, last = np.searchsorted(self.contact_samples, [sample, sample + 1])
        return slice(int(first), int(last))
