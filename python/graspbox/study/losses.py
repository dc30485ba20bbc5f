"""The losses of the reference study, by name: position error, plus a weight times one of six orientation errors.

| name | orientation error | greatest value | q and -q equal |
|---|---|---|---|
| ``posenet`` | norm of q_true - q                                        | 2          | no  |
| ``psi1``    | min(norm of q_true - q, norm of q_true + q)               | sqrt(2)    | yes |
| ``psi2``    | min(acos(q_true . q), pi - acos(q_true . q))              | pi/2       | yes |
| ``psi3``    | acos(abs(q_true . q))                                     | pi/2       | yes |
| ``psi4``    | 1 - abs(q_true . q)                                       | 1          | yes |
| ``euler``   | norm of the wrapped differences of roll, pitch and yaw    | pi sqrt(3) |     |

q is the network's output after `normalized`. ``psi2`` and ``psi3`` are one function written in two ways, equal to half
the angle of the rotation between the two; the study reports different results for them. acos(c) is evaluated as
2 atan2(norm of a - b, norm of a + b): the same value, but its gradient is finite everywhere.

Source of psi1 to psi4 and ``euler``: D. Huynh, "Metrics for 3D rotations: comparison and analysis", Journal of
Mathematical Imaging and Vision 35(2), 2009; of ``posenet``: A. Kendall, M. Grimes, R. Cipolla, "PoseNet: a
convolutional network for real-time 6-DOF camera relocalization", ICCV 2015.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ["LOSSES", "Errors", "Loss", "LossWeights", "normalized"]

#: Added to the first entry of a quaternion before it is normalized, so that zero has a direction (algorithm 7).
DELTA = 1e-12


def normalized(quaternions: Tensor) -> Tensor:
    """Normalize quaternions (n, 4) by the study's algorithm 7: (q + delta) / norm, delta = (1e-12, 0, 0, 0)."""
    shifted = quaternions + torch.tensor([DELTA, 0.0, 0.0, 0.0], dtype=quaternions.dtype, device=quaternions.device)
    # A norm of 0 remains if q is exactly -delta; the floor prevents 0 / 0.
    return shifted / torch.linalg.vector_norm(shifted, dim=1, keepdim=True).clamp_min(1e-30)


def _distance(first: Tensor, second: Tensor) -> Tensor:
    """Euclidean distance (n,); its gradient is 0 where it is 0."""
    return torch.linalg.vector_norm(first - second, dim=1)


def _angle(first: Tensor, second: Tensor) -> Tensor:
    """Angle (n,) in [0, pi] between unit vectors: acos of their product, with a finite gradient."""
    return 2 * torch.atan2(_distance(first, second), _distance(first, -second))


def _posenet(true: Tensor, predicted: Tensor) -> Tensor:
    return _distance(true, normalized(predicted))


def _psi1(true: Tensor, predicted: Tensor) -> Tensor:
    q = normalized(predicted)
    return torch.minimum(_distance(true, q), _distance(true, -q))


def _psi2(true: Tensor, predicted: Tensor) -> Tensor:
    angle = _angle(true, normalized(predicted))
    return torch.minimum(angle, math.pi - angle)


def _psi3(true: Tensor, predicted: Tensor) -> Tensor:
    q = normalized(predicted)
    opposite = (true * q).sum(dim=1, keepdim=True) < 0
    return _angle(true, torch.where(opposite, -q, q))


def _psi4(true: Tensor, predicted: Tensor) -> Tensor:
    return 1 - (true * normalized(predicted)).sum(dim=1).abs()


def _euler(true: Tensor, predicted: Tensor) -> Tensor:
    difference = (true - predicted).abs().remainder(2 * math.pi)
    return torch.linalg.vector_norm(torch.minimum(difference, 2 * math.pi - difference), dim=1)


@dataclass(frozen=True)
class Loss:
    """An orientation error.

    `error` maps true orientations (n, k) and a network's outputs (n, k) to nonnegative errors (n,), at most `greatest`.
    `size` is k: 4 for quaternions (w, x, y, z), where the true ones are unit and the outputs are normalized, and 3 for
    Euler angles (roll, pitch, yaw), radians.
    """

    name: str
    error: Callable[[Tensor, Tensor], Tensor]
    size: int
    greatest: float

    @property
    def outputs(self) -> int:
        """Number of network outputs for this loss: three for the position, and those of the orientation."""
        return 3 + self.size


LOSSES = {
    loss.name: loss
    for loss in (
        Loss("posenet", _posenet, 4, 2.0),
        Loss("psi1", _psi1, 4, math.sqrt(2)),
        Loss("psi2", _psi2, 4, math.pi / 2),
        Loss("psi3", _psi3, 4, math.pi / 2),
        Loss("psi4", _psi4, 4, 1.0),
        Loss("euler", _euler, 3, math.pi * math.sqrt(3)),
    )
}


@dataclass(frozen=True)
class LossWeights:
    """Weights of the orientation error and of the position error, 1/m; by default those of the study's program."""

    rotation: float = 0.031
    position: float = 0.005


@dataclass(frozen=True)
class Errors:
    """Position errors (n,) of a batch, metres, and orientation errors (n,), in the unit of the loss."""

    position: Tensor
    rotation: Tensor

    @classmethod
    def of(cls, loss: Loss, labels: Tensor, outputs: Tensor) -> "Errors":
        """Compare labels (n, 3 + k) with outputs (n, 3 + k): position (metres), then orientation."""
        return cls(_distance(labels[:, :3], outputs[:, :3]), loss.error(labels[:, 3:], outputs[:, 3:]))

    def total(self, weights: LossWeights) -> Tensor:
        """Weighted sum per sample, (n,)."""
        return weights.position * self.position + weights.rotation * self.rotation
