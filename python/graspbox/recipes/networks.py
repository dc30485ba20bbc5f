"""The networks trained by the stages of a run, loaded from its folder."""

import json
from dataclasses import dataclass
from pathlib import Path

import torch

from graspbox._common.files import read_bounded, replacing, write_bytes
from graspbox.artifacts import weight_files
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.downloads import CONFIG
from graspbox.artifacts.folders import completion_folder, read_depth_policy
from graspbox.artifacts.runtimes import AnchorHead, Completion, onnx_network
from graspbox.dataset.learned import of_splits
from graspbox.errors import ConfigError
from graspbox.models.completion.network import CompletionNet
from graspbox.models.head.network import AnchorNet
from graspbox.models.head.training import load_head, save_head
from graspbox.models.scenes import SceneConfig
from graspbox.models.scorer.network import ScorerNet
from graspbox.models.scorer.shared import SHARED_SHAPE, SharedScorerNet
from graspbox.perception import HandGrid
from graspbox.perception.anchors import Anchors
from graspbox.recipes.settings.depth import HEAD_OF_ROUNDS, Sizes
from graspbox.training.trainer import load_weights, read_weights

__all__ = [
    "HEAD_OF_ROUNDS",
    "TrainedNetworks",
    "grid_shape",
    "is_published",
    "is_shared",
    "latest_weights",
    "learned_before",
    "scorer_width",
]

#: Weights of a completion that began in another run, with folded norms.
ADOPTED = "completion.safetensors"
#: Largest file of settings that is read, bytes.
_LARGEST_SETTINGS = 1_000_000


def latest_weights(run: Path) -> Path:
    """Find the scorer of a run of ``graspbox train depth`` or ``any-hand``: the weights of its last round.

    Raises
    ------
    ConfigError
        If there are none.
    """
    found = sorted(run.glob("round-*/weights.pt"), key=lambda path: int(path.parent.name.partition("-")[2]))
    for path in (*reversed(found), run / "scorer" / "weights.pt"):
        if path.exists():
            return path
    raise ConfigError(f"there is no trained scorer in {str(run)!r}; name a run of graspbox train depth or any-hand")


def is_published(folder: Path) -> bool:
    """Whether a folder holds a published policy, not a run."""
    return (folder / CONFIG).exists()


def is_shared(run: Path) -> bool:
    """Whether the scorer of a run or a published policy is one of many hands.

    Raises
    ------
    ConfigError
        As `latest_weights`, and if the file is not one of weights.
    """
    if is_published(run):
        return read_depth_policy(run).hand_numbers is not None
    return any(name.startswith("describe") for name in read_weights(latest_weights(run)))


def scorer_width(start: Path) -> int:
    """Count the channels of the first layer of the scorer of a run or a published policy.

    Raises
    ------
    ConfigError, FileError
        As `is_shared`, if the policy cannot be read, and if the weights are those of another network.
    """
    if is_published(start):
        return read_depth_policy(start).width
    weights = latest_weights(start)
    if (stem := read_weights(weights).get("stem.weight")) is None:
        raise ConfigError(f"{weights} holds the weights of another network; name a run of graspbox train depth")
    return len(stem)


def grid_shape(start: Path) -> tuple[int, int, int] | None:
    """Return the shape of the grid of the scorer of a run or a published policy; None if it is what the hand needs.

    That of many hands has one shape for all, which a scorer that began with it keeps.

    Raises
    ------
    ConfigError, FileError
        As `is_shared`, and if the settings of a run cannot be read.
    """
    if is_shared(start):
        return SHARED_SHAPE
    if is_published(start):
        return read_depth_policy(start).grid.shape
    path = start / "settings.json"
    before = json.loads(read_bounded(path, _LARGEST_SETTINGS)).get("start") if path.exists() else None
    return grid_shape(Path(before)) if before and Path(before).exists() else None


def learned_before(start: Path) -> list[str]:
    """Name the objects from which a published policy learned, or a run and the runs with which it began.

    Runs that are gone are left out.

    Raises
    ------
    ConfigError, FileError
        If the policy or the settings of a run cannot be read.
    """
    if is_published(start):
        return list(read_depth_policy(start).learned_from)
    if not (path := start / "settings.json").exists():
        return []
    settings = json.loads(read_bounded(path, _LARGEST_SETTINGS))
    own = of_splits([*settings.get("objects", ()), *settings.get("fresh", ())])
    return own + (learned_before(Path(before)) if (before := settings.get("start")) else [])


