"""A pretrained grasp regressor or head as the features extractor of a policy of Stable-Baselines3.

| folder with | trained by | observation | features |
|---|---|---|---|
| ``model.json`` | `graspbox.study.training` (``Cnn2d``, ``Cnn2dDropout``) | ``rgbd`` | the penultimate layer, for the image as `graspbox.study.regressor` centres it |
| ``model.json`` | `graspbox.study.training` (``Cnn3d``) | ``voxels`` | the same, for the voxels as the regressor crops them |
| ``head.json`` | `graspbox.models.head.training` (``anchor``, ``set``, ``regressor``) | ``depth`` | the feature map of the trunk, for the crop around the object, averaged to 6 x 6 |

A trainable layer maps them to `features` numbers. Crops and centred images do not contain the object's position, so it
is appended: whether an object was visible, x and y in the world (metres), and for a head the cosine and sine of the
crop's yaw. Other entries of a ``Dict`` go through the networks of `graspbox.sb3.extractors`.

Pass it as ``policy_kwargs=dict(features_extractor_class=TrunkExtractor, features_extractor_kwargs=dict(folder=...))``;
docs/guides/train.md has an example.
"""  # noqa: E501 (a table)

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from graspbox.configs.cameras import CamerasConfig
from graspbox.envs.settings import HandArgument
from graspbox.errors import ConfigError
from graspbox.models.head.heads import PoseNet
from graspbox.models.head.network import AnchorNet
from graspbox.models.head.training import load_head
from graspbox.perception.cameras import camera_pose, lens
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import crop
from graspbox.perception.hand_grids import HandGrid
from graspbox.sb3.extractors import network
from graspbox.simulation import load_hand
from graspbox.study.model import PoseModel
from graspbox.study.regressor import VOXELS, centered_image, cropped_voxels
from graspbox.study.samples import IMAGE_SIZE

__all__ = ["TrunkExtractor"]

#: Side of a head's feature map.
_MAP = 6


