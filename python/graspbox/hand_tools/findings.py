"""A finding, and the hand that checks look at."""

import tomllib
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspbox.hand_tools.urdf import Tree, read_tree
from graspbox.hands import Hand

__all__ = ["SEVERITIES", "CheckedHand", "Finding", "Severity", "value_of"]

Floats = NDArray[np.float64]
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


@dataclass(frozen=True)
class CheckedHand:
    """A hand with its files as plain values, which the core has checked.

    Attributes
    ----------
    hand : Hand
        The hand.
    tree : Tree
        Its links and joints.
    table : dict
        Its ``hand.toml``.
    """

    hand: Hand
    tree: Tree
    table: dict[str, Any]

    @classmethod
    def of(cls, hand: Hand) -> "CheckedHand":
        """Read the files of a hand."""
        urdf, toml = hand.files
        return cls(hand, read_tree(urdf), tomllib.loads(toml))

    @cached_property
    def start(self) -> Floats:
        """Positions (c,) of the independent joints of the open hand with its first preshape, rad or m."""
        return np.asarray(self.hand.open(self.preshapes[0][1]))

    @cached_property
    def preshapes(self) -> tuple[tuple[str, float], ...]:
        """Names and values of the preshapes, by value."""
        return tuple(sorted(self.hand.preshapes.items(), key=lambda item: item[1]))

    @cached_property
    def bodies(self) -> NDArray[np.int64]:
        """For each collision shape, the row of the joint that carries it; -1 for the palm. (n,)."""
        return np.asarray(self.hand.shapes(self.start)[3])

    @cached_property
    def pads(self) -> NDArray[np.bool_]:
        """Which collision shapes are pads, (n,)."""
        return np.asarray(self.hand.shapes(self.start)[2])

    @cached_property
    def chains(self) -> NDArray[np.int64]:
        """For each collision shape, the index of its chain; -1 for the palm. (n,)."""
        of_joint = self.hand.joint_frames(self.start)[1]
        return np.array([of_joint[row] if row >= 0 else -1 for row in self.bodies], dtype=np.int64)

    @cached_property
    def shape_names(self) -> tuple[str, ...]:
        """Names of the collision shapes; those of a link whose mesh became several boxes are named after the link."""
        links = [(collider, body) for link, body in zip(self.tree.links, self.tree.body_of, strict=True)
                 for collider in link.colliders]  # fmt: skip
        if [body for _, body in links] == self.bodies.tolist():
            return tuple(name for name, _ in links)
        return tuple(self.tree.body_name(int(body)) for body in self.bodies)

    @cached_property
    def closing(self) -> tuple[str, ...]:
        """Names of the actuators that close the hand."""
        return tuple(self.table["grasp"]["closing"])


def value_of(owner: dict[str, Any], key: str, default: float) -> float:
    """Return the value of an optional quantity in a table of ``hand.toml``."""
    return float(owner[key]["value"]) if key in owner else default
