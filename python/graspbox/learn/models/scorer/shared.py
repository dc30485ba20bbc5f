"""One scorer for many hands: what the fingers sweep, and a few numbers about the hand, are inputs.

`SharedScorerNet` learns from trials of many hands at once. `SharedScorerNet.of_hand` returns the scorer of any hand,
also of one without trials: an ordinary `ScorerNet`, with the features of its preshapes computed once.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.learn.models.scorer.network import ScorerNet, moments_of
from graspbox.learn.training.norms import fold_norms
from graspbox.learn.training.trainer import load_weights, read_weights
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.inputs.hand_numbers import CELL, HAND_NUMBERS, HandTables, hand_numbers, tables_of

__all__ = ["SHARED_SHAPE", "SharedScorerNet"]

#: Shape of the grids of all hands.
SHARED_SHAPE = (24, 24, 16)
#: Width of the layer between a hand's numbers and the features of its preshapes.
_HIDDEN = 32
#: Parts of a scorer whose weights are those of all hands.
_SHARED_PARTS = ("stem", "stem_of_swept", "trunk", "head")


class SharedScorerNet(ScorerNet):
    """A scorer of several hands, whose preshapes are numbered one hand after the other, from `first` of each.

    All grids have the shape `SHARED_SHAPE`. Weights do not depend on the hands: those of other hands can be loaded.
    """

    numbers: Tensor
    scale: Tensor

    def __init__(self, grids: Sequence[HandGrid], width: int = 48) -> None:
        super().__init__(grids[0], width)
        self._width = width
        counts = [len(grid.preshapes) for grid in grids]
        self.first = np.cumsum([0, *counts[:-1]]).tolist()
        tables = [tables_of(grid) for grid in grids]
        # Weights do not depend on the hands, and no buffer is saved with them.
        del self.swept, self.moments
        self.register_buffer("moments", moments_of(grids[0].shape, CELL), persistent=False)
        for name in HandTables._fields:
            table = torch.from_numpy(np.concatenate([getattr(each, name) for each in tables]))
            self.register_buffer(name, table, persistent=False)
        features = self.shape_of_preshape.embedding_dim
        del self.shape_of_preshape
        self.describe = nn.Sequential(
            nn.Linear(len(HAND_NUMBERS), _HIDDEN), nn.ReLU(inplace=True), nn.Linear(_HIDDEN, features)
        )

    def forward(self, cells: Tensor, poses: Tensor, preshape: Tensor) -> Tensor:
        """See `ScorerNet.forward`."""
        used, place = torch.unique(preshape, return_inverse=True)
        return self.of_tables(cells, poses, place, self.swept[used], self.numbers[used], self.scale[used])

    def of_tables(
        self, cells: Tensor, poses: Tensor, preshape: Tensor, swept: Tensor, numbers: Tensor, scale: Tensor
    ) -> Tensor:
        """Return logits (m, 3) with other hands: `preshape` (m,) is the row of each grasp in their `HandTables`."""
        layers, features = self.layer_of_swept(swept), self.describe(numbers)
        return self.logits(cells, poses, layers[preshape], features[preshape], scale[preshape])

    @classmethod
    def load(cls, weights: Path, grids: Sequence[HandGrid]) -> "SharedScorerNet":
        """Load weights of a training for any hands; raises ConfigError as `load_weights`."""
        saved = read_weights(weights)
        stem = saved.get("stem.weight")
        if stem is None or "describe.0.weight" not in saved:
            raise ConfigError(f"{weights} does not hold a scorer of many hands; graspbox train any-hand makes one")
        net = cls(grids, len(stem))
        load_weights(net, weights)
        return net

    def of_hand(self, grid: HandGrid) -> ScorerNet:
        """Return the scorer of one hand, trained or not, for evaluation; folded norms stay folded."""
        net = ScorerNet(grid, self._width)
        if any(
            getattr(net, part).state_dict().keys() != getattr(self, part).state_dict().keys() for part in _SHARED_PARTS
        ):
            fold_norms(net)
        for part in _SHARED_PARTS:
            getattr(net, part).load_state_dict(getattr(self, part).state_dict())
        with torch.no_grad():
            net.shape_of_preshape.weight.copy_(self.describe(torch.from_numpy(hand_numbers(grid))))
        net.eval()
        return net
