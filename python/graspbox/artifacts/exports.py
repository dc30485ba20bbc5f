"""Export of trained networks as published policies (extra ``train``): weights as safetensors, graphs as ONNX.

`export` writes a folder of any kind; the functions after it define the graphs of the kinds built from
`graspbox.models`. Each ONNX file is compared with its network, and ``config.json`` is written last.
"""

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox._common.files import write_text
from graspbox.artifacts.configs import (
    COMPLETION,
    HAND_FILES,
    DepthPolicyConfig,
    FeelPolicyConfig,
    HeadPolicyConfig,
    PolicyConfig,
)
from graspbox.artifacts.folders import file_hash, read_depth_policy, save, use_of
from graspbox.artifacts.graphs import AnyHandScorerGraph, CompletionGraph, ScorerGraph
from graspbox.artifacts.onnx_files import PARITY, write_onnx
from graspbox.artifacts.runtimes import onnx_network, torch_network
from graspbox.artifacts.weight_files import check_size, round_weights, save_weights
from graspbox.errors import ConfigError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.models.calibration import Calibration
from graspbox.models.completion.network import CompletionNet
from graspbox.models.head.graph import BEST, HeadGraph
from graspbox.models.head.heads import HeadNet
from graspbox.models.head.network import AnchorNet
from graspbox.models.scorer.hand_numbers import HAND_NUMBERS, tables_of
from graspbox.models.scorer.inputs import GraspInputs, ScorerInputs
from graspbox.models.scorer.network import ScorerNet
from graspbox.models.scorer.shared import SharedScorerNet
from graspbox.models.stability.inputs import STORED_NAME
from graspbox.models.stability.network import StabilityGraph, StabilityNet
from graspbox.perception.configs import CropConfig, FinderConfig, HandGridConfig
from graspbox.perception.finder import LOOKED_AT
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import perturbed
from graspbox.training.norms import fold_norms

__all__ = [
    "FINALISTS",
    "Traced",
    "export",
    "export_depth_policy",
    "export_feel_policy",
    "export_head",
    "write_completion",
    "write_head",
    "write_scorer",
]

#: Number of grasps that all members of a scorer score.
FINALISTS = 16
#: Examples for the comparison of the grasp-stability networks, in standard deviations of each input.
_READINGS = 64

Config = TypeVar("Config", bound=PolicyConfig)


@dataclass(frozen=True)
class Traced:
    """A network to export.

    Attributes
    ----------
    graph : Module
        A module on named arrays, with ``inputs`` and ``outputs``.
    example : sequence of Tensor
        Example inputs for tracing.
    dynamic : bool
        Whether the number of rows varies.
    checks : sequence of mapping
        Inputs on which the ONNX file must reproduce the graph's outputs.
    compare : callable, optional
        Alternative comparison, of the file by its path; raises ConfigError.
    """

    graph: nn.Module
    example: Sequence[Tensor]
    dynamic: bool = True
    checks: Sequence[Mapping[str, NDArray[Any]]] = ()
    compare: Callable[[Path], None] | None = None

    def write(self, path: Path) -> None:
        """Write the ONNX file; raises ConfigError if its outputs differ from the graph's."""
        write_onnx(self.graph, self.example, self.dynamic, path, self.checks)
        if self.compare is not None:
            self.compare(path)


