"""Configuration of a network of the study; read without torch."""

from dataclasses import dataclass
from typing import Literal

from graspbox.study.samples import Kind

__all__ = ["ModelConfig", "Units"]

Units = Literal["sigmoid", "relu"]


@dataclass(frozen=True)
class ModelConfig:
    """Configuration of a `graspbox.study.model.PoseModel`.

    Attributes
    ----------
    network : str
        One of `graspbox.study.networks.NETWORKS`.
    loss : str
        One of `graspbox.study.losses.LOSSES`; it determines whether outputs are quaternions or Euler angles.
    kind : {"image", "binary", "ternary"}
        Its input (`graspbox.study.samples`).
    units : {"relu", "sigmoid"}
        Activation functions of the network.
    zero_output : bool
        Whether its last layer is initialized with zeros.
    preshape : float
        The preshape of its training grasps, which it does not predict.
    size : int or None
        Side of its inputs; None for the study's.
    fully_connected : tuple of int or None
        Units of the fully connected layers before the last; None for the study's.
    """

    network: str
    loss: str
    kind: Kind
    units: Units = "relu"
    zero_output: bool = False
    preshape: float = 0.0
    size: int | None = None
    fully_connected: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if self.fully_connected is not None:
            # JSON has lists, not tuples.
            object.__setattr__(self, "fully_connected", tuple(self.fully_connected))
