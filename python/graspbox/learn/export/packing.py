"""Large constants of ONNX files in less space, where that is exact; onnxruntime unpacks them when it loads the file."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

__all__ = ["LARGE", "pack", "unpacked"]

#: Number of elements from which a constant is packed.
LARGE = 1024
_NARROW: dict[np.dtype[Any], tuple[type, ...]] = {
    np.dtype(np.float32): (np.float16,),
    np.dtype(np.int64): (np.int16, np.int32),
    np.dtype(np.int32): (np.int16,),
}


def pack(model: ModelProto) -> None:
    """Pack large constants: in a narrower type, or as a table of different rows or numbers and places in it."""
    graph = model.graph
    constants, nodes = list(graph.initializer), list(graph.node)
    del graph.initializer[:], graph.node[:]
    for constant in constants:
        values = numpy_helper.to_array(constant)
        forms = [] if values.size < LARGE else [*_narrow(constant.name, values), *_tables(constant.name, values)]
        forms.append(([constant], []))
        tensors, unpacking = min(forms, key=_size)
        graph.initializer.extend(tensors)
        graph.node.extend(unpacking)
    graph.node.extend(nodes)


def unpacked(model: ModelProto) -> dict[str, NDArray[Any]]:
    """Return the constants of a model by name, those that `pack` packed included."""
    constants = {constant.name: numpy_helper.to_array(constant) for constant in model.graph.initializer}
    for node in model.graph.node:
        if not all(name in constants for name in node.input):
            continue
        inputs = [constants[name] for name in node.input]
        if node.op_type == "Cast":
            constants[node.output[0]] = inputs[0].astype(helper.tensor_dtype_to_np_dtype(node.attribute[0].i))
        elif node.op_type == "Gather" and not node.attribute:
            constants[node.output[0]] = inputs[0][inputs[1]]
    return constants


_Form = tuple[list[TensorProto], list[NodeProto]]


def _size(form: _Form) -> int:
    return sum(numpy_helper.to_array(tensor).nbytes for tensor in form[0])


def _narrow(name: str, values: NDArray[Any]) -> Iterator[_Form]:
    """Store numbers in a narrower type."""
    for kind in _NARROW.get(values.dtype, ()):
        with np.errstate(over="ignore"):
            packed: NDArray[Any] = values.astype(kind)
        if np.array_equal(packed, values):
            yield [_tensor(packed, f"{name}_packed")], [_cast(f"{name}_packed", name, values.dtype)]


def _tables(name: str, values: NDArray[Any]) -> Iterator[_Form]:
    """Store the different numbers, or rows along the last axis, and the place of each in that table."""
    for shape in ((-1,), (-1, values.shape[-1])):
        # Compare bits: NaN and negative zeros stay as they are.
        rows = values.reshape(shape)
        bits = np.ascontiguousarray(rows).view(f"u{values.itemsize}")
        _, first, place = np.unique(bits, axis=0, return_index=True, return_inverse=True)
        if len(first) > 1 << 16:
            continue
        kind = np.uint8 if len(first) <= 1 << 8 else np.uint16
        place = place.reshape(values.shape if len(shape) == 1 else values.shape[:-1]).astype(kind)
        nodes = [
            _cast(f"{name}_places", f"{name}_rows", np.dtype(np.int32)),
            helper.make_node("Gather", [f"{name}_table", f"{name}_rows"], [name]),
        ]
        yield [_tensor(rows[first], f"{name}_table"), _tensor(place, f"{name}_places")], nodes


def _tensor(values: NDArray[Any], name: str) -> TensorProto:
    return numpy_helper.from_array(np.ascontiguousarray(values), name)


def _cast(packed: str, name: str, kind: np.dtype[Any]) -> NodeProto:
    return helper.make_node("Cast", [packed], [name], to=helper.np_dtype_to_tensor_dtype(kind))
