"""Conversion of arrays of rotations to and from unit quaternions and Euler angles.

Quaternions are (w, x, y, z) with w >= 0. Euler angles are (roll, pitch, yaw) about fixed x, y, z axes in this order:
R = Rz(yaw) Ry(pitch) Rx(roll), with pitch in [-pi/2, pi/2]. Arrays of other shapes are a `ConfigError`. SciPy has both
conversions, but the core does not need it otherwise.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox.errors import ConfigError

__all__ = [
    "angle_between",
    "euler_from_rotation",
    "poses_from",
    "quaternion_from_rotation",
    "rotation_about",
    "rotation_from_euler",
    "rotation_from_quaternion",
]

Array = NDArray[np.float64]

#: Quaternions of this length or shorter count as zero.
_SHORTEST = 1e-9


def _rows(values: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
    array = floats(values, name)
    if array.ndim != len(shape) + 1 or array.shape[1:] != shape:
        wanted = ", ".join(("n", *map(str, shape)))
        raise ConfigError(f"{name} has shape {array.shape}; give ({wanted})")
    return array


def quaternion_from_rotation(rotations: ArrayLike) -> Array:
    """Convert rotations (n, 3, 3) to unit quaternions (n, 4) with w >= 0.

    Each quaternion is the row of 4 q q^T with the largest diagonal entry, which avoids division by a small number.
    """
    r = _rows(rotations, "rotations", (3, 3))
    xx, yy, zz = r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]
    wx, wy, wz = r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]
    xy, xz, yz = r[:, 1, 0] + r[:, 0, 1], r[:, 0, 2] + r[:, 2, 0], r[:, 2, 1] + r[:, 1, 2]
    outer = np.stack(
        [
            np.stack([1 + xx + yy + zz, wx, wy, wz], axis=1),
            np.stack([wx, 1 + xx - yy - zz, xy, xz], axis=1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], axis=1),
            np.stack([wz, xz, yz, 1 - xx - yy + zz], axis=1),
        ],
        axis=1,
    )
    largest = np.argmax(np.einsum("nii->ni", outer), axis=1)
    q = outer[np.arange(len(r)), largest]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return np.asarray(np.where(q[:, :1] < 0, -q, q))


def rotation_from_quaternion(quaternions: ArrayLike) -> Array:
    """Convert quaternions (n, 4) of any length to rotations (n, 3, 3).

    Raises
    ------
    ConfigError
        For a quaternion that is shorter than 1e-9 or not finite.
    """
    q = _rows(quaternions, "quaternions", (4,))
    length = np.linalg.norm(q, axis=1, keepdims=True)
    if not (length > _SHORTEST).all() or not np.isfinite(length).all():
        raise ConfigError("quaternions has one that is zero or not finite; give quaternions of finite, nonzero length")
    w, x, y, z = (q / length).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.asarray(np.moveaxis(np.array(rows), 2, 0))


def euler_from_rotation(rotations: ArrayLike) -> Array:
    """Convert rotations (n, 3, 3) to (roll, pitch, yaw) (n, 3), radians; at a pitch of +-pi/2, roll is 0."""
    r = _rows(rotations, "rotations", (3, 3))
    cosine = np.hypot(r[:, 0, 0], r[:, 1, 0])
    pitch = np.arctan2(-r[:, 2, 0], cosine)
    locked = cosine < 1e-9
    roll = np.where(locked, 0.0, np.arctan2(r[:, 2, 1], r[:, 2, 2]))
    yaw = np.where(locked, np.arctan2(-r[:, 0, 1], r[:, 1, 1]), np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    return np.stack([roll, pitch, yaw], axis=1)


def rotation_from_euler(angles: ArrayLike) -> Array:
    """Convert (roll, pitch, yaw) (n, 3), radians, to rotations (n, 3, 3)."""
    roll, pitch, yaw = _rows(angles, "angles", (3,)).T / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    quaternions = [
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    ]
    return rotation_from_quaternion(np.stack(quaternions, axis=1))


def rotation_about(axes: ArrayLike, angles: ArrayLike) -> Array:
    """Return the rotations (..., 3, 3) by `angles` (...), radians, about unit vectors (..., 3): Rodrigues' formula."""
    x, y, z = np.moveaxis(np.asarray(axes, dtype=np.float64), -1, 0)
    zero, angle = np.zeros_like(x), np.asarray(angles, dtype=np.float64)[..., None, None]
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def upright_pose(position: ArrayLike, angle: float) -> Array:
    """Return a pose (4, 4) at a position (3,), metres, turned by an angle about z, radians."""
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation_about([0.0, 0.0, 1.0], angle), position
    return made


def poses_from(positions: ArrayLike, rotations: ArrayLike) -> Array:
    """Assemble homogeneous matrices (n, 4, 4) from positions (n, 3) and rotations (n, 3, 3)."""
    p, r = _rows(positions, "positions", (3,)), _rows(rotations, "rotations", (3, 3))
    if len(p) != len(r):
        raise ConfigError(f"there are {len(p)} positions and {len(r)} rotations; give the same number of both")
    poses = np.broadcast_to(np.eye(4), (len(p), 4, 4)).copy()
    poses[:, :3, 3], poses[:, :3, :3] = p, r
    return poses


def angle_between(first: ArrayLike, second: ArrayLike) -> Array:
    """Return the angles (n,) in [0, pi] between rotations (n, 3, 3) and others (n, 3, 3), radians."""
    a, b = _rows(first, "first", (3, 3)), _rows(second, "second", (3, 3))
    relative = np.einsum("nji,njk->nik", a, b)
    q = quaternion_from_rotation(relative)
    return np.asarray(2 * np.arctan2(np.linalg.norm(q[:, 1:], axis=1), q[:, 0]))
