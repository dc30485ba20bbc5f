"""Batch normalizations, folded into convolutions: networks of published policies have none left."""

from itertools import pairwise

from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

__all__ = ["fold_norms"]


def fold_norms(net: nn.Module) -> None:
    """Fold batch normalizations into the preceding convolutions, in place; for evaluation.

    A module normalizes the output of a convolution if the normalization is registered directly after it.
    """
    for module in list(net.eval().modules()):
        children = list(module.named_children())
        for (name, convolution), (following, norm) in pairwise(children):
            if isinstance(convolution, nn.Conv2d | nn.Conv3d) and isinstance(norm, nn.BatchNorm2d | nn.BatchNorm3d):
                setattr(module, name, fuse_conv_bn_eval(convolution, norm))
                setattr(module, following, nn.Identity())
