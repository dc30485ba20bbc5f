"""From geometry to time: each piece of a path from rest to rest, within the limits of speed, acceleration and jerk.

A piece is a cubic spline q(s) of the joints. Its course s(t) has one degree of freedom, so that the arm never leaves
the checked geometry: q' = dq/ds and its derivatives bound speed, acceleration and jerk of every joint from those of s,

    |dq/dt|    <= |q'| v
    |d2q/dt2|  <= |q''| v^2 + |q'| a
    |d3q/dt3|  <= |q'''| v^3 + 3 |q''| v a + |q'| j

for any time at which v, a, j bound the derivatives of s. A straight motion of the joints has q'' = q''' = 0.

Where an arm slows down near the ends of its ranges (`Arm.slowing`), also ds/dt <= u(s). A course from rest to rest over
a length l has v^2 <= 2 a s and v^2 <= 2 a (l - s), so that an a is chosen which keeps these below u^2 where u < v.
"""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox._core import Arm
from graspbox.errors import PathError
from graspbox.hands.loading import AssumedWarning

__all__ = ["NEED", "Limits", "TimedPiece", "limits_of", "tell", "timed"]

#: What the package ruckig is needed for.
NEED = "timing a path needs the package ruckig (on Linux with ARM: pip install ruckig, and a compiler of C++20)"
#: What is assumed where an arm states no limit: full speed is reached in this time, full acceleration in that, seconds.
ASSUMED_TIMES = {"acceleration": 0.5, "jerk": 0.1}
#: Arms about whose assumed limits a warning was given.
_TOLD: set[Arm] = set()
#: Shares of the greatest speed and acceleration along a curve that are tried: less of one leaves more to the others.
_SPEEDS = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2)
_ACCELERATIONS = (1.0, 0.75, 0.5, 0.25)
#: How often the greatest speed is halved, if none of these shares leaves room for a change of acceleration.
_HALVINGS = 20
#: Share of a limit that is used: rounding must not exceed it.
_USED = 0.9999
#: Places along a piece at which the speeds near the ends of ranges are computed.
_PLACES = 257


@dataclass(frozen=True)
class Limits:
    """Greatest speed, acceleration and jerk of each joint, (k,), `Arm.slowing` (k, 4), names, and what was assumed."""

    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    jerk: NDArray[np.float64]
    slowing: NDArray[np.float64]
    joints: tuple[str, ...]
    assumed: tuple[str, ...] = ()

    def allowed(self, positions: NDArray[np.float64], towards: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest speeds (m, k) at positions (m, k), in the directions of signs (m, k)."""
        least, greatest, rate, offset = self.slowing.T
        left = np.where(towards > 0, greatest - positions, positions - least)
        return np.asarray(np.minimum(self.speed, np.maximum(np.sqrt(rate * np.maximum(left, 0.0)) - offset, 0.0)))


def limits_of(arm: Arm, share: float = 1.0) -> Limits:
    """Return the limits of an arm, `share` of its speeds; what it does not state is assumed."""
    speed, acceleration, jerk = arm.speeds, arm.accelerations.copy(), arm.jerks.copy()
    assumed = []
    for name, numbers, before in (("acceleration", acceleration, speed), ("jerk", jerk, acceleration)):
        missing = ~np.isfinite(numbers)
        numbers[missing] = before[missing] / ASSUMED_TIMES[name]
        if missing.any():
            joints = ", ".join(joint for joint, none in zip(arm.joints, missing, strict=True) if none)
            least = f"{numbers[missing].min():.3g} rad/s{'2' if name == 'acceleration' else '3'}"
            assumed.append(f"arm {arm.name!r} states no {name} of {joints}: {least} or more is assumed")
    # Slower by a factor in time: its square in accelerations, its cube in jerks.
    slowing = arm.slowing * (1.0, 1.0, share**2, share)
    names = tuple(arm.joints)
    return Limits(share * speed, share**2 * acceleration, share**3 * jerk, slowing, names, tuple(assumed))


def tell(arm: Arm, limits: Limits) -> None:
    """Warn of what is assumed, once per arm."""
    if limits.assumed and arm not in _TOLD:
        _TOLD.add(arm)
        warnings.warn(AssumedWarning(limits.assumed, "Trajectory.assumptions"), stacklevel=3)


@dataclass(frozen=True)
class TimedPiece:
    """A cubic spline q(s), and cubic pieces of s(t).

    Attributes
    ----------
    phase : str
        Part of the path.
    knots : (n + 1,) float64
        Values of s where the polynomials of the spline meet.
    coefficients : (n, 4, k) float64
        Of (s - knot)^0 to ^3.
    starts : (p,) float64
        Times at which the pieces of s(t) begin, seconds.
    course : (p, 4) float64
        s and its derivatives there.
    duration : float
        Seconds.
    """

    phase: str
    knots: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    starts: NDArray[np.float64]
    course: NDArray[np.float64]
    duration: float

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return position, velocity, acceleration and jerk of the joints, (4, m, k), at times from its beginning."""
        part = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.starts) - 1)
        since = times - self.starts[part]
        s0, v0, a0, j = self.course[part].T
        s = s0 + since * (v0 + since * (a0 / 2 + since * j / 6))
        v = v0 + since * (a0 + since * j / 2)
        a = a0 + since * j
        s = np.clip(s, self.knots[0], self.knots[-1])
        segment = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.coefficients) - 1)
        x = (s - self.knots[segment])[:, None]
        c0, c1, c2, c3 = np.moveaxis(self.coefficients[segment], 1, 0)
        first, second, third = c1 + x * (2 * c2 + 3 * c3 * x), 2 * c2 + 6 * c3 * x, 6 * c3
        v, a, j = v[:, None], a[:, None], j[:, None]
        return np.stack(
            [
                c0 + x * (c1 + x * (c2 + x * c3)),
                first * v,
                second * v**2 + first * a,
                third * v**3 + 3 * second * v * a + first * j,
            ]
        )


