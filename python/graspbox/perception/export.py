"""Export of trained networks: weights as safetensors, and each network as one ONNX file (extra ``train``)."""

import logging
import shutil
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

import graspbox
from graspbox.errors import ConfigError
from graspbox.files import replacing
from graspbox.perception.calibration import Calibration
from graspbox.perception.completion import CompletionNet
from graspbox.perception.configs import CropConfig, HandGridConfig
from graspbox.perception.finder import FinderConfig
from graspbox.perception.graphs import CompletionGraph, ScorerGraph
from graspbox.perception.grasp_inputs import GraspInputs, ScorerInputs
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import perturbed
from graspbox.perception.policy_folders import DepthPolicyConfig, file_hash, write_depth_policy
from graspbox.perception.runtimes import onnx_network, torch_network
from graspbox.perception.scorer import ScorerNet
from graspbox.perception.weight_files import round_weights, save_weights

__all__ = [
    "FINALISTS",
    "PARITY",
    "export_completion",
    "export_depth_policy",
    "export_scorer",
    "write_onnx",
]

#: Grasps that all members of a scorer judge.
FINALISTS = 16
#: Greatest difference between what ONNX and torch give; bytes may differ by 1.
PARITY = 1e-4
_OPSET = 18
_COMPLETION, _SCORER = "completion", "scorer"


def write_onnx(
    graph: nn.Module,
    example: Sequence[Tensor],
    dynamic: bool,
    path: Path,
    checks: Sequence[Mapping[str, NDArray[Any]]],
) -> None:
    """Write a graph, traced with an example, and compare the file with it on given inputs.

    A graph whose `forward` takes any number of inputs says so by ``variadic = True``.

    Raises
    ------
    ConfigError
        If they differ.
    """
    rows = torch.export.Dim("rows", min=2)
    each = tuple({0: rows} for _ in example)
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
    quiet.setLevel(level)
    network, reference = onnx_network(path), torch_network(graph)
    for inputs in checks:
        found, expected = network(inputs), reference(inputs)
        for name, values in expected.items():
            worst = _difference(found[name], values)
            if worst > PARITY:
                raise ConfigError(f"{path} differs from the network by {worst:.2g} in {name!r}; do not use it")


def _difference(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Give the greatest difference; bytes that differ by one count as equal, since a rounding decides."""
    worst = float(np.abs(a.astype(np.float64) - b.astype(np.float64)).max())
    return max(0.0, worst - 1.0) if a.dtype == np.uint8 else worst


def export_completion(net: CompletionNet, path: Path, crop: CropConfig = CropConfig()) -> None:  # noqa: B008 (frozen)
    """Write a completion as ONNX: ``channels`` (1, 3, N, N, N) uint8 to ``occupancy`` (1, N, N, N) uint8.

    Raises
    ------
    ConfigError
        If the file does not give what the network gives.
    """
    generator = torch.Generator().manual_seed(0)
    n = crop.resolution
    example = torch.randint(0, 256, (1, 3, n, n, n), dtype=torch.uint8, generator=generator)
    write_onnx(CompletionGraph(net), [example], False, path, [{"channels": example.numpy()}])


def export_scorer(
    members: Sequence[ScorerNet], calibration: Calibration, grid: HandGrid, path: Path, *, finalists: int = FINALISTS
) -> None:
    """Write a scorer as ONNX, from `GraspInputs` to `Judged`; raises as `export_completion`."""
    given = _grasps_of_a_block(grid, 4 * finalists)
    example = [torch.from_numpy(array[: finalists + 7]) for array in given]
    # With finalists alone, nothing depends on which of two grasps that score alike to the last digit is one.
    checks = [{k: v[i : i + finalists] for k, v in given._asdict().items()} for i in range(0, 4 * finalists, finalists)]
    write_onnx(ScorerGraph(members, calibration, finalists), example, True, path, checks)


def _grasps_of_a_block(grid: HandGrid, count: int) -> GraspInputs:
    """Make inputs of grasps of a block of 6 x 6 x 10 cm, as a scorer meets them."""
    n, size = grid.crop.resolution, grid.crop.voxel_size
    centers = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * size + np.array(grid.crop.origin)
    inside = (np.abs(centers[:, :2]) < 0.03).all(axis=1) & (centers[:, 2] > 0) & (centers[:, 2] < 0.1)
    occupancy = (255 * inside).astype(np.uint8).reshape(n, n, n)
    found = grid.propose(occupancy)
    # A hand for which nothing is proposed is placed above the block.
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3] = 0.15
    poses = found.poses if len(found) else above[None]
    preshapes = found.preshape if len(found) else grid.preshapes[:1]
    rows = np.arange(count) % len(poses)
    moved = perturbed(poses[rows], np.random.default_rng(0), 0.005, 0.05)
    volume = np.stack([occupancy, occupancy, np.zeros_like(occupancy)])
    return ScorerInputs(grid).make(volume[None], np.zeros(count, dtype=np.int64), moved, preshapes[rows])


def export_depth_policy(
    folder: Path,
    name: str,
    completion: CompletionNet,
    members: Sequence[ScorerNet],
    calibration: Calibration,
    *,
    hand: str = "reflex",
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    grid: HandGridConfig = HandGridConfig(),  # noqa: B008 (frozen)
    finder: FinderConfig = FinderConfig(),  # noqa: B008 (frozen)
    licence: Path | None = None,
) -> DepthPolicyConfig:
    """Write a policy's folder: networks, weights, ``config.json`` last.

    Parameters
    ----------
    folder : Path
        The folder; it is made.
    name : str
        Name of the policy in results.
    completion, members
        Trained networks; their weights are rounded to half precision.
    calibration : Calibration
        What makes the scorer's logits probabilities.
    hand : str
        Name of the hand.
    crop, grid, finder
        Settings.
    licence : Path, optional
        A file that is copied as ``LICENSE``.

    Raises
    ------
    ConfigError
        If an ONNX file does not give what its network gives.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    hand_grid = HandGrid(hand, grid, crop=crop)
    for net in (completion, *members):
        round_weights(net)
    export_completion(completion, folder / f"{_COMPLETION}.onnx", crop)
    export_scorer(members, calibration, hand_grid, folder / f"{_SCORER}.onnx")
    save_weights(completion, folder / f"{_COMPLETION}.safetensors")
    for number, member in enumerate(members):
        save_weights(member, folder / f"{_SCORER}-{number}.safetensors")
    kept = [f"{part}.onnx" for part in (_COMPLETION, _SCORER)]
    kept += [f"{_COMPLETION}.safetensors", *(f"{_SCORER}-{number}.safetensors" for number in range(len(members)))]
    config = DepthPolicyConfig(
        name=name,
        graspbox=graspbox.__version__,
        hand=hand,
        calibration=calibration,
        files={file: file_hash(folder / file) for file in kept},
        members=len(members),
        width=members[0].stem.out_channels,
        finalists=FINALISTS,
        completion_width=completion.stem.out_channels,
        crop=crop,
        grid=grid,
        finder=finder,
    )
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    write_depth_policy(folder, config)
    return config
