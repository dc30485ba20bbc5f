"""Export of what feels: weights as safetensors, and the calibrated networks as one ONNX file (extra ``train``)."""

from collections.abc import Sequence
from pathlib import Path

import torch

from graspbox.perception.onnx_files import write_onnx
from graspbox.perception.stability_net import StabilityGraph, StabilityNet
from graspbox.perception.weight_files import save_weights

__all__ = ["export_stability"]

#: Examples with which the file is compared with the networks, in standard deviations of each input.
_CHECKS = 64


def export_stability(folder: Path, nets: Sequence[StabilityNet], calibration: tuple[float, float]) -> list[str]:
    """Write ``feel.onnx``, ``felt`` (n, k) float32 to ``probability`` (n,), and the weights of each network.

    Parameters
    ----------
    folder : Path
        The policy's folder.
    nets : sequence of StabilityNet
        At least one.
    calibration : pair of float
        Slope and offset of the logit.

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    ConfigError
        If the file does not give what the networks give.
    """
    generator = torch.Generator().manual_seed(0)
    net = nets[0]
    examples = net.mean + net.scale * torch.randn(_CHECKS, len(net.mean), generator=generator)
    checks = [{"felt": examples.numpy()}, {"felt": examples[:1].numpy()}]
    write_onnx(StabilityGraph(nets, calibration), [examples[:7]], True, folder / "feel.onnx", checks)
    names = [f"feel-{number}.safetensors" for number in range(len(nets))]
    for member, name in zip(nets, names, strict=True):
        save_weights(member, folder / name)
    return ["feel.onnx", *names]
