"""A finding, and the hand under check."""

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspbox.hand_tools.bodies import Floats, HandBodies

__all__ = ["SEVERITIES", "CheckedHand", "Finding", "Severity"]

Severity = Literal["error", "warning", "note"]
#: Severities, the gravest first.
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """One finding of `graspbox.hand_tools.check_hand`.

    Attributes
    ----------
    severity : {"error", "warning", "note"}
        An error makes the hand useless in simulation; a warning is probably a mistake; a note is worth knowing.
    check : str
        Name of the check, such as ``self-collision``.
    subject : str
        The link, joint, actuator or object.
    value : str
        The value with its unit; empty where there is none.
    message : str
        The problem, and why it matters.
    remedy : str
        What to change; empty for a fact.
    """

    severity: Severity
    check: str
    subject: str
    value: str
    message: str
    remedy: str = ""

    def row(self) -> dict[str, str]:
        """Return the fields, as ``graspbox hand check --json`` prints them."""
        return asdict(self)


class CheckedHand(HandBodies):
    """A hand under check."""

    @cached_property
    def preshapes(self) -> tuple[tuple[str, float], ...]:
        """Names and values of the preshapes, by value."""
        return tuple(sorted(self.hand.preshapes.items(), key=lambda item: item[1]))

    @cached_property
    def start(self) -> Floats:
        """Positions (c,) of the independent joints of the open hand with its first preshape, rad or m."""
        return self.hand.open(self.preshapes[0][1])

    @cached_property
    def chains(self) -> NDArray[np.int64]:
        """For each collision shape, the index of its chain; -1 for the palm. (n,)."""
        # The palm's row, -1, is the last.
        return np.append(self.hand.joint_frames(self.start)[1], -1)[self.bodies]
