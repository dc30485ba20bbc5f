"""Intrinsics and pose of a camera of a config."""

import numpy as np
from numpy.typing import NDArray

from graspbox.configs.cameras import CameraConfig
from graspbox.errors import ConfigError

__all__ = ["camera_pose", "lens"]


def lens(fov: float, image_size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the intrinsics (3, 3), pixels, of a vertical field of view (radians) and images of rows and columns."""
    rows, columns = image_size
    focal = 0.5 * rows / np.tan(0.5 * fov)
    return np.array([[focal, 0.0, 0.5 * columns], [0.0, focal, 0.5 * rows], [0.0, 0.0, 1.0]])


def camera_pose(camera: CameraConfig) -> NDArray[np.float64]:
    """Return the pose (4, 4) of a camera in the frame of its mount: z forward, x right, y down.

    Raises
    ------
    ConfigError
        If eye and target coincide, or it looks along `up`.
    """
    eye, target, up = (np.asarray(v, dtype=np.float64) for v in (camera.eye, camera.target, camera.up))
    forward = target - eye
    right = np.cross(forward, up)
    if min(np.linalg.norm(forward), np.linalg.norm(right)) < 1e-9:
        raise ConfigError(
            f"camera {camera.name!r} at {camera.eye} looks at {camera.target} with {camera.up} up; move one"
        )
    forward /= np.linalg.norm(forward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose
