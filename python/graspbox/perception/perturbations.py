"""Small random motions of hand poses."""

from dataclasses import dataclass
from math import degrees, radians
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspbox._common.rotations import rotation_about
from graspbox.errors import ConfigError

__all__ = ["PoseNoise", "perturbed"]


#: Largest standard deviations of `PoseNoise`, metres and radians.
_LARGEST = (0.05, 0.5)


@dataclass(frozen=True)
class PoseNoise:
    """Normal errors of a hand's pose along and about each of its axes.

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
        for name, most, unit in (("position", _LARGEST[0], "metres"), ("rotation", _LARGEST[1], "radians")):
            if not 0.0 <= (value := getattr(self, name)) <= most:
                raise ConfigError(f"{name} of the hand's error is {value}; pass {unit}, 0 to {most}")

    @classmethod
    def in_millimetres(cls, position: float, rotation: float) -> Self:
        """Convert millimetres and degrees; raises as the class."""
        most = 1e3 * _LARGEST[0], degrees(_LARGEST[1])
        if not (0.0 <= position <= most[0] and 0.0 <= rotation <= most[1]):
            raise ConfigError(
                f"the hand's error is {position:g} mm and {rotation:g} degrees; pass 0 to {most[0]:g} mm and 0 to "
                f"{most[1]:.1f} degrees"
            )
        return cls(1e-3 * position, radians(rotation))


def perturbed(
    poses: NDArray[np.float64], rng: np.random.Generator, position: float, rotation: float
) -> NDArray[np.float64]:
    """Move poses (n, 4, 4) along and about each axis of the hand by normal errors, metres and radians."""
    moved = poses.copy()
    moved[:, :3, 3] += np.einsum("nij,nj->ni", poses[:, :3, :3], rng.normal(0.0, position, (len(poses), 3)))
    turns = rng.normal(0.0, rotation, (len(poses), 3))
    angles = np.linalg.norm(turns, axis=1)
    moved[:, :3, :3] = poses[:, :3, :3] @ rotation_about(turns / np.maximum(angles, 1e-12)[:, None], angles)
    return moved
