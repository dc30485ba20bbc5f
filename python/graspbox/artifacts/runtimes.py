"""Inference with trained networks: completion and scorer of a policy, run by onnxruntime (extra ``onnx``) or torch."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox._common.extras import imported
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.folders import completion_folder
from graspbox.errors import ConfigError, FileError
from graspbox.models.scorer.hand_numbers import tables_of
from graspbox.models.scorer.inputs import GraspInputs, ScorerInputs
from graspbox.models.stability.inputs import STORED_NAME
from graspbox.perception.anchors import RESIDUALS, Anchors, Candidates
from graspbox.perception.hand_grids import HandGrid

__all__ = [
    "AnchorHead",
    "Backend",
    "Completion",
    "Judged",
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
    """Load an ONNX file.

    Parameters
    ----------
    path : Path
        The file.
    num_threads : int, optional
        Threads of one run; by default one per core.

    Raises
    ------
    MissingExtraError
        If onnxruntime is not installed.
    FileError
        If there is no such file.
    ConfigError
        If onnxruntime cannot read it. The network raises it too, for invalid inputs and outputs that are not finite.
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
            found = session.run(names, dict(inputs))
        except Exception as error:
            raise ConfigError(f"{path} does not take {_described(inputs)}: {str(error).splitlines()[0]}") from None
        return _finite(dict(zip(names, found, strict=True)), str(path))

    return run


def torch_network(graph: Any) -> Network:
    """Run a module of `graspbox.artifacts.graphs` in torch; raises ConfigError for outputs that are not finite."""
    torch = import_module("torch")

    def run(inputs: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
        with torch.no_grad():
            found = graph(*(torch.from_numpy(np.ascontiguousarray(inputs[name])) for name in graph.inputs))
        tensors = found if isinstance(found, tuple) else (found,)
        named = {name: tensor.numpy() for name, tensor in zip(graph.outputs, tensors, strict=True)}
        return _finite(named, type(graph).__name__)

    return run


def _described(inputs: Mapping[str, NDArray[Any]]) -> str:
    return ", ".join(f"{name} {values.shape} {values.dtype}" for name, values in inputs.items())


def _finite(found: Mapping[str, NDArray[Any]], called: str) -> Mapping[str, NDArray[Any]]:
    for name, values in found.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise ConfigError(f"{called}: output {name!r} is not finite; train or export it again")
    return found


def output(found: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...], called: str) -> NDArray[Any]:
    """Return an output of a network.

    Raises
    ------
    ConfigError
        If there is none of that name, or it has another shape; the message names the network `called`.
    """
    if name not in found:
        raise ConfigError(f"the network {called} gives {', '.join(found)}, but no {name!r}; export the policy again")
    if found[name].shape != shape:
        raise ConfigError(
            f"the network {called} gives {name!r} of shape {found[name].shape}, expected {shape}; export the policy "
            "again"
        )
    return found[name]


