"""Depth images: units, intrinsics and poses that are checked, their points, and the table that they show."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox.errors import ConfigError

__all__ = [
    "MAX_COORDINATE",
    "MOST_PIXELS",
    "camera_over_plane",
    "camera_over_table",
    "check_gravity",
    "check_intrinsics",
    "check_points",
    "check_pose",
    "check_size",
    "check_table",
    "fit_table",
    "intrinsics_of",
    "is_cut_out",
    "metric_depth",
    "points_of",
    "table_share",
    "table_under",
    "thinned",
]

#: Metres per unit of images of integers, as most cameras write them.
_INTEGERS = 0.001
#: Units of depth images, metres.
_UNITS = {
    "metres": 1.0,
    "inches": 0.0254,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "tenths of millimetres": 0.0001,
}
#: In the right unit half of the pixels are farther than the first, and a tenth nearer than the second, metres.
_NEAREST, _FARTHEST = 0.15, 3.0
#: Distance of the tables that policies learn from, metres.
_USUAL = 0.6
#: Most pixels of an image: 8192 x 8192.
MOST_PIXELS = 1 << 26
#: Coordinates of a camera are at most this, metres: beyond, millimetres are lost, and a fit may not end.
MAX_COORDINATE = 1e4
#: Most points of obstacles: a box of 0.5 m filled at every 8 mm has half as many.
_MOST_OBSTACLES = 500_000
#: Obstacles beyond this distance cannot matter, metres: their unit is wrong.
_FARTHEST_OBSTACLE = 10.0
#: A plane is fitted to about this many points at most; more make it slower, not better.
_MOST_POINTS = 1_000_000
#: Pixels of an image from which a table is fitted, about: those of a quarter of a million give the same plane.
_FITTED = 40_000
#: Planes that are tried, pixels that vote for them, and the least share of the votes that a table has.
_PLANES, _VOTERS, _TABLE_SHARE = 600, 4000, 0.1
#: Pixels vote the more the nearer they are to the middle: a Gaussian of this share of the image's size. A vote below a
#: plane counts half against it: a thing's own face has a table below.
_AROUND_MIDDLE, _BELOW = 0.3, 0.5
#: Least share of the pixels that lie on the table as placed by the camera's pose.
_SEEN_TABLE = 0.12
#: Without it, most of the pixels that may lie below the table, and the greatest height of the lowest ones, metres.
_MOST_SUNK, _HIGHEST = 0.05, 0.3
#: Heights within the first, metres, are one level surface; one with more than the second of the image is a table.
_LEVEL, _ANOTHER_TABLE = 0.03, 0.25
#: A pixel is the table's within this distance and this share of its depth, metres.
_ON_TABLE, _ON_TABLE_GROWTH = 0.004, 0.004
#: Least angle between the table and the optical axis, radians, and cosine of the greatest one of up to a normal.
_LEAST_TILT, _LEVEL_COSINE = 0.17, 0.985
#: Distance of an assumed table under a thing, metres.
_UNDER = 0.02
#: An image with a smaller share of measured pixels shows a thing that was cut out.
_CUT_OUT = 0.25
#: Arrays of fewer numbers are shown in errors.
_FEW = 10
_POSE_ADVICE = "pass the camera's pose, or with a mask the direction of gravity"
#: Focal length of the images that policies learn from, pixels.
_FOCAL = 230.0


def check_points(points: ArrayLike, name: str = "keep_off") -> NDArray[np.float64]:
    """Check points (k, 3) of obstacles, at most 10 m away; raises ConfigError."""
    # Arrays of a file are mapped, and read only once their shape is known.
    array = points if isinstance(points, np.ndarray) else floats(points, name)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) > _MOST_OBSTACLES:
        raise ConfigError(f"{name} has shape {array.shape}; pass points (k, 3), at most {_MOST_OBSTACLES}")
    values = floats(array, name)
    if not (np.abs(values) <= _FARTHEST_OBSTACLE).all():
        raise ConfigError(
            f"{name} has a coordinate of {float(values.flat[np.argmax(np.abs(values))]):.6g}; pass metres, at most "
            f"{_FARTHEST_OBSTACLE:g} m from the origin of the table's frame"
        )
    return values


def metric_depth(
    values: NDArray[np.generic], scale: float | None = None, name: str = "the depth"
) -> NDArray[np.float64]:
    """Convert a depth image (H, W) or (H, W, 1) to metres, 0 where nothing was measured (0, NaN or infinity).

    `scale` is in metres per unit, by default 1 for floats and 0.001 for integers; errors call the image `name`.

    Raises
    ------
    ConfigError
        If it is no depth image, or has a negative depth, or depths whose unit must be another.
    """
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim == 2 and values.shape[1] == 3 < len(values) and values.dtype.kind == "f":
        raise ConfigError(
            f"{name} has shape {values.shape}, points rather than an image; read clouds with "
            "graspbox.captures.read_capture, as graspbox grasp-image does"
        )
    if values.ndim != 2 or values.dtype.kind not in "fiu" or not values.size:
        raise ConfigError(
            f"{name} holds {values.dtype} of shape {values.shape}; pass one depth image (H, W) of numbers"
        )
    check_size(values.size, name)
    if scale is not None and not 0.0 < scale < float("inf"):
        raise ConfigError(f"the depth scale is {scale}; pass metres per unit of the image, such as 0.001")
    metres = scale if scale is not None else (1.0 if values.dtype.kind == "f" else _INTEGERS)
    depth = np.where(np.isfinite(values), values, 0).astype(np.float64) * metres
    if depth.min() < 0:
        raise ConfigError(f"{name} holds the depth {depth.min():.3g} m; depths are distances along the optical axis")
    _check_unit(depth, metres, name)
    return depth


def check_size(pixels: int, name: str, most: int = MOST_PIXELS) -> None:
    """Raise ConfigError for an image of too many pixels."""
    if pixels > most:
        raise ConfigError(f"{name} has more than {most} pixels; pass a smaller image, with its own intrinsics")


def _check_unit(depth: NDArray[np.float64], metres: float, name: str) -> None:
    seen = depth[depth > 0]
    if not len(seen):
        raise ConfigError(
            f"{name} has no pixel with a depth: all are 0 or not finite; pass an image that shows the object"
        )
    near, middle = np.percentile(seen[:: 1 + len(seen) // _MOST_POINTS], (10, 50))

    def off(factor: float) -> float:
        """Return the deviation of the distances from usual ones; infinite where they are implausible."""
        share = factor / metres
        plausible = share * middle > _NEAREST and share * near < _FARTHEST
        return abs(float(np.log(share * middle / _USUAL))) if plausible else np.inf

    if np.isfinite(off(metres)):
        return
    # An image does not show its unit: some may be plausible, and the nearest to usual distances may be wrong.
    possible = sorted((unit for unit in _UNITS if np.isfinite(off(_UNITS[unit]))), key=lambda unit: off(_UNITS[unit]))
    choices = " or ".join(f"{unit} (depth scale {_UNITS[unit]:g})" for unit in possible)
    perhaps = f"; perhaps its unit is {choices}, which an image does not show" if possible else ""
    raise ConfigError(
        f"the middle depth of {name} would be {middle:.3g} m{perhaps}: look its unit up, and pass the depth scale, in "
        f"metres per unit of the image; here it is {metres:g}"
    )


def is_cut_out(depth: NDArray[np.floating]) -> bool:
    """Whether an image (H, W) shows a thing alone, with nothing measured around it."""
    return bool(np.count_nonzero(depth) < _CUT_OUT * depth.size)


def intrinsics_of(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    """Return the matrix (3, 3) of focal lengths and a principal point, pixels."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def check_intrinsics(intrinsics: ArrayLike, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Check that intrinsics (3, 3) fit an image of rows and columns, and return them as float64; raises ConfigError."""
    matrix = floats(intrinsics, "intrinsics")
    rows, columns = shape
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ConfigError(f"intrinsics have shape {matrix.shape}; pass a finite 3x3 matrix")
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    if not (fx > 0 and fy > 0):
        raise ConfigError(f"the focal lengths are {fx:g} and {fy:g}; pass positive numbers of pixels")
    if fx < 0.2 * columns:
        raise ConfigError(
            f"the focal length is {fx:g} pixels in an image of {columns} columns; pass FX FY CX CY in pixels "
            "of this image"
        )
    for name, center, size in (("CX", cx, columns), ("CY", cy, rows)):
        if not 0.0 < center < size:
            raise ConfigError(
                f"{name} is {center:g}, outside of an image of {columns} x {rows} pixels; the intrinsics belong to an "
                "image of another size"
            )
    return matrix


