"""Weights in half precision, so that those of published policies take half the space (extra ``train``).

Networks are rounded before they are exported; their files then hold the rounded weights exactly. They compute in single
precision as before.
"""

import torch
from torch import Tensor, nn

__all__ = ["pack", "round_weights"]

#: Numbers of a tensor from which on its precision matters for the size of a file.
_LARGE = 1024


def round_weights(net: nn.Module) -> None:
    """Round the large weights of a network to half precision, in place."""
    with torch.no_grad():
        for parameter in net.parameters():
            if parameter.numel() >= _LARGE:
                parameter.copy_(parameter.half())


def pack(tensor: Tensor) -> Tensor:
    """Give a large tensor that half precision holds exactly in half precision, another as it is."""
    if tensor.dtype != torch.float32 or tensor.numel() < _LARGE:
        return tensor.contiguous()
    half = tensor.half().contiguous()
    return half if torch.equal(half.float(), tensor) else tensor.contiguous()