class Completion:
    """Completes crops.

    Parameters
    ----------
    network : callable
        Maps ``channels`` to ``occupancy``: `graspbox.artifacts.graphs.CompletionGraph`.
    """

    def __init__(self, network: Network) -> None:
        self._network = network

    def __call__(self, channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Complete crops: channels (n, 3, N, N, N) to occupancy (n, N, N, N), both uint8, 0 to 255 for 0 to 1.

        Crops are processed one by one, so that the bits of one do not depend on the others.
        """
        if not len(channels):
            return np.zeros((0, *channels.shape[2:]), dtype=np.uint8)
        shape = (1, *channels.shape[2:])
        found = [output(self._network({"channels": one[None]}), "occupancy", shape, "completion") for one in channels]
        return np.concatenate(found)


class Judged(NamedTuple):
    """A scorer's outputs for m grasps.

    Attributes
    ----------
    choice : (m,) float64
        Score by which grasps are chosen: a mean of the next two.
    success, secure : (m,) float64
        Probability that the grasp succeeds, and that it also holds the object without a shift.
    logits : (m, 2) float64
        Logits of success and secure, before calibration.
    """

    choice: NDArray[np.float64]
    success: NDArray[np.float64]
    secure: NDArray[np.float64]
    logits: NDArray[np.float64]


class Scorer:
    """Scores grasps.

    Parameters
    ----------
    network : callable
        `graspbox.artifacts.graphs.ScorerGraph`.
    inputs : ScorerInputs
        Inputs of the hand.
    finalists : int
        Least number of grasps that the network accepts; fewer are padded.
    members : int
        Number of scorers of the ensemble.
    """

    def __init__(self, network: Network, inputs: ScorerInputs, finalists: int, members: int = 1) -> None:
        self._network, self._inputs, self._finalists, self._members = network, inputs, finalists, members

    def judge(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> Judged:
        """Judge grasps in one crop.

        Parameters
        ----------
        volume : (3, N, N, N) uint8
            Completed, surface, unseen.
        crop_from_hand : (m, 4, 4) float64
            Metres.
        preshape : (m,) float64
            Preshapes.
        """
        count = len(preshape)
        if not count:
            nothing = np.zeros(0)
            return Judged(nothing, nothing, nothing, np.zeros((0, 2)))
        crop_of = np.zeros(count, dtype=np.int64)
        made = self._inputs.make(volume[None], crop_of, crop_from_hand, preshape)
        if count < self._finalists:
            # Padding repeats the last grasp; all of them are finalists.
            rows = np.minimum(np.arange(self._finalists), count - 1)
            made = GraspInputs(made.cells[rows], made.poses[rows], made.preshape[rows])
        found, m = self._network(made._asdict()), len(made.preshape)
        shapes = {"choice": (m,), "success": (m,), "secure": (m,), "logits": (m, 2)}
        each = (output(found, name, shapes[name], "scorer") for name in Judged._fields)
        return Judged(*(values[:count].astype(np.float64) for values in each))

    def __call__(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the score by which grasps are chosen, (m,) float64; arguments as `judge`."""
        return self.judge(volume, crop_from_hand, preshape).choice

    def each(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Score every grasp by all members of the ensemble: scores to average, not to rank by; see ``__call__``."""
        if self._members == 1 or not len(preshape):
            return self(volume, crop_from_hand, preshape)
        blocks = range(self._finalists, len(preshape), self._finalists)
        pairs = zip(np.split(crop_from_hand, blocks), np.split(preshape, blocks), strict=True)
        return np.concatenate([self(volume, *pair) for pair in pairs])


def of_hand(network: Network, grid: HandGrid) -> Network:
    """Fix the hand of a scorer of any hand: `graspbox.artifacts.graphs.AnyHandScorerGraph` to `ScorerGraph`."""
    tables = tables_of(grid)
    # The network takes two rows or more.
    rows = np.minimum(np.arange(max(2, len(tables.numbers))), len(tables.numbers) - 1)
    fixed = {name: np.ascontiguousarray(table[rows]) for name, table in tables._asdict().items()}
    return lambda inputs: network({**inputs, **fixed})


class AnchorHead:
    """Predicts grasps.

    Parameters
    ----------
    network : callable
        `graspbox.models.head.graph.HeadGraph`.
    anchors : Anchors
        Its anchors.
    """

    def __init__(self, network: Network, anchors: Anchors) -> None:
        self._network, self._anchors = network, anchors

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Return the best grasps of one crop (2 or more, N, N, N) uint8, at most as many as the network returns."""
        found = self._network({"volumes": np.ascontiguousarray(volume[None, :_SEEN])})
        rows = len(found.get("anchors", ()))
        shapes: dict[str, tuple[int, ...]] = {"anchors": (rows,), "residuals": (rows, RESIDUALS), "scores": (rows,)}
        index, residuals, scores = (output(found, name, shape, "head")[:count] for name, shape in shapes.items())
        if not rows or index.dtype.kind != "i" or index.min() < 0 or index.max() >= len(self._anchors):
            raise ConfigError(
                f"the network 'head' names anchors that are not among the {len(self._anchors)} of config.json; export "
                "the policy again"
            )
        return self._anchors.candidates(index, residuals, scores)


class Stability:
    """Predicts from the hand's sensors the probability that a grasp holds.

    Parameters
    ----------
    network : callable
        `graspbox.models.stability.network.StabilityGraph`.
    """

    def __init__(self, network: Network) -> None:
        self._network = network

    def __call__(self, readings: NDArray[np.float32]) -> float:
        """Return the probability that the grasp holds; `readings` (k,) are those of `StabilityReading.vector`."""
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
    """Load the networks of a policy's folder.

    Parameters
    ----------
    folder : Path
        The folder.
    config : DepthPolicyConfig
        Its configuration.
    grid : HandGrid
        Voxel grid of the hand.
    backend : {"onnx", "torch"}
        Runtime of the networks.
    num_threads : int, optional
        Threads of onnxruntime; by default one per core. torch has its own setting.
    """
    files = [completion_folder(folder, config) / "completion.onnx", folder / "scorer.onnx"]
    files += [folder / "head.onnx"] if config.head else []
    if backend == "torch":
        networks = [torch_network(graph) for graph in import_module("graspbox.artifacts.graphs").load_graphs(folder)]
    else:
        networks = [onnx_network(file, num_threads) for file in files]
    head = AnchorHead(networks[2], Anchors(len(grid.preshapes), config.head.anchors)) if config.head else None
    scoring = networks[1] if config.hand_numbers is None else of_hand(networks[1], grid)
    scorer = Scorer(scoring, ScorerInputs(grid), config.finalists, config.members)
    return Parts(Completion(networks[0]), scorer, head)
