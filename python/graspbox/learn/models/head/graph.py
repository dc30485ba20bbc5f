"""A head as an exportable function: bytes in; anchors, residuals and scores out (torch)."""

import copy

from torch import Tensor, nn

from graspbox.learn.models.head.network import AnchorNet

__all__ = ["BEST", "HeadGraph"]

#: Number of anchors that a published head returns.
BEST = 1024


class HeadGraph(nn.Module):  # type: ignore[misc]
    """Up to `best` anchors of one crop, the best first, from channels (1, 2, N, N, N) uint8."""

    inputs = ("volumes",)
    outputs = ("anchors", "residuals", "scores")

    def __init__(self, net: AnchorNet, best: int = BEST) -> None:
        super().__init__()
        # The exporter turns torch's embedding bag into a loop, which is a thousand times slower.
        self.net = copy.copy(net.eval())
        self._count = min(best, len(net.anchors))
        self.net._sampled = _sampled

    def forward(self, volumes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return indices (k,), residuals (k, 6) and scores (k,), as `AnchorNet.best` does."""
        anchors: tuple[Tensor, Tensor, Tensor] = self.net.best(volumes, self._count)
        return anchors


def _sampled(features: Tensor, rows: Tensor, weights: Tensor) -> Tensor:
    """Interpolate features as `AnchorNet` does."""
    flat = features.permute(0, 2, 3, 1).flatten(0, 2)
    return (flat[rows] * weights[..., None]).sum(2).flatten(1)
