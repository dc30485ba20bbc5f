"""Clouds as depth images: an organised cloud contains its intrinsics, another one is rendered by a virtual camera."""

import io
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = ["LARGEST_FILE", "MOST_POINTS", "Rendered", "organised", "rendered", "text_columns", "turned"]

#: Largest file of a cloud, bytes, and most points.
LARGEST_FILE, MOST_POINTS = 1 << 30, 1 << 24
#: Fewest points of a cloud, and of a grid whose intrinsics are estimated.
_LEAST_POINTS, _LEAST_GRID = 50, 100
#: In an organised cloud half of the points lie within the first of their pixels, and 95 of 100 within the second.
_MEDIAN_ERROR, _MOST_ERROR = 0.5, 1.0
#: Points beyond this tangent of the angle to the optical axis are left out.
_WIDEST = 2.0
#: Sides of rendered images: the first one tried, and the largest, pixels.
_FIRST_SIDE, _LARGEST_SIDE = 24, 1600
#: Most empty pixels among filled ones, as a share of these.
_HOLES = 0.05
#: An empty pixel is a hole if so many of its 8 neighbours are filled.
_NEIGHBOURS = 5
#: Depths of a surface beside a pixel differ by this share, and by so many times the width of a pixel at 1 m.
_ALIKE, _ALIKE_PIXELS = 0.02, 6.0
#: Fewest filled neighbours of a filled pixel, on average.
_BESIDE = 3
#: Times that holes are filled: wider ones from their borders.
_FILLINGS = 3
#: Points of a pixel within this share of the nearest depth are of the same surface.
_SAME_SURFACE = 0.01

Array = NDArray[np.float64]


class Rendered(NamedTuple):
    """Depth (H, W), intrinsics (3, 3), and the share of the points that is in the image."""

    depth: Array
    intrinsics: Array
    share: float


def text_columns(text: io.BytesIO, columns: list[int], skipped: int, rows: int, path: Path) -> Array:
    """Read columns of numbers (rows, 3) from text, after lines that are skipped; raises ConfigError."""
    if 2 * (rows + skipped) > text.getbuffer().nbytes + 2:
        raise ConfigError(f"{path} promises {rows} points and ends before; write the file again")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty file is found below
            values = np.loadtxt(
                io.TextIOWrapper(text, "latin-1"),
                usecols=columns,
                skiprows=skipped,
                max_rows=rows,
                comments=None,
                ndmin=2,
            )
    except (ValueError, OverflowError, IndexError) as error:
        raise ConfigError(f"{path} holds a line that is not of its points: {error}") from None
    if len(values) < rows:
        raise ConfigError(f"{path} promises {rows} points and ends after {len(values)}; write the file again")
    return np.asarray(values, dtype=np.float64)


def turned(points: Array) -> tuple[Array, bool]:
    """Return points (..., 3) with z forward, and whether y and z were negated: RealSense's PLY files look along -z."""
    z = points[..., 2][np.isfinite(points).all(axis=-1) & points.any(axis=-1)]
    if not len(z) or np.median(z) >= 0:
        return points, False
    return points * np.array([1.0, -1.0, -1.0]), True


def organised(points: Array) -> tuple[Array, Array] | str:
    """Return depth (H, W) and intrinsics (3, 3) of a grid (H, W, 3) of points with z forward.

    The intrinsics are those by which the points project to their pixels. Returns a reason instead if there are none.

    Raises
    ------
    ConfigError
        If x does not point right, or y down.
    """
    depth = np.where(np.isfinite(points).all(axis=2) & (points[..., 2] > 0), points[..., 2], 0.0)
    v, u = np.nonzero(depth)
    if len(u) < _LEAST_GRID or np.ptp(u) < 2 or np.ptp(v) < 2:
        return "it has too few points"
    seen = points[v, u]
    lens = np.eye(3)
    errors = []
    with np.errstate(all="ignore"):
        for axis, pixels in enumerate((u, v)):
            ray = seen[:, axis] / seen[:, 2]
            fit = np.stack([ray, np.ones_like(ray)], axis=1)
            (focal, center), *_ = np.linalg.lstsq(fit, pixels + 0.5, rcond=None)
            lens[axis, axis], lens[axis, 2] = focal, center
            errors.append(np.abs(focal * ray + center - pixels - 0.5))
    error = np.maximum(*errors)
    if not (np.median(error) < _MEDIAN_ERROR and np.quantile(error, 0.95) < _MOST_ERROR):
        return "its points are not those of a pinhole camera's pixels"
    if lens[0, 0] <= 0 or lens[1, 1] <= 0:
        raise ConfigError(
            "the organised cloud has x to the left or y up; turn it to a camera's axes: x right, y down, z forward"
        )
    return depth, lens


