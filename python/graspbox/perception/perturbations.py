"""Small random motions of hand poses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = ["PoseNoise", "perturbed"]


@dataclass(frozen=True)
class PoseNoise:
    """How far a hand goes from where it is sent: normal errors along and about each of its axes.

    Attributes
    ----------
    position, rotation : float
        Standard deviations, metres and radians; at most 0.05 m and 0.5.

    Raises
    ------
    ConfigError
        For a number out of range.
    """

    position: float = 0.004
    rotation: float = 0.07

    def __post_init__(self) -> None:
        for name, most, unit in (("position", 0.05, "metres"), ("rotation", 0.5, "radians")):
            if not 0.0 <= (given := getattr(self, name)) <= most:
                raise ConfigError(f"{name} of the hand's error is {given}; give {unit}, 0 to {most}")


def perturbed(
    poses: NDArray[np.float64], rng: np.random.Generator, position: float, rotation: float
) -> NDArray[np.float64]:
    """Move poses (n, 4, 4) along and about each axis of the hand by normal errors, metres and radians."""
    moved = poses.copy()
    moved[:, :3, 3] += np.einsum("nij,nj->ni", poses[:, :3, :3], rng.normal(0.0, position, (len(poses), 3)))
    turns = rng.normal(0.0, rotation, (len(poses), 3))
    angles = np.linalg.norm(turns, axis=1)[:, None, None]
    x, y, z = (turns / np.maximum(angles[:, 0], 1e-12)).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    turned = np.eye(3) + np.sin(angles) * cross + (1.0 - np.cos(angles)) * (cross @ cross)
    moved[:, :3, :3] = poses[:, :3, :3] @ turned
    return moved
