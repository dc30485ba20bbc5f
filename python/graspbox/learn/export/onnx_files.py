"""ONNX files: export of a torch module to a file with the same outputs (extra ``train``)."""

import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import ModelProto, numpy_helper
from torch import Tensor, nn

from graspbox._common.files import replacing
from graspbox.errors import ConfigError
from graspbox.learn.export.packing import pack
from graspbox.learn.export.weight_files import COUNTED
from graspbox.policies.published.runtimes import onnx_network, torch_network

__all__ = ["PARITY", "write_onnx"]

#: Greatest difference between the outputs of ONNX and torch; bytes may differ by 1.
PARITY = 1e-4
_OPSET = 18


def write_onnx(
    graph: nn.Module,
    example: Sequence[Tensor],
    dynamic: bool,
    path: Path,
    checks: Sequence[Mapping[str, NDArray[Any]]],
) -> None:
    """Write a graph, traced with an example, and compare the file's outputs with the graph's.

    The file is the only one of the network: its initializers have the names of the graph's state dict, from which
    `graspbox.learn.export.weight_files` restores the network.

    A graph whose `forward` takes any number of inputs sets ``variadic = True``; one whose inputs have different numbers
    of rows names them in ``rows``, one name per input.

    Raises ConfigError if the outputs differ, or a weight is not finite.
    """
    names = getattr(graph, "rows", ("rows",) * len(example))
    sizes = {name: torch.export.Dim(name, min=2) for name in names}
    each = tuple({0: sizes[name]} for name in names)
    shapes = None if not dynamic else (each,) if getattr(graph, "variadic", False) else each
    quiet = logging.getLogger("torch.onnx")
    level = quiet.level
    quiet.setLevel(logging.ERROR)
    with replacing(path) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside the exporter
        torch.onnx.export(
            graph,
            tuple(example),
            str(temporary),
            input_names=list(graph.inputs),
            output_names=list(graph.outputs),
            dynamic_shapes=shapes,
            opset_version=_OPSET,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        model = onnx.load(str(temporary))
        _tidy(model)
        _check_finite(model, path)
        _complete(model, graph)
        pack(model)
        onnx.save(model, str(temporary))
    quiet.setLevel(level)
    network, reference = onnx_network(path), torch_network(graph)
    for inputs in checks:
        actual, expected = network(inputs), reference(inputs)
        for name, values in expected.items():
            worst = _difference(actual[name], values)
            if worst > PARITY:
                raise ConfigError(f"{path} differs from the network by {worst:.2g} in {name!r}; do not use it")


def _tidy(model: ModelProto) -> None:
    """Remove the exporter's metadata of each node: paths and lines of code."""
    graph = model.graph
    for noted in (model, graph, *model.functions, *graph.node, *graph.value_info, *graph.input, *graph.output):
        del noted.metadata_props[:]
        noted.doc_string = ""


def _check_finite(model: ModelProto, path: Path) -> None:
    """Refuse weights that are not finite; a single infinity is a bound."""
    for constant in model.graph.initializer:
        values = numpy_helper.to_array(constant)
        if values.dtype.kind == "f" and not np.isfinite(values).all() and (values.size > 1 or np.isnan(values).any()):
            raise ConfigError(f"{path}: the weights {constant.name!r} are not finite; train again")


def _complete(model: ModelProto, net: nn.Module) -> None:
    """Name initializers as the state dict does; add entries that the exporter merged with others or folded."""
    state = {name: own.cpu().numpy() for name, own in net.state_dict().items() if not name.endswith(COUNTED)}
    stored = {constant.name: numpy_helper.to_array(constant) for constant in model.graph.initializer}
    for name in sorted(state.keys() - stored.keys()):
        own = state[name]
        same = (n for n, v in stored.items() if n not in state and (v.dtype, v.shape) == (own.dtype, own.shape))
        unnamed = next((n for n in same if stored[n].tobytes() == own.tobytes()), None)
        if unnamed is None:
            model.graph.initializer.append(numpy_helper.from_array(own, name))
        else:
            _rename(model, unnamed, name)
            stored[name] = stored.pop(unnamed)


def _rename(model: ModelProto, name: str, new: str) -> None:
    for constant in model.graph.initializer:
        constant.name = new if constant.name == name else constant.name
    for node in model.graph.node:
        node.input[:] = [new if each == name else each for each in node.input]


def _difference(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Return the greatest difference; bytes that differ by one count as equal, because of rounding."""
    worst = float(np.abs(a.astype(np.float64) - b.astype(np.float64)).max())
    return max(0.0, worst - 1.0) if a.dtype == np.uint8 else worst
