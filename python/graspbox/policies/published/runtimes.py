"""Inference with trained networks: completion and scorer of a policy, run by onnxruntime (extra ``onnx``) or torch."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox.errors import ConfigError, FileError
from graspbox.perception.anchors import RESIDUALS, Anchors, Candidates
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.inputs.hand_numbers import tables_of
from graspbox.perception.inputs.scorer import GraspInputs, ScorerInputs
from graspbox.perception.outputs import NONE_JUDGED, Judged
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.folders import completion_folder
from graspbox.policies.stability_inputs import STORED_NAME

__all__ = [
    "AnchorHead",
    "Backend",
    "Completion",
    "Network",
    "Parts",
    "Scorer",
    "Stability",
    "load_parts",
    "load_stability",
    "of_hand",
    "onnx_network",
    "output",
    "torch_network",
]

#: Runtimes of networks.
Backend = Literal["onnx", "torch"]

#: Channels of a crop that are inputs of a head.
_SEEN = 2

#: A function from named arrays to named arrays.
Network = Callable[[Mapping[str, NDArray[Any]]], Mapping[str, NDArray[Any]]]


def onnx_network(path: Path, num_threads: int | None = None) -> Network:
    """Load an ONNX file; a run takes `num_threads`, by default one per core.

    Raises MissingExtraError without onnxruntime, FileError without the file, and ConfigError if onnxruntime cannot read
    it.
    The network raises ConfigError too, for invalid inputs and outputs that are not finite.
    """
    runtime = imported("onnxruntime", "policies with networks need the package onnxruntime", "onnx")
    if not Path(path).is_file():
        raise FileError(2, "there is no such network; export the policy again", str(path))
    options = runtime.SessionOptions()
    options.intra_op_num_threads = num_threads or 0
    options.inter_op_num_threads = 1
    # Spinning threads would take the cores from the geometry between two networks.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Errors are raised; onnxruntime would also print them.
    options.log_severity_level = 4
    try:
        session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no base class
        raise ConfigError(f"{path} cannot be read by onnxruntime: {str(error).splitlines()[0]}") from error
    names = [output.name for output in session.get_outputs()]

    def run(inputs: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
        try:
            values = session.run(names, dict(inputs))
        except Exception as error:
            raise ConfigError(f"{path} does not take {_described(inputs)}: {str(error).splitlines()[0]}") from None
        return _finite(dict(zip(names, values, strict=True)), str(path))

    return run


def torch_network(graph: Any) -> Network:
    """Run a module of `graspbox.learn.export.graphs` in torch; raises ConfigError for outputs that are not finite."""
    torch = import_module("torch")

    def run(inputs: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
        with torch.no_grad():
            values = graph(*(torch.from_numpy(np.ascontiguousarray(inputs[name])) for name in graph.inputs))
        tensors = values if isinstance(values, tuple) else (values,)
        named = {name: tensor.numpy() for name, tensor in zip(graph.outputs, tensors, strict=True)}
        return _finite(named, type(graph).__name__)

    return run


def _described(inputs: Mapping[str, NDArray[Any]]) -> str:
    return ", ".join(f"{name} {values.shape} {values.dtype}" for name, values in inputs.items())


def _finite(outputs: Mapping[str, NDArray[Any]], called: str) -> Mapping[str, NDArray[Any]]:
    for name, values in outputs.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise ConfigError(f"{called}: output {name!r} is not finite; train or export it again")
    return outputs


def output(outputs: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...], called: str) -> NDArray[Any]:
    """Return an output of the network `called`; raises ConfigError if it is missing or has another shape."""
    if name not in outputs:
        raise ConfigError(
            f"the network {called} returns {', '.join(outputs)}, but no {name!r}; export the policy again"
        )
    if outputs[name].shape != shape:
        raise ConfigError(
            f"the network {called} returns {name!r} of shape {outputs[name].shape}, expected {shape}; export the "
            "policy again"
        )
    return outputs[name]


class Completion:
    """Completes crops, ``channels`` to ``occupancy``, by `graspbox.learn.export.graphs.CompletionGraph`."""

    def __init__(self, network: Network) -> None:
        self._network = network

    def __call__(self, channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Complete crops: channels (n, 3, N, N, N) to occupancy (n, N, N, N), both uint8, 0 to 255 for 0 to 1.

        Crops are processed one by one, so that the bits of one do not depend on the others.
        """
        if not len(channels):
            return np.zeros((0, *channels.shape[2:]), dtype=np.uint8)
        shape = (1, *channels.shape[2:])
        parts = [output(self._network({"channels": one[None]}), "occupancy", shape, "completion") for one in channels]
        return np.concatenate(parts)


