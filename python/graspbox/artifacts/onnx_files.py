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
from onnx import helper, numpy_helper
from torch import Tensor, nn

from graspbox._common.files import replacing
from graspbox.artifacts.runtimes import onnx_network, torch_network
from graspbox.errors import ConfigError

__all__ = ["PARITY", "write_onnx"]

#: Greatest difference between the outputs of ONNX and torch; bytes may differ by 1.
PARITY = 1e-4
_OPSET = 18
#: Number of elements from which a constant is stored in less space, and the type.
_LARGE = 1024
_NARROW = {np.dtype(np.float32): np.float16, np.dtype(np.int64): np.int32}


def write_onnx(
    graph: nn.Module,
    example: Sequence[Tensor],
    dynamic: bool,
    path: Path,
    checks: Sequence[Mapping[str, NDArray[Any]]],
) -> None:
    """Write a graph, traced with an example, and compare the file's outputs with the graph's.

    A graph whose `forward` takes any number of inputs sets ``variadic = True``; one whose inputs have different numbers
    of rows names them in ``rows``, one name per input.

    Raises
    ------
    ConfigError
        If the outputs differ.
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
        _tidy(temporary)
    quiet.setLevel(level)
    network, reference = onnx_network(path), torch_network(graph)
    for inputs in checks:
        found, expected = network(inputs), reference(inputs)
        for name, values in expected.items():
            worst = _difference(found[name], values)
            if worst > PARITY:
                raise ConfigError(f"{path} differs from the network by {worst:.2g} in {name!r}; do not use it")


def _tidy(path: Path) -> None:
    """Store constants in half precision where that is exact, and remove the exporter's metadata of each node.

    onnxruntime widens the constants once, when it loads the file. The metadata are paths and lines of code.
    """
    model = onnx.load(str(path))
    graph = model.graph
    for noted in (model, graph, *model.functions, *graph.node, *graph.value_info, *graph.input, *graph.output):
        del noted.metadata_props[:]
        noted.doc_string = ""
    widened = []
    for constant in graph.initializer:
        values = numpy_helper.to_array(constant)
        narrow = _NARROW.get(values.dtype)
        if values.size < _LARGE or narrow is None:
            continue
        with np.errstate(over="ignore"):
            packed = values.astype(narrow)
        if np.array_equal(packed, values):
            name, kind = constant.name, constant.data_type
            constant.CopyFrom(numpy_helper.from_array(packed, f"{name}_packed"))
            widened.append(helper.make_node("Cast", [f"{name}_packed"], [name], to=kind))
    nodes = [*widened, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.save(model, str(path))


def _difference(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Return the greatest difference; bytes that differ by one count as equal, because of rounding."""
    worst = float(np.abs(a.astype(np.float64) - b.astype(np.float64)).max())
    return max(0.0, worst - 1.0) if a.dtype == np.uint8 else worst
