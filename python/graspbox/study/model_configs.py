"""Configuration of a network of the study; read without torch."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from graspbox._common.arguments import check_range, natural, shown
from graspbox.errors import ConfigError
from graspbox.study.samples import Kind

__all__ = ["LossName", "ModelConfig", "NetworkName", "Units"]

#: Keys of `graspbox.study.networks.NETWORKS` and of `graspbox.study.losses.LOSSES`, which need torch.
NetworkName = Literal["cnn2d", "cnn2d_dropout", "cnn3d"]
LossName = Literal["posenet", "psi1", "psi2", "psi3", "psi4", "euler"]
Units = Literal["sigmoid", "relu"]

#: Upper bounds of the side of an input and of the units of a layer, with a wide margin.
_LARGEST, _WIDEST = 1024, 1 << 16


@dataclass(frozen=True)
class ModelConfig:
    """Configuration of a `graspbox.study.model.PoseModel`; refuses unknown names and numbers out of range.

    Attributes
    ----------
    network, loss, kind, units : str
        The network, its loss, which determines whether outputs are quaternions or Euler angles, its input
        (`graspbox.study.samples`) and its activation functions.
    zero_output : bool
        Whether its last layer is initialized with zeros.
    preshape : float
        The preshape of its training grasps, which it does not predict; within the limits of the hand.
    size, fully_connected : int and tuple of int, or None
        Side of its inputs, 1 to 1024, and units of the fully connected layers before the last; None for the study's.
    """

    network: NetworkName
    loss: LossName
    kind: Kind
    units: Units = "relu"
    zero_output: bool = False
    preshape: float = 0.0
    size: int | None = None
    fully_connected: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        for name, known in (("network", NetworkName), ("loss", LossName), ("kind", Kind), ("units", Units)):
            if (value := getattr(self, name)) not in get_args(known):
                raise ConfigError(f"{name} is {shown(value)}; choose from {', '.join(get_args(known))}")
        if not math.isfinite(self.preshape):
            raise ConfigError(f"preshape is {self.preshape}; it must be finite")
        if self.size is not None:
            natural(self.size, "size")
            check_range(self, "size", 1, _LARGEST)
        if self.fully_connected is not None:
            # JSON has lists, not tuples.
            widths = tuple(natural(width, "fully_connected") for width in self.fully_connected)
            object.__setattr__(self, "fully_connected", widths)
            if not widths or not all(0 < width <= _WIDEST for width in widths):
                raise ConfigError(f"fully_connected is {shown(widths)}; they must be integers from 1 to {_WIDEST}")
