"""What a network of the study is made of; read without torch."""

from dataclasses import dataclass
from typing import Literal

from graspbox.learning.samples import Kind

__all__ = ["ModelConfig", "Units"]

Units = Literal["sigmoid", "relu"]


@dataclass(frozen=True)
class ModelConfig:
    """What a `graspbox.learning.model.PoseModel` is made of.

    Attributes
    ----------
    network : str
        One of `graspbox.learning.networks.NETWORKS`.
    loss : str
        One of `graspbox.learning.losses.LOSSES`; it decides between quaternions and Euler angles.
    kind : {"image", "binary", "ternary"}
        What it sees (`graspbox.learning.samples`).
    units : {"relu", "sigmoid"}
        Units of the network.
    zero_output : bool
        Whether its last layer begins with zeros.
    preshape : float
        The preshape of the grasps that it learns from, which it does not predict.
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
            # JSON has lists.
            object.__setattr__(self, "fully_connected", tuple(self.fully_connected))