def check_pose(table_from_camera: ArrayLike, name: str = "table_from_camera") -> NDArray[np.float64]:
    """Check the pose (4, 4) of a camera, which errors call `name`, and return it as float64.

    Raises
    ------
    ConfigError
        If it is no pose, in metres, of a camera above the table.
    """
    pose = floats(table_from_camera, name)
    if pose.shape != (4, 4):
        raise ConfigError(f"{name} has shape {pose.shape}; pass a pose (4, 4)")
    turn = pose[:3, :3]
    if not np.allclose(pose[3], (0, 0, 0, 1)) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3):
        raise ConfigError(f"{name} is not a rigid motion: rotation and translation in metres, with 0 0 0 1 below")
    if np.linalg.det(turn) < 0:
        raise ConfigError(f"{name} mirrors; the axes of a camera are x right, y down, z forward")
    if not (np.abs(pose[:3, 3]) <= MAX_COORDINATE).all():
        raise ConfigError(f"{name} places the camera at {pose[:3, 3]}; pass metres, at most {MAX_COORDINATE:g}")
    if pose[2, 3] <= 0 or turn[2, 2] >= 0:
        raise ConfigError(
            f"{name} places the camera at the height {pose[2, 3]:.3g} m, or lets it look up; pass the camera's pose "
            "in the table's frame, not its inverse, with z up and z = 0 on the table"
        )
    return pose


