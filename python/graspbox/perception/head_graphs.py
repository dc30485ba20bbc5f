"""A head as a function of what perception gives: bytes in, anchors with residuals and scores out (torch)."""

import copy

from torch import Tensor, nn

from graspbox.perception.anchor_net import AnchorNet

__all__ = ["BEST", "HeadGraph"]

#: Anchors that a published head gives.
BEST = 1024


class HeadGraph(nn.Module):  # type: ignore[misc]
    """The best anchors of one crop, the best first, from channels (1, 2, N, N, N) uint8.

    Parameters
    ----------
    net : AnchorNet
        The head.
    best : int
        How many anchors it gives, if there are so many.
    """

    inputs = ("volumes",)
    outputs = ("anchors", "residuals", "scores")

    def __init__(self, net: AnchorNet, best: int = BEST) -> None:
        super().__init__()
        # The exporter makes a loop of torch's embedding bag, which takes a thousand times as long.
        self.net = copy.copy(net.eval())
        self._count = min(best, len(net.anchors))
        self.net._sampled = _sampled

    def forward(self, volumes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Give indices (k,), residuals (k, 6) and scores (k,), as `AnchorNet.best` does."""
        found: tuple[Tensor, Tensor, Tensor] = self.net.best(volumes, self._count)
        return found


def _sampled(features: Tensor, rows: Tensor, weights: Tensor) -> Tensor:
    """Interpolate features as `AnchorNet` does."""
    flat = features.permute(0, 2, 3, 1).flatten(0, 2)
    return (flat[rows] * weights[..., None]).sum(2).flatten(1)
