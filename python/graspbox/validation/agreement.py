"""How far two lists of results agree."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def kappa(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Agreement of two lists of labels beyond chance (Cohen 1960); 1 where both have one label only and agree."""
    agreed = float(np.mean(first == second))
    by_chance = float(first.mean() * second.mean() + (1 - first.mean()) * (1 - second.mean()))
    return 1.0 if by_chance == 1 else (agreed - by_chance) / (1 - by_chance)


def ranks(values: ArrayLike) -> NDArray[np.float64]:
    """Ranks from 1; equal values share the mean of theirs."""
    _, place, counts = np.unique(np.asarray(values), return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return np.asarray((last - 0.5 * (counts - 1))[place], dtype=np.float64)


def spearman(first: ArrayLike, second: ArrayLike) -> float:
    """Rank correlation (Spearman 1904): Pearson's of the ranks; NaN where one list has a single value."""
    a, b = ranks(first), ranks(second)
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else float("nan")
