"""Trained networks as exportable functions: bytes in, bytes and calibrated probabilities out (torch).

`graspbox.learn.export.exports` writes them as ONNX; `graspbox.policies.published.runtimes` runs either.
"""

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

from graspbox.hands import load_hand
from graspbox.learn.export.weight_files import restored
from graspbox.learn.models.completion.network import CompletionNet
from graspbox.learn.models.head.graph import HeadGraph
from graspbox.learn.models.head.network import AnchorNet
from graspbox.learn.models.scorer.network import DECIDING, ScorerNet, deciding
from graspbox.learn.models.scorer.shared import SharedScorerNet
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.inputs.hand_numbers import HandTables
from graspbox.policies.published.calibration import CAUTION, OTHERS, Calibration
from graspbox.policies.published.folders import completion_folder, hand_of, read_depth_policy

__all__ = ["AnyHandScorerGraph", "CompletionGraph", "ScorerGraph", "load_graphs"]


class CompletionGraph(nn.Module):  # type: ignore[misc]
    """Maps channels (n, 3, N, N, N) uint8 of crops to occupancy (n, N, N, N) uint8."""

    inputs = ("channels",)
    outputs = ("occupancy",)

    def __init__(self, net: CompletionNet) -> None:
        super().__init__()
        self.net = net.eval()

    def forward(self, channels: Tensor) -> Tensor:
        """Return the share of each voxel that the object fills, 0 to 255 for 0 to 1."""
        shares = torch.sigmoid(self.net(channels.float() / 255.0))
        return (shares * 255.0).round().to(torch.uint8)


class ScorerGraph(nn.Module):  # type: ignore[misc]
    """An ensemble of scorers: the first member ranks all grasps, all members score its best ones, the finalists.

    It takes at least as many grasps as there are finalists.
    """

    inputs = ("cells", "poses", "preshape")
    outputs = ("choice", "success", "secure", "logits")

    def __init__(self, members: Sequence[ScorerNet], calibration: Calibration, finalists: int) -> None:
        super().__init__()
        self.members = nn.ModuleList([member.eval() for member in members])
        self._calibration, self._finalists = calibration, finalists

    def forward(self, cells: Tensor, poses: Tensor, preshape: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return choice, success and secure (m,), and the logits (m, 2) before calibration."""
        logits = deciding(self.members[0](cells, poses, preshape))
        if len(self.members) > 1:
            choice, _, _ = _judged(logits, self._calibration)
            best = choice.topk(self._finalists).indices
            chosen = cells[best], poses[best], preshape[best]
            others = [deciding(member(*chosen)) for member in list(self.members)[1:]]
            votes = torch.stack([logits[best], *others])
            mean = votes.mean(0)
            cautious = mean - CAUTION * (votes - mean).square().mean(0).sqrt()
            logits = (logits - OTHERS).scatter(0, best[:, None].expand(-1, len(DECIDING)), cautious)
        return *_judged(logits, self._calibration), logits


class AnyHandScorerGraph(nn.Module):  # type: ignore[misc]
    """A scorer of any hand, whose tables are inputs: two rows or more of `HandTables`."""

    inputs = (*ScorerGraph.inputs, *HandTables._fields)
    outputs = ScorerGraph.outputs
    #: What the first axis of each input counts.
    rows = ("grasps", "grasps", "grasps", "preshapes", "preshapes", "preshapes")

    def __init__(self, net: SharedScorerNet, calibration: Calibration) -> None:
        super().__init__()
        self.net, self._calibration = net.eval(), calibration

    def forward(
        self, cells: Tensor, poses: Tensor, preshape: Tensor, swept: Tensor, numbers: Tensor, scale: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return choice, success and secure (m,), and the logits (m, 2) before calibration."""
        logits = deciding(self.net.of_tables(cells, poses, preshape, swept, numbers, scale))
        return *_judged(logits, self._calibration), logits


def _judged(logits: Tensor, calibration: Calibration) -> tuple[Tensor, Tensor, Tensor]:
    """Return the score of the choice, and the probabilities of `DECIDING`, from their logits (m, 2)."""
    (slope, offset), (slope_of_secure, offset_of_secure) = calibration.success, calibration.secure
    of_success, of_secure = logits.unbind(1)
    success = torch.sigmoid(of_success * slope + offset)
    secure = torch.sigmoid(of_secure * slope_of_secure + offset_of_secure)
    weight = calibration.secure_weight
    return (success + weight * secure) / (1.0 + weight), success, secure


def load_graphs(folder: Path) -> tuple[CompletionGraph | ScorerGraph | AnyHandScorerGraph | HeadGraph, ...]:
    """Load the networks of a policy's folder into torch: completion, scorer, and the head if it has one.

    Raises ConfigError or FileError as `graspbox.policies.published.load`, or if weights belong to another network.
    """
    config = read_depth_policy(Path(folder))
    folder = Path(folder)
    hand = load_hand(hand_of(folder, config))
    grid = HandGrid(hand, config.settings_for(hand)[0], crop=config.crop)
    file = completion_folder(folder, config) / "completion.onnx"
    completion = restored(lambda: CompletionNet(config.completion_width), file, "net.")
    if config.hand_numbers is not None:
        shared = restored(lambda: SharedScorerNet([grid], config.width), folder / "scorer.onnx", "net.")
        return CompletionGraph(completion), AnyHandScorerGraph(shared, config.calibration)
    parts_of_scorer = (f"members.{number}." for number in range(config.members))
    members = [restored(lambda: ScorerNet(grid, config.width), folder / "scorer.onnx", p) for p in parts_of_scorer]
    parts = CompletionGraph(completion), ScorerGraph(members, config.calibration, config.finalists)
    if (settings := config.head) is None:
        return parts
    head = restored(lambda: AnchorNet(len(grid.preshapes), settings, config.crop), folder / "head.onnx", "net.")
    return *parts, HeadGraph(head)
