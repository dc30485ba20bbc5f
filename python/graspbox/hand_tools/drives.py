"""Actuators and sensors: travel that misses limits, servos and force control that do not settle."""

from collections.abc import Iterator

import numpy as np

from graspbox.configs import PhysicsConfig
from graspbox.hand_tools.bodies import inertia_of
from graspbox.hand_tools.findings import CheckedHand, Finding, Severity
from graspbox.hands.description import Actuator

__all__ = ["sensors", "stability", "travels"]

#: Share of a joint's range by which travel may miss it.
_MISSED = 0.02
#: The same for the tendon that a spool winds.
_TENDON = 0.05
#: Least share of the critical damping of a servo, and greatest time in which it settles, seconds.
_DAMPING, _SLOWEST = 0.1, 0.5


def travels(checked: CheckedHand) -> Iterator[Finding]:
    """Find actuators whose travel misses the limits of their joints."""
    for actuator in checked.described.actuators:
        if actuator.spool is not None:
            yield from _spool(checked, actuator, actuator.spool)
        for driven, ratio, offset in actuator.joints:
            joint = checked.described.links[driven]
            (low, high), (least, most) = sorted(ratio * end + offset for end in actuator.travel), joint.limits
            subject, value = f"actuator {actuator.name}, joint {joint.joint}", f"[{low:.4g}, {high:.4g}] {joint.unit}"
            missed, allowed = _MISSED * (most - least), f"[{least:.4g}, {most:.4g}]"
            if max(low - least, most - high) > missed:
                severity: Severity = "warning" if actuator.closes else "note"
                message = f"it does not cover the joint's limits {allowed}: the hand never opens or closes completely"
                remedy = "correct `travel`, `ratio` or `offset`: the joint is at offset + ratio x position"
                yield Finding(severity, "travel", subject, value, message, remedy)
            if max(least - low, high - most) > missed:
                message = f"it goes beyond the joint's limits {allowed}, and presses it against its stop"
                remedy = "correct `travel`, `ratio` or `offset` unless the real hand does this"
                yield Finding("note", "travel", subject, value, message, remedy)


def _spool(checked: CheckedHand, actuator: Actuator, spool: tuple[int, float]) -> Iterator[Finding]:
    """Compare the tendon that a spool winds with the one that its joints take up, from open to closed."""
    hand, (tendon, radius) = checked.hand, spool
    wound = (actuator.travel[1] - actuator.travel[0]) * radius
    names = [link.joint for link in checked.described.links]
    arms = {names[joint]: arm for joint, arm in checked.described.tendons[tendon].arms}
    motion = hand.closed(checked.preshapes[0][1], 1.0) - checked.start
    needed = sum(arms.get(name, 0.0) * float(moved) for name, moved in zip(hand.joints, motion, strict=True))
    if wound < (1 - _TENDON) * needed:
        message = (
            f"it winds less of its tendon than the {needed * 1e3:.3g} mm that its joints take up: the hand never "
            "closes completely"
        )
        remedy = "correct `travel`, the radius of the spool, or the moment arms"
        yield Finding("warning", "travel", f"actuator {actuator.name}", f"{wound * 1e3:.3g} mm", message, remedy)


def stability(checked: CheckedHand) -> Iterator[Finding]:
    """Find force control that is too fast for the time step, and servos that ring or creep.

    An actuator under force control moves by ``force_gain`` times the error of its load per second, and its load rises
    by the stiffness of its tendon or servo: the error shrinks by their product times the step. Servos themselves are
    integrated implicitly, and are stable with any step.
    """
    step = PhysicsConfig().dt
    for actuator in checked.described.actuators:
        stiffness = _stiffness(checked, actuator)
        if stiffness is None:
            continue
        share = actuator.force_gain * stiffness * step
        if share > 1.0:
            message = (
                f"with its {'servo' if actuator.spool is None else 'tendon'}'s stiffness a step of {1e3 * step:.0f} ms "
                f"corrects {share:.1f} times the force's error, which {'diverges' if share > 2 else 'oscillates'}"
            )
            remedy = f"use at most {0.2 / (stiffness * step):.2g}: a time constant of 5 steps"
            subject, value = f"actuator {actuator.name}", f"force_gain {actuator.force_gain:.3g}"
            yield Finding("error" if share > 2.0 else "warning", "stability", subject, value, message, remedy)
        if actuator.servo is not None:
            yield from _servo(checked, actuator, actuator.servo)


def _stiffness(checked: CheckedHand, actuator: Actuator) -> float | None:
    """Return the rise of the load per position, N m/rad, N/m or N/rad; None for a rigid drive."""
    if actuator.spool is not None:
        tendon, radius = actuator.spool
        return checked.described.tendons[tendon].stiffness * radius
    if actuator.servo is not None:
        return actuator.servo[0] * max(abs(ratio) for _, ratio, _ in actuator.joints)
    return None


def _servo(checked: CheckedHand, actuator: Actuator, servo: tuple[float, float]) -> Iterator[Finding]:
    stiffness, own = servo
    for driven, _, _ in actuator.joints:
        joint = checked.described.links[driven]
        damping = own + joint.spring.damping
        inertia = inertia_of(checked.hand, checked.hand.joints.index(joint.joint), checked.start)
        critical = 2 * float(np.sqrt(stiffness * (inertia + joint.spring.armature)))
        if damping < _DAMPING * critical:
            message = f"it is {damping / critical:.0%} of the critical damping: the finger rings when it stops"
        elif damping / stiffness > _SLOWEST:
            duration = damping / stiffness
            message = f"the joint creeps to its goal in {duration:.2g} s, so the hand lifts before it has closed"
        else:
            continue
        subject = f"actuator {actuator.name}, joint {joint.joint}"
        value = f"damping {own:.3g} {'N s/m' if joint.kind == 'prismatic' else 'N m s/rad'}"
        remedy = f"use about {critical:.3g}: 2 sqrt(stiffness x inertia and armature)"
        yield Finding("warning", "stability", subject, value, message, remedy)


def sensors(checked: CheckedHand) -> Iterator[Finding]:
    """Report missing tactile sensors and joint encoders."""
    if not checked.described.sensors:
        message, remedy = "environments have no observation `tactile`", "add `[[sensors]]` if the real hand has some"
        yield Finding("note", "sensors", "tactile sensors", "none", message, remedy)
    if not any(link.encoder for link in checked.described.links):
        message = "joint positions are privileged observations: policies for the real hand do not see them"
        remedy = "set `encoder = true` in the `[joints]` tables of measured joints"
        yield Finding("note", "sensors", "joint encoders", "none", message, remedy)