class Scorer:
    """Scores grasps by a network, `graspbox.learn.export.graphs.ScorerGraph`, an ensemble of `members`.

    It accepts at least `finalists` grasps; fewer are padded.
    """

    def __init__(self, network: Network, inputs: ScorerInputs, finalists: int, members: int = 1) -> None:
        self._network, self._inputs, self._finalists, self._members = network, inputs, finalists, members

    def judge(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> Judged:
        """Judge poses (m, 4, 4), metres, with preshapes (m,) in a volume (3, N, N, N): completed, surface, unseen."""
        count = len(preshape)
        if not count:
            return NONE_JUDGED
        crop_of = np.zeros(count, dtype=np.int64)
        made = self._inputs.make(volume[None], crop_of, crop_from_hand, preshape)
        if count < self._finalists:
            # Padding repeats the last grasp; all of them are finalists.
            rows = np.minimum(np.arange(self._finalists), count - 1)
            made = GraspInputs(made.cells[rows], made.poses[rows], made.preshape[rows])
        outputs, m = self._network(made._asdict()), len(made.preshape)
        shapes = {"choice": (m,), "success": (m,), "secure": (m,), "logits": (m, 2)}
        each = (output(outputs, name, shapes[name], "scorer") for name in Judged._fields)
        return Judged(*(values[:count].astype(np.float64) for values in each))

    def __call__(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the score by which grasps are chosen, (m,) float64; arguments as `judge`."""
        return self.judge(volume, crop_from_hand, preshape).choice

    def judge_each(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> Judged:
        """Judge every grasp by all members of the ensemble: scores to average, not to rank by; as `judge`."""
        if self._members == 1 or not len(preshape):
            return self.judge(volume, crop_from_hand, preshape)
        blocks = range(self._finalists, len(preshape), self._finalists)
        pairs = zip(np.split(crop_from_hand, blocks), np.split(preshape, blocks), strict=True)
        return Judged.joined([self.judge(volume, *pair) for pair in pairs])


def of_hand(network: Network, grid: HandGrid) -> Network:
    """Fix the hand of a scorer of any hand: `graspbox.learn.export.graphs.AnyHandScorerGraph` to `ScorerGraph`."""
    tables = tables_of(grid)
    # The network takes two rows or more.
    rows = np.minimum(np.arange(max(2, len(tables.numbers))), len(tables.numbers) - 1)
    fixed = {name: np.ascontiguousarray(table[rows]) for name, table in tables._asdict().items()}
    return lambda inputs: network({**inputs, **fixed})


class AnchorHead:
    """Predicts grasps among anchors by a network, `graspbox.learn.models.head.graph.HeadGraph`."""

    def __init__(self, network: Network, anchors: Anchors) -> None:
        self._network, self._anchors = network, anchors

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Return the best grasps of one crop (2 or more, N, N, N) uint8, at most as many as the network returns."""
        outputs = self._network({"volumes": np.ascontiguousarray(volume[None, :_SEEN])})
        rows = len(outputs.get("anchors", ()))
        shapes: dict[str, tuple[int, ...]] = {"anchors": (rows,), "residuals": (rows, RESIDUALS), "scores": (rows,)}
        index, residuals, scores = (output(outputs, name, shape, "head")[:count] for name, shape in shapes.items())
        if not rows or index.dtype.kind != "i" or index.min() < 0 or index.max() >= len(self._anchors):
            raise ConfigError(
                f"the network 'head' names anchors that are not among the {len(self._anchors)} of config.json; export "
                "the policy again"
            )
        return self._anchors.candidates(index, residuals, scores)


class Stability:
    """Predicts whether a grasp holds, by a network, `graspbox.learn.models.stability.network.StabilityGraph`."""

    def __init__(self, network: Network) -> None:
        self._network = network

    def __call__(self, readings: NDArray[np.float32]) -> float:
        """Return the probability that the grasp holds, from readings (k,): `StabilityReading.vector`."""
        return float(output(self._network({STORED_NAME: readings[None]}), "probability", (1,), "feel")[0])


def load_stability(folder: Path) -> Stability:
    """Load the grasp-stability network of a policy's folder; it is small and runs on one thread."""
    return Stability(onnx_network(Path(folder) / "feel.onnx", 1))


class Parts(NamedTuple):
    """The networks of a policy of one depth image; the head is None if the policy has none."""

    complete: Completion
    scorer: Scorer
    head: AnchorHead | None


def load_parts(
    folder: Path, config: DepthPolicyConfig, grid: HandGrid, backend: Backend = "onnx", num_threads: int | None = None
) -> Parts:
    """Load the networks of a policy's folder for the hand of a grid.

    `num_threads` is for onnxruntime, by default one per core; torch has its own setting.
    """
    files = [completion_folder(folder, config) / "completion.onnx", folder / "scorer.onnx"]
    files += [folder / "head.onnx"] if config.head else []
    if backend == "torch":
        networks = [torch_network(graph) for graph in import_module("graspbox.learn.export.graphs").load_graphs(folder)]
    else:
        networks = [onnx_network(file, num_threads) for file in files]
    head = AnchorHead(networks[2], Anchors(len(grid.preshapes), config.head.anchors)) if config.head else None
    scoring = networks[1] if config.hand_numbers is None else of_hand(networks[1], grid)
    scorer = Scorer(scoring, ScorerInputs(grid), config.finalists, config.members)
    return Parts(Completion(networks[0]), scorer, head)
