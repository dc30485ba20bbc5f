"""Published networks of the study: their configuration and runtime; without torch.

``pose.onnx`` maps ``inputs`` (n, ...) uint8 to ``poses`` (n, 4, 4) float32, ``base_from_hand``.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from graspbox._common.made_once import MadeOnce
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.policies.published.configs import PolicyConfig
from graspbox.policies.published.folders import load
from graspbox.policies.published.runtimes import Network, onnx_network, output
from graspbox.study.model_configs import ModelConfig

__all__ = ["PosePolicyConfig", "PublishedPoses"]


@dataclass(frozen=True, kw_only=True)
class PosePolicyConfig(PolicyConfig):
    """A published network of the study."""

    kind: ClassVar[str] = "study"

    environment: None = None
    model: ModelConfig

    @property
    def holds(self) -> tuple[str, ...]:
        """Names of the files of its networks."""
        return ("pose.onnx",)

    def check(self, hand: Hand) -> None:
        """Check the preshape too; raises as `PolicyConfig.check`."""
        super().check(hand)
        low, high = hand.preshape_limits
        if not low <= self.model.preshape <= high:
            raise ConfigError(
                f"study.model.preshape is {self.model.preshape:g}; the hand {self.hand!r} has {low:g} to {high:g}"
            )


class PublishedPoses:
    """A published network of the study, run by onnxruntime; predicts as `graspbox.study.model.PoseModel` does.

    `published` describes the folder, and `config` the network. Raises as `graspbox.policies.published.load`.
    """

    def __init__(self, folder: Path) -> None:
        self.published = load(folder, PosePolicyConfig)
        self.config = self.published.model
        self._file = Path(folder) / "pose.onnx"
        self._network: MadeOnce[Network] = MadeOnce(partial(onnx_network, self._file))

    def predict(self, inputs: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Predict ``base_from_hand`` (n, 4, 4) for inputs (n, ...) uint8, one by one."""
        return predicted(self._network(), inputs, str(self._file))


def predicted(network: Network, inputs: NDArray[np.uint8], called: str) -> NDArray[np.float64]:
    """Predict poses by a network, named `called` in errors; see `PublishedPoses.predict`."""
    # One by one: the bits of a pose do not depend on the other inputs.
    poses = [output(network({"inputs": np.ascontiguousarray(one[None])}), "poses", (1, 4, 4), called) for one in inputs]
    return np.concatenate(poses).astype(np.float64)
