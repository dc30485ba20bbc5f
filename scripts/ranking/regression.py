"""Logistic regression of success on features of poses, with one intercept per object; the rank of held-out objects."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FOLDS = 6
#: Ridge on the intercepts; it keeps those of objects without a success, or without a failure, finite.
INTERCEPT_RIDGE = 0.3
#: Standard deviation below which a feature is uninformative.
NEARLY_CONSTANT = 0.02


def fit(features: Array, success: Array, objects: NDArray[np.int64], ridge: float) -> Array:
    """Fit the weights (k,) to features (n, k), success (n,) of 0 and 1, and object numbers (n,).

    `ridge` applies to the weights of standardized features.
    """
    scale = features.std(axis=0)
    # A feature that hardly varies gets no weight.
    scale[scale < NEARLY_CONSTANT] = np.inf
    indicators = (objects[:, None] == np.unique(objects)).astype(np.float64)
    x = np.hstack([(features - features.mean(axis=0)) / scale, indicators])
    penalty = np.concatenate([np.full(features.shape[1], ridge), np.full(indicators.shape[1], INTERCEPT_RIDGE)])
    w = np.zeros(x.shape[1])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ w, -30.0, 30.0)))
        gradient = x.T @ (p - success) + penalty * w
        step = np.linalg.solve((x.T * (p * (1.0 - p))) @ x + np.diag(penalty), gradient)
        w -= step
        if np.abs(step).max() < 1e-9:
            break
    weights: Array = w[: features.shape[1]] / scale
    return weights


def judge(score: Array, success: Array, objects: NDArray[np.int64]) -> dict[str, float]:
    """Evaluate a score: success rate of the first pose per object, and share of its pairs in the right order."""
    first, pairs = [], []
    for number in np.unique(objects):
        mine = objects == number
        first.append(success[mine][np.argmax(score[mine])])
        good, bad = score[mine & (success == 1)], score[mine & (success == 0)]
        if len(good) and len(bad):
            pairs.append(np.mean((good[:, None] > bad) + 0.5 * (good[:, None] == bad)))
    return {"first": float(np.mean(first)), "pairs": float(np.mean(pairs))}


def held_out(features: Array, success: Array, objects: NDArray[np.int64], ridge: float, seed: int) -> Array:
    """Score each object by weights fitted without it."""
    fold = np.random.default_rng(seed).permutation(objects.max() + 1) % FOLDS
    score = np.zeros(len(success))
    for k in range(FOLDS):
        out = fold[objects] == k
        score[out] = features[out] @ fit(features[~out], success[~out], objects[~out], ridge)
    return score