@dataclass(frozen=True)
class TrainedNetworks:
    """Networks of a run.

    Attributes
    ----------
    out : Path
        The run's folder.
    sizes : Sizes
        Sizes of the networks; `width` is that of the scorer with which the run begins, if there is one.
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
        """Copy the completion of a published policy into the run.

        Returns
        -------
        DepthPolicyConfig
            The policy that has the completion: the published one, or the one that it shares.

        Raises
        ------
        ConfigError
            If the folder holds no policy of one depth image, or one with other crops.
        """
        config = read_depth_policy(policy)
        if not config.crop.has_voxels_of(self.scenes.crop):
            raise ConfigError(
                f"the completion of {str(policy)!r} takes {config.crop}, this training {self.scenes.crop}"
            )
        owner = completion_folder(policy, config)
        for name in (ADOPTED, "completion.onnx"):
            write_bytes(self.out / "completion" / name, (owner / name).read_bytes())
        return read_depth_policy(owner)

    def keep_tuned(self, net: CompletionNet) -> None:
        """Replace the adopted completion by one that was trained further."""
        weight_files.save_weights(net, self.out / "completion" / ADOPTED)

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

    def adopt_scorer(self, folder: Path) -> Path:
        """Copy the scorer of a run of ``graspbox train depth`` or ``any-hand``, or of a policy, for this run's hand.

        Returns
        -------
        Path
            The file of the weights with which the first member begins.

        Raises
        ------
        ConfigError
            If the folder holds neither, or its scorer is of another hand.
        """
        net = self._published_scorer(folder) if is_published(folder) else self._scorer_of_run(folder)
        target = self.folder(0, 0) / "start.pt"
        with replacing(target) as temporary:
            torch.save(net.state_dict(), temporary)
        return target

    def keep_scorer(self, start: Path) -> None:
        """Take the scorer with which the run begins for the trained one.

        Raises
        ------
        ConfigError
            If it is one of several of a published policy.
        """
        if is_published(start) and (members := read_depth_policy(start).members) > 1:
            raise ConfigError(f"{str(start)!r} has {members} scorers, not one that could be kept; train further")
        folder = self.folder(0, 0)
        write_bytes(folder / "weights.pt", (folder / "start.pt").read_bytes())

    def _scorer_of_run(self, run: Path) -> ScorerNet:
        weights = latest_weights(run)
        if is_shared(run):
            return SharedScorerNet.load(weights, [self.grid]).of_hand(self.grid)
        net = ScorerNet(self.grid, scorer_width(run))
        load_weights(net, weights)
        return net

    def _published_scorer(self, folder: Path) -> ScorerNet:
        config = read_depth_policy(folder)
        grid, _ = config.settings_for(self.grid.hand)
        if grid != self.grid.config:
            raise ConfigError(f"the scorer in {str(folder)!r} has the grid {grid}, this training {self.grid.config}")
        weights = folder / config.member_weights[0]
        if config.hand_numbers is not None:
            shared = weight_files.restored(lambda: SharedScorerNet([self.grid], config.width), weights)
            return shared.of_hand(self.grid)
        return weight_files.restored(lambda: ScorerNet(self.grid, config.width), weights)

    def adopt_head(self, policy: Path) -> bool:
        """Copy the head of a published policy into the run, if it has one.

        Raises
        ------
        ConfigError
            If its crops are others.
        """
        config = read_depth_policy(policy)
        if (head := config.head) is None:
            return False
        if not config.crop.has_voxels_of(self.scenes.crop):
            raise ConfigError(f"the head of {str(policy)!r} takes {config.crop}, this training {self.scenes.crop}")
        weights = policy / "head.safetensors"
        net = weight_files.restored(lambda: AnchorNet(len(self.grid.preshapes), head, self.scenes.crop), weights)
        save_head(self.out / "head", net, head)
        return True

    def head_folder(self) -> Path:
        """Return the folder of the head: after the rounds it is the one that learned from them too."""
        tuned = self.out / HEAD_OF_ROUNDS
        return tuned if (tuned / "head.onnx").exists() else self.out / "head"

    def head_net(self) -> AnchorNet:
        """Load the trained head."""
        folder = self.head_folder()
        net = load_head(folder, len(self.grid.preshapes), self.scenes.crop)
        if not isinstance(net, AnchorNet):
            raise ConfigError(f"{folder} holds a {type(net).__name__}; name another folder, or delete it")
        return net

    def predictor(self) -> AnchorHead:
        """Load the exported head."""
        network = onnx_network(self.head_folder() / "head.onnx")
        return AnchorHead(network, Anchors(len(self.grid.preshapes), self.head_net().config.anchors))

    def members(self) -> list[ScorerNet]:
        """Load the ensemble: the first member after the last rounds, the latest first, and further members."""
        last, sizes = self.sizes.rounds, self.sizes
        snapshots = [self.member_net(0, round_) for round_ in range(last, last - sizes.snapshots, -1)]
        return snapshots + [self.member_net(number, last) for number in range(1, sizes.members)]
