"""The head ``anchor``: logits of every pose of a grid, from patches of features that turn with the hand.

The features of a trunk are sampled at a few points of the table plane, placed in the hand's own axes around the grasp
point. What follows is the same for all grasp points and rolls, so that what is learned of one is known of all.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.perception.anchors import RESIDUALS, Anchors, Candidates
from graspbox.perception.configs import CropConfig
from graspbox.perception.head_configs import HeadConfig
from graspbox.perception.head_parts import Trunk, unit

__all__ = ["LOGITS", "AnchorNet", "AnchorSamples"]

#: What the logits of an anchor tell: whether the open hand gets there, whether the grasp then succeeds, and whether it
#: is secure.
LOGITS = ("reached", "success", "secure")
#: Where features are sampled, along the hand's x and y from the grasp point, metres.
_ALONG, _ACROSS = (-0.07, -0.035, 0.0, 0.035, 0.07), (-0.04, 0.0, 0.04)


@dataclass(frozen=True, eq=False)
class AnchorSamples:
    """m poses among the anchors of n crops.

    Attributes
    ----------
    sample_of : (m,) int64
        The crop of each.
    place : (m, 4) float32
        See `graspbox.perception.anchors.Encoded`.
    preshape : (m,) int64
        By index.
    """

    sample_of: Tensor
    place: Tensor
    preshape: Tensor

    @classmethod
    def of(
        cls, sample_of: NDArray[np.int64], place: NDArray[np.float64], preshape: NDArray[np.int64]
    ) -> "AnchorSamples":
        """Take poses in crops ``sample_of`` (m,)."""
        return cls(torch.from_numpy(sample_of), torch.from_numpy(place).float(), torch.from_numpy(preshape))


class AnchorNet(nn.Module):  # type: ignore[misc]
    """Logits and residuals of anchors.

    Parameters
    ----------
    preshapes : int
        Number of the hand's preshapes.
    config : HeadConfig
        The head.
    crop : CropConfig
        The crops that it sees.
    """

    _rows: Tensor
    _weights: Tensor

    def __init__(
        self,
        preshapes: int,
        config: HeadConfig = HeadConfig(),  # noqa: B008 (frozen)
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    ) -> None:
        super().__init__()
        config.anchors.check(crop)
        self.config, self.anchors = config, Anchors(preshapes, config.anchors)
        self._side = crop.resolution // 2
        self.trunk = Trunk(crop.resolution, config.width)
        self.features = unit(config.width, config.features)
        taps = len(_ALONG) * len(_ACROSS)
        self.hidden = nn.Sequential(
            nn.Linear(taps * config.features, config.hidden),
            nn.ReLU(inplace=True),
            nn.Linear(config.hidden, config.hidden),
            nn.ReLU(inplace=True),
        )
        _, heights, rolls, cells, _ = self.anchors.shape
        self.logits = nn.Linear(config.hidden, len(LOGITS) * preshapes * heights)
        self.residuals = nn.Linear(config.hidden, RESIDUALS * preshapes)
        # Where the anchors themselves sample, by roll, x and y.
        roll, x, y = torch.meshgrid(torch.arange(rolls), torch.arange(cells), torch.arange(cells), indexing="ij")
        place = torch.stack([x, y, torch.zeros_like(x), roll], dim=3).flatten(0, 2).float()
        rows, weights = self._taps(place)
        self.register_buffer("_rows", rows, persistent=False)
        self.register_buffer("_weights", weights, persistent=False)

    def seen(self, volumes: Tensor) -> Tensor:
        """Give features (n, f, N/2, N/2), from channels (n, 2 or more, N, N, N) uint8."""
        found: Tensor = self.features(self.trunk(volumes))
        return found

    def forward(self, volumes: Tensor) -> Tensor:
        """Give logits (n, 3, p, heights, rolls, x, y) of `LOGITS`, from channels of crops as `seen` takes them."""
        return torch.stack([self._all(features[None]) for features in self.seen(volumes)])

    def best(self, volumes: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
        """Give the best anchors of one crop, from channels (1, 2 or more, N, N, N) uint8.

        Returns
        -------
        (k,) int64, (k, 6) float32, (k,) float32
            Indices of anchors, residuals and scores: by the probabilities of reach, success and security.
        """
        features = self.seen(volumes)
        shares = torch.sigmoid(self._all(features))
        scores = shares[0] * (shares[1] + self.config.secure * shares[2]) / (1.0 + self.config.secure)
        best, index = scores.flatten().topk(count)
        return index, self.residuals_at(features, torch.zeros_like(index), index), best

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Give the best anchors of one crop (2 or more, N, N, N) as grasps, the best first."""
        with torch.no_grad():
            index, offsets, scores = self.best(torch.from_numpy(volume[None]), count)
        return self.anchors.candidates(index.numpy(), offsets.numpy(), scores.numpy())

    def best_of_each(self, features: Tensor) -> Tensor:
        """Give the best anchor (p rolls,) of each preshape and roll, from features (1, f, N/2, N/2) of `seen`."""
        with torch.no_grad():
            logits = functional.logsigmoid(self._all(features))
            preshapes, heights, rolls, *cells = self.anchors.shape
            best = (logits[0] + logits[1]).transpose(1, 2).flatten(2).argmax(2)
            height, column = best // (cells[0] * cells[1]), best % (cells[0] * cells[1])
            groups = torch.arange(preshapes)[:, None] * heights + height
            found: Tensor = ((groups * rolls + torch.arange(rolls)) * (cells[0] * cells[1]) + column).flatten()
        return found

    def values(self, features: Tensor, samples: AnchorSamples) -> Tensor:
        """Give logits (m, 3) of `LOGITS` at poses, from features of `seen`; between heights they are interpolated."""
        preshapes, heights, *_ = self.anchors.shape
        hidden = self._hidden(features, samples.sample_of, samples.place)
        logits = self.logits(hidden).unflatten(1, (len(LOGITS), preshapes, heights))
        own = logits[torch.arange(len(logits)), :, samples.preshape]
        height = samples.place[:, 2].clamp(0, heights - 1)
        low = height.floor().clamp(max=heights - 2)
        share = (height - low)[:, None]
        at = low.long()[:, None, None].expand(-1, len(LOGITS), 1)
        found: Tensor = own.gather(2, at)[..., 0] * (1 - share) + own.gather(2, at + 1)[..., 0] * share
        return found

    def residuals_at(self, features: Tensor, sample_of: Tensor, index: Tensor) -> Tensor:
        """Give residuals (m, 6) of anchors (m,) in crops (m,), from features of `seen`.

        Anchors that differ in height alone share their residuals. The network gives x and y along the hand's axes.
        """
        preshape, _, roll, x, y = torch.unravel_index(index, self.anchors.shape)
        place = torch.stack([x, y, torch.zeros_like(x), roll], dim=1).float()
        found = self.residuals(self._hidden(features, sample_of, place)).unflatten(1, (RESIDUALS, -1))
        own = found[torch.arange(len(index)), :, preshape]
        along, across = self._axes(place)
        return torch.cat([own[:, :1] * along + own[:, 1:2] * across, own[:, 2:]], dim=1)

    def _all(self, features: Tensor) -> Tensor:
        """Give logits (3, p, heights, rolls, x, y) of every anchor of one crop."""
        preshapes, heights, *rest = self.anchors.shape
        found = self.logits(self.hidden(self._sampled(features, self._rows, self._weights)))
        made: Tensor = found.T.unflatten(0, (len(LOGITS), preshapes, heights)).unflatten(3, tuple(rest))
        return made

    def _hidden(self, features: Tensor, sample_of: Tensor, place: Tensor) -> Tensor:
        rows, weights = self._taps(place)
        rows = rows + (sample_of * self._side**2)[:, None, None]
        found: Tensor = self.hidden(self._sampled(features, rows, weights))
        return found

    def _axes(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """Give the hand's x and y (m, 2) in the crop, where its approach is straight down."""
        angle = place[:, 3] * (2.0 * np.pi / self.config.anchors.rolls)
        cosine, sine = angle.cos(), angle.sin()
        return torch.stack([cosine, sine], 1), torch.stack([sine, -cosine], 1)

    def _taps(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """Give rows (m, taps, 4) of the features to sample, and their weights; beyond the crop its border counts."""
        anchors, along, across = self.config.anchors, *self._axes(place)
        margin = 0.5 * (self._side - anchors.cells)
        points = [
            place[:, :2] + margin + (x / anchors.spacing) * along + (y / anchors.spacing) * across
            for x in _ALONG
            for y in _ACROSS
        ]
        at = torch.stack(points, dim=1).clamp(0, self._side - 1)
        low = at.floor().clamp(max=self._side - 2)
        share = at - low
        first = (low[..., 0] * self._side + low[..., 1]).long()
        rows = torch.stack([first, first + 1, first + self._side, first + self._side + 1], dim=2)
        x, y = share.unbind(2)
        return rows, torch.stack([(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y], dim=2)

    @staticmethod
    def _sampled(features: Tensor, rows: Tensor, weights: Tensor) -> Tensor:
        """Interpolate features (n, f, N/2, N/2): (m, taps f)."""
        flat = features.permute(0, 2, 3, 1).flatten(0, 2)
        found = functional.embedding_bag(rows.flatten(0, 1), flat, per_sample_weights=weights.flatten(0, 1), mode="sum")
        return found.unflatten(0, rows.shape[:2]).flatten(1)
