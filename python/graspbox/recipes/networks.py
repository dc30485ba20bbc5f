"""The networks trained by the stages of a run, loaded from its folder."""

from dataclasses import dataclass
from pathlib import Path

import torch

from graspbox._common.files import replacing, write_bytes
from graspbox.artifacts import weight_files
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.folders import completion_folder, read_depth_policy
from graspbox.artifacts.runtimes import AnchorHead, Completion, onnx_network
from graspbox.errors import ConfigError
from graspbox.models.completion.network import CompletionNet
from graspbox.models.head.network import AnchorNet
from graspbox.models.head.training import load_head
from graspbox.models.scenes import SceneConfig
from graspbox.models.scorer.network import ScorerNet
from graspbox.models.scorer.shared import SharedScorerNet
from graspbox.perception import HandGrid
from graspbox.perception.anchors import Anchors
from graspbox.recipes.settings import Sizes
from graspbox.training.trainer import load_weights

__all__ = ["TrainedNetworks", "shared_weights"]

#: Weights of a completion that was not trained in the run.
ADOPTED = "completion.safetensors"


def shared_weights(run: Path) -> Path:
    """Find the weights of a run of ``graspbox train any-hand``: those of its last round.

    Raises
    ------
    ConfigError
        If there are none.
    """
    found = sorted(run.glob("round-*/weights.pt"), key=lambda path: int(path.parent.name.partition("-")[2]))
    for path in (*reversed(found), run / "scorer" / "weights.pt"):
        if path.exists():
            return path
    raise ConfigError(f"there is no trained scorer in {str(run)!r}; name a run of graspbox train any-hand")


@dataclass(frozen=True)
class TrainedNetworks:
    """Networks of a run.

    Attributes
    ----------
    out : Path
        The run's folder.
    sizes : Sizes
        Sizes of the networks.
    grid : HandGrid
        Voxel grid of the hand.
    scenes : SceneConfig
        How scenes are rendered.
    """

    out: Path
    sizes: Sizes
    grid: HandGrid
    scenes: SceneConfig

    def completion_net(self) -> CompletionNet:
        """Load the trained completion, or that of another policy (`adopt_completion`)."""
        if (weights := self.out / "completion" / ADOPTED).exists():
            width = len(weight_files.load_weights(weights)["stem.weight"])
            return weight_files.restored(lambda: CompletionNet(width), weights)
        net = CompletionNet(self.sizes.completion_width)
        load_weights(net, self.out / "completion" / "weights.pt")
        return net

    def completion(self) -> Completion:
        """Load the exported completion."""
        return Completion(onnx_network(self.out / "completion" / "completion.onnx"))

    def adopt_completion(self, policy: Path) -> DepthPolicyConfig:
        """Copy the completion of a published policy into the run; returns the policy's description.

        Raises
        ------
        ConfigError
            If the folder holds no policy of one depth image, or one with other crops.
        """
        config = read_depth_policy(policy)
        if config.crop != self.scenes.crop:
            raise ConfigError(
                f"the completion of {str(policy)!r} takes {config.crop}, this training {self.scenes.crop}"
            )
        owner = completion_folder(policy, config)
        for name in (ADOPTED, "completion.onnx"):
            write_bytes(self.out / "completion" / name, (owner / name).read_bytes())
        return config

    def folder(self, member: int, round_: int) -> Path:
        """Return the folder of a member's weights: the first member has weights after each round."""
        if member:
            return self.out / f"member-{member}"
        return self.out / (f"round-{round_}" if round_ else "scorer")

    def member_net(self, member: int, round_: int) -> ScorerNet:
        """Load a trained member."""
        net = ScorerNet(self.grid, self.sizes.width)
        load_weights(net, self.folder(member, round_) / "weights.pt")
        return net

    def adopt_scorer(self, run: Path) -> Path:
        """Copy the scorer of many hands of a run of ``graspbox train any-hand`` into this run, for its hand.

        Returns
        -------
        Path
            The file of the weights with which the first member begins.

        Raises
        ------
        ConfigError
            If the folder holds no such run, or its scorer is of another width.
        """
        net = SharedScorerNet.load(shared_weights(run), [self.grid]).of_hand(self.grid)
        if (width := net.stem.out_channels) != self.sizes.width:
            raise ConfigError(f"the scorer in {str(run)!r} has the width {width}; give --sizes.width {width}")
        target = self.folder(0, 0) / "start.pt"
        with replacing(target) as temporary:
            torch.save(net.state_dict(), temporary)
        return target

    def head_net(self) -> AnchorNet:
        """Load the trained head."""
        net = load_head(self.out / "head", len(self.grid.preshapes), self.scenes.crop)
        if not isinstance(net, AnchorNet):
            raise ConfigError(f"{self.out / 'head'} holds a {type(net).__name__}; name another folder, or delete it")
        return net

    def predictor(self) -> AnchorHead:
        """Load the exported head."""
        network = onnx_network(self.out / "head" / "head.onnx")
        return AnchorHead(network, Anchors(len(self.grid.preshapes), self.head_net().config.anchors))

    def members(self) -> list[ScorerNet]:
        """Load the ensemble."""
        return [self.member_net(number, self.sizes.rounds) for number in range(self.sizes.members)]
