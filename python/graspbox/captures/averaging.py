"""Several images of one still view, as one image with less noise and fewer holes."""

from collections.abc import Iterable, Sized
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graspbox.captures.capture import Capture
from graspbox.errors import ConfigError
from graspbox.perception.depth_images import check_size

__all__ = ["MOST_IMAGES", "average", "check_count"]

#: Most images: a second of a fast camera; more take time, and no noise any more.
MOST_IMAGES = 120
#: Images of which the exact median is taken, and most pixels of one: 34 images of 4 bytes a pixel are held at once.
_GROUP, _MOST_PIXELS = 31, 1 << 23
#: Rows of the images whose median is computed at once, about this many values.
_VALUES = 1 << 20


def check_count(images: int) -> None:
    """Refuse a number of images that cannot be averaged; raises ConfigError."""
    if not 1 <= images <= MOST_IMAGES:
        raise ConfigError(f"there are {images} images to average; pass 1 to {MOST_IMAGES}")


def average(captures: Iterable[Capture]) -> Capture:
    """Average the images of a camera that stands still over a scene that does.

    The depth of a pixel is the median of its measured values, finite and not 0, and 0 where fewer than half of the
    images, or only one of several, measured it. Of more than 31 images it is the median of the medians of groups of 31
    (the remedian of Rousseeuw and Bassett, 1990), without a last group of less than 16. Labels and pose are those of
    the first image that has some.

    Parameters
    ----------
    captures : iterable of Capture
        Images of the same size and intrinsics, at most 120, of at most 2^23 pixels; they are taken one after another,
        and at most 34 are held.

    Raises
    ------
    ConfigError
        If there are none, too many, or sizes, intrinsics or poses differ.
    """
    if isinstance(captures, Sized):
        check_count(len(captures))
    images = iter(captures)
    first = next(images, None)
    if first is None:
        check_count(0)
    assert first is not None
    made = _Average(first)
    for other in images:
        made.add(other)
    return made.capture()


class _Average:
    """The images so far, of which whole groups are replaced by their medians."""

    def __init__(self, first: Capture) -> None:
        self._first, self._labels, self._warnings = first, first.labels, dict.fromkeys(first.warnings)
        self._count = 1
        depth = _measured(first)
        self._measured, self._group = (depth > 0).astype(np.uint8), [depth]
        self._medians: list[NDArray[np.float32]] = []

    def add(self, other: Capture) -> None:
        """Take another image."""
        first, number = self._first, self._count
        check_count(number + 1)
        check_size(first.depth.size, "each image to average", _MOST_PIXELS)
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
        if len(self._group) == _GROUP:
            self._medians.append(_median(self._group))
            self._group = []
        self._count += 1
        depth = _measured(other)
        self._measured += depth > 0
        self._group.append(depth)
        self._labels = other.labels if self._labels is None else self._labels
        self._warnings |= dict.fromkeys(other.warnings)

    def capture(self) -> Capture:
        """Return the average."""
        if self._count == 1:
            return self._first
        kept = self._measured >= max(2.0, self._count / 2)
        if not kept.any():
            raise ConfigError("no pixel is measured in half of the images; pass images of one still view")
        # A last group of few images would count as much as a whole one; they are less than half of all.
        left = [_median(self._group)] if len(self._group) > _GROUP // 2 or not self._medians else []
        depth = np.where(kept, _median([*self._medians, *left]), 0.0).astype(np.float64)
        source = f"{self._count} images, {self._first.source}"
        return replace(self._first, depth=depth, labels=self._labels, warnings=tuple(self._warnings), source=source)


@np.errstate(over="ignore", invalid="ignore")
def _measured(capture: Capture) -> NDArray[np.float32]:
    """Return the depth of an image, 0 where it is not positive or not finite: `_median` needs an order."""
    depth = capture.depth.astype(np.float32)
    depth[~np.isfinite(depth) | (depth < 0.0)] = 0.0
    return depth


def _median(images: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the median of the measured values of each pixel, 0 without any."""
    if len(images) == 1:
        return images[0]
    rows, columns = images[0].shape
    step = max(1, _VALUES // (columns * len(images)))
    found = np.zeros((rows, columns), dtype=np.float32)
    for start in range(0, rows, step):
        part = np.sort(np.stack([image[start : start + step] for image in images]), axis=0)
        # Zeros come first: the measured values are the last ones.
        counts = (part > 0).sum(axis=0)
        low, high = len(images) - (counts + 2) // 2, len(images) - (counts + 1) // 2
        pair = [np.take_along_axis(part, np.minimum(at, len(images) - 1)[None], axis=0)[0] for at in (low, high)]
        found[start : start + step] = np.where(counts > 0, 0.5 * (pair[0] + pair[1]), 0.0)
    return found


def _pose(capture: Capture) -> NDArray[np.float64]:
    return np.eye(4) if capture.table_from_camera is None else capture.table_from_camera
