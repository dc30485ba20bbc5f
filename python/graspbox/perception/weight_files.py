"""Files of weights of published policies, in half precision where that is exact: half the space (extra ``train``).

A network is made ready before it is exported: normalizations become part of the convolutions before them, as an ONNX
file has them, and what is left is rounded. Both files of the network then hold these weights exactly. It computes in
single precision as before.
"""

from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from graspbox.errors import ConfigError
from graspbox.files import write_bytes

__all__ = ["LARGEST_NETWORK", "check_size", "fold_norms", "restore_weights", "round_weights", "save_weights"]

#: Most bytes of the weights of a published network; its folder holds them twice.
LARGEST_NETWORK = 8_000_000
#: Numbers of a tensor from which on its precision matters for the size of a file.
_LARGE = 1024


def fold_norms(net: nn.Module) -> None:
    """Make batch normalizations part of the convolutions before them, in place; for evaluation.

    A module normalizes what a convolution gives where the normalization is registered directly after it.
    """
    for module in list(net.eval().modules()):
        children = list(module.named_children())
        for (name, convolution), (following, norm) in pairwise(children):
            if isinstance(convolution, nn.Conv2d | nn.Conv3d) and isinstance(norm, nn.BatchNorm2d | nn.BatchNorm3d):
                setattr(module, name, fuse_conv_bn_eval(convolution, norm))
                setattr(module, following, nn.Identity())


def round_weights(net: nn.Module) -> None:
    """Round the large weights of a network to half precision, in place."""
    with torch.no_grad():
        for parameter in net.parameters():
            if parameter.numel() >= _LARGE:
                parameter.copy_(parameter.half())


def _pack(tensor: Tensor) -> Tensor:
    """Give a large tensor that half precision holds exactly in half precision, another as it is."""
    if tensor.dtype != torch.float32 or tensor.numel() < _LARGE:
        return tensor.contiguous()
    half = tensor.half().contiguous()
    return half if torch.equal(half.float(), tensor) else tensor.contiguous()


def check_size(net: nn.Module, called: str) -> None:
    """Refuse a network whose file would be too large for a folder of policies.

    Raises
    ------
    ConfigError
        If its weights take more than `LARGEST_NETWORK` bytes.
    """
    count = sum(parameter.numel() for parameter in net.parameters())
    size = sum(parameter.numel() * parameter.element_size() for parameter in net.parameters())
    if size > LARGEST_NETWORK:
        raise ConfigError(
            f"{called} has {count / 1e6:.1f} million weights, a file of {size / 1e6:.0f} MB; published networks have "
            f"at most {LARGEST_NETWORK / 1e6:.0f} MB: publish a smaller one"
        )


def save_weights(net: nn.Module, path: Path) -> None:
    """Write the weights of a network as safetensors; those that half precision holds exactly in half precision."""
    from safetensors.torch import save

    write_bytes(path, save({name: _pack(tensor) for name, tensor in net.state_dict().items()}))


def restore_weights(net: nn.Module, path: Path) -> None:
    """Read what `save_weights` wrote into a network.

    Raises
    ------
    ConfigError
        If they are the weights of another network.
    """
    from safetensors.torch import load_file

    try:
        net.load_state_dict(load_file(str(path)))
    except RuntimeError as error:
        raise ConfigError(f"{path} holds the weights of another network: {str(error).splitlines()[0]}") from None
    net.eval()
