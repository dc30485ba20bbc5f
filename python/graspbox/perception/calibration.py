"""Calibration: what makes a scorer's logits say how often the grasps that it chooses hold; no torch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = ["CAUTION", "OTHERS", "Calibration", "calibration_error", "fit_logits"]

#: An ensemble's logit is its mean minus this many standard deviations.
CAUTION = 0.5
#: What grasps that the ensemble does not judge lose in logit.
OTHERS = 1.0
#: Grasps with which the fit begins: slope 1 and offset 0 count as much as this many.
_PRIOR = 4.0
_ITERATIONS = 50


@dataclass(frozen=True)
class Calibration:
    """From logits to probabilities, and to what grasps are chosen by.

    Attributes
    ----------
    success, secure : pair of float
        Slope (one over the temperature, positive) and offset of the logit of success, and of a secure hold.
    secure_weight : float
        Grasps are chosen by (success + weight * secure) / (1 + weight).
    """

    success: tuple[float, float] = (1.0, 0.0)
    secure: tuple[float, float] = (1.0, 0.0)
    secure_weight: float = 0.3

    def __post_init__(self) -> None:
        for name in ("success", "secure"):
            pair = getattr(self, name)
            if len(pair) != 2 or not np.isfinite(pair).all() or not pair[0] > 0.0:
                raise ConfigError(f"{name} is {pair}; give a positive slope and an offset")
        if not 0.0 <= self.secure_weight < float("inf"):
            raise ConfigError(f"secure_weight is {self.secure_weight}; give 0 or more")


def fit_logits(logits: NDArray[np.float64], held: NDArray[np.bool_]) -> tuple[float, float]:
    """Find slope and offset that make logits say how often grasps hold.

    Parameters
    ----------
    logits : (m,) float64
        Of chosen grasps.
    held : (m,) bool
        Whether they held.

    Returns
    -------
    float, float
        Slope, at least 0.05, and offset, of the least cross-entropy (Newton's method), with a weak pull towards 1 and
        0: on few grasps, or grasps that all ended alike, they stay finite.

    Raises
    ------
    ConfigError
        If there are no grasps.
    """
    if not len(logits):
        raise ConfigError("there are no grasps to calibrate on; give some")
    inputs = np.stack([np.asarray(logits, dtype=np.float64), np.ones(len(logits))], axis=1)
    start = np.array([1.0, 0.0])
    found = start.copy()
    for _ in range(_ITERATIONS):
        shares = 1.0 / (1.0 + np.exp(-np.clip(inputs @ found, -30.0, 30.0)))
        slope = inputs.T @ (shares - held) + _PRIOR * (found - start)
        curve = (inputs * (shares * (1.0 - shares))[:, None]).T @ inputs + _PRIOR * np.eye(2)
        step = np.linalg.solve(curve, slope)
        # A step of Newton's method far from the solution may be too long.
        found -= step / max(1.0, float(np.abs(step).max()))
        if np.abs(step).max() < 1e-10:
            break
    return float(max(found[0], 0.05)), float(found[1])


def calibration_error(probabilities: NDArray[np.float64], held: NDArray[np.bool_], bins: int = 10) -> float:
    """Give the expected calibration error: the mean distance of stated and true shares, over bins of equal width.

    Raises
    ------
    ConfigError
        If there are no grasps.
    """
    if not len(probabilities):
        raise ConfigError("there are no grasps to measure the calibration with; give some")
    bin_of = np.minimum((np.asarray(probabilities) * bins).astype(np.int64), bins - 1)
    stated, true = (np.bincount(bin_of, weights, minlength=bins) for weights in (probabilities, held))
    return float(np.abs(stated - true).sum() / len(probabilities))
