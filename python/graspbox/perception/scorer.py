"""The scorer: how likely a grasp holds, from the voxels around the hand.

`ScorerNet` is a small 3-D CNN over the cells of a `graspbox.perception.HandGrid`: completed, surface, unseen, table,
and what the fingers sweep. `ScorerInputs` makes its inputs; `Scorer` is an ensemble that chooses by its mean minus half
its standard deviation.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.errors import ConfigError
from graspbox.files import write_text
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid
from graspbox.perception.training import load_weights

__all__ = ["TARGETS", "Scorer", "ScorerBatch", "ScorerInputs", "ScorerNet", "fit_temperature", "scorer_losses"]

#: What the outputs are the logits of; the first is what grasps are chosen by.
TARGETS = ("success", "secure", "slip")
#: Numbers beside the cells.
SCALARS = 8
#: Share of a batch that counts: its hardest samples.
_HARDEST = 0.75
#: Weight of the other two targets.
_AUXILIARY = 0.3
#: Choice: mean minus this many standard deviations of the ensemble.
_CAUTION = 0.5
#: Grasps that are scored at once; more would not fit into the cache.
_CHUNK = 64


class ScorerInputs:
    """Inputs of the scorer for one hand.

    Parameters
    ----------
    grid : HandGrid
        The hand.
    """

    def __init__(self, grid: HandGrid) -> None:
        self.grid = grid
        self._preshapes = len(grid.preshapes)

    @property
    def preshapes(self) -> int:
        """Number of the hand's preshapes."""
        return self._preshapes

    def make(
        self,
        volumes: NDArray[np.uint8],
        crop_of: NDArray[np.int64],
        crop_from_hand: NDArray[np.float64],
        preshape: NDArray[np.float64],
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Make inputs of m grasps in s crops.

        Parameters
        ----------
        volumes : (s, 3, N, N, N) uint8
            As for `HandGrid.crops`: completed, surface, unseen.
        crop_of : (m,) int64
            The crop of each grasp.
        crop_from_hand : (m, 4, 4) float64
            Metres.
        preshape : (m,) float64
            The nearest of the hand's preshapes is taken.

        Returns
        -------
        cells (m, 4, X, Y, Z) uint8, scalars (m, 8) float32, preshape (m,) int64
            The scalars: direction of gravity in the hand frame (3), height of the hand over the table in units of 0.1
            m, middle of the completed cells in units of 0.1 m from the middle of the grid (3), and their share.
        """
        cells = torch.from_numpy(self.grid.crops(volumes, crop_of, crop_from_hand))
        gravity = -crop_from_hand[:, 2, :3]
        height = crop_from_hand[:, 2, 3:] * 10.0
        completed = cells[:, 0].float()
        mass = completed.sum((1, 2, 3)) / 255.0
        middle = []
        for axis in range(3):
            others = tuple(other + 1 for other in range(3) if other != axis)
            count = completed.shape[axis + 1]
            along = (torch.arange(count) - (count - 1) / 2) * (self.grid.cell * 10.0)
            middle.append((completed.sum(others) / 255.0 * along).sum(1) / mass.clamp(min=1.0))
        own = torch.from_numpy(np.concatenate([gravity, height], axis=1)).float()
        share = mass / completed[0].numel() * 10.0 if len(cells) else mass
        scalars = torch.cat([own, torch.stack(middle, 1), share[:, None]], dim=1)
        return cells, scalars, torch.from_numpy(self.grid.nearest(preshape))


class ScorerNet(nn.Module):  # type: ignore[misc]
    """A 3-D CNN from cells, scalars and preshape to three logits.

    Parameters
    ----------
    swept : (p, X, Y, Z) uint8 array
        What the fingers sweep with each preshape (`HandGrid.swept`); X, Y and Z are multiples of 8.
    width : int
        Channels at half the resolution; coarser levels have two and four times as many.
    """

    swept: Tensor

    def __init__(self, swept: NDArray[np.uint8], width: int = 16) -> None:
        super().__init__()
        self.register_buffer("swept", torch.from_numpy(np.ascontiguousarray(swept)), persistent=True)
        preshapes, *shape = swept.shape
        coarse = int(np.prod([n // 8 for n in shape]))
        self.trunk = nn.Sequential(
            nn.Conv3d(len(HAND_CHANNELS) + 1, width, 4, stride=2, padding=1, bias=False),
            nn.BatchNorm3d(width),
            nn.ReLU(inplace=True),
            nn.Conv3d(width, 2 * width, 3, stride=2, padding=1, bias=False),
            nn.BatchNorm3d(2 * width),
            nn.ReLU(inplace=True),
            nn.Conv3d(2 * width, 4 * width, 3, padding=1, bias=False),
            nn.BatchNorm3d(4 * width),
            nn.ReLU(inplace=True),
            nn.Conv3d(4 * width, 4 * width, 3, stride=2, padding=1, bias=False),
            nn.BatchNorm3d(4 * width),
            nn.ReLU(inplace=True),
            nn.Flatten(),
        )
        self.shape_of_preshape = nn.Embedding(preshapes, 8)
        self.head = nn.Sequential(
            nn.Linear(4 * width * coarse + SCALARS + 8, 128), nn.ReLU(inplace=True), nn.Linear(128, len(TARGETS))
        )

    def forward(self, cells: Tensor, scalars: Tensor, preshape: Tensor) -> Tensor:
        """Give logits (m, 3) of `TARGETS`, from the outputs of `ScorerInputs.make`."""
        swept = self.swept[preshape][:, None]
        found = self.trunk(torch.cat([cells, swept], dim=1).float() / 255.0)
        logits: Tensor = self.head(torch.cat([found, scalars, self.shape_of_preshape(preshape)], dim=1))
        return logits


@dataclass(frozen=True, eq=False)
class ScorerBatch:
    """m grasps with their outcomes.

    Attributes
    ----------
    cells, scalars, preshape
        As `ScorerInputs.make` gives them.
    targets : (m, 3) float32
        `TARGETS`, 0 or 1.
    """

    cells: Tensor
    scalars: Tensor
    preshape: Tensor
    targets: Tensor


def scorer_losses(net: nn.Module, batch: ScorerBatch) -> dict[str, Tensor]:
    """Give the cross-entropy of success over the hardest three quarters of a batch, and those of the other targets."""
    logits = net(batch.cells, batch.scalars, batch.preshape)
    entropy = functional.binary_cross_entropy_with_logits(logits, batch.targets, reduction="none")
    hardest = max(1, int(_HARDEST * len(entropy)))
    others = entropy[:, 1:].mean(0) * _AUXILIARY
    return {
        TARGETS[0]: entropy[:, 0].topk(hardest).values.mean(),
        **dict(zip(TARGETS[1:], others, strict=True)),
    }


def fit_temperature(logits: NDArray[np.float64], success: NDArray[np.bool_]) -> float:
    """Find the number that logits must be divided by so that they say how often grasps succeed.

    Parameters
    ----------
    logits : (m,) float64
        Of chosen grasps.
    success : (m,) bool
        Whether they succeeded.

    Returns
    -------
    float
        Between 0.05 and 20: the least cross-entropy, on a grid of 1 %.

    Raises
    ------
    ConfigError
        If there are none.
    """
    if not len(logits):
        raise ConfigError("there are no grasps to calibrate on; give some")
    grid = np.exp(np.arange(np.log(0.05), np.log(20.0), 0.01))
    signed = np.where(success, logits, -logits)
    entropies = np.logaddexp(0.0, -signed[None] / grid[:, None]).mean(axis=1)
    return float(grid[int(np.argmin(entropies))])


class Scorer:
    """An ensemble of trained scorers.

    Parameters
    ----------
    folders : sequence of Path
        A run's folder per member: ``weights.pt``. The first ranks all grasps, the others judge those that it finds
        best.
    inputs : ScorerInputs
        The hand.
    temperature : float
        What the mean logit is divided by; see `fit_temperature`.
    finalists : int
        Grasps that the whole ensemble judges.

    Raises
    ------
    ConfigError
        If there is no member, or weights are missing or another network's.
    """

    def __init__(
        self, folders: Sequence[Path], inputs: ScorerInputs, *, temperature: float = 1.0, finalists: int = 24
    ) -> None:
        if not folders:
            raise ConfigError("the scorer has no member; name at least one folder")
        self._inputs, self._temperature, self._finalists = inputs, temperature, finalists
        self.members = []
        for folder in folders:
            net = ScorerNet(inputs.grid.swept)
            load_weights(net, Path(folder) / "weights.pt")
            self.members.append(net)

    def __call__(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Score grasps in one crop.

        Parameters
        ----------
        volume : (3, N, N, N) uint8
            Completed, surface, unseen.
        crop_from_hand : (m, 4, 4) float64
            Metres.
        preshape : (m,) float64
            Preshapes.

        Returns
        -------
        (m,) float64
            Probability that the grasp succeeds, at the mean logit minus half a standard deviation of the ensemble.
            Grasps that the first member does not count among the best have what it gives minus 1 in logit: the rest of
            the ensemble does not judge them.
        """
        if not len(preshape):
            return np.zeros(0)
        crop_of = np.zeros(len(preshape), dtype=np.int64)
        inputs = self._inputs.make(volume[None], crop_of, crop_from_hand, preshape)
        first = _logits(self.members[0], *inputs)
        if len(self.members) == 1:
            return _sigmoid(first / self._temperature)
        best = np.argsort(-first, kind="stable")[: self._finalists]
        chosen = [part[torch.from_numpy(best)] for part in inputs]
        all_members = np.stack([first[best], *(_logits(net, *chosen) for net in self.members[1:])])
        cautious = first - 1.0
        cautious[best] = all_members.mean(axis=0) - _CAUTION * all_members.std(axis=0)
        return _sigmoid(cautious / self._temperature)

    @classmethod
    def load(cls, folder: Path, inputs: ScorerInputs) -> "Scorer":
        """Load an ensemble from a folder: ``scorer.json`` names the members and their temperature."""
        path = Path(folder) / "scorer.json"
        if not path.exists():
            raise ConfigError(f"{folder} holds no scorer.json; train a scorer there first")
        given = json.loads(path.read_text())
        members = [Path(folder) / name for name in given["members"]]
        return cls(members, inputs, temperature=given["temperature"])

    @staticmethod
    def describe(folder: Path, members: Sequence[str], temperature: float) -> None:
        """Write ``scorer.json``."""
        text = json.dumps({"members": list(members), "temperature": temperature}, indent=1)
        write_text(Path(folder) / "scorer.json", text + "\n")


def _logits(net: ScorerNet, cells: Tensor, scalars: Tensor, preshape: Tensor) -> NDArray[np.float64]:
    """Success logits (m,)."""
    with torch.no_grad():
        parts = zip(cells.split(_CHUNK), scalars.split(_CHUNK), preshape.split(_CHUNK), strict=True)
        found = torch.cat([net(*part)[:, 0] for part in parts])
    return np.asarray(found.double().numpy())


def _sigmoid(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(1.0 / (1.0 + np.exp(-x)))
