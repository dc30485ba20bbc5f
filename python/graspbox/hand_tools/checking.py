"""All checks of a hand, in the order in which their findings help."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from graspbox._common.files import read_bounded
from graspbox.errors import GraspboxError
from graspbox.hand_tools import drives, motion, numbers
from graspbox.hand_tools.findings import SEVERITIES, CheckedHand, Finding
from graspbox.hand_tools.trials import trials as run_trials
from graspbox.hands import HandLike, load_hand
from graspbox.hands.description import describe_wrong_urdf
from graspbox.hands.urdf_meshes import LARGEST

__all__ = ["HandReport", "check_hand", "unit_findings"]

_CHECKS: tuple[Callable[[CheckedHand], Iterator[Finding]], ...] = (
    lambda checked: numbers.units(checked.described.links),
    numbers.sizes,
    numbers.limits,
    numbers.inertias,
    drives.travels,
    drives.stability,
    motion.pads,
    motion.meeting,
    motion.overlaps,
    motion.extent,
    drives.sensors,
)


@dataclass(frozen=True)
class HandReport:
    """Findings about the hand `name`, the gravest first."""

    name: str
    findings: tuple[Finding, ...]

    @property
    def has_errors(self) -> bool:
        """Whether any finding is an error."""
        return any(finding.severity == "error" for finding in self.findings)

    def table(self) -> dict[str, object]:
        """Return counts and findings, as ``graspbox hand check --json`` prints them."""
        counts = {severity: sum(f.severity == severity for f in self.findings) for severity in SEVERITIES}
        return {"hand": self.name, "counts": counts, "findings": [finding.row() for finding in self.findings]}


def check_hand(hand: HandLike, *, trials: bool = True, seed: int = 0) -> HandReport:
    """Check a hand: units, limits, inertias, actuators, closing motion, reach, sensors, planner and trials.

    Parameters
    ----------
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`, which raises the errors.
    trials : bool
        Whether to plan and simulate a few grasps, which takes seconds.
    seed : int
        Seed of the planner.
    """
    checked = CheckedHand(load_hand(hand))
    findings = [finding for check in _CHECKS for finding in check(checked)]
    if trials:
        findings += [*motion.emptied(checked), *run_trials(checked, seed)]
    return HandReport(checked.hand.name, tuple(sorted(findings, key=lambda f: SEVERITIES.index(f.severity))))


def unit_findings(urdf: str | os.PathLike[str]) -> tuple[Finding, ...]:
    """Return wrong units of a URDF that cannot be loaded, which often explain its errors; none if it cannot be read."""
    try:
        links = describe_wrong_urdf(read_bounded(urdf, LARGEST).decode(errors="replace"))
    except GraspboxError:
        return ()
    return tuple(finding for finding in numbers.units(links) if finding.severity != "note") if links else ()