def export(
    folder: Path,
    config: Config,
    networks: Mapping[str, Traced],
    weights: Mapping[str, nn.Module],
    licence: Path | None = None,
    hand: Hand | None = None,
) -> Config:
    """Write a policy's folder.

    Parameters
    ----------
    folder : Path
        The folder, which is created.
    config : PolicyConfig
        Its configuration, without files.
    networks : mapping
        Networks by the name of the ONNX file.
    weights : mapping
        Modules by the name of the file for their weights.
    licence : Path, optional
        A file to copy as ``LICENSE``.
    hand : Hand, optional
        The hand; the folder gets its files if it is not a shipped one.

    Returns
    -------
    PolicyConfig
        The configuration, with the files.

    Raises
    ------
    ConfigError
        If a network is too large to be published, or the outputs of an ONNX file differ from its network's.
    """
    folder = Path(folder)
    for name, net in weights.items():
        check_size(net, f"{name!r} of the policy {config.name!r}")
    folder.mkdir(parents=True, exist_ok=True)
    for name, traced in networks.items():
        traced.write(folder / name)
    for name, net in weights.items():
        save_weights(net, folder / name)
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    own = () if hand is None or hand.name in Hand.names() else HAND_FILES
    for name, text in zip(own, () if hand is None else hand.files, strict=False):
        write_text(folder / name, text)
    names = (*networks, *weights, *own)
    return save(folder, replace(config, files={name: file_hash(folder / name) for name in names}))


def export_depth_policy(
    folder: Path,
    name: str,
    completion: CompletionNet | Path,
    members: Sequence[ScorerNet],
    calibration: Calibration,
    *,
    learned_from: Iterable[str],
    hand: HandLike = "reflex",
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    grid: HandGridConfig = HandGridConfig(),  # noqa: B008 (frozen)
    finder: FinderConfig = FinderConfig(),  # noqa: B008 (frozen)
    head: AnchorNet | None = None,
    licence: Path | None = None,
) -> DepthPolicyConfig:
    """Export a policy of one depth image.

    Parameters
    ----------
    folder : Path
        The folder, which is created.
    name : str
        Name of the policy in results.
    completion : CompletionNet or Path
        A trained network, or the folder of a published policy with it, which the new one then uses.
    members : sequence of ScorerNet
        Trained networks. The weights of all networks are rounded to half precision. A single `SharedScorerNet` makes a
        policy for any hand.
    calibration : Calibration
        Maps the scorer's logits to probabilities.
    learned_from : iterable of str
        Object sets that it was trained on.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    crop, grid, finder
        Settings.
    head : AnchorNet, optional
        A trained head, whose best grasps are scored together with the proposals.
    licence : Path, optional
        A file to copy as ``LICENSE``.

    Raises
    ------
    ConfigError
        As `export`.
    """
    own = () if isinstance(completion, Path) else (completion,)
    for net in (*own, *members):
        _prepare(net)
    loaded = load_hand(hand)
    config = DepthPolicyConfig(
        name=name,
        hand=loaded.name,
        uses={COMPLETION: use_of(Path(folder), completion)} if isinstance(completion, Path) else {},
        learned_from=tuple(learned_from),
        calibration=calibration,
        members=len(members),
        width=members[0].stem.out_channels,
        finalists=FINALISTS,
        completion_width=_width_of(completion),
        crop=crop,
        grid=grid,
        finder=finder,
        head=None if head is None else head.config,
        hand_numbers=tuple(HAND_NUMBERS) if isinstance(members[0], SharedScorerNet) else None,
    )
    networks, weights = dict[str, Traced](), dict[str, nn.Module]()
    if not isinstance(completion, Path):
        networks["completion.onnx"], weights["completion.safetensors"] = (
            _traced_completion(completion, crop),
            completion,
        )
    hand_grid = HandGrid(loaded, config.settings_for(loaded)[0], crop=crop)
    networks["scorer.onnx"] = _traced_scorer(members, calibration, hand_grid)
    weights |= dict(zip(config.member_weights, members, strict=True))
    if head is not None:
        _prepare(head)
        networks["head.onnx"] = _traced_head(head, crop, LOOKED_AT * finder.predicted)
        weights["head.safetensors"] = head
    return export(folder, config, networks, weights, licence, loaded)


def _width_of(completion: CompletionNet | Path) -> int:
    """Return the channels of the first layer of a completion."""
    if isinstance(completion, Path):
        return read_depth_policy(completion).completion_width
    return int(completion.stem.out_channels)


