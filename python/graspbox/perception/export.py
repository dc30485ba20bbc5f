"""Export of trained networks: weights as safetensors, and each network as one ONNX file (extra ``train``)."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

import graspbox
from graspbox.perception.anchor_net import AnchorNet
from graspbox.perception.calibration import Calibration
from graspbox.perception.completion import CompletionNet
from graspbox.perception.configs import CropConfig, HandGridConfig
from graspbox.perception.finder import LOOKED_AT
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.graphs import CompletionGraph, ScorerGraph
from graspbox.perception.grasp_inputs import GraspInputs, ScorerInputs
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.head_export import HEAD_FILES, write_head
from graspbox.perception.onnx_files import write_onnx
from graspbox.perception.perturbations import perturbed
from graspbox.perception.policy_folders import DepthPolicyConfig, file_hash, write_depth_policy
from graspbox.perception.scorer import ScorerNet
from graspbox.perception.weight_files import fold_norms, round_weights, save_weights

__all__ = [
    "FINALISTS",
    "export_completion",
    "export_depth_policy",
    "export_scorer",
]

#: Grasps that all members of a scorer judge.
FINALISTS = 16
_COMPLETION, _SCORER = "completion", "scorer"


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
    head: AnchorNet | None = None,
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
    head : AnchorNet, optional
        A trained head, whose best grasps are scored beside the proposals.
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
        fold_norms(net)
        round_weights(net)
    export_completion(completion, folder / f"{_COMPLETION}.onnx", crop)
    export_scorer(members, calibration, hand_grid, folder / f"{_SCORER}.onnx")
    save_weights(completion, folder / f"{_COMPLETION}.safetensors")
    for number, member in enumerate(members):
        save_weights(member, folder / f"{_SCORER}-{number}.safetensors")
    kept = [f"{part}.onnx" for part in (_COMPLETION, _SCORER)]
    kept += [f"{_COMPLETION}.safetensors", *(f"{_SCORER}-{number}.safetensors" for number in range(len(members)))]
    if head is not None:
        write_head(folder, head, crop, LOOKED_AT * finder.predicted)
        kept += HEAD_FILES
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
        head=None if head is None else head.config,
    )
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    write_depth_policy(folder, config)
    return config
