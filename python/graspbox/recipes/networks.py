"""The networks trained by the stages of a run, loaded from its folder."""

from dataclasses import dataclass
from pathlib import Path

from graspbox._common.files import write_bytes
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
from graspbox.perception import HandGrid
from graspbox.perception.anchors import Anchors
from graspbox.recipes.settings import Sizes
from graspbox.training.trainer import load_weights

__all__ = ["TrainedNetworks"]

#: Weights of a completion that was not trained in the run.
ADOPTED = "completion.safetensors"


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
