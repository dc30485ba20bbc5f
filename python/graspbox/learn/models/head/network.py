"""The network of a head: logits of every pose of a grid, from feature patches sampled in the hand's axes.

The features of a trunk are sampled at a few points of the table plane, placed in the hand's own axes around the grasp
point. The layers after that are shared by all grasp points and rolls, so evidence from one pose serves all.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.learn.models.head.trunk import Trunk, unit
from graspbox.perception.anchors import RESIDUALS, Anchors, Candidates
from graspbox.perception.configs import CropConfig
from graspbox.policies.published.head_configs import HeadConfig

__all__ = ["LOGITS", "REACHED", "SECURE", "SUCCESS", "AnchorNet", "AnchorSamples"]

#: Events whose logits an anchor has: the open hand reaches the pose, the grasp succeeds, the grasp is secure.
LOGITS = ("reached", "success", "secure")
#: Their places.
REACHED, SUCCESS, SECURE = range(len(LOGITS))
#: Sampling points of features, along the hand's x and y from the grasp point, metres.
_ALONG, _ACROSS = (-0.07, -0.035, 0.0, 0.035, 0.07), (-0.04, 0.0, 0.04)


@dataclass(frozen=True, eq=False)
class AnchorSamples:
    """m poses among the anchors of n crops: the crop of each, its place (m, 4) and its preshape's index.

    `graspbox.perception.anchors.Encoded` describes places.
    """

    sample_of: Tensor
    place: Tensor
    preshape: Tensor

    @classmethod
    def of(
        cls, sample_of: NDArray[np.int64], place: NDArray[np.float64], preshape: NDArray[np.int64]
    ) -> "AnchorSamples":
        """Build samples from poses in crops ``sample_of`` (m,)."""
        return cls(torch.from_numpy(sample_of), torch.from_numpy(place).float(), torch.from_numpy(preshape))


class AnchorNet(nn.Module):  # type: ignore[misc]
    """Logits and residuals of the anchors of a hand with a number of preshapes."""

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
        # Sampling points of the anchors themselves, by roll, x and y.
        roll, x, y = torch.meshgrid(torch.arange(rolls), torch.arange(cells), torch.arange(cells), indexing="ij")
        place = torch.stack([x, y, torch.zeros_like(x), roll], dim=3).flatten(0, 2).float()
        rows, weights = self._taps(place)
        self.register_buffer("_rows", rows, persistent=False)
        self.register_buffer("_weights", weights, persistent=False)

    def seen(self, volumes: Tensor) -> Tensor:
        """Return features (n, f, N/2, N/2), from channels (n, 2 or more, N, N, N) uint8."""
        features: Tensor = self.features(self.trunk(volumes))
        return features

    def forward(self, volumes: Tensor) -> Tensor:
        """Return logits (n, 3, p, heights, rolls, x, y) of `LOGITS`, from channels of crops as `seen` takes them."""
        return torch.stack([self._all(features[None]) for features in self.seen(volumes)])

    def best(self, volumes: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
        """Return the best anchors of one crop, from channels (1, 2 or more, N, N, N) uint8.

        Returns
        -------
        (k,) int64, (k, 6) float32, (k,) float32
            Anchor indices, residuals, and scores computed from the probabilities of reach, success and security.
        """
        features = self.seen(volumes)
        shares = torch.sigmoid(self._all(features))
        scores = shares[REACHED] * (shares[SUCCESS] + self.config.secure * shares[SECURE]) / (1.0 + self.config.secure)
        best, index = scores.flatten().topk(count)
        return index, self.residuals_at(features, torch.zeros_like(index), index), best

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Return the best anchors of one crop (2 or more, N, N, N) as grasps, best first."""
        with torch.no_grad():
            best = self.best(torch.from_numpy(volume[None]).to(self._rows.device), count)
        index, offsets, scores = (values.cpu().numpy() for values in best)
        return self.anchors.candidates(index, offsets, scores)

    def best_of_each(self, features: Tensor) -> Tensor:
        """Return the best anchor (p rolls,) of each preshape and roll, from features (1, f, N/2, N/2) of `seen`."""
        with torch.no_grad():
            logits = functional.logsigmoid(self._all(features))
            preshapes, heights, rolls, *cells = self.anchors.shape
            best = (logits[REACHED] + logits[SUCCESS]).transpose(1, 2).flatten(2).argmax(2)
            height, column = best // (cells[0] * cells[1]), best % (cells[0] * cells[1])
            groups = torch.arange(preshapes, device=height.device)[:, None] * heights + height
            turns = torch.arange(rolls, device=height.device)
            index: Tensor = ((groups * rolls + turns) * (cells[0] * cells[1]) + column).flatten()
        return index

    def values(self, features: Tensor, samples: AnchorSamples) -> Tensor:
        """Return logits (m, 3) of `LOGITS` at poses, from features of `seen`; interpolated between heights."""
        preshapes, heights, *_ = self.anchors.shape
        hidden = self._hidden(features, samples.sample_of, samples.place)
        logits = self.logits(hidden).unflatten(1, (len(LOGITS), preshapes, heights))
        own = logits[torch.arange(len(logits)), :, samples.preshape]
        height = samples.place[:, 2].clamp(0, heights - 1)
        low = height.floor().clamp(max=heights - 2)
        share = (height - low)[:, None]
        at = low.long()[:, None, None].expand(-1, len(LOGITS), 1)
        values: Tensor = own.gather(2, at)[..., 0] * (1 - share) + own.gather(2, at + 1)[..., 0] * share
        return values

    def residuals_at(self, features: Tensor, sample_of: Tensor, index: Tensor) -> Tensor:
        """Return residuals (m, 6) of anchors (m,) in crops (m,), from features of `seen`.

        Anchors that differ only in height share their residuals. The network predicts x and y along the hand's axes.
        """
        preshape, _, roll, x, y = torch.unravel_index(index, self.anchors.shape)
        place = torch.stack([x, y, torch.zeros_like(x), roll], dim=1).float()
        residuals = self.residuals(self._hidden(features, sample_of, place)).unflatten(1, (RESIDUALS, -1))
        own = residuals[torch.arange(len(index)), :, preshape]
        along, across = self._axes(place)
        return torch.cat([own[:, :1] * along + own[:, 1:2] * across, own[:, 2:]], dim=1)

    def _all(self, features: Tensor) -> Tensor:
        """Return logits (3, p, heights, rolls, x, y) of every anchor of one crop."""
        preshapes, heights, *rest = self.anchors.shape
        logits = self.logits(self.hidden(self._sampled(features, self._rows, self._weights)))
        shaped: Tensor = logits.T.unflatten(0, (len(LOGITS), preshapes, heights)).unflatten(3, tuple(rest))
        return shaped

    def _hidden(self, features: Tensor, sample_of: Tensor, place: Tensor) -> Tensor:
        rows, weights = self._taps(place)
        rows = rows + (sample_of * self._side**2)[:, None, None]
        hidden: Tensor = self.hidden(self._sampled(features, rows, weights))
        return hidden

    def _axes(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """Return the hand's x and y axes (m, 2) in the crop, for an approach straight down."""
        angle = place[:, 3] * (2.0 * np.pi / self.config.anchors.rolls)
        cosine, sine = angle.cos(), angle.sin()
        return torch.stack([cosine, sine], 1), torch.stack([sine, -cosine], 1)

    def _taps(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """Return rows (m, taps, 4) of the features to sample, and their weights; the crop's border is repeated."""
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
        """Interpolate features (n, f, N/2, N/2) to (m, taps f)."""
        flat = features.permute(0, 2, 3, 1).flatten(0, 2)
        sums = functional.embedding_bag(rows.flatten(0, 1), flat, per_sample_weights=weights.flatten(0, 1), mode="sum")
        return sums.unflatten(0, rows.shape[:2]).flatten(1)
