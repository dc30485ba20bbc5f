"""Distance and depth of pairs of boxes, by separating axes."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["gaps"]

Floats = NDArray[np.float64]


def gaps(first: Floats, first_half: Floats, second: Floats, second_half: Floats) -> Floats:
    """Return the distance (n,) of each pair of boxes, metres; a negative number is the depth of an overlap.

    It is measured along the best of 19 axes: those that separate boxes, the axes of the frame, and the line between the
    centres. Edges and corners that face each other along another axis are a little farther apart. Boxes are their poses
    (n, 4, 4) and half extents (n, 3), metres.
    """
    a, b = first[:, :3, :3], second[:, :3, :3]
    crossed = np.cross(a[:, :, :, None], b[:, :, None, :], axis=1).reshape(len(a), 3, 9)
    length = np.linalg.norm(crossed, axis=1, keepdims=True)
    parallel = length < 1e-6
    offset = second[:, :3, 3] - first[:, :3, 3]
    distance = np.linalg.norm(offset, axis=1, keepdims=True)
    others = np.tile(np.eye(3), (len(a), 1, 1))
    between = np.where(distance > 1e-9, offset / np.maximum(distance, 1e-9), others[:, 0])
    unit = np.where(parallel, 0.0, crossed / np.where(parallel, 1.0, length))
    axes = np.concatenate([a, b, others, between[:, :, None], unit], axis=2)
    apart = np.abs(np.einsum("ni,nik->nk", offset, axes))
    reach = np.einsum("nj,njk->nk", first_half, np.abs(np.einsum("nij,nik->njk", a, axes)))
    reach += np.einsum("nj,njk->nk", second_half, np.abs(np.einsum("nij,nik->njk", b, axes)))
    gap = apart - reach
    gap[:, 10:][parallel[:, 0]] = -np.inf
    return np.asarray(gap.max(axis=1))
