"""The study's networks and losses: layers, closed forms, gradients, and that each can overfit a batch."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="networks need the extra 'train'")

from graspbox._common.rotations import quaternion_from_rotation, rotation_from_euler  # noqa: E402
from graspbox.errors import ConfigError  # noqa: E402
from graspbox.study.losses import LOSSES, Errors, LossWeights, normalized  # noqa: E402
from graspbox.study.model_configs import ModelConfig  # noqa: E402
from graspbox.study.networks import NETWORKS, Cnn2d, Cnn2dDropout, Cnn3d, Units  # noqa: E402

pytestmark = pytest.mark.train

QUATERNION_LOSSES = [name for name, loss in LOSSES.items() if loss.size == 4]
#: Those that do not tell q from -q.
SYMMETRIC = ["psi1", "psi2", "psi3", "psi4"]
#: A small size of each network's input, for tests.
SMALL = {"cnn2d": 64, "cnn2d_dropout": 64, "cnn3d": 40}


def unit(count: int, seed: int = 0) -> Any:
    return normalized(torch.randn(count, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)))


def turned(degrees: float) -> Any:
    """Give the quaternion (1, 4) of a turn about z."""
    half = math.radians(degrees) / 2
    return torch.tensor([[math.cos(half), 0.0, 0.0, math.sin(half)]], dtype=torch.float64)


def describe(network: Any) -> list[str]:
    """Layers in the notation of the study."""
    found = []
    for layer in network.layers:
        match layer:
            case torch.nn.Conv2d() | torch.nn.Conv3d():
                assert set(layer.padding) == {0}
                found.append(f"C({layer.out_channels},{layer.kernel_size[0]},{layer.stride[0]})")
            case torch.nn.MaxPool2d() | torch.nn.MaxPool3d():
                found.append(f"P({layer.kernel_size})")
            case torch.nn.Dropout():
                found.append(f"D({layer.p})")
            case torch.nn.Linear():
                found.append(f"FC({layer.out_features})")
    return found


def test_networks_are_the_studys() -> None:
    front = "C(32,5,1) C(32,5,1) C(32,5,1) P(2) C(32,3,1) P(2) C(32,3,1) P(2) C(32,4,1) P(2)"
    assert " ".join(describe(Cnn2d(7))) == f"{front} FC(5500) FC(2500) FC(1500) FC(7)"
    assert " ".join(describe(Cnn2dDropout(6))) == f"{front} D(0.2) D(0.5) D(0.5) FC(1500) FC(6)"
    voxels = "C(5,3,1) C(5,3,1) P(2) C(5,3,1) C(5,3,1) P(2) C(5,2,1) C(5,2,1) C(5,2,1) P(2)"
    assert " ".join(describe(Cnn3d(7))) == f"{voxels} FC(550) FC(250) FC(150) FC(7)"


@pytest.mark.parametrize(("network", "weights"), [(Cnn2d, 47_351_015), (Cnn2dDropout, 8_211_015), (Cnn3d, 523_552)])
def test_networks_have_the_documented_number_of_weights(network: type[Cnn2d], weights: int) -> None:
    """The study says 47 million of the first, which convolutions with padding would not give."""
    made = network(7)
    assert sum(p.numel() for p in made.parameters()) == weights
    with torch.inference_mode():
        assert made(torch.zeros(1, *made.input_shape)).shape == (1, 7)


@pytest.mark.parametrize("units", ["relu", "sigmoid"])
def test_weights_are_uniform_within_their_bound(units: Units) -> None:
    network = Cnn2d(7, units=units, size=64, fully_connected=(60, 500), generator=torch.Generator().manual_seed(0))
    layers = [layer for layer in network.layers if hasattr(layer, "weight")]
    for layer in layers:
        area = math.prod(layer.weight.shape[2:])
        inputs, outputs = layer.weight.shape[1] * area, layer.weight.shape[0] * area
        factor = 4 if units == "sigmoid" and layer is not layers[-1] else 1
        bound = factor * math.sqrt(6 / (inputs + outputs))
        assert layer.weight.abs().max() <= bound
        assert layer.weight.abs().max() > 0.9 * bound
        # Uniform numbers in [-b, b] have the standard deviation b / sqrt(3).
        assert float(layer.weight.detach().std()) == pytest.approx(bound / math.sqrt(3), rel=0.1)
        assert not layer.bias.any()
    kinds = {type(layer) for layer in network.layers}
    assert (torch.nn.Sigmoid in kinds, torch.nn.ReLU in kinds) == (units == "sigmoid", units == "relu")


def test_the_studys_output_begins_at_zero() -> None:
    # Without a seed, about one in a hundred of these small networks begins with a layer of units that are all off.
    network, other = (
        Cnn3d(7, zero_output=zero, size=32, generator=torch.Generator().manual_seed(1)) for zero in (True, False)
    )
    voxels = torch.rand(2, *network.input_shape, generator=torch.Generator().manual_seed(2))
    with torch.inference_mode():
        assert not network(voxels).any()
        assert other(voxels).any()


def test_same_seed_same_weights() -> None:
    first, second, other = (Cnn3d(7, size=32, generator=torch.Generator().manual_seed(s)) for s in (1, 1, 2))
    pairs = zip(first.parameters(), second.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    assert not torch.equal(first.layers[0].weight, other.layers[0].weight)


def test_wrong_networks_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"units is 'tanh' .*; choose from sigmoid, relu"):
        ModelConfig("cnn2d", "psi4", "image", units="tanh")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="size is 20; Cnn2d needs a larger input"):
        Cnn2d(7, size=20)
    with pytest.raises(ConfigError, match=r"network is 'vgg' .*; choose from cnn2d, cnn2d_dropout, cnn3d"):
        ModelConfig("vgg", "psi4", "image")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"loss is 'psi5' .*; choose from posenet, psi1"):
        ModelConfig("cnn2d", "psi5", "image")  # type: ignore[arg-type]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_normalization_is_algorithm_7(dtype: Any) -> None:
    """Zero becomes (1, 0, 0, 0); anything else that is not tiny becomes q / norm; all of it has a finite gradient."""
    given = torch.tensor([[0.0, 0, 0, 0], [0, 3, 0, 4], [-2, 0, 0, 0], [-1e-12, 0, 0, 0]], dtype=dtype)
    given.requires_grad_()
    q = normalized(given)
    expected = torch.tensor([[1.0, 0, 0, 0], [0, 0.6, 0, 0.8], [-1, 0, 0, 0]], dtype=dtype)
    torch.testing.assert_close(q[:3], expected)
    q.sum().backward()
    assert q.isfinite().all()
    assert given.grad is not None
    assert given.grad.isfinite().all()
    # From an output of zero the gradient is 1e12: with a learning rate of 1e-9 the step is 1000.
    torch.testing.assert_close(given.grad[0], torch.tensor([0, 1e12, 1e12, 1e12], dtype=dtype))


@pytest.mark.parametrize("degrees", [0.0, 1.0, 60.0, 179.0, 180.0])
def test_losses_in_closed_form(degrees: float) -> None:
    """The angle between two turns about one axis is known: half of it is between the quaternions."""
    start, half = turned(20.0), math.radians(degrees) / 2
    end = turned(20.0 + degrees)
    chord = 2 * math.sin(half / 2)
    expected = {"posenet": chord, "psi1": chord, "psi2": half, "psi3": half, "psi4": 1 - math.cos(half)}
    for name, value in expected.items():
        for length in (1.0, 7.0):
            found = LOSSES[name].error(start, length * end)
            assert float(found) == pytest.approx(value, abs=1e-9), name
    angles = [torch.tensor([[0.1, -0.2, a]], dtype=torch.float64) for a in (0.3, 0.3 + math.radians(degrees))]
    assert float(LOSSES["euler"].error(*angles)) == pytest.approx(math.radians(degrees), abs=1e-9)


def test_losses_are_the_formulas_of_the_study() -> None:
    """Written out with acos, which the code avoids for its gradient."""
    p, q = unit(500, 1), unit(500, 2)
    dot = (p * q).sum(dim=1)
    torch.testing.assert_close(LOSSES["psi2"].error(p, q), torch.minimum(dot.acos(), math.pi - dot.acos()))
    torch.testing.assert_close(LOSSES["psi3"].error(p, q), dot.abs().acos())
    torch.testing.assert_close(LOSSES["psi4"].error(p, q), 1 - dot.abs())
    both = torch.minimum((p - q).norm(dim=1), (p + q).norm(dim=1))
    torch.testing.assert_close(LOSSES["psi1"].error(p, q), both)
    torch.testing.assert_close(LOSSES["posenet"].error(p, 3 * q), (p - q).norm(dim=1))


def test_psi2_and_psi3_are_one_function() -> None:
    p, q = unit(500, 3), unit(500, 4)
    torch.testing.assert_close(LOSSES["psi2"].error(p, q), LOSSES["psi3"].error(p, q))


@pytest.mark.parametrize("name", QUATERNION_LOSSES)
def test_the_sign_of_a_quaternion(name: str) -> None:
    """It makes no difference to any loss but posenet, which takes the same rotation for an error of up to 2."""
    p, q = unit(200, 5), unit(200, 6)
    first, second = LOSSES[name].error(p, q), LOSSES[name].error(p, -q)
    if name in SYMMETRIC:
        torch.testing.assert_close(first, second)
        torch.testing.assert_close(LOSSES[name].error(p, -p), torch.zeros(200, dtype=torch.float64))
    else:
        assert (first - second).abs().max() > 1
        torch.testing.assert_close(LOSSES[name].error(p, -p), torch.full((200,), 2.0, dtype=torch.float64))


def test_euler_angles_wrap() -> None:
    a = torch.tensor([[3.0, -3.0, 0.5]], dtype=torch.float64)
    b = torch.tensor([[-3.0, 3.0, 0.5 + 6 * math.pi]], dtype=torch.float64)
    apart = 2 * math.pi - 6
    assert float(LOSSES["euler"].error(a, b)) == pytest.approx(math.hypot(apart, apart))


@pytest.mark.parametrize("name", LOSSES)
def test_losses_reach_their_greatest_value_and_no_more(name: str) -> None:
    loss = LOSSES[name]
    if loss.size == 3:
        p, q = torch.randn(5000, 3) * 4, torch.randn(5000, 3) * 4
        p[0], q[0] = 0.0, math.pi
    else:
        p, q = unit(5000, 7).float(), unit(5000, 8).float()
        p[0], q[0] = torch.tensor([1.0, 0, 0, 0]), torch.tensor([0.0, 0, 1, 0])
        if name == "posenet":
            q[0] = -p[0]
    found = loss.error(p, q)
    assert (found >= 0).all()
    assert found.max() <= loss.greatest + 1e-5
    assert float(found[0]) == pytest.approx(loss.greatest, abs=1e-5)


@pytest.mark.parametrize("name", LOSSES)
def test_gradients_are_finite_where_formulas_are_singular(name: str) -> None:
    """At the true orientation, at its opposite, at right angles, and at an output of zero."""
    loss = LOSSES[name]
    if loss.size == 3:
        true = torch.zeros(4, 3)
        given = torch.tensor([[0.0, 0, 0], [math.pi, 0, 0], [0, 2 * math.pi, 0], [-math.pi, math.pi, 0]])
    else:
        true = torch.tensor([[1.0, 0, 0, 0]]).repeat(4, 1)
        given = torch.tensor([[1.0, 0, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]])
    given.requires_grad_()
    loss.error(true, given).sum().backward()
    assert given.grad is not None
    assert given.grad.isfinite().all()


@pytest.mark.parametrize("name", LOSSES)
def test_gradients_are_those_of_finite_differences(name: str) -> None:
    size = LOSSES[name].size
    true = unit(20, 9) if size == 4 else torch.randn(20, 3, dtype=torch.float64)
    given = torch.randn(20, size, dtype=torch.float64, generator=torch.Generator().manual_seed(10), requires_grad=True)
    assert torch.autograd.gradcheck(lambda q: LOSSES[name].error(true, q), given)


def test_euler_and_quaternion_losses_see_the_same_rotations() -> None:
    """Turns about one axis by Euler angles have the angle that psi3 halves."""
    angles = np.array([[0.0, 0.0, 0.4], [0.0, 0.0, 1.5]])
    q = torch.from_numpy(quaternion_from_rotation(rotation_from_euler(angles)))
    assert 2 * float(LOSSES["psi3"].error(q[:1], q[1:])) == pytest.approx(1.1)


def test_weights_of_the_study() -> None:
    labels = torch.tensor([[0.0, 0, 0, 1, 0, 0, 0]])
    outputs = torch.tensor([[0.3, 0, 0.4, 0, 1, 0, 0]])
    errors = Errors.of(LOSSES["psi4"], labels, outputs)
    assert float(errors.position) == pytest.approx(0.5)
    assert float(errors.total(LossWeights())) == pytest.approx(0.005 * 0.5 + 0.031 * 1.0)


@pytest.mark.parametrize(("network", "loss"), [*itertools.product(NETWORKS, LOSSES)])
def test_each_network_learns_a_batch_by_heart_with_each_loss(network: str, loss: str) -> None:
    """Four inputs with four poses far from each other: one answer for all of them would leave most of the error."""
    generator = torch.Generator().manual_seed(0)
    chosen = LOSSES[loss]
    layers = (32,) if network == "cnn2d_dropout" else (64, 32)
    made = NETWORKS[network](chosen.outputs, size=SMALL[network], fully_connected=layers, generator=generator)
    inputs = torch.randn(4, *made.input_shape, generator=generator)
    positions = 0.3 * torch.randn(4, 3, generator=generator)
    angles = torch.tensor([[0.5, 0.2, -1.0], [-0.5, 0.6, 1.0], [1.2, -0.6, 0.3], [-1.2, 0.1, -0.3]])
    turns = rotation_from_euler(angles.numpy())
    orientation = angles if chosen.size == 3 else torch.from_numpy(quaternion_from_rotation(turns)).float()
    labels = torch.cat([positions, orientation], dim=1)
    # Dropout is tested elsewhere: in evaluation it does not change the fitted function.
    made.eval()
    optimizer = torch.optim.Adam(made.parameters(), 3e-3)
    weights = LossWeights(1.0, 2.0)
    errors = []
    for _ in range(200):
        error = Errors.of(chosen, labels, made(inputs)).total(weights).mean()
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
        errors.append(float(error.detach()))
        if errors[-1] < 0.1 * errors[0]:
            break
    assert errors[-1] < 0.1 * errors[0], errors[::20]


def test_dropout_drops_in_training_alone() -> None:
    """Three dropouts of 0.2, 0.5 and 0.5 in a row keep a fifth of the features."""
    made = Cnn2dDropout(7, size=64, fully_connected=(8,))
    drops = torch.nn.Sequential(*(layer for layer in made.layers if isinstance(layer, torch.nn.Dropout)))
    ones = torch.ones(1, 100_000)
    kept = float((drops.train()(ones) > 0).float().mean())
    assert kept == pytest.approx(0.2, abs=0.01)
    torch.testing.assert_close(drops.eval()(ones), ones)
