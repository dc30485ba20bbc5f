"""Actuators and sensors: travel that misses limits, servos and force control that do not settle."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from graspbox.configs import PhysicsConfig
from graspbox.hand_tools.findings import CheckedHand, Finding, value_of

__all__ = ["sensors", "stability", "travels"]

#: Share of a joint's range by which travel may miss it.
_MISSED = 0.02
#: The same for the tendon that a spool winds.
_TENDON = 0.05
#: Ranges of damping ratios of a servo, and greatest time in which it settles, seconds.
_DAMPING, _SLOWEST = 0.1, 0.5


def travels(checked: CheckedHand) -> Iterator[Finding]:
    """Find actuators whose travel misses the limits of their joints."""
    joints = {joint.name: joint for joint in checked.tree.moving}
    for actuator in checked.table["actuators"]:
        low, high = map(float, actuator["travel"]["value"])
        closes = actuator["name"] in checked.closing
        if "spool" in actuator:
            yield from _spool(checked, actuator, high - low)
        for name, driven in _driven(actuator).items():
            ratio, offset = float(driven["ratio"]["value"]), value_of(driven, "offset", 0.0)
            joint = joints[name]
            led = sorted((ratio * low + offset, ratio * high + offset))
            span = joint.limits[1] - joint.limits[0]
            short = max(led[0] - joint.limits[0], joint.limits[1] - led[1])
            beyond = max(joint.limits[0] - led[0], led[1] - joint.limits[1])
            value = f"[{led[0]:.4g}, {led[1]:.4g}] {joint.unit}"
            allowed = f"[{joint.limits[0]:.4g}, {joint.limits[1]:.4g}]"
            if short > _MISSED * span:
                yield Finding(
                    "warning" if closes else "note",
                    "travel",
                    f"actuator {actuator['name']}, joint {name}",
                    value,
                    f"it does not cover the joint's limits {allowed}: the hand never opens or closes completely",
                    "correct `travel`, `ratio` or `offset`: the joint is at offset + ratio x position",
                )
            if beyond > _MISSED * span:
                yield Finding(
                    "note",
                    "travel",
                    f"actuator {actuator['name']}, joint {name}",
                    value,
                    f"it goes beyond the joint's limits {allowed}, and presses it against its stop",
                    "correct `travel`, `ratio` or `offset` unless the real hand does this",
                )


def _driven(actuator: dict[str, Any]) -> dict[str, Any]:
    driven: dict[str, Any] = (actuator.get("servo") or actuator.get("rigid") or {}).get("joints", {})
    return driven


def _spool(checked: CheckedHand, actuator: dict[str, Any], turns: float) -> Iterator[Finding]:
    """Compare the tendon that a spool winds with the one that its joints take up, from open to closed."""
    hand, spool = checked.hand, actuator["spool"]
    wound = turns * float(spool["radius"]["value"])
    arms = {name: float(arm["value"]) for name, arm in checked.table["tendons"][spool["tendon"]]["arms"].items()}
    motion = hand.closed(checked.preshapes[0][1], 1.0) - hand.open(checked.preshapes[0][1])
    needed = sum(arms.get(name, 0.0) * float(way) for name, way in zip(hand.joints, motion, strict=True))
    if wound < (1 - _TENDON) * needed:
        yield Finding(
            "warning",
            "travel",
            f"actuator {actuator['name']}",
            f"{wound * 1e3:.3g} mm",
            f"it winds less of its tendon than the {needed * 1e3:.3g} mm that its joints take up: the hand never "
            "closes completely",
            "correct `travel`, the radius of the spool, or the moment arms",
        )


def stability(checked: CheckedHand) -> Iterator[Finding]:
    """Find force control that is too fast for the time step, and servos that ring or creep.

    An actuator under force control moves by ``force_gain`` times the error of its load per second, and its load rises
    by the stiffness of its tendon or servo: the error shrinks by their product times the step. Servos themselves are
    integrated implicitly, and are stable with any step.
    """
    step = PhysicsConfig().dt
    for actuator in checked.table["actuators"]:
        stiffness = _stiffness(checked, actuator)
        if stiffness is None:
            continue
        gain = float(actuator["force_gain"]["value"])
        share = gain * stiffness * step
        if share > 1.0:
            yield Finding(
                "error" if share > 2.0 else "warning",
                "stability",
                f"actuator {actuator['name']}",
                f"force_gain {gain:.3g}",
                f"with its {'tendon' if 'spool' in actuator else 'servo'}'s stiffness a step of {1e3 * step:.0f} ms "
                f"corrects {share:.1f} times the force's error, which {'diverges' if share > 2 else 'oscillates'}",
                f"give at most {0.2 / (stiffness * step):.2g}: a time constant of 5 steps",
            )
        if "servo" in actuator:
            yield from _servo(checked, actuator)


def _stiffness(checked: CheckedHand, actuator: dict[str, Any]) -> float | None:
    """Return how fast the load rises with the position, N m/rad, N/m or N/rad; None for a rigid drive."""
    if "spool" in actuator:
        tendon = checked.table["tendons"][actuator["spool"]["tendon"]]
        return float(tendon["stiffness"]["value"]) * float(actuator["spool"]["radius"]["value"])
    if "servo" in actuator:
        ratios = [abs(float(driven["ratio"]["value"])) for driven in _driven(actuator).values()]
        return float(actuator["servo"]["stiffness"]["value"]) * max(ratios)
    return None


def _servo(checked: CheckedHand, actuator: dict[str, Any]) -> Iterator[Finding]:
    stiffness = float(actuator["servo"]["stiffness"]["value"])
    own = float(actuator["servo"]["damping"]["value"])
    for name in _driven(actuator):
        group = _group(checked, name)
        damping = own + value_of(group, "damping", 0.0)
        inertia = checked.tree.inertia_of(checked.hand.joints.index(name), checked.start)
        inertia += value_of(group, "armature", 0.0)
        critical = 2 * float(np.sqrt(stiffness * inertia))
        unit = "N s/m" if checked.tree.independent[checked.hand.joints.index(name)].kind == "prismatic" else "N m s/rad"
        subject, value = f"actuator {actuator['name']}, joint {name}", f"damping {own:.3g} {unit}"
        if damping < _DAMPING * critical:
            yield Finding(
                "warning",
                "stability",
                subject,
                value,
                f"it is {damping / critical:.0%} of the critical damping: the finger rings when it stops",
                f"give about {critical:.3g}: 2 sqrt(stiffness x inertia and armature)",
            )
        elif damping / stiffness > _SLOWEST:
            yield Finding(
                "warning",
                "stability",
                subject,
                value,
                f"the joint creeps to its goal in {damping / stiffness:.2g} s, so the hand lifts before it has closed",
                f"give about {critical:.3g}: 2 sqrt(stiffness x inertia and armature)",
            )


def _group(checked: CheckedHand, joint: str) -> dict[str, Any]:
    """Return the table of `[joints]` that a joint belongs to; empty if it has none."""
    for name, group in checked.table.get("joints", {}).items():
        if joint in group.get("names", [name]):
            return dict(group)
    return {}


def sensors(checked: CheckedHand) -> Iterator[Finding]:
    """State missing tactile sensors and joint encoders."""
    if not checked.table.get("sensors"):
        yield Finding(
            "note",
            "sensors",
            "tactile sensors",
            "none",
            "environments have no observation `tactile`",
            "add `[[sensors]]` if the real hand has some",
        )
    if not any(group.get("encoder") for group in checked.table.get("joints", {}).values()):
        yield Finding(
            "note",
            "sensors",
            "joint encoders",
            "none",
            "joint positions are privileged observations: policies for the real hand do not see them",
            "give `encoder = true` in the `[joints]` tables of measured joints",
        )
