"""Published weights: normalizations folded, large weights in half precision, the same results."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import errors
from graspbox.models.head.configs import HeadConfig
from graspbox.perception import HandGrid
from graspbox.perception.anchors import AnchorConfig

torch = pytest.importorskip("torch")

from graspbox.artifacts.onnx_files import write_onnx  # noqa: E402
from graspbox.artifacts.runtimes import onnx_network  # noqa: E402
from graspbox.artifacts.weight_files import (  # noqa: E402
    restore_weights,
    restored,
    round_weights,
    save_weights,
)
from graspbox.models.completion.network import CompletionNet  # noqa: E402
from graspbox.models.head.network import AnchorNet  # noqa: E402
from graspbox.models.scorer.network import ScorerNet  # noqa: E402
from graspbox.training.norms import fold_norms  # noqa: E402

pytestmark = pytest.mark.train
#: Numbers of each constant.
_ROWS = 1 << 16
_SMALL = HeadConfig(width=8, features=8, hidden=16, anchors=AnchorConfig(heights=8))


def lively(net: Any) -> Any:
    """Give normalizations statistics of their own, as training does."""
    generator = torch.Generator().manual_seed(0)
    for module in net.modules():
        if isinstance(module, torch.nn.BatchNorm2d | torch.nn.BatchNorm3d):
            for values, low in ((module.running_mean, -0.2), (module.running_var, 0.5), (module.weight, 0.5)):
                values.data.copy_(low + torch.rand(values.shape, generator=generator))
            module.bias.data.copy_(torch.rand(module.bias.shape, generator=generator) - 0.5)
    return net.eval()


def given(name: str) -> tuple[Any, tuple[Any, ...]]:
    """Make a small network and its input."""
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    if name == "completion":
        return lively(CompletionNet(4)), (torch.rand(2, 3, 16, 16, 16),)
    if name == "head":
        return lively(AnchorNet(3, _SMALL)), (
            torch.from_numpy(rng.integers(0, 256, (1, 2, 48, 48, 48), dtype=np.uint8)),
        )
    grid = HandGrid()
    cells = torch.from_numpy(rng.integers(0, 256, (5, 4, *grid.shape), dtype=np.uint8))
    return lively(ScorerNet(grid, 8)), (cells, torch.rand(5, 4, 4), torch.arange(5) % 3)


@pytest.mark.parametrize(("name", "left"), [("completion", 0), ("head", 0), ("scorer", 1)])
def test_folded_networks_give_the_same(name: str, left: int, tmp_path: Path) -> None:
    net, inputs = given(name)
    with torch.no_grad():
        expected = net(*inputs)
        fold_norms(net)
        torch.testing.assert_close(net(*inputs), expected, atol=1e-4, rtol=1e-4)
    # That of the scorer has two convolutions before it, whose sum it normalizes.
    norms = [m for m in net.modules() if isinstance(m, torch.nn.BatchNorm2d | torch.nn.BatchNorm3d)]
    assert len(norms) == left
    round_weights(net)
    save_weights(net, tmp_path / "net.safetensors")
    other, _ = given(name)
    fold_norms(other)
    restore_weights(other, tmp_path / "net.safetensors")
    with torch.no_grad():
        torch.testing.assert_close(other(*inputs), net(*inputs), atol=0, rtol=0)


def test_weights_of_another_size_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    """The wide network would take 500 GB."""
    net = CompletionNet(4)
    fold_norms(net)
    save_weights(net, tmp_path / "net.safetensors")
    assert torch.equal(restored(lambda: CompletionNet(4), tmp_path / "net.safetensors").stem.weight, net.stem.weight)
    with pytest.raises(errors.ConfigError, match=r"another network: for 'stem.weight' it has \(4, 3, .* needs \(20000"):
        restored(lambda: CompletionNet(20_000), tmp_path / "net.safetensors")


class Table(torch.nn.Module):  # type: ignore[misc, name-defined]
    """Looks numbers up: constants that are exact in less space, and others."""

    inputs, outputs = ("rows",), ("exact", "inexact", "far")

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("halves", (torch.arange(_ROWS) % 1024) / 8.0)
        self.register_buffer("thirds", torch.arange(_ROWS) / 3.0)
        self.register_buffer("large", torch.arange(_ROWS) + 2**40)

    def forward(self, rows: Any) -> tuple[Any, ...]:
        """Give the numbers of rows."""
        return self.halves[rows] * 2, self.thirds[rows] * 2, self.large[rows] + 1


def test_constants_take_half_the_space_where_that_is_exact(tmp_path: Path) -> None:
    path, rows = tmp_path / "table.onnx", torch.tensor([0, 7, 2000])
    write_onnx(Table(), [rows], False, path, [])
    found = onnx_network(path)({"rows": rows.numpy()})
    np.testing.assert_array_equal(found["exact"], np.array([0, 7, 976], dtype=np.float32) / 4)
    np.testing.assert_array_equal(found["inexact"], (torch.arange(_ROWS) / 3.0)[rows].numpy() * 2)
    np.testing.assert_array_equal(found["far"], rows.numpy() + 2**40 + 1)
    # Numbers of 2, 4 and 8 bytes, and the graph.
    assert 14 * _ROWS < path.stat().st_size < 15 * _ROWS
    assert str(Path(__file__).parent).encode() not in path.read_bytes()


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"\xff" * 16, b"\x02" + bytes(7) + b"[]"])
def test_a_file_without_weights_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "net.safetensors"
    path.write_bytes(content)
    with pytest.raises(errors.ConfigError, match=r"net\.safetensors is not a weights file"):
        restore_weights(CompletionNet(4), path)
