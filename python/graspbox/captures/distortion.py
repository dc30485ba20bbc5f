"""Lens distortion: a distorted image becomes that of an ideal pinhole camera, by nearest neighbour.

Sources: OpenCV's documentation of ``calib3d`` (models ``plumb_bob``, ``rational_polynomial``) and ``fisheye``
(Kannala and Brandt, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye
lenses", PAMI 2006); RealSense's documentation "Projection in Intel RealSense SDK 2.0".
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspbox.captures.capture import Camera
from graspbox.errors import ConfigError

__all__ = ["MODELS", "source_pixels", "standard_model", "undistorted"]

Array = NDArray[np.float64]

#: Names of a model, and the one that is used here.
_NAMES = {
    "": "plumb_bob",
    "none": "plumb_bob",
    "radtan": "plumb_bob",
    "brown_conrady": "plumb_bob",
    "fisheye": "equidistant",
    "kannala_brandt4": "equidistant",
}
#: Iterations that invert a polynomial; far fewer suffice for real lenses.
_ITERATIONS = 30
#: Smaller shifts move no pixel, pixels.
_LEAST_SHIFT = 0.5
#: Radii at which the growth of a model is checked.
_RADII = 512


def _brown(x: Array, y: Array, c: Array) -> tuple[Array, Array]:
    """OpenCV's model: k1 k2 p1 p2 k3, k4 k5 k6 of the denominator, s1 to s4 of the thin prism."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = c
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2),
        y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + r2 * (s3 + r2 * s4),
    )


def _modified(x: Array, y: Array, c: Array) -> tuple[Array, Array]:
    """RealSense's variant: the tangential terms apply to the scaled coordinates."""
    k1, k2, p1, p2, k3 = c[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x, y = x * radial, y * radial
    return x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)


def _equidistant(x: Array, y: Array, c: Array) -> tuple[Array, Array]:
    r = np.hypot(x, y)
    angle = np.arctan(r)
    a2 = angle * angle
    bent = angle * (1 + a2 * (c[0] + a2 * (c[1] + a2 * (c[2] + a2 * c[3]))))
    factor = np.where(r > 1e-9, bent / np.maximum(r, 1e-9), 1.0)
    return x * factor, y * factor


def _inverse(x: Array, y: Array, c: Array) -> tuple[Array, Array]:
    """RealSense's inverse model: the polynomial leads from distorted to ideal coordinates."""
    u, v = x.copy(), y.copy()
    for _ in range(_ITERATIONS):
        ideal_u, ideal_v = _brown(u, v, c)
        u, v = u + x - ideal_u, v + y - ideal_v
    # Where the iteration does not end, no pixel is the source.
    ideal_u, ideal_v = _brown(u, v, c)
    lost = ~(np.hypot(ideal_u - x, ideal_v - y) < 1e-4)
    u[lost] = v[lost] = np.nan
    return u, v


#: Models: the function from ideal to distorted coordinates (at z = 1), and the number of coefficients.
MODELS: dict[str, tuple[Callable[[Array, Array, Array], tuple[Array, Array]], int]] = {
    "plumb_bob": (_brown, 5),
    "rational_polynomial": (_brown, 12),
    "modified_brown_conrady": (_modified, 5),
    "inverse_brown_conrady": (_inverse, 5),
    "equidistant": (_equidistant, 4),
}


def standard_model(model: str, coefficients: tuple[float, ...], name: str) -> tuple[str, tuple[float, ...]]:
    """Return the standard name of a model, and its coefficients without zeros at the end.

    Raises
    ------
    ConfigError
        For an unknown model, a coefficient that is not finite, or too many of them.
    """
    if not np.isfinite(coefficients).all():
        raise ConfigError(f"{name} has a coefficient of distortion that is not finite; pass the calibrated ones")
    used = tuple(coefficients[: int(np.max(np.flatnonzero(np.array(coefficients)), initial=-1)) + 1])
    if not used:
        return "", ()
    plain = model.strip().lower().replace("-", "_").replace(" ", "_")
    plain = plain.removeprefix("distortion.").removeprefix("rs2_distortion_")
    found = _NAMES.get(plain, plain)
    # OpenCV's files name no model: their number of coefficients tells it.
    if found == "plumb_bob" and len(used) > 5:
        found = "rational_polynomial"
    if found not in MODELS or len(used) > MODELS[found][1]:
        raise ConfigError(
            f"{name} has the distortion {model or 'without a name'!r} with {len(used)} coefficients, which is not "
            f"known; undistort the image first, and pass its intrinsics. Known are {', '.join(MODELS)}"
        )
    return found, used


def source_pixels(camera: Camera, shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Return where the pixels of the ideal image lie in the distorted one: columns, rows (-1: nowhere), and shifts.

    All have the shape (H, W); the shift is in pixels, infinite where there is no source.
    """
    rows, columns = shape
    model, count = MODELS[camera.model]
    c = np.zeros(max(count, 12))
    c[: len(camera.coefficients)] = camera.coefficients
    u, v = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    ideal = np.linalg.inv(camera.matrix) @ np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    with np.errstate(all="ignore"):
        x, y = model(ideal[0], ideal[1], c)
        if camera.model not in ("inverse_brown_conrady", "equidistant"):
            x[np.hypot(ideal[0], ideal[1]) > _last_radius(model, c, float(np.hypot(ideal[0], ideal[1]).max()))] = np.nan
        place = camera.matrix[:2] @ np.stack([x, y, np.ones_like(x)])
        shift = np.hypot(place[0] - u.ravel(), place[1] - v.ravel()).reshape(shape)
        inside = np.isfinite(place).all(axis=0) & (place >= 0).all(axis=0)
        inside &= (place[0] < columns) & (place[1] < rows)
    column, row = (np.where(inside, np.where(inside, one, 0).astype(np.int64), -1).reshape(shape) for one in place)
    return column, row, np.where(inside.reshape(shape), shift, np.inf)


def _last_radius(model: Callable[[Array, Array, Array], tuple[Array, Array]], c: Array, most: float) -> float:
    """Return the radius up to which a polynomial grows: beyond it would show parts of the image twice."""
    r = np.linspace(0.0, most, _RADII)
    radial = c.copy()
    radial[[2, 3]] = radial[8:12] = 0.0
    grown = model(r, np.zeros_like(r), radial)[0]
    falls = np.flatnonzero(~(np.diff(grown) > 0))
    return float(r[falls[0]]) if len(falls) else np.inf


def undistorted(camera: Camera, *images: NDArray[np.generic]) -> tuple[NDArray[np.generic], ...] | None:
    """Resample images (H, W) of a camera to those without distortion, 0 where it saw nothing.

    Returns None if the distortion moves no pixel by half a pixel.
    """
    shape = (images[0].shape[0], images[0].shape[1])
    column, row, shift = source_pixels(camera, shape)
    if not (shift >= _LEAST_SHIFT).any():
        return None
    inside = column >= 0
    return tuple(np.where(inside, image[row, column], np.zeros((), image.dtype)) for image in images)
