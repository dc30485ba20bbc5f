"""Several images of one still view, as one image with less noise and fewer holes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graspbox.captures.capture import Capture
from graspbox.errors import ConfigError

__all__ = ["MOST_IMAGES", "average"]

#: Most images: a second of a fast camera; more take memory, and no noise any more.
MOST_IMAGES = 120


def average(captures: Sequence[Capture]) -> Capture:
    """Average the images of a camera that stands still over a scene that does.

    The depth of a pixel is the median of its measured values, and 0 where fewer than half of the images, or only one
    of several, measured it. Labels and pose are those of the first image that has some.

    Parameters
    ----------
    captures : sequence of Capture
        Images of the same size and intrinsics, at most 120.

    Raises
    ------
    ConfigError
        If there are none, too many, or sizes, intrinsics or poses differ.
    """
    if not 1 <= len(captures) <= MOST_IMAGES:
        raise ConfigError(f"there are {len(captures)} images to average; pass 1 to {MOST_IMAGES}")
    first = captures[0]
    if len(captures) == 1:
        return first
    for number, other in enumerate(captures[1:], 1):
        if other.depth.shape != first.depth.shape or not np.allclose(other.intrinsics, first.intrinsics, atol=1e-3):
            raise ConfigError(
                f"image {number} is {other.depth.shape[1]} x {other.depth.shape[0]} pixels, f = "
                f"{other.intrinsics[0, 0]:.1f}, the first {first.depth.shape[1]} x {first.depth.shape[0]}, f = "
                f"{first.intrinsics[0, 0]:.1f}; pass images of one camera"
            )
        if (other.table_from_camera is None) != (first.table_from_camera is None) or not np.allclose(
            _pose(other), _pose(first), atol=1e-6
        ):
            raise ConfigError(f"image {number} has another pose of the camera than the first; pass images of one view")
    stack = np.stack([one.depth for one in captures])
    measured = (stack > 0).sum(axis=0)
    kept = measured >= max(2.0, len(captures) / 2)
    if not kept.any():
        raise ConfigError("no pixel is measured in half of the images; pass images of one still view")
    middle = np.nanmedian(np.where(kept & (stack > 0), stack, np.where(kept, np.nan, 0.0)), axis=0)
    labels = next((one.labels for one in captures if one.labels is not None), None)
    warnings = tuple(dict.fromkeys(warning for one in captures for warning in one.warnings))
    source = f"{len(captures)} images, {first.source}"
    return replace(first, depth=np.asarray(middle), labels=labels, warnings=warnings, source=source)


def _pose(capture: Capture) -> NDArray[np.float64]:
    return np.eye(4) if capture.table_from_camera is None else capture.table_from_camera
