"""Measures of the agreement of two lists of results."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def kappa(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Return the agreement of two lists of labels beyond chance (Cohen 1960); 1 if all labels are the same."""
    agreed = float(np.mean(first == second))
    by_chance = float(first.mean() * second.mean() + (1 - first.mean()) * (1 - second.mean()))
    return 1.0 if by_chance == 1 else (agreed - by_chance) / (1 - by_chance)


def ranks(values: ArrayLike) -> NDArray[np.float64]:
    """Return ranks from 1; equal values get the mean of their ranks."""
    _, place, counts = np.unique(np.asarray(values), return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return np.asarray((last - 0.5 * (counts - 1))[place], dtype=np.float64)


def spearman(first: ArrayLike, second: ArrayLike) -> float:
    """Return the rank correlation (Spearman 1904): Pearson's of the ranks; NaN if all values of a list are equal."""
    a, b = ranks(first), ranks(second)
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else float("nan")
