"""Folders of published networks of the study, and what runs them; without torch.

| file | contents |
|---|---|
| ``config.json``      | `PosePolicyConfig` |
| ``pose.onnx``        | ``inputs`` (n, ...) uint8 to ``poses`` (n, 4, 4) float32, ``base_from_hand`` |
| ``pose.safetensors`` | the weights, the large ones in half precision |
| ``README.md``        | the card: data, command, time, seed, scores, limits |
| ``LICENSE``          | the licence of the weights |
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.learning.model_configs import ModelConfig
from graspbox.perception.policy_folders import (
    POSE_KIND,
    check_hashes,
    check_texts,
    read_config,
    read_learned_from,
    write_config,
)
from graspbox.perception.runtimes import Network, onnx_network

__all__ = ["PosePolicyConfig", "PublishedPoses", "read_pose_policy", "write_pose_policy"]


@dataclass(frozen=True)
class PosePolicyConfig:
    """What a published network of the study is.

    Attributes
    ----------
    name : str
        Name in results.
    graspbox : str
        Version that exported it.
    hand : str
        The hand that it was trained with.
    model : ModelConfig
        The network.
    files : mapping of str to str
        SHA-256 of every file of the network.
    """

    name: str
    graspbox: str
    hand: str
    model: ModelConfig
    files: Mapping[str, str]

    def __post_init__(self) -> None:
        check_texts(self, "name", "graspbox", "hand")
        check_hashes(self.files)
        if not isinstance(self.model, ModelConfig):
            raise ConfigError(f"model is {self.model!r}; give the fields of a ModelConfig")


def write_pose_policy(folder: Path, config: PosePolicyConfig) -> None:
    """Write ``config.json``."""
    write_config(folder, POSE_KIND, config)


def read_pose_policy(folder: Path) -> PosePolicyConfig:
    """Read ``config.json`` of a published network of the study, and check the files that it names.

    Raises
    ------
    FileError
        If a file is missing.
    ConfigError
        If the policy is of another kind, an entry is missing, unknown or wrong, or a file is not the one that was
        exported.
    """
    return read_config(Path(folder), POSE_KIND, PosePolicyConfig)


class PublishedPoses:
    """A published network of the study, run by onnxruntime; predicts as `graspbox.learning.model.PoseModel` does.

    Parameters
    ----------
    folder : Path
        Its folder.
    num_threads : int, optional
        Threads of a prediction; by default one per core.

    Raises
    ------
    ConfigError, FileError
        As `read_pose_policy`.

    Attributes
    ----------
    published : PosePolicyConfig
        What the folder says.
    config : ModelConfig
        The network.
    learned_from : tuple of str
        Object sets from which it learned.
    """

    def __init__(self, folder: Path, num_threads: int | None = None) -> None:
        self.published = read_pose_policy(folder)
        self.config = self.published.model
        self.learned_from = read_learned_from(Path(folder))
        self._file, self._num_threads = Path(folder) / "pose.onnx", num_threads
        self._network: Network | None = None

    def predict(self, inputs: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Predict ``base_from_hand`` (n, 4, 4) for inputs (n, ...) uint8, each by itself.

        Raises
        ------
        ConfigError
            If the network's outputs are not finite.
        """
        if self._network is None:
            self._network = onnx_network(self._file, self._num_threads)
        # One by one: the bits of a pose do not depend on the other inputs.
        poses = [self._network({"inputs": np.ascontiguousarray(one[None])})["poses"] for one in inputs]
        found = np.concatenate(poses).astype(np.float64)
        if not np.isfinite(found).all():
            raise ConfigError("the poses hold numbers that are not finite; the network has diverged")
        return found