class _Trunk(nn.Module):  # type: ignore[misc]
    """A trained network without its last layers, always in evaluation mode.

    Rollouts and updates therefore use the same function. It keeps its weights when a policy initializes its modules:
    PPO would reinitialize the layers of its features extractor.
    """

    #: The observation that it needs, and its shape; None: (H, W, 1).
    obs: str
    shape: tuple[int, ...] | None
    #: Number of its outputs, and of the numbers appended to them.
    size: int
    beside: int

    @abstractmethod
    def prepare(self, rows: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Convert rows of the observation to inputs of the network, and the numbers appended to its output."""

    def train(self, mode: bool = True) -> Self:
        """Stay in evaluation mode."""
        del mode
        super().train(False)
        return self

    def apply(self, fn: Callable[[nn.Module], None]) -> Self:
        """Keep the weights unchanged."""
        del fn
        return self


class _Regressor(_Trunk):
    """A network of the study."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.model = PoseModel.load(folder)
        kind = self._kind = self.model.config.kind
        self.obs = "rgbd" if kind == "image" else "voxels"
        self.shape = (IMAGE_SIZE, IMAGE_SIZE, 4) if kind == "image" else (VOXELS,) * 3
        layers = self.model.network.layers
        self.size, self.beside = layers[-1].in_features, 3
        layers[-1] = nn.Identity()

    def prepare(self, rows: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Centre or crop the object of each row."""
        inputs = np.zeros((len(rows), *self.model.network.input_shape[1:]), dtype=np.uint8)
        beside = np.zeros((len(rows), self.beside), dtype=np.float32)
        for i, row in enumerate(rows):
            codes = row if self._kind == "image" else row.astype(np.uint8)
            found = centered_image(codes) if self._kind == "image" else cropped_voxels(codes, self._kind)
            if found is not None:
                inputs[i], beside[i] = found[0], (1.0, *found[1][:2, 3])
        return inputs, beside

    def forward(self, inputs: Tensor) -> Tensor:
        """Return the units (n, size) of the penultimate layer, from inputs (n, ...) uint8."""
        model = self.model
        scaled = (inputs.float() / 255.0 - model.input_shift) / model.input_scale
        found: Tensor = model.network(scaled.unsqueeze(1))
        return found


class _Head(_Trunk):
    """The trunk of a head."""

    def __init__(self, folder: Path, cameras: CamerasConfig, hand: HandArgument) -> None:
        super().__init__()
        camera, self._crop = cameras.cameras[0], CropConfig()
        if camera.mount != "world":
            raise ConfigError(f"camera {camera.name!r} is mounted on the hand; put one first whose mount is 'world'")
        head = load_head(folder, len(HandGrid(load_hand(hand), crop=self._crop).preshapes), self._crop)
        if not isinstance(head, AnchorNet | PoseNet):
            raise ConfigError(f"the head in {str(folder)!r} has no network; name one of another kind than 'constant'")
        self.net = nn.Sequential(head.trunk, *([head.features] if isinstance(head, AnchorNet) else []))
        channels = head.config.features if isinstance(head, AnchorNet) else head.config.width
        self.pool = nn.Sequential(nn.AdaptiveAvgPool2d(_MAP), nn.Flatten())
        self.obs, self.shape, self.size, self.beside = "depth", None, channels * _MAP**2, 5
        self._fov, self._pose = camera.fov, camera_pose(camera)

    def prepare(self, rows: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Crop the object of each row, as `graspbox.policies.HeadGrasp` does."""
        images = np.ascontiguousarray(rows[..., 0])
        size = (images.shape[1], images.shape[2])
        poses = np.broadcast_to(self._pose, (len(images), 4, 4))
        found = crop(images, lens(self._fov, size), poses, config=self._crop)
        pose = found.world_from_crop
        places = [pose[:, 0, 3], pose[:, 1, 3], pose[:, 0, 0], pose[:, 1, 0]]
        beside = np.stack([np.ones(len(pose)), *places], axis=1) * found.found[:, None]
        return found.channels[:, :2], beside.astype(np.float32)

    def forward(self, inputs: Tensor) -> Tensor:
        """Return features (n, size) of channels (n, 2, N, N, N) uint8."""
        found: Tensor = self.pool(self.net(inputs))
        return found


def _load(folder: Path, cameras: CamerasConfig, hand: HandArgument) -> _Regressor | _Head:
    if (folder / "model.json").is_file():
        return _Regressor(folder)
    if (folder / "head.json").is_file():
        return _Head(folder, cameras, hand)
    raise ConfigError(
        f"{str(folder)!r} holds neither model.json nor head.json; name the folder in which a network of the study "
        "(graspbox.study) or a head (graspbox train head) was trained"
    )


class TrunkExtractor(BaseFeaturesExtractor):  # type: ignore[misc]
    """Features of an observation from a trained network; see the table of the module.

    A saved model loads the folder again before it reads its own weights.

    Parameters
    ----------
    observation_space : gymnasium.Space
        Space of the observation that the network needs, or a ``Dict`` with it.
    folder : str or Path
        Folder of the trained network.
    frozen : bool
        Whether the network is frozen; else it is trained with the policy. Normalization and dropout stay in evaluation
        mode.
    features : int
        Number of features computed from the network's output.
    cameras : CamerasConfig
        Cameras of the environments; a head uses the first one. The observation determines the size of its images.
    hand : str, Hand or pair of paths
        The hand with which a head was trained.

    Raises
    ------
    ConfigError
        If the folder holds no network of the table, or the observation does not fit it.
    FileError
        If a file is missing.
    """

    def __init__(
        self,
        observation_space: gymnasium.Space[Any],
        folder: str | Path,
        frozen: bool = True,
        features: int = 128,
        cameras: CamerasConfig = CamerasConfig(),  # noqa: B008 (frozen)
        hand: HandArgument = "reflex",
    ) -> None:
        if features < 1:
            raise ConfigError(f"features is {features}; it must be at least 1")
        trunk = _load(Path(folder), cameras, hand)
        named = isinstance(observation_space, gymnasium.spaces.Dict)
        spaces = observation_space.spaces if named else {trunk.obs: observation_space}  # type: ignore[attr-defined]
        _check(trunk, spaces, folder)
        others = {name: network(space, features) for name, space in spaces.items() if name != trunk.obs}
        size = features + trunk.beside + sum(count for _, count in others.values())
        super().__init__(observation_space, size)
        self._named, self.frozen = named, frozen
        self.trunk = trunk.eval()
        self.trunk.requires_grad_(not frozen)
        self.neck = nn.Sequential(nn.Linear(trunk.size, features), nn.ReLU())
        self.networks = nn.ModuleDict({f"of_{name}": net for name, (net, _) in others.items()})

    def forward(self, observations: Any) -> Tensor:
        """Features (rows, features_dim) of observations preprocessed by Stable-Baselines3."""
        seen = observations[self.trunk.obs] if self._named else observations
        inputs, beside = self.trunk.prepare(seen.detach().cpu().numpy())
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            found = self.trunk(torch.from_numpy(inputs).to(seen.device))
        parts = [self.neck(found), torch.from_numpy(beside).to(seen.device)]
        parts += [net(observations[name.removeprefix("of_")]) for name, net in self.networks.items()]
        return torch.cat(parts, dim=1)


def _check(trunk: _Trunk, spaces: dict[str, Any], folder: str | Path) -> None:
    """Refuse observations of the wrong shape or kind."""
    if trunk.obs not in spaces:
        raise ConfigError(f"the network in {str(folder)!r} needs obs={trunk.obs!r}; there are {', '.join(spaces)}")
    shape = spaces[trunk.obs].shape
    fits = shape == trunk.shape if trunk.shape is not None else len(shape) == 3 and shape[2] == 1
    if not fits:
        wanted = trunk.shape or "(H, W, 1)"
        raise ConfigError(
            f"the observation has shape {shape}; the network in {str(folder)!r} needs obs={trunk.obs!r} of shape "
            f"{wanted}, as graspbox.study.regressor.cameras makes it for a network of the study"
        )