def timed(
    phase: str, postures: NDArray[np.float64], lengths: NDArray[np.float64] | None, limits: Limits
) -> list[TimedPiece]:
    """Time a piece of a path.

    Parameters
    ----------
    phase : str
        Part of the path.
    postures : (m, k) array
        Without `lengths`, corners at which the arm comes to rest, straight motions between them. With them, samples of
        a straight line of the hand.
    lengths : (m,) array or None
        Distances of the samples along the line, evenly spaced.
    limits : Limits
        Of the joints.

    Returns
    -------
    list of TimedPiece

    Raises
    ------
    PathError
        For a line on which a joint moves where the arm lets it move no more.
    """
    if lengths is None:
        return [_straight(phase, a, b, limits) for a, b in pairwise(postures) if not np.array_equal(a, b)]
    return [_curve(phase, postures, lengths, limits)]


def _straight(phase: str, start: NDArray[np.float64], end: NDArray[np.float64], limits: Limits) -> TimedPiece:
    """Time a straight motion of the joints; s goes from 0 to 1."""
    change = end - start
    with np.errstate(divide="ignore"):
        least = [float((limit / np.abs(change)).min()) for limit in (limits.speed, limits.acceleration, limits.jerk)]
    coefficients = np.zeros((1, 4, len(start)))
    coefficients[0, :2] = start, change
    speed, acceleration, jerk = (_USED * x for x in least)
    knots, choices = np.array([0.0, 1.0]), [(speed, acceleration)]
    if (gentle := _gentle(knots, coefficients, limits, speed)) is not None:
        choices = [(share * speed, min(acceleration, gentle(share * speed))) for share in _SPEEDS]
    starts, course, duration = min((_course(1.0, *choice, jerk) for choice in choices), key=lambda found: found[2])
    return TimedPiece(phase, knots, coefficients, starts, course, duration)


def _curve(phase: str, postures: NDArray[np.float64], lengths: NDArray[np.float64], limits: Limits) -> TimedPiece:
    """Time a spline through samples; of the bounds of speed and acceleration, those that take the least time."""
    coefficients = _spline(postures, float(lengths[1] - lengths[0]))
    first, second, third = _greatest(coefficients, float(lengths[1] - lengths[0]))
    with np.errstate(divide="ignore"):
        fastest = min(
            (limits.speed / first).min(),
            np.sqrt(limits.acceleration / second).min(),
            np.cbrt(limits.jerk / third).min(),
        )
        gentle = _gentle(lengths, coefficients, limits, fastest)
        for _ in range(_HALVINGS):
            if choices := list(_choices(fastest, (first, second, third), limits, gentle)):
                break
            fastest *= 0.5
        else:
            raise _at_limit(phase, postures, limits)
    courses = (_course(float(lengths[-1]), *choice) for choice in choices)
    starts, course, duration = min(courses, key=lambda found: found[2])
    return TimedPiece(phase, lengths, coefficients, starts, course, duration)


def _choices(
    fastest: float,
    slopes: tuple[NDArray[np.float64], ...],
    limits: Limits,
    gentle: Callable[[float], float] | None,
) -> Iterator[tuple[float, float, float]]:
    """Yield bounds of the derivatives of s that keep to the limits, from the greatest derivatives (k,) of a spline."""
    first, second, third = slopes
    for speed in (_USED * fastest * np.array(_SPEEDS)).tolist():
        most = ((_USED * limits.acceleration - second * speed**2) / first).min()
        most = most if gentle is None else min(most, gentle(speed))
        for acceleration in (most * np.array(_ACCELERATIONS)).tolist():
            bent = third * speed**3 + 3 * second * speed * acceleration
            jerk = float(((_USED * limits.jerk - bent) / first).min())
            if acceleration > 0 and jerk > 0:
                yield speed, acceleration, jerk


