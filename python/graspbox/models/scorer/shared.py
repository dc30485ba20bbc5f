"""One scorer for many hands: what the fingers sweep, and a few numbers about the hand, are inputs.

`SharedScorerNet` learns from trials of many hands at once. `SharedScorerNet.of_hand` gives the scorer of any one hand,
also of one without trials: an ordinary `ScorerNet`, with the features of its preshapes computed once.
"""

from collections.abc import Sequence
from pathlib import Path
from pickle import UnpicklingError

import numpy as np
import torch
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.models.scorer.hand_numbers import HAND_NUMBERS, hand_numbers
from graspbox.models.scorer.network import ScorerNet
from graspbox.perception.hand_grids import HandGrid
from graspbox.training.trainer import load_weights

__all__ = ["SHARED_SHAPE", "SharedScorerNet"]

#: Shape of the grids of all hands.
SHARED_SHAPE = (24, 24, 16)
#: Width of the layer between a hand's numbers and the features of its preshapes.
_HIDDEN = 32
#: Parts of a scorer whose weights are those of all hands.
_SHARED_PARTS = ("stem", "stem_of_swept", "trunk", "head")


class SharedScorerNet(ScorerNet):
    """A scorer of several hands, whose preshapes are numbered one hand after the other.

    Weights do not depend on the hands: those of other hands can be loaded.

    Parameters
    ----------
    grids : sequence of HandGrid
        Voxel grids of the hands, all of the shape `SHARED_SHAPE`.
    width : int
        As for `ScorerNet`.

    Attributes
    ----------
    first : list of int
        Number of the first preshape of each hand.
    """

    numbers: Tensor
    scales: Tensor

    def __init__(self, grids: Sequence[HandGrid], width: int = 48) -> None:
        super().__init__(grids[0], width)
        self._width = width
        counts = [len(grid.preshapes) for grid in grids]
        self.first = np.cumsum([0, *counts[:-1]]).tolist()
        scales = np.repeat([grid.cell / grids[0].cell for grid in grids], counts)
        tables = {
            "swept": np.concatenate([grid.swept for grid in grids]),
            "moments": self.moments.numpy(),
            "numbers": np.concatenate([hand_numbers(grid) for grid in grids]),
            "scales": scales.astype(np.float32)[:, None],
        }
        del self.swept, self.moments
        for name, table in tables.items():
            self.register_buffer(name, torch.from_numpy(table), persistent=False)
        features = self.shape_of_preshape.embedding_dim
        del self.shape_of_preshape
        self.describe = nn.Sequential(
            nn.Linear(len(HAND_NUMBERS), _HIDDEN), nn.ReLU(inplace=True), nn.Linear(_HIDDEN, features)
        )

    def forward(self, cells: Tensor, poses: Tensor, preshape: Tensor) -> Tensor:
        """See `ScorerNet.forward`."""
        used, place = torch.unique(preshape, return_inverse=True)
        swept, features = self.layer_of_swept(self.swept[used]), self.describe(self.numbers[used])
        return self.logits(cells, poses, swept[place], features[place], self.scales[preshape])

    @classmethod
    def load(cls, weights: Path, grids: Sequence[HandGrid]) -> "SharedScorerNet":
        """Load weights of a training for any hands.

        Raises
        ------
        ConfigError
            If the file holds the weights of another network.
        """
        try:
            saved = torch.load(weights, map_location="cpu", weights_only=True)
        except (OSError, RuntimeError, UnpicklingError) as error:
            raise ConfigError(f"{weights} is not a file of weights: {error}") from None
        stem = saved.get("stem.weight")
        if stem is None or "describe.0.weight" not in saved:
            raise ConfigError(f"{weights} does not hold a scorer of many hands; graspbox train any-hand makes one")
        net = cls(grids, len(stem))
        load_weights(net, weights)
        return net

    def of_hand(self, grid: HandGrid) -> ScorerNet:
        """Return the scorer of one hand, trained or not, for evaluation."""
        net = ScorerNet(grid, self._width)
        for part in _SHARED_PARTS:
            getattr(net, part).load_state_dict(getattr(self, part).state_dict())
        with torch.no_grad():
            net.shape_of_preshape.weight.copy_(self.describe(torch.from_numpy(hand_numbers(grid))))
        net.eval()
        return net