def camera_over_table(height: float, tilt: float, roll: float = 0.0) -> NDArray[np.float64]:
    """Return the pose ``table_from_camera`` (4, 4) of a camera: the table's frame has its origin below the camera.

    Its z axis points up and its x axis in the horizontal direction of view; for a camera that looks straight down, to
    the
    upper border of its images.

    Parameters
    ----------
    height : float
        Of the camera over the table, metres.
    tilt : float
        Angle by which it looks down, radians: 0 is horizontal, pi/2 straight down.
    roll : float
        Turn about its optical axis, radians, clockwise as it looks.

    Raises
    ------
    ConfigError
        If it is not above the table, or does not look down.
    """
    if not 0.0 < height < 10.0:
        raise ConfigError(f"the camera's height is {height} m; pass metres over the table")
    if not 0.0 < tilt <= np.pi / 2 + 1e-9:
        raise ConfigError(
            f"the camera's tilt is {np.degrees(tilt):g} degrees; pass 0 (horizontal) to 90 (straight down)"
        )
    forward = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    right = np.array([0.0, -1.0, 0.0])
    upright = np.stack([right, np.cross(forward, right), forward], axis=1)
    c, s = np.cos(roll), np.sin(roll)
    pose = np.eye(4)
    pose[:3, :3] = upright @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    pose[2, 3] = height
    return pose


