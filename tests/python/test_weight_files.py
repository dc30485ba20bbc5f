"""Published weights: normalizations folded, large weights in half precision, the same results."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import errors
from graspbox.perception import HandGrid
from graspbox.perception.anchors import AnchorConfig
from graspbox.policies.published.head_configs import HeadConfig

torch = pytest.importorskip("torch")

from graspbox.learn.export.exports import write_completion  # noqa: E402
from graspbox.learn.export.onnx_files import write_onnx  # noqa: E402
from graspbox.learn.export.weight_files import load_weights, restore_weights, restored, round_weights  # noqa: E402
from graspbox.learn.models.completion.network import CompletionNet  # noqa: E402
from graspbox.learn.models.head.network import AnchorNet  # noqa: E402
from graspbox.learn.models.scorer.network import ScorerNet  # noqa: E402
from graspbox.learn.training.norms import fold_norms  # noqa: E402
from graspbox.policies.published.runtimes import onnx_network  # noqa: E402

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


class Graph(torch.nn.Module):  # type: ignore[misc, name-defined]
    """A network in a graph."""

    outputs = ("values",)

    def __init__(self, net: Any, inputs: tuple[str, ...]) -> None:
        super().__init__()
        self.net, self.inputs = net, inputs

    def forward(self, *inputs: Any) -> Any:
        """Return its values."""
        return self.net(*inputs)


@pytest.mark.parametrize("name", ["completion", "scorer"])
def test_a_network_is_restored_from_its_onnx_file(name: str, tmp_path: Path) -> None:
    net, inputs = given(name)
    fold_norms(net)
    round_weights(net)
    path = tmp_path / "net.onnx"
    write_onnx(Graph(net, tuple(f"input_{i}" for i in range(len(inputs)))), inputs, False, path, [])
    other, _ = given(name)
    fold_norms(other)
    with torch.no_grad():
        for parameter in other.parameters():
            parameter.zero_()
        restore_weights(other, path, "net.")
        torch.testing.assert_close(other(*inputs), net(*inputs), atol=0, rtol=0)
    with pytest.raises(errors.ConfigError, match=r"net\.onnx has no weights members\.\*; export the policy again"):
        load_weights(path, "members.")


def test_merged_weights_are_stored_too(tmp_path: Path) -> None:
    """The exporter stores equal weights once; each layer is restored."""
    net = torch.nn.Sequential(torch.nn.Linear(4, 4), torch.nn.Linear(4, 4))
    net[1].load_state_dict(net[0].state_dict())
    rows = torch.rand(3, 4)
    write_onnx(Graph(net, ("rows",)), [rows], False, tmp_path / "net.onnx", [{"rows": rows.numpy()}])
    found = load_weights(tmp_path / "net.onnx", "net.")
    for name, values in net.state_dict().items():
        assert torch.equal(found[name], values)


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused(wrong: float, tmp_path: Path) -> None:
    net = torch.nn.Linear(4, 4)
    with torch.no_grad():
        net.weight[1, 2] = wrong
    with pytest.raises(errors.ConfigError, match=r"net\.onnx: the weights 'net\.weight' are not finite; train again"):
        write_onnx(Graph(net, ("rows",)), [torch.rand(3, 4)], False, tmp_path / "net.onnx", [])
    assert not (tmp_path / "net.onnx").exists()


def test_weights_of_another_size_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    """The wide network would take 500 GB."""
    net = CompletionNet(4)
    path = tmp_path / "net.onnx"
    write_completion(net, path)
    assert torch.equal(restored(lambda: CompletionNet(4), path, "net.").stem.weight, net.stem.weight)
    with pytest.raises(errors.ConfigError, match=r"another network: for 'stem.weight' it has \(4, 3, .* needs \(20000"):
        restored(lambda: CompletionNet(20_000), path, "net.")


class Table(torch.nn.Module):  # type: ignore[misc, name-defined]
    """Looks numbers up: constants that are exact in less space, and others."""

    inputs, outputs = ("rows",), ("exact", "inexact", "far", "rows_of_four")

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("halves", (torch.arange(_ROWS) % 1024) / 8.0)
        self.register_buffer("repeated", torch.arange(_ROWS).reshape(-1, 4) % 300 / 7.0)
        self.register_buffer("thirds", torch.arange(_ROWS) / 3.0)
        self.register_buffer("large", torch.arange(_ROWS) + 2**40)

    def forward(self, rows: Any) -> tuple[Any, ...]:
        """Give the numbers of rows."""
        return self.halves[rows] * 2, self.thirds[rows] * 2, self.large[rows] + 1, self.repeated[rows] * 2


def test_constants_take_half_the_space_where_that_is_exact(tmp_path: Path) -> None:
    path, rows = tmp_path / "table.onnx", torch.tensor([0, 7, 2000])
    write_onnx(Table(), [rows], False, path, [])
    found = onnx_network(path)({"rows": rows.numpy()})
    np.testing.assert_array_equal(found["exact"], np.array([0, 7, 976], dtype=np.float32) / 4)
    np.testing.assert_array_equal(found["inexact"], (torch.arange(_ROWS) / 3.0)[rows].numpy() * 2)
    np.testing.assert_array_equal(found["far"], rows.numpy() + 2**40 + 1)
    np.testing.assert_array_equal(found["rows_of_four"], Table().repeated[rows].numpy() * 2)
    # Numbers of 2, 4 and 8 bytes, a byte for every fourth of the repeated ones, and the graph.
    assert 14.25 * _ROWS < path.stat().st_size < 15 * _ROWS
    stored = load_weights(path)
    for name, values in Table().named_buffers():
        assert stored[name].dtype == values.dtype
        assert torch.equal(stored[name], values)
    assert str(Path(__file__).parent).encode() not in path.read_bytes()


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"\xff" * 16])
def test_a_file_without_weights_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(content)
    with pytest.raises(errors.ConfigError, match=r"net\.onnx (is not an ONNX file|has no weights net\.\*)"):
        restore_weights(CompletionNet(4), path, "net.")
