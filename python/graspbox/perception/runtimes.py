"""Trained networks at work: completion and scorer of a policy, run by onnxruntime (extra ``onnx``) or by torch."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError, FileError, MissingExtraError
from graspbox.perception.anchors import Anchors, Candidates
from graspbox.perception.grasp_inputs import GraspInputs, ScorerInputs
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.policy_folders import DepthPolicyConfig

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
    "onnx_network",
    "torch_network",
]

#: What runs networks.
Backend = Literal["onnx", "torch"]

#: Channels of a crop that a head sees.
_SEEN = 2

#: From named arrays to named arrays.
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
        If onnxruntime cannot read it.
    """
    try:
        runtime = import_module("onnxruntime")
    except ModuleNotFoundError as error:
        if error.name != "onnxruntime":
            raise
        raise MissingExtraError(
            "policies with networks need the package onnxruntime: pip install 'graspbox[onnx]'"
        ) from None
    if not Path(path).is_file():
        raise FileError(2, "there is no such network; export the policy again", str(path))
    options = runtime.SessionOptions()
    options.intra_op_num_threads = num_threads or 0
    options.inter_op_num_threads = 1
    # Threads that wait by spinning would take the cores from the geometry between two networks.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no base class
        raise ConfigError(f"{path} is no network that onnxruntime reads: {str(error).splitlines()[0]}") from error
    names = [output.name for output in session.get_outputs()]
    return lambda inputs: dict(zip(names, session.run(names, dict(inputs)), strict=True))


def torch_network(graph: Any) -> Network:
    """Run a module of `graspbox.perception.graphs` by torch."""
    torch = import_module("torch")

    def run(inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        with torch.no_grad():
            found = graph(*(torch.from_numpy(np.ascontiguousarray(inputs[name])) for name in graph.inputs))
        tensors = found if isinstance(found, tuple) else (found,)
        return {name: tensor.numpy() for name, tensor in zip(graph.outputs, tensors, strict=True)}

    return run


class Completion:
    """Completes crops.

    Parameters
    ----------
    network : callable
        From ``channels`` to ``occupancy``: `graspbox.perception.graphs.CompletionGraph`.
    """

    def __init__(self, network: Network) -> None:
        self._network = network

    def __call__(self, channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Complete crops: channels (n, 3, N, N, N) to occupancy (n, N, N, N), both uint8, 0 to 255 for 0 to 1.

        Each crop is completed by itself, so that its bits do not depend on the others.
        """
        if not len(channels):
            return np.zeros((0, *channels.shape[2:]), dtype=np.uint8)
        return np.concatenate([self._network({"channels": one[None]})["occupancy"] for one in channels])


class Judged(NamedTuple):
    """What a scorer says of m grasps.

    Attributes
    ----------
    choice : (m,) float64
        What grasps are chosen by: a mean of the next two.
    success, secure : (m,) float64
        Probability that the grasp succeeds, and that it also holds the object without a shift.
    logits : (m, 2) float64
        Of success and secure, before calibration.
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
        `graspbox.perception.graphs.ScorerGraph`.
    inputs : ScorerInputs
        The hand.
    finalists : int
        The network's least number of grasps; fewer are padded.
    members : int
        Scorers of the ensemble.
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
            # The last grasp is repeated; all of them are finalists.
            rows = np.minimum(np.arange(self._finalists), count - 1)
            made = GraspInputs(made.cells[rows], made.poses[rows], made.preshape[rows])
        found = self._network(made._asdict())
        return Judged(*(found[name][:count].astype(np.float64) for name in Judged._fields))

    def __call__(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Give what grasps are chosen by, (m,) float64; arguments as `judge`."""
        return self.judge(volume, crop_from_hand, preshape).choice

    def each(
        self, volume: NDArray[np.uint8], crop_from_hand: NDArray[np.float64], preshape: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Score as ``__call__``, but every grasp by all members of the ensemble: scores to average, not to rank by."""
        if self._members == 1 or not len(preshape):
            return self(volume, crop_from_hand, preshape)
        blocks = range(self._finalists, len(preshape), self._finalists)
        pairs = zip(np.split(crop_from_hand, blocks), np.split(preshape, blocks), strict=True)
        return np.concatenate([self(volume, *pair) for pair in pairs])


class AnchorHead:
    """Predicts grasps.

    Parameters
    ----------
    network : callable
        `graspbox.perception.head_graphs.HeadGraph`.
    anchors : Anchors
        Its anchors.
    """

    def __init__(self, network: Network, anchors: Anchors) -> None:
        self._network, self._anchors = network, anchors

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Give the best grasps of one crop (2 or more, N, N, N) uint8, at most as many as the network has."""
        found = self._network({"volumes": np.ascontiguousarray(volume[None, :_SEEN])})
        return self._anchors.candidates(*(found[name][:count] for name in ("anchors", "residuals", "scores")))


class Stability:
    """Tells how likely a grasp holds from what a hand feels.

    Parameters
    ----------
    network : callable
        `graspbox.perception.stability_net.StabilityGraph`.
    """

    def __init__(self, network: Network) -> None:
        self._network = network

    def __call__(self, felt: NDArray[np.float32]) -> float:
        """Give the probability that the grasp holds; `felt` (k,) is that of `graspbox.perception.stability.Feeling`."""
        return float(self._network({"felt": felt[None]})["probability"][0])


def load_stability(folder: Path) -> Stability:
    """Load what feels from a policy's folder; it is small and runs on one thread."""
    return Stability(onnx_network(Path(folder) / "feel.onnx", 1))


class Parts(NamedTuple):
    """The networks of a policy of one depth image; the head is None where the policy has none."""

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
        What `graspbox.perception.policy_folders.read_depth_policy` read there.
    grid : HandGrid
        The hand.
    backend : {"onnx", "torch"}
        What runs them.
    num_threads : int, optional
        Threads of onnxruntime; by default one per core. torch has a setting of its own.
    """
    names = ["completion", "scorer", *(["head"] if config.head else [])]
    if backend == "torch":
        networks = [torch_network(graph) for graph in import_module("graspbox.perception.graphs").load_graphs(folder)]
    else:
        networks = [onnx_network(folder / f"{name}.onnx", num_threads) for name in names]
    head = AnchorHead(networks[2], Anchors(len(grid.preshapes), config.head.anchors)) if config.head else None
    scorer = Scorer(networks[1], ScorerInputs(grid), config.finalists, config.members)
    return Parts(Completion(networks[0]), scorer, head)
