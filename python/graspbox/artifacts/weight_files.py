"""Files of weights of published policies, in half precision where that is exact: half the size (extra ``train``).

A network is prepared before export: normalizations are folded into the preceding convolutions, as in an ONNX
file, and the remaining weights are rounded. Both files of the network then contain these weights exactly. It still
computes in single precision.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import torch
from torch import Tensor, nn

from graspbox._common.files import read_bounded, write_bytes
from graspbox.errors import ConfigError
from graspbox.training.norms import fold_norms

__all__ = [
    "LARGEST_NETWORK",
    "check_size",
    "load_weights",
    "restore_weights",
    "restored",
    "round_weights",
    "save_weights",
]

Net = TypeVar("Net", bound=nn.Module)

#: Greatest size of the weights of a published network, bytes; its folder contains them twice.
LARGEST_NETWORK = 8_000_000
#: Number of elements from which the precision of a tensor matters for the size of a file.
_LARGE = 1024


def round_weights(net: nn.Module) -> None:
    """Round the large weights of a network to half precision, in place."""
    with torch.no_grad():
        for parameter in net.parameters():
            if parameter.numel() >= _LARGE:
                parameter.copy_(parameter.half())


def _pack(tensor: Tensor) -> Tensor:
    """Convert a large tensor to half precision if that is exact; return others unchanged."""
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
    """Write the weights of a network as safetensors, in half precision where that is exact."""
    from safetensors.torch import save

    write_bytes(path, save({name: _pack(tensor) for name, tensor in net.state_dict().items()}))


def load_weights(path: Path) -> dict[str, Tensor]:
    """Read a file of `save_weights`.

    Raises
    ------
    ConfigError
        If the file is not a weights file.
    FileError
        If it cannot be read.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load

    try:
        found: dict[str, Tensor] = load(read_bounded(path, 2 * LARGEST_NETWORK))
    except SafetensorError as error:
        raise ConfigError(f"{path} is not a weights file: {error}") from None
    return found


def restore_weights(net: nn.Module, path: Path) -> None:
    """Load a file of `save_weights` into a network.

    Raises
    ------
    ConfigError
        If the file is not a weights file, or belongs to another network.
    """
    _restore(net, load_weights(path), path)


def restored(make: Callable[[], Net], path: Path) -> Net:
    """Make a network with folded norms, and load a file of `save_weights` into it.

    The sizes are compared before memory is allocated: a network that the file does not fit may be huge.

    Raises
    ------
    ConfigError
        If the file is not a weights file, or belongs to another network.
    """
    weights = load_weights(path)
    with torch.device("meta"):
        outline = make()
    fold_norms(outline)
    _check_fit(outline, weights, path)
    net = make()
    fold_norms(net)
    _restore(net, weights, path)
    return net


def _restore(net: nn.Module, weights: Mapping[str, Tensor], path: Path) -> None:
    _check_fit(net, weights, path)
    net.load_state_dict(weights)
    net.eval()


def _check_fit(net: nn.Module, weights: Mapping[str, Tensor], path: Path) -> None:
    """Refuse weights whose names or shapes are not those of a network, by the first that differs."""
    wanted, stored = ({name: tuple(each.shape) for name, each in d.items()} for d in (net.state_dict(), weights))
    for name in [*wanted, *stored]:
        if wanted.get(name) != stored.get(name):
            has, needs = (str(sizes.get(name, "nothing")) for sizes in (stored, wanted))
            raise ConfigError(
                f"{path} holds the weights of another network: for {name!r} it has {has}, config.json needs {needs}; "
                "export the policy again"
            )
