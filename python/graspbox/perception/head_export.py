"""Export of a trained head: weights as safetensors, and the network as one ONNX file (extra ``train``)."""

import shutil
from pathlib import Path

import numpy as np
import torch

import graspbox
from graspbox.errors import ConfigError
from graspbox.perception.anchor_net import AnchorNet
from graspbox.perception.configs import CropConfig
from graspbox.perception.head_folders import HeadPolicyConfig, write_head_policy
from graspbox.perception.head_graphs import BEST, HeadGraph
from graspbox.perception.heads import HeadNet
from graspbox.perception.onnx_files import PARITY, write_onnx
from graspbox.perception.policy_folders import file_hash
from graspbox.perception.runtimes import onnx_network, torch_network
from graspbox.perception.weight_files import fold_norms, round_weights, save_weights

__all__ = ["HEAD_FILES", "export_head", "write_head"]

#: Files of a head: the network, and its weights.
HEAD_FILES = ("head.onnx", "head.safetensors")


def export_head(
    folder: Path,
    name: str,
    net: HeadNet,
    *,
    hand: str = "reflex",
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    filtered: bool = True,
    licence: Path | None = None,
) -> HeadPolicyConfig:
    """Write a policy's folder: network, weights, ``config.json`` last.

    Parameters
    ----------
    folder : Path
        The folder; it is made.
    name : str
        Name of the policy in results.
    net : AnchorNet
        A trained head; its weights are rounded to half precision.
    hand : str
        Name of the hand.
    crop : CropConfig
        The crops that it sees.
    filtered : bool
        Whether the policy takes the best grasp that does not collide with what is seen, instead of the best.
    licence : Path, optional
        A file that is copied as ``LICENSE``.

    Raises
    ------
    ConfigError
        If it is another head than an anchor head, or the ONNX file does not give what the network gives.
    """
    if not isinstance(net, AnchorNet):
        raise ConfigError(f"a {type(net).__name__} cannot be exported; give a head of the kind 'anchor'")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_head(folder, net, crop)
    config = HeadPolicyConfig(
        name=name,
        graspbox=graspbox.__version__,
        hand=hand,
        preshapes=net.anchors.shape[0],
        files={file: file_hash(folder / file) for file in HEAD_FILES},
        filtered=filtered,
        head=net.config,
        crop=crop,
    )
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    write_head_policy(folder, config)
    return config


def write_head(
    folder: Path,
    net: AnchorNet,
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    best: int = BEST,
) -> None:
    """Write `HEAD_FILES` into a folder, weights rounded to half precision; the network gives `best` anchors.

    Raises
    ------
    ConfigError
        If the ONNX file does not give what the network gives.
    """
    generator = torch.Generator().manual_seed(0)
    n = crop.resolution
    # Smooth noise, as the surfaces that a head meets: neighbouring voxels differ by little.
    coarse = torch.rand((1, 2, n // 8, n // 8, n // 8), generator=generator)
    smooth = torch.nn.functional.interpolate(coarse, size=(n, n, n), mode="trilinear")
    example = (255.0 * (smooth > 0.6) * smooth).to(torch.uint8)
    fold_norms(net)
    round_weights(net)
    graph = HeadGraph(net, best)
    path, weights = (folder / name for name in HEAD_FILES)
    write_onnx(graph, [example], False, path, [])
    _check(path, graph, example)
    save_weights(net, weights)


def _check(path: Path, graph: HeadGraph, example: torch.Tensor) -> None:
    """Compare the file with the network, anchor by anchor: of two that score alike to the last digit, any is first.

    Raises
    ------
    ConfigError
        If they differ.
    """
    inputs = {"volumes": example.numpy()}
    found, expected = onnx_network(path)(inputs), torch_network(graph)(inputs)
    _, mine, theirs = np.intersect1d(found["anchors"], expected["anchors"], return_indices=True)
    worst = float(np.abs(found["scores"] - expected["scores"]).max())
    if len(mine):
        worst = max(worst, float(np.abs(found["residuals"][mine] - expected["residuals"][theirs]).max()))
    if worst > PARITY or len(mine) < len(found["anchors"]) // 2:
        raise ConfigError(f"{path} differs from the network by {worst:.2g}; do not use it")
