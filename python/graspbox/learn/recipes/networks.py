"""The networks trained by the stages of a run, loaded from its folder."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspbox._common.files import read_bounded, write_bytes
from graspbox.data.trials.learned import of_splits
from graspbox.errors import ConfigError
from graspbox.learn.export import weight_files
from graspbox.learn.models.completion.network import CompletionNet
from graspbox.learn.models.head.network import AnchorNet
from graspbox.learn.models.head.training import load_head, save_head
from graspbox.learn.models.scenes import SceneConfig
from graspbox.learn.models.scorer.network import ScorerNet
from graspbox.learn.models.scorer.shared import SHARED_SHAPE, SharedScorerNet
from graspbox.learn.recipes.settings.depth import HEAD_OF_ROUNDS, Sizes
from graspbox.learn.training.trainer import load_weights, read_weights, save_atomic
from graspbox.perception import HandGrid
from graspbox.perception.anchors import Anchors
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.downloads import CONFIG
from graspbox.policies.published.folders import completion_folder, read_depth_policy
from graspbox.policies.published.runtimes import AnchorHead, Completion, onnx_network

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

#: File of an exported completion.
COMPLETION = "completion.onnx"
#: Largest file of settings that is read, bytes.
_LARGEST_SETTINGS = 1_000_000


def latest_weights(run: Path) -> Path:
    """Return the weights of the scorer of a run of ``graspbox train depth`` or ``any-hand`` after its last round."""
    rounds = sorted(run.glob("round-*/weights.pt"), key=lambda path: int(path.parent.name.partition("-")[2]))
    for path in (*reversed(rounds), run / "scorer" / "weights.pt"):
        if path.exists():
            return path
    raise ConfigError(f"there is no trained scorer in {str(run)!r}; name a run of graspbox train depth or any-hand")


def is_published(folder: Path) -> bool:
    """Whether a folder holds a published policy, not a run."""
    return (folder / CONFIG).exists()


def is_shared(run: Path) -> bool:
    """Whether the scorer of a run or a published policy is one of many hands."""
    if is_published(run):
        return read_depth_policy(run).hand_numbers is not None
    return any(name.startswith("describe") for name in read_weights(latest_weights(run)))


def scorer_width(start: Path) -> int:
    """Count the channels of the first layer of the scorer of a run or a published policy."""
    if is_published(start):
        return read_depth_policy(start).width
    weights = latest_weights(start)
    if (stem := read_weights(weights).get("stem.weight")) is None:
        raise ConfigError(f"{weights} holds the weights of another network; name a run of graspbox train depth")
    return len(stem)


def grid_shape(start: Path) -> tuple[int, int, int] | None:
    """Return the shape of the grid of the scorer of a run or a published policy; None if it is that of the hand.

    The scorer of many hands has one shape for all, which a scorer that began with it keeps.
    """
    if is_shared(start):
        return SHARED_SHAPE
    if is_published(start):
        return read_depth_policy(start).grid.shape
    before = _settings(start).get("start")
    return grid_shape(Path(before)) if before and Path(before).exists() else None


def learned_before(start: Path) -> list[str]:
    """Name the objects from which a published policy learned, or a run and the runs with which it began.

    Runs that no longer exist are left out.
    """
    if is_published(start):
        return list(read_depth_policy(start).learned_from)
    settings = _settings(start)
    own = of_splits([*settings.get("objects", ()), *settings.get("fresh", ())])
    return own + (learned_before(Path(before)) if (before := settings.get("start")) else [])


def _settings(run: Path) -> dict[str, Any]:
    """Read the settings of a run; empty if it does not exist."""
    path = run / "settings.json"
    return dict(json.loads(read_bounded(path, _LARGEST_SETTINGS))) if path.exists() else {}


@dataclass(frozen=True)
class TrainedNetworks:
    """Networks in the folder of a run, for a hand's grid and crops of rendered scenes.

    The width in `sizes` is that of the scorer with which the run begins, if there is one. Functions raise ConfigError
    for files of other networks.
    """

    out: Path
    sizes: Sizes
    grid: HandGrid
    scenes: SceneConfig

    def trained_completion(self) -> CompletionNet:
        """Load the completion that the run has trained, before it is exported."""
        net = CompletionNet(self.sizes.completion_width)
        load_weights(net, self.out / "completion" / "weights.pt")
        return net

    def completion_net(self) -> CompletionNet:
        """Load the exported completion into torch: the run's own, or that of another policy (`adopt_completion`)."""
        file = self.out / "completion" / COMPLETION
        width = len(weight_files.load_weights(file, "net.")["stem.weight"])
        return weight_files.restored(lambda: CompletionNet(width), file, "net.")

    def completion(self) -> Completion:
        """Load the exported completion for onnxruntime."""
        return Completion(onnx_network(self.out / "completion" / COMPLETION))

    def adopt_completion(self, policy: Path) -> DepthPolicyConfig:
        """Copy the completion of a published policy into the run, to be trained further or used as it is.

        Returns the policy that has the completion: the published one, or the one whose completion it uses.
        """
        config = self._with_own_crops(policy, "completion")
        owner = completion_folder(policy, config)
        write_bytes(self.out / "completion" / COMPLETION, (owner / COMPLETION).read_bytes())
        return read_depth_policy(owner)

    def scorer_folder(self, rounds: int) -> Path:
        """Return the folder of the scorer's weights after a number of rounds."""
        return self.out / (f"round-{rounds}" if rounds else "scorer")

    def scorer_net(self, rounds: int) -> ScorerNet:
        """Load the scorer after a number of rounds."""
        net = ScorerNet(self.grid, self.sizes.width)
        load_weights(net, self.scorer_folder(rounds) / "weights.pt")
        return net

    def adopt_scorer(self, folder: Path) -> Path:
        """Copy the scorer of a run of ``graspbox train depth`` or ``any-hand``, or of a policy, for this run's hand.

        Returns the file of the weights.
        """
        net = self._published_scorer(folder) if is_published(folder) else self._scorer_of_run(folder)
        target = self.scorer_folder(0) / "start.pt"
        save_atomic(net.state_dict(), target)
        return target

    def keep_scorer(self, start: Path) -> None:
        """Take the scorer with which the run begins for the trained one, unless it is one of several."""
        if is_published(start) and (members := read_depth_policy(start).members) > 1:
            raise ConfigError(f"{str(start)!r} has {members} scorers, not one that could be kept; train further")
        folder = self.scorer_folder(0)
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
        file = folder / "scorer.onnx"
        if config.hand_numbers is not None:
            shared = weight_files.restored(lambda: SharedScorerNet([self.grid], config.width), file, "net.")
            return shared.of_hand(self.grid)
        return weight_files.restored(lambda: ScorerNet(self.grid, config.width), file, "members.0.")

    def adopt_head(self, policy: Path) -> bool:
        """Copy the head of a published policy into the run, if it has one."""
        if (head := read_depth_policy(policy).head) is None:
            return False
        self._with_own_crops(policy, "head")
        file = policy / "head.onnx"
        net = weight_files.restored(lambda: AnchorNet(len(self.grid.preshapes), head, self.scenes.crop), file, "net.")
        save_head(self.out / "head", net, head)
        return True

    def _with_own_crops(self, policy: Path, part: str) -> DepthPolicyConfig:
        """Read a published policy; refuses one whose crops have other voxels."""
        config = read_depth_policy(policy)
        if not config.crop.has_voxels_of(self.scenes.crop):
            raise ConfigError(f"the {part} of {str(policy)!r} takes {config.crop}, this training {self.scenes.crop}")
        return config

    def head_folder(self) -> Path:
        """Return the folder of the head: after the rounds it is the one that learned from them too."""
        tuned = self.out / HEAD_OF_ROUNDS
        return tuned if (tuned / "head.onnx").exists() else self.out / "head"

    def head_net(self) -> AnchorNet:
        """Load the trained head."""
        return load_head(self.head_folder(), len(self.grid.preshapes), self.scenes.crop)

    def predictor(self) -> AnchorHead:
        """Load the exported head."""
        network = onnx_network(self.head_folder() / "head.onnx")
        return AnchorHead(network, Anchors(len(self.grid.preshapes), self.head_net().config.anchors))