def rendered(points: Array) -> Rendered:
    """Render points (n, 3) with z forward, metres, by a pinhole camera at their origin.

    Each pixel has the depth of the nearest surface. The resolution is the finest at which neighbouring points leave no
    holes; single empty pixels are filled from their neighbours.

    Raises
    ------
    ConfigError
        If there are too few points before the camera, or they are too sparse.
    """
    z = points[:, 2]
    front = np.isfinite(points).all(axis=1) & (z > 0)
    front[front] = (np.abs(points[front, :2]) < _WIDEST * z[front, None]).all(axis=1)
    number, points = len(points), points[front]
    if len(points) < _LEAST_POINTS:
        raise ConfigError(
            f"{len(points)} of {number} points lie before the camera; pass points in the camera's frame, z forward"
        )
    rays = points[:, :2] / points[:, 2:]
    focal = _finest(rays, rays.min(axis=0), rays.max(axis=0))
    # The optical axis is in the middle, as in the image of a real camera.
    high = np.abs(rays).max(axis=0)
    low = -high
    shape = _shape(low, high, focal)
    lens = np.array([[focal, 0.0, -low[0] * focal], [0.0, focal, -low[1] * focal], [0.0, 0.0, 1.0]])
    depth = _nearest(points[:, 2], (rays - low) * focal, shape)
    for _ in range(_FILLINGS):
        depth = _filled(depth, _ALIKE + _ALIKE_PIXELS / focal)
    return Rendered(depth, lens, len(points) / number)


def _shape(low: Array, high: Array, focal: float) -> tuple[int, int]:
    columns, rows = np.maximum(np.ceil((high - low) * focal + 1e-6), 1).astype(np.int64).tolist()
    return rows, columns


def _finest(rays: Array, low: Array, high: Array) -> float:
    """Return the largest focal length without holes, pixels."""
    most = _LARGEST_SIDE / max(float(2 * np.abs([low, high]).max()), 1e-6)
    focal = min(_FIRST_SIDE / max(float((high - low).max()), 1e-6), most)
    if not _is_closed(rays, low, high, focal):
        raise ConfigError(
            f"the {len(rays)} points of the cloud are too sparse for a depth image; pass the camera's full cloud"
        )
    step = 1.5
    while step > 1.02:
        while focal * step <= most and _is_closed(rays, low, high, focal * step):
            focal *= step
        step = step**0.5
    return focal


def _is_closed(rays: Array, low: Array, high: Array, focal: float) -> bool:
    """Tell whether filled pixels are beside each other, and few pixels are empty among them."""
    rows, columns = _shape(low, high, focal)
    places = ((rays - low) * focal).astype(np.int64)
    filled = np.zeros((rows, columns), dtype=np.bool_)
    filled[np.minimum(places[:, 1], rows - 1), np.minimum(places[:, 0], columns - 1)] = True
    around = np.stack(_around(filled)).sum(axis=0)
    holes = ~filled & (around >= _NEIGHBOURS)
    return bool(holes.sum() <= _HOLES * filled.sum() and around[filled].mean() >= _BESIDE)


def _around(image: NDArray[np.generic]) -> list[NDArray[np.generic]]:
    """Return the 8 neighbours (H, W) of each pixel, 0 beyond the border."""
    rows, columns = image.shape
    wide = np.pad(image, 1)
    return [wide[r : r + rows, c : c + columns] for r in range(3) for c in range(3) if (r, c) != (1, 1)]


def _nearest(z: Array, places: Array, shape: tuple[int, int]) -> Array:
    """Return the depth of each pixel: of the points of the nearest surface, that next to the middle of the pixel."""
    column, row = (np.minimum(places[:, i].astype(np.int64), shape[1 - i] - 1) for i in range(2))
    pixel = row * shape[1] + column
    first = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(first, pixel, z)
    same = z <= first[pixel] * (1 + _SAME_SURFACE)
    away = np.hypot(places[:, 0] - column - 0.5, places[:, 1] - row - 0.5)
    order = np.flatnonzero(same)[np.argsort(-away[same], kind="stable")]
    depth = np.zeros(len(first))
    # Of equal indices the last assignment counts: that of the nearest point.
    depth[pixel[order]] = z[order]
    return depth.reshape(shape)


def _filled(depth: Array, alike: float) -> Array:
    """Fill empty pixels among filled ones with the mean of the farthest surface beside them.

    Depths of a surface differ by a share of at most `alike`.
    """
    around = np.stack([np.asarray(one, dtype=np.float64) for one in _around(depth)])
    far = around * (1 + alike) >= np.maximum(around.max(axis=0), 1e-9)
    mean = np.where(far, around, 0.0).sum(axis=0) / np.maximum(far.sum(axis=0), 1)
    return np.where((depth == 0) & ((around > 0).sum(axis=0) >= _NEIGHBOURS), mean, depth)
