"""Distances along the rays of pixels, which some simulators and cameras store instead of the depth along z.

A table that is read as the wrong one of the two is curved, so that a plane has fewer of its pixels.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.depth_images import fit_table, is_cut_out, table_share

__all__ = ["DEPTH_KINDS", "DepthKind", "distances_instead", "is_flat", "z_of_distances"]

#: What the values of a depth image are: depths along the optical axis, or distances from the camera.
DepthKind = Literal["z", "distance"]
DEPTH_KINDS = get_args(DepthKind)

#: A table with the first share of the pixels is flat, and one that has the second more as distances is curved. In 94
#: real captures of z it has at most 0.03 more, in those of distances along rays 0.1 and more but for bins in narrow
#: views. A smaller plane than the third is one of many in a full bin.
_FLAT, _MORE, _LEAST = 0.6, 0.08, 0.18


def z_of_distances(distances: NDArray[np.float64], intrinsics: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depths (H, W) along the optical axis of an image of distances from the camera, in their unit."""
    rows, columns = (np.arange(size) + 0.5 for size in distances.shape)
    into = np.linalg.inv(intrinsics)
    across = into[:2, :1] * columns + into[:2, 2:]
    down = into[:2, 1:2] * rows
    squares = sum((across[axis][None] + down[axis][:, None]) ** 2 for axis in range(2))
    return np.asarray(distances / np.sqrt(1.0 + squares))


def is_flat(
    depth: NDArray[np.float64], intrinsics: NDArray[np.float64], table_from_camera: NDArray[np.float64]
) -> bool:
    """Whether most pixels of an image (H, W), metres, are those of a flat table."""
    return table_share(depth, intrinsics, table_from_camera) > _FLAT


def distances_instead(
    depth: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    table_from_camera: NDArray[np.float64] | None,
    focus: NDArray[np.bool_] | None = None,
    gravity: NDArray[np.float64] | None = None,
) -> str | None:
    """Return a warning if a table in an image (H, W), metres, is flatter as distances; arguments as of `fit_table`.

    `table_from_camera` is its pose that `fit_table` finds, None if it finds no table. Narrow views of full bins do not
    tell, nor do things that were cut out, which may be curved so.
    """
    if is_cut_out(depth):
        return None
    flat = 0.0 if table_from_camera is None else table_share(depth, intrinsics, table_from_camera)
    if flat > _FLAT:
        return None
    straight = z_of_distances(depth, intrinsics)
    try:
        along = table_share(straight, intrinsics, fit_table(straight, intrinsics, focus, gravity))
    except ConfigError:
        return None
    if along < max(flat + _MORE, _LEAST):
        return None
    return (
        f"the table is curved, as in an image of distances along the rays: a plane has {flat:.0%} of the pixels, and "
        f"{along:.0%} if they are distances; then read it with depth_is='distance' (--depth-is distance)"
    )