def export_head(
    folder: Path,
    name: str,
    net: HeadNet,
    *,
    learned_from: Iterable[str],
    hand: HandLike = "reflex",
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    filtered: bool = True,
    licence: Path | None = None,
) -> HeadPolicyConfig:
    """Export a policy of one network; arguments and errors as for `export_depth_policy`.

    Parameters
    ----------
    net : AnchorNet
        A trained head; its weights are rounded to half precision.
    filtered : bool
        Whether the policy executes the best grasp that does not collide with the observed surface, instead of the best.
    """
    if not isinstance(net, AnchorNet):
        raise ConfigError(f"a {type(net).__name__} cannot be exported; give a head of the kind 'anchor'")
    _prepare(net)
    loaded = load_hand(hand)
    config = HeadPolicyConfig(
        name=name,
        hand=loaded.name,
        learned_from=tuple(learned_from),
        preshapes=net.anchors.shape[0],
        filtered=filtered,
        head=net.config,
        crop=crop,
    )
    networks = {"head.onnx": _traced_head(net, crop)}
    return export(folder, config, networks, {"head.safetensors": net}, licence, loaded)


def export_feel_policy(
    folder: Path,
    name: str,
    nets: Sequence[StabilityNet],
    calibration: tuple[float, float],
    *,
    depth: Path,
    times: tuple[float, ...],
    threshold: float,
    learned_from: Iterable[str],
    licence: Path | None = None,
) -> FeelPolicyConfig:
    """Export a policy with a grasp-stability check; arguments and errors as for `export_depth_policy`.

    Parameters
    ----------
    nets, calibration
        As for `StabilityGraph`.
    depth : Path
        Folder of the published policy that chooses its grasps; it must not be moved.
    times, threshold
        See `FeelPolicyConfig`.
    """
    folder = Path(folder)
    config = FeelPolicyConfig(
        name=name,
        hand=read_depth_policy(depth).hand,
        learned_from=tuple(learned_from),
        uses={"depth": use_of(folder, depth)},
        times=times,
        threshold=threshold,
        calibration=calibration,
        width=nets[0].layers[0].out_features,
        members=len(nets),
    )
    generator = torch.Generator().manual_seed(0)
    net = nets[0]
    readings = net.mean + net.scale * torch.randn(_READINGS, len(net.mean), generator=generator)
    checks = [{STORED_NAME: readings.numpy()}, {STORED_NAME: readings[:1].numpy()}]
    network = Traced(StabilityGraph(nets, calibration), [readings[:7]], checks=checks)
    weights = dict(zip(config.holds[1:], nets, strict=True))
    return export(folder, config, {"feel.onnx": network}, weights, licence)


def write_completion(net: CompletionNet, path: Path, crop: CropConfig = CropConfig()) -> None:  # noqa: B008 (frozen)
    """Write a completion as ONNX: ``channels`` (1, 3, N, N, N) uint8 to ``occupancy`` (1, N, N, N) uint8.

    Raises
    ------
    ConfigError
        If the file's outputs differ from the network's, as in the next two functions.
    """
    _traced_completion(net, crop).write(path)


def write_scorer(
    members: Sequence[ScorerNet], calibration: Calibration, grid: HandGrid, path: Path, *, finalists: int = FINALISTS
) -> None:
    """Write a scorer as ONNX, from `GraspInputs` to `Judged`."""
    _traced_scorer(members, calibration, grid, finalists).write(path)


def write_head(net: AnchorNet, path: Path, crop: CropConfig = CropConfig()) -> None:  # noqa: B008 (frozen)
    """Write a head as ONNX, its weights rounded to half precision."""
    _prepare(net)
    _traced_head(net, crop).write(path)


def _prepare(net: nn.Module) -> None:
    fold_norms(net)
    round_weights(net)