def fit_table(
    depth: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    focus: NDArray[np.bool_] | None = None,
    gravity: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Find the table in a depth image (H, W), metres, and return ``table_from_camera`` (4, 4).

    It is the plane that has most of the pixels, of which those near the middle of `focus` (H, W), by default of the
    image, are counted more. Its frame is that of `camera_over_table`; `intrinsics` are in pixels. With the direction of
    `gravity` (3,), camera's frame, only level planes count, within 10 degrees.

    Raises
    ------
    ConfigError
        If no plane has a tenth of these pixels, or the largest is no table below the camera.
    """
    every = _every(depth)
    points, weights = points_of(depth, intrinsics, every), _nearness(depth, every, focus)
    if len(points) < 3:
        raise ConfigError(f"the depth image shows no table; {_POSE_ADVICE}")
    normal, offset = _most_voted(points, weights, None if gravity is None else -gravity)
    for _ in range(5):
        on = np.abs(points @ normal - offset) < _ON_TABLE + _ON_TABLE_GROWTH * points[:, 2]
        own, share = points[on], weights[on] / weights[on].sum()
        middle = share @ own
        moved = own - middle
        normal = np.linalg.svd((moved.T * share) @ moved)[0][:, 2]
        offset = float(normal @ middle)
    pose = camera_over_plane(normal, offset)
    if pose is None:
        raise ConfigError(f"the largest plane is seen at {_degrees(normal)} degrees, as a wall is; {_POSE_ADVICE}")
    return pose


def table_under(
    depth: NDArray[np.float64], intrinsics: NDArray[np.float64], focus: NDArray[np.bool_], gravity: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Assume a level table 2 cm under the lowest pixel of `focus` (H, W), where none is seen; as `fit_table`.

    Raises
    ------
    ConfigError
        If these pixels have no depth, or the camera does not look down.
    """
    points = points_of(np.where(focus, depth, 0.0), intrinsics)
    if not len(points):
        raise ConfigError("the mask has no pixels with a depth; pass the mask of a thing that the image shows")
    pose = camera_over_plane(-gravity, float((points @ -gravity).min()) - _UNDER)
    if pose is None or gravity[2] <= 0.0:
        raise ConfigError(
            f"with the gravity {gravity.round(3).tolist()} the camera does not look down; pass its direction in the "
            "camera's frame: x right, y down, z forward"
        )
    return pose


def table_share(
    depth: NDArray[np.float64], intrinsics: NDArray[np.float64], table_from_camera: NDArray[np.float64]
) -> float:
    """Return the share of the pixels of an image (H, W), metres, that lie on the plane z = 0 of a table."""
    points = points_of(depth, intrinsics, _every(depth))
    heights = points @ table_from_camera[2, :3] + table_from_camera[2, 3]
    return float((np.abs(heights) < _ON_TABLE + _ON_TABLE_GROWTH * points[:, 2]).mean()) if len(points) else 0.0


def _every(depth: NDArray[np.float64]) -> int:
    """Return the step between the pixels from which a table is fitted."""
    return int(np.ceil(np.sqrt(depth.size / _FITTED)))


def check_gravity(gravity: ArrayLike) -> NDArray[np.float64]:
    """Return a direction (3,) as a unit vector; raises ConfigError if it is none."""
    values = floats(gravity, "gravity")
    length = float(np.linalg.norm(values)) if values.shape == (3,) else 0.0
    if not 1e-6 < length < 1e6:
        raise ConfigError(
            f"gravity is {values.tolist() if values.size < _FEW else values.shape}; pass its direction in the camera's "
            "frame (x right, y down, z forward), three numbers such as 0 0.7 0.7"
        )
    return np.asarray(values / length)


def _degrees(normal: NDArray[np.float64]) -> str:
    """Return the angle at which a plane is seen."""
    return f"{np.degrees(np.arcsin(min(abs(float(normal[2])), 1.0))):.0f}"


def camera_over_plane(normal: NDArray[np.float64], offset: float) -> NDArray[np.float64] | None:
    """Return the pose of `camera_over_table` over the plane ``normal @ x = offset``, camera frame, metres.

    None if the camera looks along it, as along a wall.
    """
    # Up is where the camera is.
    up, height = (-normal, offset) if offset > 0 else (normal, -offset)
    tilt = float(np.arcsin(np.clip(-up[2], -1.0, 1.0)))
    if tilt < _LEAST_TILT:
        return None
    return camera_over_table(height, tilt, float(np.arctan2(-up[0], -up[1])) if tilt < np.pi / 2 - 1e-6 else 0.0)


def _nearness(depth: NDArray[np.float64], every: int, focus: NDArray[np.bool_] | None) -> NDArray[np.float64]:
    """Return the weights (n,) of the points of `points_of`: 1 at the middle of the pixels `focus`, less away."""
    shape = np.array(depth.shape)
    # A mask of nothing is refused where the thing is searched.
    middle = shape / 2 if focus is None or not focus.any() else np.array([one.mean() for one in np.nonzero(focus)])
    places = every * np.stack(np.nonzero(depth[::every, ::every]), axis=1)
    return np.asarray(np.exp(-0.5 * (((places - middle) / (_AROUND_MIDDLE * shape)) ** 2).sum(axis=1)))


def _most_voted(
    points: NDArray[np.float64], weights: NDArray[np.float64], up: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], float]:
    """Return unit normal (3,) and offset of the plane through three points with most of the weighted votes.

    Walls, and with the direction `up` (3,) all planes that are not level, take part only if nothing else is found.
    """
    rng = np.random.default_rng(0)
    # Sampling without replacement, by weights (Efraimidis and Spirakis, 2006).
    keys = rng.random(len(points)) ** (1.0 / np.maximum(weights, 1e-6))
    voters = points[np.argsort(-keys, kind="stable")[:_VOTERS]]
    corners = voters[rng.integers(len(voters), size=(_PLANES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(lengths, 1e-12)
    offsets = np.einsum("ij,ij->i", normals, corners[:, 0])
    # The camera is above every plane.
    facing = np.where(offsets > 0, -1.0, 1.0)
    normals, offsets = normals * facing[:, None], offsets * facing
    near = (_ON_TABLE + _ON_TABLE_GROWTH * voters[:, 2]).astype(np.float32)
    heights = (normals @ voters.T - offsets[:, None]).astype(np.float32)
    below = np.count_nonzero(heights < -2.5 * near, axis=1) / len(voters)
    on = np.count_nonzero(np.abs(heights) < near, axis=1) / len(voters) * (lengths[:, 0] > 1e-9)
    level = -normals[:, 2] > np.sin(_LEAST_TILT) if up is None else normals @ up > _LEVEL_COSINE
    best = int(np.argmax(np.where(level, on - _BELOW * below, -np.inf)))
    if not level.any() or on[best] < _TABLE_SHARE:
        largest = int(np.argmax(on - _BELOW * below))
        told = f"has {on[best]:.0%} of the pixels"
        if on[largest] >= _TABLE_SHARE:
            seen = f"is seen at {_degrees(normals[largest])} degrees, as a wall is"
            told = seen if up is None else "is not level"
        raise ConfigError(f"no table was found: the largest plane {told}; {_POSE_ADVICE}")
    return normals[best], float(offsets[best])


def check_table(
    depth: NDArray[np.float64], intrinsics: NDArray[np.float64], table_from_camera: NDArray[np.float64]
) -> str | None:
    """Check a given pose of the camera by a depth image (H, W), metres, that need not show the table.

    Returns a warning if less than an eighth of the image is at the height of the table, else None; raises ConfigError
    if then things would also be in the table or high in the air, or another level surface fills the image.
    """
    points = points_of(depth, intrinsics)
    heights = points @ table_from_camera[2, :3] + table_from_camera[2, 3]
    tolerance = _ON_TABLE + _ON_TABLE_GROWTH * points[:, 2]
    share = float((np.abs(heights) < 2 * tolerance).mean()) if len(points) else 0.0
    if share >= _SEEN_TABLE:
        return None
    middle = f"; the middle height of its pixels is {np.median(heights):.3g} m" if len(points) else ""
    told = f"{share:.0%} of the image is at the height of the table{middle}"
    sunk = float((heights < -4 * tolerance).mean()) if len(points) else 1.0
    # A single far pixel must not make many levels.
    levels = np.floor(heights[np.abs(heights) < _FARTHEST_OBSTACLE] / _LEVEL).astype(np.int64)
    level = np.unique(levels, return_counts=True)[1].max(initial=0) / depth.size
    if sunk > _MOST_SUNK or np.quantile(heights, _MOST_SUNK) > _HIGHEST or level > _ANOTHER_TABLE:
        raise ConfigError(
            f"the camera's pose does not fit the image: {told}. "
            "Check the pose (the camera's in the table's frame, not its inverse), its units and the depth scale"
        )
    return f"the camera's pose cannot be checked: {told}"


def points_of(depth: NDArray[np.floating], intrinsics: NDArray[np.float64], every: int = 1) -> NDArray[np.float64]:
    """Return the points (n, 3) that an image shows, camera frame; those of every k-th pixel of every k-th row."""
    rows, columns = np.nonzero(depth[::every, ::every])
    rows, columns = every * rows, every * columns
    z = depth[rows, columns]
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(z))])
    points: NDArray[np.float64] = ((np.linalg.inv(intrinsics) @ pixels) * z).T
    return points


def thinned(
    depth: NDArray[np.float64], intrinsics: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Keep every k-th pixel of a fine image, which is then about as coarse as those that policies learn from.

    Returns image (h, w), its intrinsics (3, 3), and k.
    """
    step = max(1, int(intrinsics[0, 0] / _FOCAL))
    first = step // 2
    kept = np.ascontiguousarray(depth[first::step, first::step])
    scaled = intrinsics.copy()
    scaled[:2] /= step
    scaled[:2, 2] = (intrinsics[:2, 2] - first - 0.5) / step + 0.5
    return kept, scaled, step
