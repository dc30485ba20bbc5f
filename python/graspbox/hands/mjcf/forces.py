"""The greatest force of the joints of an MJCF hand, from its actuators.

The force of an actuator is bounded by its force range, and by its gain and bias at the ends of its control range; it
acts on a joint by its transmission: a gear, or the moment arm of a tendon. What a joint gets may be bounded once more.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.hands.mjcf.loops import Coupling, name_of

__all__ = ["Force", "forces"]

Array = NDArray[np.float64]

#: Moment arms below this have no effect, metres or 1.
_LEAST_ARM = 1e-9
#: Greatest force of a joint, as in the core, N m or N; more is a placeholder.
_MOST = 1000.0


@dataclass(frozen=True)
class Force:
    """The greatest force of a joint, N m or N; 0 where it is unknown. `source` says why, or what bounds it."""

    value: float
    source: str


@dataclass(frozen=True)
class _Bounds:
    low: float
    high: float
    source: str


def forces(
    mujoco: Any, model: Any, ranges: Mapping[int, tuple[float, float]], led: Mapping[int, Coupling]
) -> dict[int, Force]:
    """Return the greatest force of each joint in `ranges`, the joints of the hand with their limits.

    That of a joint which others follow, with the couplings `led`, moves all of them: it has the sum of their
    actuators, each by its ratio.
    """
    return _Drives(mujoco, model, ranges, led).of_joints()


class _Drives:
    def __init__(
        self, mujoco: Any, model: Any, ranges: Mapping[int, tuple[float, float]], led: Mapping[int, Coupling]
    ) -> None:
        self._mujoco, self._model, self._ranges, self._led = mujoco, model, ranges, led
        self._data = mujoco.MjData(model)
        self._arms = self._measured()

    def _law(self, joint: int) -> Coupling:
        return self._led.get(joint, (joint, 1.0, 0.0))

    def _measured(self) -> Array:
        """Measure the moment arm of each actuator at each joint, (actuators, joints), with the hand half closed."""
        model, data = self._model, self._data
        for joint in self._ranges:
            leader, ratio, offset = self._law(joint)
            data.qpos[model.jnt_qposadr[joint]] = ratio * sum(self._ranges[leader]) / 2 + offset
        self._mujoco.mj_fwdPosition(model, data)
        arms = np.zeros((model.nu, model.njnt))
        for joint in self._ranges:
            data.qvel[:] = 0.0
            data.qvel[model.jnt_dofadr[joint]] = 1.0
            self._mujoco.mj_fwdVelocity(model, data)
            arms[:, joint] = data.actuator_velocity
        arms[np.abs(arms) < _LEAST_ARM] = 0.0
        return arms

    def of_joints(self) -> dict[int, Force]:
        bounds = {joint: self._at_joint(joint) for joint in self._ranges}
        found: dict[int, Force] = {}
        for joint in self._ranges:
            group = (
                [each for each in self._ranges if self._law(each)[0] == joint] if joint not in self._led else [joint]
            )
            shares = [(self._law(each)[1] if each != joint else 1.0, bounds[each]) for each in group]
            found[joint] = _together([(ratio, share) for ratio, share in shares if share is not None])
            if joint in self._led and not found[joint].value:
                found[joint] = Force(0.0, f"it follows {name_of(self._model, 'joint', self._led[joint][0])}")
        return found

    def _at_joint(self, joint: int) -> _Bounds | None:
        """Return the bounds of the force of all actuators at a joint; None without an actuator."""
        model, low, high, sources = self._model, 0.0, 0.0, list[str]()
        for actuator in np.flatnonzero(self._arms[:, joint]).tolist():
            bounds, arm = self._of_actuator(actuator), float(self._arms[actuator, joint])
            ends = sorted((arm * bounds.low, arm * bounds.high))
            low, high = low + ends[0], high + ends[1]
            times = "" if abs(arm) == 1.0 else f" times {abs(arm):.4g}"
            sources.append(f"{bounds.source}{times}")
        if not sources:
            return None
        if model.jnt_actfrclimited[joint]:
            least, most = model.jnt_actfrcrange[joint].tolist()
            if low < least or high > most:
                sources = [f"actuatorfrcrange of joint {name_of(model, 'joint', joint)!r}"]
            low, high = max(low, least), min(high, most)
        return _Bounds(low, high, "; ".join(sources))

    def _of_actuator(self, actuator: int) -> _Bounds:
        model, name = self._model, f"actuator {name_of(self._model, 'actuator', actuator)!r}"
        low, high, source = self._by_control(actuator)
        if model.actuator_forcelimited[actuator]:
            least, most = model.actuator_forcerange[actuator].tolist()
            if low < least or high > most:
                source = "forcerange"
            low, high = max(low, least), min(high, most)
        tendon = int(model.actuator_trnid[actuator, 0])
        of_tendon = model.actuator_trntype[actuator] == self._mujoco.mjtTrn.mjTRN_TENDON
        if of_tendon and getattr(model, "tendon_actfrclimited", np.zeros(model.ntendon))[tendon]:
            least, most = model.tendon_actfrcrange[tendon].tolist()
            low, high, source = max(low, least), min(high, most), "actuatorfrcrange of its tendon"
        return _Bounds(low, high, f"{name}, {source}")

    def _by_control(self, actuator: int) -> tuple[float, float, str]:
        """Return the forces that commands ask for, at any position within the limits of joints, and what says so."""
        model, kinds, biases = self._model, self._mujoco.mjtGain, self._mujoco.mjtBias
        gain, bias = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
        kind, bias_kind = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
        if kind == kinds.mjGAIN_MUSCLE:
            peak = float(gain[2]) if gain[2] >= 0 else float(gain[3]) / max(float(model.actuator_acc0[actuator]), 1e-9)
            return -peak, 0.0, "peak of the muscle"
        linear = {int(kinds.mjGAIN_FIXED), int(kinds.mjGAIN_AFFINE)}
        if kind not in linear or bias_kind not in {int(biases.mjBIAS_NONE), int(biases.mjBIAS_AFFINE)}:
            return -np.inf, np.inf, "whose gain is none that is known"
        lengths = self._lengths(actuator)
        offset, slope = (float(bias[0]), float(bias[1])) if bias_kind == biases.mjBIAS_AFFINE else (0.0, 0.0)
        commands = self._commands(actuator)
        if commands is None:
            if slope < 0.0 and not model.actuator_forcelimited[actuator]:
                most = -slope * (lengths[1] - lengths[0])
                return -most, most, "its stiffness times the range of joints"
            return -np.inf, np.inf, "which has neither forcerange nor ctrlrange"
        at = [float(gain[0]) + (float(gain[1]) * x if kind == kinds.mjGAIN_AFFINE else 0.0) for x in lengths]
        ends = [factor * u + offset + slope * x for factor, x in zip(at, lengths, strict=True) for u in commands]
        return min(ends), max(ends), "its gain times ctrlrange"

    def _commands(self, actuator: int) -> list[float] | None:
        """Return the range of what the gain multiplies; None without one."""
        model = self._model
        dynamics = model.actuator_dyntype[actuator]
        if model.actuator_actlimited[actuator]:
            return [float(end) for end in model.actuator_actrange[actuator]]
        if model.actuator_ctrllimited[actuator] and dynamics != self._mujoco.mjtDyn.mjDYN_INTEGRATOR:
            return [float(end) for end in model.actuator_ctrlrange[actuator]]
        return None

    def _lengths(self, actuator: int) -> tuple[float, float]:
        """Return the least and the greatest length of the transmission within the limits of joints."""
        arms: dict[int, float] = {}
        for joint in self._ranges:
            leader, ratio, _ = self._law(joint)
            arms[leader] = arms.get(leader, 0.0) + ratio * float(self._arms[actuator, joint])
        half = sum(abs(arm) * (self._ranges[leader][1] - self._ranges[leader][0]) / 2 for leader, arm in arms.items())
        middle = float(self._data.actuator_length[actuator])
        return middle - half, middle + half


def _together(shares: list[tuple[float, _Bounds]]) -> Force:
    """Add the forces of joints that move together, each by its ratio."""
    low = high = 0.0
    for ratio, bounds in shares:
        ends = sorted((ratio * bounds.low, ratio * bounds.high)) if ratio else (0.0, 0.0)
        low, high = low + ends[0], high + ends[1]
    source = "; ".join(dict.fromkeys(bounds.source for ratio, bounds in shares if ratio))
    if len(shares) > 1:
        source += "; summed over the joints that follow"
    if not source:
        return Force(0.0, "no actuator moves it")
    value = max(abs(low), abs(high))
    if np.isfinite(value) and value > _MOST:
        source = f"{source}: {value:.4g}, which no hand has"
    return Force(value if value <= _MOST else 0.0, source)
