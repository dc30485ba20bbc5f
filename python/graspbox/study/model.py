"""A network with its scaling: from stored images or voxels to poses in metres."""

import json
import math
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox._common.arguments import config_of
from graspbox._common.files import read_bounded, replacing, write_text
from graspbox.errors import ConfigError, FileError
from graspbox.study.losses import LOSSES, Loss, normalized
from graspbox.study.model_configs import ModelConfig
from graspbox.study.networks import NETWORKS
from graspbox.study.samples import poses_of_labels

__all__ = ["ModelConfig", "PoseModel", "moved"]

#: Files of a saved model.
_CONFIG, _WEIGHTS = "model.json", "weights.pt"
_LARGEST_CONFIG = 1 << 20
#: Inputs per forward pass of `PoseModel.predict`.
_BATCH = 16


class PoseModel(nn.Module):  # type: ignore[misc]
    """Predicts the pose of a grasp from an image or a voxel grid.

    The input is scaled to [0, 1], shifted and scaled, and goes through the network; the network's positions are scaled
    and shifted to metres. Until `fit_scaling` is called, these shifts are 0 and the scales 1, as in the study. `seed`
    determines the initial weights. A network that does not take this kind of input is a `ConfigError`.
    """

    input_shift: Tensor
    input_scale: Tensor
    position_shift: Tensor
    position_scale: Tensor

    def __init__(self, config: ModelConfig, seed: int = 0) -> None:
        super().__init__()
        made = NETWORKS[config.network]
        self.config = config
        self.loss: Loss = LOSSES[config.loss]
        if (made.axes == 2) != (config.kind == "image"):
            raise ConfigError(f"the network {config.network!r} takes {made.axes} axes; kind {config.kind!r} has not")
        self.network = made(
            self.loss.outputs,
            units=config.units,
            zero_output=config.zero_output,
            size=config.size,
            fully_connected=config.fully_connected,
            generator=torch.Generator().manual_seed(seed),
        )
        self.register_buffer("input_shift", torch.zeros(()))
        self.register_buffer("input_scale", torch.ones(()))
        self.register_buffer("position_shift", torch.zeros(3))
        self.register_buffer("position_scale", torch.ones(()))

    def fit_scaling(self, inputs: NDArray[np.uint8], labels: NDArray[np.float32]) -> None:
        """Scale inputs (n, ...) and the positions of labels (n, 7 or 6) to mean 0 and variance 1."""
        # float64 sums over all images would take 8 times their memory; histograms do not.
        counts = np.bincount(inputs.reshape(-1), minlength=256) / inputs.size
        values = np.arange(256) / 255
        mean = float(counts @ values)
        spread = float(np.sqrt(counts @ (values - mean) ** 2))
        positions = labels[:, :3].astype(np.float64)
        around = float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).mean()))
        self.input_shift.fill_(mean)
        self.input_scale.fill_(max(spread, 1e-3))
        self.position_shift.copy_(torch.as_tensor(positions.mean(axis=0)))
        self.position_scale.fill_(max(around, 1e-3))

    def forward(self, inputs: Tensor) -> Tensor:
        """Predict outputs (n, 7 or 6), positions in metres, from inputs (n, ...) uint8; no quaternion is normalized."""
        scaled = (inputs.to(torch.float32) / 255 - self.input_shift) / self.input_scale
        outputs = self.network(scaled.unsqueeze(1))
        positions = outputs[:, :3] * self.position_scale + self.position_shift
        return torch.cat([positions, outputs[:, 3:]], dim=1)

    def labels(self, inputs: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Predict labels (n, 7 or 6) of inputs (n, ...) uint8; quaternions are normalized."""
        shape = self.network.input_shape[1:]
        if inputs.ndim != len(shape) + 1 or inputs.shape[1:] != shape or inputs.dtype != np.uint8:
            wanted = f"(n, {', '.join(map(str, shape))}) uint8"
            raise ConfigError(f"the inputs have shape {inputs.shape} and type {inputs.dtype}; they must be {wanted}")
        was, batches = self.training, []
        self.eval()
        with torch.inference_mode():
            for start in range(0, len(inputs), _BATCH):
                batch = torch.from_numpy(np.ascontiguousarray(inputs[start : start + _BATCH]))
                outputs = self(batch.to(self.input_shift.device))
                if self.loss.size == 4:
                    outputs[:, 3:] = normalized(outputs[:, 3:])
                batches.append(outputs.cpu().numpy())
        self.train(was)
        return np.concatenate(batches)

    def predict(self, inputs: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Predict ``base_from_hand`` (n, 4, 4) for inputs (n, ...) uint8; refuses outputs that are not finite."""
        return poses_of_labels(self.labels(inputs))

    def save(self, folder: Path) -> None:
        """Write ``model.json`` and ``weights.pt``."""
        self.describe(folder)
        with replacing(folder / _WEIGHTS) as path:
            torch.save(self.state_dict(), path)

    def describe(self, folder: Path) -> None:
        """Write only ``model.json``."""
        write_text(folder / _CONFIG, json.dumps(asdict(self.config), indent=2) + "\n")

    @classmethod
    def load(cls, folder: Path) -> "PoseModel":
        """Read the files of `save`; refuses files that are missing, damaged or do not belong together."""
        try:
            settings: Any = json.loads(read_bounded(folder / _CONFIG, _LARGEST_CONFIG))
            model = cls(config_of(ModelConfig, settings, _CONFIG))
        except (ValueError, TypeError, AttributeError) as error:
            raise ConfigError(
                f"{str(folder / _CONFIG)!r} does not describe a model ({error}); train the network again"
            ) from None
        path = folder / _WEIGHTS
        if not path.is_file():
            raise FileError(2, "there are no weights of a model", str(path))
        try:
            model.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        except (RuntimeError, pickle.UnpicklingError, EOFError, TypeError) as error:
            reason = str(error).partition("\n")[0]
            raise ConfigError(
                f"{str(path)!r} does not have the weights of the network of {_CONFIG} ({reason}); train it again"
            ) from None
        return model


def moved(before: PoseModel, after: PoseModel) -> float:
    """Measure how far the weights of all layers but the last moved, as a share of their norm."""
    with torch.no_grad():
        pairs = list(zip(before.network.parameters(), after.network.parameters(), strict=True))[:-2]
        apart = sum(float((a - b).square().sum()) for a, b in pairs)
        return math.sqrt(apart / sum(float(a.square().sum()) for a, _ in pairs))