def _traced_completion(net: CompletionNet, crop: CropConfig) -> Traced:
    generator = torch.Generator().manual_seed(0)
    n = crop.resolution
    example = torch.randint(0, 256, (1, 3, n, n, n), dtype=torch.uint8, generator=generator)
    return Traced(CompletionGraph(net), [example], dynamic=False, checks=[{"channels": example.numpy()}])


def _traced_scorer(
    members: Sequence[ScorerNet], calibration: Calibration, grid: HandGrid, finalists: int = FINALISTS
) -> Traced:
    grasps = _grasps_of_a_block(grid, 4 * finalists)
    example = [torch.from_numpy(array[: finalists + 7]) for array in grasps]
    if isinstance(net := members[0], SharedScorerNet):
        # Three rows of the tables: one that were as long as another input could be taken for it.
        tables = {name: np.repeat(table[:1], 3, axis=0) for name, table in tables_of(grid)._asdict().items()}
        example += [torch.from_numpy(table) for table in tables.values()]
        first = {**grasps._asdict(), "preshape": np.zeros_like(grasps.preshape)}
        return Traced(AnyHandScorerGraph(net, calibration), example, checks=[{**first, **tables}])
    # With finalists alone, the result does not depend on how ties between grasps are broken.
    checks = [
        {k: v[i : i + finalists] for k, v in grasps._asdict().items()} for i in range(0, 4 * finalists, finalists)
    ]
    return Traced(ScorerGraph(members, calibration, finalists), example, checks=checks)


def _grasps_of_a_block(grid: HandGrid, count: int) -> GraspInputs:
    """Make typical inputs of a scorer: grasps of a block of 6 x 6 x 10 cm."""
    n, size = grid.crop.resolution, grid.crop.voxel_size
    centers = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * size + np.array(grid.crop.origin)
    inside = (np.abs(centers[:, :2]) < 0.03).all(axis=1) & (centers[:, 2] > 0) & (centers[:, 2] < 0.1)
    occupancy = (255 * inside).astype(np.uint8).reshape(n, n, n)
    found = grid.propose(occupancy)
    # A hand without proposals is placed above the block.
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3] = 0.15
    poses = found.poses if len(found) else above[None]
    preshapes = found.preshape if len(found) else grid.preshapes[:1]
    rows = np.arange(count) % len(poses)
    moved = perturbed(poses[rows], np.random.default_rng(0), 0.005, 0.05)
    volume = np.stack([occupancy, occupancy, np.zeros_like(occupancy)])
    return ScorerInputs(grid).make(volume[None], np.zeros(count, dtype=np.int64), moved, preshapes[rows])


def _traced_head(net: AnchorNet, crop: CropConfig, best: int = BEST) -> Traced:
    """Trace a head that returns its `best` anchors."""
    generator = torch.Generator().manual_seed(0)
    n = crop.resolution
    # Smooth noise, like the surfaces in a head's inputs: neighbouring voxels differ little.
    coarse = torch.rand((1, 2, n // 8, n // 8, n // 8), generator=generator)
    smooth = torch.nn.functional.interpolate(coarse, size=(n, n, n), mode="trilinear")
    example = (255.0 * (smooth > 0.6) * smooth).to(torch.uint8)
    graph = HeadGraph(net, best)

    def compare(path: Path) -> None:
        """Compare anchor by anchor: the order of ties in the last digit is arbitrary."""
        inputs = {"volumes": example.numpy()}
        found, expected = onnx_network(path)(inputs), torch_network(graph)(inputs)
        _, mine, theirs = np.intersect1d(found["anchors"], expected["anchors"], return_indices=True)
        worst = float(np.abs(found["scores"] - expected["scores"]).max())
        if len(mine):
            worst = max(worst, float(np.abs(found["residuals"][mine] - expected["residuals"][theirs]).max()))
        if worst > PARITY or len(mine) < len(found["anchors"]) // 2:
            raise ConfigError(f"{path} differs from the network by {worst:.2g}; do not use it")

    return Traced(graph, [example], dynamic=False, compare=compare)
