"""Weights of published policies, read from their ONNX files (extra ``train``).

A network is prepared before export: normalizations are folded into the preceding convolutions, and large weights
are rounded to half precision, in which the file stores them exactly. The network still computes in single precision.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import onnx
import torch
from google.protobuf.message import DecodeError
from torch import Tensor, nn

from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError
from graspbox.learn.export.packing import LARGE, unpacked
from graspbox.learn.training.norms import fold_norms

__all__ = [
    "COUNTED",
    "LARGEST_NETWORK",
    "check_size",
    "load_weights",
    "restore_weights",
    "restored",
    "round_weights",
]

Net = TypeVar("Net", bound=nn.Module)

#: Greatest size of the weights of a published network, and of its file, bytes.
LARGEST_NETWORK = 8_000_000
_LARGEST_FILE = 1 << 28
#: End of the names of counters of normalizations: part of the state, but no network reads them in evaluation.
COUNTED = "num_batches_tracked"


def round_weights(net: nn.Module) -> None:
    """Round the large weights of a network to half precision, in place."""
    with torch.no_grad():
        for parameter in net.parameters():
            if parameter.numel() >= LARGE:
                parameter.copy_(parameter.half())


def check_size(net: nn.Module, called: str) -> None:
    """Refuse a network whose weights take more than `LARGEST_NETWORK` bytes: raises ConfigError."""
    count = sum(parameter.numel() for parameter in net.parameters())
    size = sum(parameter.numel() * parameter.element_size() for parameter in net.parameters())
    if size > LARGEST_NETWORK:
        raise ConfigError(
            f"{called} has {count / 1e6:.1f} million weights, a file of {size / 1e6:.0f} MB; published networks have "
            f"at most {LARGEST_NETWORK / 1e6:.0f} MB: publish a smaller one"
        )


def load_weights(path: Path, part: str = "") -> dict[str, Tensor]:
    """Read the weights of a network from its ONNX file, whose initializers have the names of the state dict.

    Only the names that begin with `part`, such as ``members.0.``, are returned, without it. Weights have the precision
    in which the network computes; other constants of the graph are among them.

    Raises ConfigError if the file is not an ONNX file with such weights; FileError if it cannot be read.
    """
    content = read_bounded(path, _LARGEST_FILE)
    try:
        model = onnx.load_from_string(content)
    except DecodeError as error:
        raise ConfigError(f"{path} is not an ONNX file: {error}") from None
    weights = {name.removeprefix(part): each for name, each in unpacked(model).items() if name.startswith(part)}
    if not weights:
        raise ConfigError(f"{path} has no weights {part}*; export the policy again")
    return {name: torch.from_numpy(values.copy()) for name, values in weights.items()}


def restore_weights(net: nn.Module, path: Path, part: str = "") -> None:
    """Load weights into a network; arguments and errors as `load_weights`, also for a file of another network."""
    _restore(net, load_weights(path, part), path)


def restored(make: Callable[[], Net], path: Path, part: str) -> Net:
    """Make a network with folded norms, and load weights into it; as `restore_weights`.

    The sizes are compared before memory is allocated: a network that the file does not fit may be huge.
    """
    weights = load_weights(path, part)
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
    net.load_state_dict({name: weights.get(name, own) for name, own in net.state_dict().items()})
    net.eval()


def _check_fit(net: nn.Module, weights: Mapping[str, Tensor], path: Path) -> None:
    """Refuse weights whose names or shapes are not those of a network, by the first that differs."""
    for name, own in net.state_dict().items():
        if name.endswith(COUNTED):
            continue
        needs, has = tuple(own.shape), tuple(weights[name].shape) if name in weights else "nothing"
        if has != needs:
            raise ConfigError(
                f"{path} holds the weights of another network: for {name!r} it has {has}, config.json needs {needs}; "
                "export the policy again"
            )
