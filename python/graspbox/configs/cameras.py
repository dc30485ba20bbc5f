"""Cameras of environments and pictures, as frozen dataclasses, with their intrinsics and poses.

The other settings are in `graspbox.configs`.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = [
    "FRONT",
    "OVERHEAD",
    "PALM",
    "VIEWER",
    "CameraConfig",
    "CamerasConfig",
    "PictureConfig",
    "camera_pose",
    "lens",
]


@dataclass(frozen=True)
class CameraConfig:
    """One camera; lengths in metres, in the frame of its mount.

    Attributes
    ----------
    name : str
        Lower-case letters and digits.
    mount : {"world", "hand"}
        Frame of the camera's pose: the world frame, or the grasp frame of the hand (z out of the palm).
    eye, target, up : tuple of float
        Position of the camera, the point at the centre of its image, and the upward direction of its image.
    fov : float
        Vertical field of view, radians.
    near, far : float
        Clipping distances, metres.
    """

    name: str = "front"
    mount: Literal["world", "hand"] = "world"
    eye: tuple[float, float, float] = (-0.421, 0.0, 0.413)
    target: tuple[float, float, float] = (0.0, 0.0, 0.06)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float = 0.5
    near: float = 0.02
    far: float = 2.0


#: In front of the workspace, 0.55 m from its middle, looking down at 40 degrees.
FRONT = CameraConfig()
#: Over the workspace, as over a bin: 0.55 m from its middle, looking down at 75 degrees.
OVERHEAD = CameraConfig(eye=(-0.142, 0.0, 0.591))
#: On a bracket next to the palm, looking between the fingers at the object in the hand.
PALM = CameraConfig("palm", "hand", eye=(0.0, 0.075, 0.0), target=(0.0, 0.0, 0.09), up=(-1.0, 0.0, 0.0), fov=1.3)
#: For pictures: from the side; hand and object fill them from the start of an episode until the object is lifted.
VIEWER = CameraConfig("viewer", eye=(-0.6, -0.8, 0.72), target=(0.0, 0.0, 0.24), fov=0.56, far=30.0)


@dataclass(frozen=True)
class CamerasConfig:
    """Cameras and images of environments.

    Attributes
    ----------
    images : tuple of str
        Names of images: ``kind`` for the first camera, or ``kind_camera``. Kinds are ``rgb``, ``depth``, ``rgbd``,
        ``segmentation``, ``amodal``, ``points`` and ``voxels``; ``voxels`` without a camera combines all of them.
    image_size : pair of int
        Rows and columns of every image.
    cameras : tuple of CameraConfig
        The cameras.
    shadows : bool
        Whether hand and object cast shadows in colour images.
    voxels : int
        Voxels along each side of the cube of ``voxels``.
    voxel_side : float
        Side of that cube, metres. It is centred above the table; the table top lies halfway through its lowest layer.
    """

    images: tuple[str, ...] = ()
    image_size: tuple[int, int] = (64, 64)
    cameras: tuple[CameraConfig, ...] = (FRONT, PALM)
    shadows: bool = True
    voxels: int = 32
    voxel_side: float = 0.4


@dataclass(frozen=True)
class PictureConfig:
    """A rendered picture for viewing.

    Attributes
    ----------
    image_size : pair of int
        Rows and columns.
    samples : int
        Samples along each side of a pixel, 1 to 8.
    camera : CameraConfig
        The camera.
    """

    image_size: tuple[int, int] = (480, 640)
    samples: int = 3
    camera: CameraConfig = VIEWER


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
