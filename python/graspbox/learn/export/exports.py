"""Export of trained networks as published policies (extra ``train``), one ONNX file for each network.

`export` writes a folder of any kind; the functions after it define the graphs of the kinds built from
`graspbox.learn.models`. Each ONNX file is compared with its network, and ``config.json`` is written last.
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
from graspbox.errors import ConfigError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.learn.export.graphs import AnyHandScorerGraph, CompletionGraph, ScorerGraph
from graspbox.learn.export.onnx_files import PARITY, write_onnx
from graspbox.learn.export.weight_files import check_size, round_weights
from graspbox.learn.models.completion.network import CompletionNet
from graspbox.learn.models.head.graph import BEST, HeadGraph
from graspbox.learn.models.head.network import AnchorNet
from graspbox.learn.models.scorer.network import ScorerNet
from graspbox.learn.models.scorer.shared import SharedScorerNet
from graspbox.learn.models.stability.network import StabilityGraph, StabilityNet
from graspbox.learn.training.norms import fold_norms
from graspbox.perception.configs import CropConfig, FinderConfig, HandGridConfig
from graspbox.perception.finder import LOOKED_AT
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.inputs.hand_numbers import HAND_NUMBERS, tables_of
from graspbox.perception.inputs.scorer import GraspInputs, ScorerInputs
from graspbox.perception.perturbations import perturbed
from graspbox.policies.published.calibration import Calibration
from graspbox.policies.published.configs import (
    COMPLETION,
    HAND_FILES,
    DepthPolicyConfig,
    FeelPolicyConfig,
    HeadPolicyConfig,
    PolicyConfig,
)
from graspbox.policies.published.folders import file_hash, read_depth_policy, save, use_of
from graspbox.policies.published.runtimes import onnx_network, torch_network
from graspbox.policies.stability_inputs import STORED_NAME

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
        A module on named arrays, with ``inputs`` and ``outputs``, traced with an example.
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
    licence: Path | None = None,
    hand: Hand | None = None,
) -> Config:
    """Write a policy's folder, and return its configuration, with the files.

    Parameters
    ----------
    networks : mapping
        Networks by the name of the ONNX file.
    licence : Path, optional
        A file to copy as ``LICENSE``.
    hand : Hand, optional
        The folder gets its files if it is not a shipped one.

    Raises ConfigError if a network is too large to be published, has weights that are not finite, or its ONNX file has
    other outputs.
    """
    folder = Path(folder)
    for name, traced in networks.items():
        check_size(traced.graph, f"{name!r} of the policy {config.name!r}")
    folder.mkdir(parents=True, exist_ok=True)
    for name, traced in networks.items():
        traced.write(folder / name)
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    own = () if hand is None or hand.name in Hand.names() else HAND_FILES
    for name, text in zip(own, () if hand is None else hand.files, strict=False):
        write_text(folder / name, text)
    names = (*networks, *own)
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
    completion : CompletionNet or Path
        A trained network, or the folder of a published policy with it, which the new one then uses.
    members : sequence of ScorerNet
        Trained networks. The weights of all networks are rounded to half precision. A single `SharedScorerNet` makes a
        policy for any hand.
    learned_from : iterable of str
        Object sets on which it was trained.
    head : AnchorNet, optional
        A trained head, whose best grasps are scored together with the proposals.

    Raises ConfigError as `export`.
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
    networks = dict[str, Traced]()
    if not isinstance(completion, Path):
        networks["completion.onnx"] = _traced_completion(completion, crop)
    hand_grid = HandGrid(loaded, config.settings_for(loaded)[0], crop=crop)
    networks["scorer.onnx"] = _traced_scorer(members, calibration, hand_grid)
    if head is not None:
        _prepare(head)
        networks["head.onnx"] = _traced_head(head, crop, LOOKED_AT * finder.predicted)
    return export(folder, config, networks, licence, loaded)


def _width_of(completion: CompletionNet | Path) -> int:
    """Return the channels of the first layer of a completion."""
    if isinstance(completion, Path):
        return read_depth_policy(completion).completion_width
    return int(completion.stem.out_channels)


def export_head(
    folder: Path,
    name: str,
    net: AnchorNet,
    *,
    learned_from: Iterable[str],
    hand: HandLike = "reflex",
    licence: Path | None = None,
) -> HeadPolicyConfig:
    """Export a policy of one trained head, whose weights are rounded; arguments and errors as `export_depth_policy`.

    The policy executes the best grasp that does not collide with the observed surface.
    """
    _prepare(net)
    loaded = load_hand(hand)
    config = HeadPolicyConfig(
        name=name,
        hand=loaded.name,
        learned_from=tuple(learned_from),
        preshapes=net.anchors.shape[0],
        filtered=True,
        head=net.config,
        crop=CropConfig(),
    )
    networks = {"head.onnx": _traced_head(net, config.crop)}
    return export(folder, config, networks, licence, loaded)


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

    `depth` is the folder of the published policy that chooses its grasps; it must not be moved.
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
    return export(folder, config, {"feel.onnx": network}, licence)


def write_completion(net: CompletionNet, path: Path, crop: CropConfig = CropConfig()) -> None:  # noqa: B008 (frozen)
    """Write a completion as ONNX: ``channels`` (1, 3, N, N, N) uint8 to ``occupancy`` (1, N, N, N) uint8.

    Its normalizations are folded, in place. Raises ConfigError if the file's outputs differ from the network's, as the
    next two functions do.
    """
    fold_norms(net)
    _traced_completion(net, crop).write(path)


def write_scorer(members: Sequence[ScorerNet], calibration: Calibration, grid: HandGrid, path: Path) -> None:
    """Write a scorer as ONNX, from `GraspInputs` to `Judged`."""
    _traced_scorer(members, calibration, grid).write(path)


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


def _traced_scorer(members: Sequence[ScorerNet], calibration: Calibration, grid: HandGrid) -> Traced:
    grasps = _grasps_of_a_block(grid, 4 * FINALISTS)
    example = [torch.from_numpy(array[: FINALISTS + 7]) for array in grasps]
    if isinstance(net := members[0], SharedScorerNet):
        # Three rows of the tables: one that were as long as another input could be taken for it.
        tables = {name: np.repeat(table[:1], 3, axis=0) for name, table in tables_of(grid)._asdict().items()}
        example += [torch.from_numpy(table) for table in tables.values()]
        first = {**grasps._asdict(), "preshape": np.zeros_like(grasps.preshape)}
        return Traced(AnyHandScorerGraph(net, calibration), example, checks=[{**first, **tables}])
    # With only finalists, the result does not depend on how ties between grasps are broken.
    firsts = range(0, 4 * FINALISTS, FINALISTS)
    checks = [{name: array[i : i + FINALISTS] for name, array in grasps._asdict().items()} for i in firsts]
    return Traced(ScorerGraph(members, calibration, FINALISTS), example, checks=checks)


def _grasps_of_a_block(grid: HandGrid, count: int) -> GraspInputs:
    """Make typical inputs of a scorer: grasps of a block of 6 x 6 x 10 cm."""
    n, size = grid.crop.resolution, grid.crop.voxel_size
    centers = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * size + np.array(grid.crop.origin)
    inside = (np.abs(centers[:, :2]) < 0.03).all(axis=1) & (centers[:, 2] > 0) & (centers[:, 2] < 0.1)
    occupancy = (255 * inside).astype(np.uint8).reshape(n, n, n)
    proposals = grid.propose(occupancy)
    # A hand without proposals is placed above the block.
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3] = 0.15
    poses = proposals.poses if len(proposals) else above[None]
    preshapes = proposals.preshape if len(proposals) else grid.preshapes[:1]
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
        actual, expected = onnx_network(path)(inputs), torch_network(graph)(inputs)
        _, mine, theirs = np.intersect1d(actual["anchors"], expected["anchors"], return_indices=True)
        worst = float(np.abs(actual["scores"] - expected["scores"]).max())
        if len(mine):
            worst = max(worst, float(np.abs(actual["residuals"][mine] - expected["residuals"][theirs]).max()))
        if worst > PARITY or len(mine) < len(actual["anchors"]) // 2:
            raise ConfigError(f"{path} differs from the network by {worst:.2g}; do not use it")

    return Traced(graph, [example], dynamic=False, compare=compare)
