"""Measures of how well networks judge."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["auc"]


def auc(scores: NDArray[np.float64], success: NDArray[np.bool_]) -> float:
    """Return the area under the ROC curve: the probability that a success scores above a failure; ties count half.

    1/2 if all outcomes are alike.
    """
    order = np.sort(scores)
    ranks = 0.5 * (np.searchsorted(order, scores, "left") + np.searchsorted(order, scores, "right"))
    good, bad = int(success.sum()), int((~success).sum())
    if not good or not bad:
        return 0.5
    return float((ranks[success].sum() - good * good / 2) / (good * bad))
