"""Minimum-jerk motions between poses, for the scripted expert and for replays of trials."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["PEAK_SPEED", "TimedMotion", "minimum_jerk", "pose_matrix", "rotation_matrix", "rotation_vector"]

Array = NDArray[np.float64]

#: Peak speed of a minimum-jerk motion, as a multiple of its mean speed.
PEAK_SPEED = 1.875
#: Shortest motion, seconds.
_MIN_DURATION = 0.1


def minimum_jerk(time: float) -> float:
    """Return the fraction of the path covered after a fraction of the time, which is clipped to [0, 1].

    Source: Flash and Hogan, "The coordination of arm movements", Journal of Neuroscience 5(7), 1985.
    """
    s = min(max(time, 0.0), 1.0)
    return s * s * s * (10 + s * (6 * s - 15))


def pose_matrix(position: ArrayLike, rotation: ArrayLike) -> Array:
    """Make the homogeneous matrix (4, 4) of a position (3,) and a rotation (3, 3)."""
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = position, rotation
    return pose


def rotation_vector(rotation: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3), radians; at an angle of pi, one of the two."""
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    sine, cosine = np.linalg.norm(skew) / 2, (np.trace(rotation) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return np.asarray(skew / (2 * sine) * angle)
    if cosine > 0:
        return np.zeros(3)
    # Here R = 2 a a^T - 1, and the longest column of a a^T points along the axis a.
    outer = (rotation + np.eye(3)) / 2
    axis = outer[:, np.argmax(np.diag(outer))]
    return np.asarray(axis / np.linalg.norm(axis) * angle)


def rotation_matrix(vector: Array) -> Array:
    """Return the rotation (3, 3) of a rotation vector (3,), radians, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # Another order of products than in `rotation_about`: the last bits of motions decide published trials.
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


class TimedMotion:
    """A minimum-jerk motion between two poses: translation along a line, rotation about one axis.

    Parameters
    ----------
    start, end : (4, 4) float64
        Poses in the same frame.
    duration : float
        Seconds.
    """

    def __init__(self, start: Array, end: Array, duration: float) -> None:
        self._start, self.end, self.duration = start, end, duration
        self._turn = rotation_vector(end[:3, :3] @ start[:3, :3].T)

    @classmethod
    def within(cls, start: Array, end: Array, linear: float, angular: float) -> "TimedMotion":
        """Make the fastest motion within limits on the linear and angular speed, m/s and rad/s."""
        way = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
        turn = float(np.linalg.norm(rotation_vector(end[:3, :3] @ start[:3, :3].T)))
        return cls(start, end, max(PEAK_SPEED * way / linear, PEAK_SPEED * turn / angular, _MIN_DURATION))

    def at(self, time: float) -> Array:
        """Return the pose (4, 4) `time` seconds after the start; after `duration`, the end pose."""
        share = minimum_jerk(time / self.duration)
        position = self._start[:3, 3] + share * (self.end[:3, 3] - self._start[:3, 3])
        return pose_matrix(position, rotation_matrix(share * self._turn) @ self._start[:3, :3])
