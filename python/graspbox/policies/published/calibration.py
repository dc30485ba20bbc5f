"""Calibration of a scorer's logits to the success rate of the grasps that it chooses; no torch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import check_range
from graspbox.errors import ConfigError

__all__ = ["CAUTION", "OTHERS", "Calibration", "calibration_error", "check_line", "fit_logits"]

#: An ensemble's logit is its mean minus this many standard deviations.
CAUTION = 0.5
#: Penalty on the logit of grasps that the ensemble does not score.
OTHERS = 1.0
#: Prior of the fit: slope 1 and offset 0 weigh as much as this many grasps.
_PRIOR = 4.0
_ITERATIONS = 50
#: Largest magnitude of slopes, offsets and weights.
_LARGEST = 1000.0


@dataclass(frozen=True)
class Calibration:
    """Maps logits to probabilities and to the score by which grasps are chosen.

    `success` and `secure` are slope (one over the temperature, positive) and offset of the logits of success and of a
    secure hold; grasps are chosen by (success + w secure) / (1 + w) with w = `secure_weight`.
    """

    success: tuple[float, float] = (1.0, 0.0)
    secure: tuple[float, float] = (1.0, 0.0)
    secure_weight: float = 0.3

    def __post_init__(self) -> None:
        for name in ("success", "secure"):
            check_line(name, getattr(self, name))
        check_range(self, "secure_weight", 0.0, _LARGEST)


def check_line(name: str, pair: tuple[float, float]) -> None:
    """Refuse slope and offset of a logit unless the slope is positive and both are at most 1,000 in magnitude."""
    if len(pair) != 2 or not (0.0 < pair[0] <= _LARGEST and abs(pair[1]) <= _LARGEST):
        raise ConfigError(f"{name} is {pair}; pass a positive slope and an offset, at most {_LARGEST:g}")


def fit_logits(logits: NDArray[np.float64], held: NDArray[np.bool_]) -> tuple[float, float]:
    """Fit slope, at least 0.05, and offset so that logits (m,) of chosen grasps predict whether they held, (m,).

    They minimize the cross-entropy (Newton's method). A weak prior towards 1 and 0 keeps them finite for few grasps or
    uniform outcomes. Raises ConfigError if there are no grasps.
    """
    if not len(logits):
        raise ConfigError("there are no grasps to calibrate on; pass some")
    inputs = np.stack([np.asarray(logits, dtype=np.float64), np.ones(len(logits))], axis=1)
    start = np.array([1.0, 0.0])
    line = start.copy()
    for _ in range(_ITERATIONS):
        shares = 1.0 / (1.0 + np.exp(-np.clip(inputs @ line, -30.0, 30.0)))
        slope = inputs.T @ (shares - held) + _PRIOR * (line - start)
        curve = (inputs * (shares * (1.0 - shares))[:, None]).T @ inputs + _PRIOR * np.eye(2)
        step = np.linalg.solve(curve, slope)
        # A Newton step far from the solution may be too long.
        line -= step / max(1.0, float(np.abs(step).max()))
        if np.abs(step).max() < 1e-10:
            break
    return float(max(line[0], 0.05)), float(line[1])


def calibration_error(probabilities: NDArray[np.float64], held: NDArray[np.bool_], bins: int = 10) -> float:
    """Return the expected calibration error: mean gap between predicted and observed rates, over bins of equal width.

    Raises ConfigError if there are no grasps.
    """
    if not len(probabilities):
        raise ConfigError("there are no grasps to measure the calibration with; pass some")
    bin_of = np.minimum((np.asarray(probabilities) * bins).astype(np.int64), bins - 1)
    stated, true = (np.bincount(bin_of, weights, minlength=bins) for weights in (probabilities, held))
    return float(np.abs(stated - true).sum() / len(probabilities))
