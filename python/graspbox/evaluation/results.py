"""Results of an evaluation: trials, counts, Wilson intervals."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.policies.published.calibration import calibration_error

__all__ = ["Evaluation", "ObjectCount", "ReliabilityBin", "TrialResult", "reliability", "wilson"]

#: 97.5 % quantile of the normal distribution.
_Z95 = 1.959963984540054


def wilson(succeeded: int, trials: int, z: float = _Z95) -> tuple[float, float]:
    """Wilson score interval of a rate.

    Parameters
    ----------
    succeeded, trials : int
        Number of successes, and of independent trials; at least one trial.
    z : float
        Quantile of the normal distribution; by default that of a 95 % interval.

    Raises
    ------
    ConfigError
        If there is no trial, or there are more successes than trials.

    Notes
    -----
    Source: Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927.
    """
    if trials < 1 or not 0 <= succeeded <= trials:
        raise ConfigError(
            f"{succeeded} of {trials} trials succeeded; there must be at least one trial and no more successes"
        )
    rate, weight = succeeded / trials, z * z / trials
    center = (rate + weight / 2) / (1 + weight)
    half = z / (1 + weight) * np.sqrt(rate * (1 - rate) / trials + weight / (4 * trials))
    # Exact values where the formula has rounding errors.
    low = 0.0 if succeeded == 0 else float(center - half)
    high = 1.0 if succeeded == trials else float(center + half)
    return low, high


@dataclass(frozen=True)
class ReliabilityBin:
    """Trials with similar predicted probabilities: the mean, the success rate, its 95 % interval, their number."""

    stated: float
    rate: float
    low: float
    high: float
    trials: int


def reliability(
    probabilities: NDArray[np.float64], held: NDArray[np.bool_], bins: int = 10, fewest: int = 5
) -> list[ReliabilityBin]:
    """Compare predicted probabilities with success rates, over bins of equal width with at least `fewest` trials."""
    stated = np.asarray(probabilities, dtype=np.float64)
    bin_of = np.minimum((stated * bins).astype(np.int64), bins - 1)
    groups = []
    for rows in (np.flatnonzero(bin_of == b) for b in range(bins)):
        if len(rows) >= max(fewest, 1):
            means, count = (float(stated[rows].mean()), float(held[rows].mean())), len(rows)
            groups.append(ReliabilityBin(*means, *wilson(int(held[rows].sum()), count), count))
    return groups


@dataclass(frozen=True)
class TrialResult:
    """One trial.

    Attributes
    ----------
    seed, object, steps, reward
        Seed of its episode, name of its object, number of actions, and sum of rewards.
    success, secure, survives_shake : bool
        As `graspbox.simulation` defines them; a secure grasp is a success too. `survives_shake` is False unless the
        environments apply a shake.
    failure : str
        Kind of the failure; empty for a success, ``goal_missed`` in goal tasks.
    fits : bool
        Whether the object's least width in plan view, as it rested, is within the width that the hand states
        (`graspbox.Hand.widest`); True for a hand that states none.
    confidence : float or None
        Probability of success predicted by the policy (`Policy.confidence`). Comparisons ignore it, because its last
        digits depend on the runtime of the policy's networks.
    """

    seed: int
    object: str
    success: bool
    secure: bool
    failure: str
    steps: int
    reward: float
    survives_shake: bool = False
    fits: bool = True
    confidence: float | None = field(default=None, compare=False)


@dataclass(frozen=True)
class ObjectCount:
    """Counts of one object: name, trials, successes and secure grasps."""

    name: str
    trials: int
    succeeded: int
    secure: int


@dataclass(frozen=True)
class Evaluation:
    """Result of an evaluation; two are equal if their trials are.

    Attributes
    ----------
    trials : tuple of TrialResult
        In the order of `trial_seeds`; empty if no object can be used.
    ms_per_decision : float
        Wall time of the policy per action, milliseconds; without the simulation.
    objects_given, objects_left_out : int
        Number of available objects, and number of those left out as training objects of the policy.
    refused : mapping
        Reasons why objects cannot be used, by name; no trial has such an object.
    settings : mapping or None
        Keywords of the environment that determine the trials, as JSON holds them, without objects and observations;
        None for environments on a server, and where a keyword has no such form.
    """

    policy: str
    env_id: str
    trials: tuple[TrialResult, ...]
    ms_per_decision: float = field(compare=False)
    objects_given: int = field(default=0, compare=False)
    objects_left_out: int = field(default=0, compare=False)
    refused: Mapping[str, str] = field(default_factory=dict, compare=False)
    condition: str = field(default="nominal", compare=False)
    settings: Mapping[str, Any] | None = field(default=None, compare=False)

    @property
    def succeeded(self) -> int:
        """Number of trials that succeeded."""
        return sum(trial.success for trial in self.trials)

    @property
    def secure(self) -> int:
        """Number of trials that ended with a secure grasp."""
        return sum(trial.secure for trial in self.trials)

    @property
    def shaken(self) -> int:
        """Number of trials whose object was still held after the shake."""
        return sum(trial.survives_shake for trial in self.trials)

    @property
    def rate(self) -> float:
        """Share of trials that succeeded; NaN without trials."""
        return self.succeeded / len(self.trials) if self.trials else math.nan

    @property
    def ci95(self) -> tuple[float, float]:
        """Wilson 95 % interval of `rate`; 0 to 1 without trials."""
        return wilson(self.succeeded, len(self.trials)) if self.trials else (0.0, 1.0)

    @property
    def secure_ci95(self) -> tuple[float, float]:
        """Wilson 95 % interval of the share of secure trials; 0 to 1 without trials."""
        return wilson(self.secure, len(self.trials)) if self.trials else (0.0, 1.0)

    @property
    def calibration_error(self) -> float | None:
        """Expected calibration error of the predicted probabilities, in ten bins.

        None if some trial has none, or there is no trial.
        """
        if (stated := self._stated()) is None:
            return None
        return calibration_error(stated, np.array([trial.success for trial in self.trials]))

    @property
    def mean_confidence(self) -> float | None:
        """Mean of the predicted probabilities of success; None if some trial has none, or there is no trial."""
        return None if (stated := self._stated()) is None else float(stated.mean())

    def _stated(self) -> NDArray[np.float64] | None:
        stated = [trial.confidence for trial in self.trials if trial.confidence is not None]
        return np.array(stated) if stated and len(stated) == len(self.trials) else None

    @property
    def fitting(self) -> "Evaluation":
        """The trials whose object fits the hand (`TrialResult.fits`)."""
        return replace(self, trials=tuple(trial for trial in self.trials if trial.fits))

    @property
    def failures(self) -> dict[str, int]:
        """Number of failures by kind, in alphabetical order."""
        return dict(sorted(Counter(trial.failure for trial in self.trials if not trial.success).items()))

    @property
    def objects(self) -> tuple[ObjectCount, ...]:
        """Counts of every object that was sampled, in alphabetical order."""
        counts = {name: Counter[str]() for name in sorted({trial.object for trial in self.trials})}
        for trial in self.trials:
            counts[trial.object].update(trials=1, succeeded=int(trial.success), secure=int(trial.secure))
        return tuple(ObjectCount(name, **count) for name, count in counts.items())

    def to_json(self) -> dict[str, Any]:
        """Values for JSON, as ``graspbox evaluate --json`` prints them; ``rate`` is null without trials."""
        fitting = self.fitting
        return {
            "policy": self.policy,
            "condition": self.condition,
            "trials": len(self.trials),
            "succeeded": self.succeeded,
            "secure": self.secure,
            "rate": self.rate if self.trials else None,
            "ci95": list(self.ci95),
            "fitting": {"trials": len(fitting.trials), "succeeded": fitting.succeeded, "secure": fitting.secure},
            "objects": [{"name": o.name, "trials": o.trials, "succeeded": o.succeeded} for o in self.objects],
            "failures": self.failures,
            "objects_left_out": self.objects_left_out,
            "refused": dict(self.refused),
            "mean_confidence": self.mean_confidence,
            "calibration_error": self.calibration_error,
            "ms_per_decision": self.ms_per_decision,
        }
