"""Settings of the protocol, and the verdicts on one grasp."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspbox.configs import TrialConfig

Array = NDArray[np.float64]

#: The pulls, as unit vectors of the world, in the order in which the core makes them.
PULLS: Array = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=np.float64)


@dataclass(frozen=True)
class ForceConfig:
    """The protocol: six pulls on an object in the air, and a lift off the table.

    The defaults are those of DexGraspBench, with the closing and lifting times of a trial.

    Attributes
    ----------
    acceleration : float
        Force by the object's mass, m/s2, 0 to 1000.
    pull_time : float
        Duration of each pull, seconds, 0 to 60.
    close_time, lift_time : float
        Times to close and to lift, seconds, 0.1 to 10.
    lift_height : float
        Height to lift, metres, 0 to 1.
    max_shift, max_turn : float
        Greatest translation of the object's centre of mass (metres, 0.0001 to 1) and rotation (radians, 0.001 to pi).
    max_depth : float
        Greatest overlap of hand and object at the start, metres, 0 to 0.1.
    mass : float or None
        Mass of the object, kg; None for its own.
    friction : float or None
        Coefficient of friction between the object and the pads of the hand, which scales that with bare surfaces and
        the table alike; None for that of the scene.
    """

    acceleration: float = 10.0
    pull_time: float = 2.0
    close_time: float = TrialConfig.close_time
    lift_height: float = 0.1
    lift_time: float = TrialConfig.lift_time
    max_shift: float = 0.05
    max_turn: float = 15.0 * math.pi / 180.0
    max_depth: float = 0.01
    mass: float | None = 0.1
    friction: float | None = 0.6


@dataclass(frozen=True)
class Contact:
    """A contact of hand and object.

    Attributes
    ----------
    link : int
        Index of the link.
    point : (3,) float64
        Position, metres, in one frame for all contacts of a grasp.
    inward : (3,) float64
        Unit normal into the object: the direction of the force on it.
    friction : float
        Coefficient of friction.
    """

    link: int
    point: Array
    inward: Array
    friction: float


@dataclass(frozen=True)
class Verdict:
    """What the protocol says of one grasp.

    Attributes
    ----------
    passes : bool
        No pull moved the object beyond the limits since the start, before the hand closed: the benchmark's verdict.
    holds : bool
        No pull moved it beyond the limits since the hand closed.
    lifts, keeps : bool
        The same two verdicts for the lift off the table.
    shift, turn : (7,) float64
        Motion since the hand closed at the end of each pull and of the lift, metres and radians; NaN if the hand was
        too deep in the object to begin.
    start_depth, closed_depth : float
        Overlap of hand and object at the start, and once closed (NaN if it did not begin), metres.
    contacts : list of Contact
        Of the object in the air with the closed hand.
    """

    passes: bool
    holds: bool
    lifts: bool
    keeps: bool
    shift: Array
    turn: Array
    start_depth: float
    closed_depth: float
    contacts: list[Contact] = field(default_factory=list)

    @property
    def links(self) -> int:
        """Number of links that touch the object once the hand is closed in the air."""
        return len({contact.link for contact in self.contacts})

    @classmethod
    def refused(cls, depth: float) -> Verdict:
        """Return the verdict on a hand that is too deep in the object, by `depth` metres, to begin."""
        nothing = np.full(len(PULLS) + 1, np.nan)
        return cls(False, False, False, False, nothing, nothing, depth, float("nan"))