def _at_limit(phase: str, postures: NDArray[np.float64], limits: Limits) -> PathError:
    """Return the error of a line on which a joint moves where the arm lets it move no more."""
    least, greatest, _, _ = limits.slowing.T
    left = np.minimum(greatest - postures.max(axis=0), postures.min(axis=0) - least)
    sentence = f"in the phase {phase!r} {limits.joints[int(np.argmin(left))]} is at its limit"
    return PathError(f"no path to the grasp: {sentence}", phase, "at_limit", (sentence,))


def _gentle(
    knots: NDArray[np.float64], coefficients: NDArray[np.float64], limits: Limits, fastest: float
) -> Callable[[float], float] | None:
    """Return the greatest acceleration of s for a speed of s, since joints slow down; None if `fastest` is allowed."""
    low, high = knots[0], knots[-1]
    # Closest at both ends, where joints are slowest.
    s = low + (high - low) * (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _PLACES)))
    once = np.array([[low, 1.0, 0.0, 0.0]])
    positions, slopes = TimedPiece("", knots, coefficients, np.zeros(1), once, float(high - low)).at(s - low)[:2]
    with np.errstate(divide="ignore"):
        most = (limits.allowed(positions, slopes) / np.abs(slopes)).min(axis=1)
    if (most >= fastest).all():
        return None
    # Between two places holds the lesser of their speeds; no end of the piece is farther than this.
    most, far = np.minimum(most[:-1], most[1:]), np.minimum(s[1:] - low, high - s[:-1])

    def acceleration(speed: float) -> float:
        slow = most < speed
        return float((_USED * most[slow] ** 2 / (2 * far[slow])).min()) if slow.any() else np.inf

    return acceleration


def _spline(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the coefficients (n, 4, k) of the cubic spline through evenly spaced values (n + 1, k), not-a-knot."""
    count = len(values)
    slopes = np.diff(values, axis=0) / step
    if count == 2:
        bend = np.zeros_like(values)
    elif count == 3:
        bend = np.repeat((slopes[1:] - slopes[:-1]) / step, 3, axis=0)
    else:
        # Second derivatives at the knots.
        matrix = 4 * np.eye(count) + np.eye(count, k=1) + np.eye(count, k=-1)
        matrix[0, :3] = matrix[-1, -3:] = 1.0, -2.0, 1.0
        right = np.zeros_like(values)
        right[1:-1] = 6 / step * np.diff(slopes, axis=0)
        bend = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    linear = slopes - step / 6 * (2 * bend[:-1] + bend[1:])
    return np.stack([values[:-1], linear, bend[:-1] / 2, np.diff(bend, axis=0) / (6 * step)], axis=1)


def _greatest(coefficients: NDArray[np.float64], step: float) -> tuple[NDArray[np.float64], ...]:
    """Return the greatest absolute first, second and third derivative of a spline, (k,) each."""
    _, c1, c2, c3 = np.moveaxis(coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.nan_to_num(-c2 / (3 * c3), nan=0.0, posinf=0.0, neginf=0.0).clip(0, step)
    slopes = [np.abs(c1 + x * (2 * c2 + 3 * c3 * x)).max(axis=0) for x in (0.0, step, turn)]
    bends = [np.abs(2 * c2 + 6 * c3 * x).max(axis=0) for x in (0.0, step)]
    return np.maximum.reduce(slopes), np.maximum(*bends), np.abs(6 * c3).max(axis=0)


def _course(
    length: float, speed: float, acceleration: float, jerk: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return s(t) from rest to rest: times at which its pieces begin, s and its derivatives there, and the duration."""
    ruckig = imported("ruckig", NEED, "arm")
    wanted = ruckig.InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [length]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [speed], [acceleration], [jerk]
    found = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(wanted, found)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):  # not for positive limits
        raise RuntimeError(f"ruckig cannot time {length} with {speed}, {acceleration}, {jerk}: {result}")
    profile = found.profiles[0][0]
    starts = np.concatenate([[0.0], np.cumsum(profile.t)])[:-1]
    course = np.stack([profile.p[:-1], profile.v[:-1], profile.a[:-1], profile.j], axis=1)
    lasting = np.asarray(profile.t) > 0
    return starts[lasting], course[lasting], float(found.duration)
