"""ONNX Runtime and torch agree on the published networks, for one row and for many."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox.hands import load_hand
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies.published.folders import completion_folder, hand_of, read_depth_policy
from graspbox.policies.published.runtimes import load_parts, onnx_network, torch_network

pytest.importorskip("torch")
pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")

from graspbox.learn.export.graphs import load_graphs
from graspbox.learn.export.onnx_files import PARITY

pytestmark = pytest.mark.train

POLICIES = Path(__file__).parents[2] / "policies"


def differ(found: Any, expected: Any) -> float:
    """Return the greatest difference of two outputs; bytes may differ by one because of rounding."""
    worst = float(np.abs(found.astype(np.float64) - expected.astype(np.float64)).max())
    return max(0.0, worst - 1.0) if found.dtype == np.uint8 else worst


@pytest.mark.parametrize("name", ["any_hand", "depth", "inspire", "panda"])
def test_runtimes_agree_for_one_grasp_and_for_many(name: str) -> None:
    """`Scorer` pads a single grasp to the rows that the network takes."""
    folder = POLICIES / name
    config = read_depth_policy(folder)
    hand = load_hand(hand_of(folder, config))
    grid = HandGrid(hand, config.settings_for(hand)[0], crop=config.crop)
    onnx, torch = (load_parts(folder, config, grid, backend, 1) for backend in ("onnx", "torch"))
    rng, n = np.random.default_rng(0), config.crop.resolution
    volume = np.zeros((3, n, n, n), dtype=np.uint8)
    volume[:, 18:30, 18:30, 4:20] = rng.integers(0, 256, (3, 12, 12, 16))
    assert differ(onnx.complete(volume[None]), torch.complete(volume[None])) <= PARITY
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (60, 1, 1))
    poses[:, :3, 3] = rng.uniform([-0.03, -0.03, 0.1], [0.03, 0.03, 0.25], (60, 3))
    preshape = rng.choice(grid.preshapes, 60)
    many = onnx.scorer.judge(volume, poses, preshape)
    for mine, other in zip(many, torch.scorer.judge(volume, poses, preshape), strict=True):
        assert differ(mine, other) <= PARITY
    for row in (0, 59):
        alone = [parts.scorer.judge(volume, poses[row : row + 1], preshape[row : row + 1]) for parts in (onnx, torch)]
        for mine, other, of_many in zip(*alone, many, strict=True):
            assert differ(mine, other) <= PARITY
            assert differ(mine, of_many[row : row + 1]) <= PARITY


@pytest.mark.parametrize("name", ["depth", "panda_clutter", "robotiq"])
def test_heads_and_completions_are_restored_from_their_files(name: str) -> None:
    folder = POLICIES / name
    config = read_depth_policy(folder)
    completion, _, head = load_graphs(folder)
    n = config.crop.resolution
    channels = np.random.default_rng(0).integers(0, 256, (1, 3, n, n, n), dtype=np.uint8)
    file = completion_folder(folder, config) / "completion.onnx"
    found, expected = (run({"channels": channels}) for run in (onnx_network(file, 1), torch_network(completion)))
    assert differ(found["occupancy"], expected["occupancy"]) <= PARITY
    volumes = channels[:, :2]
    best, all_of = (run({"volumes": volumes}) for run in (onnx_network(folder / "head.onnx", 1), torch_network(head)))
    count = min(len(best["scores"]), len(all_of["scores"]))
    # Scores are sorted, so anchors with equal scores do not matter.
    assert differ(best["scores"][:count], all_of["scores"][:count]) <= PARITY


@pytest.fixture(scope="module")
def observing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Publish a policy of two observations; its weights are random."""
    sb3 = pytest.importorskip("stable_baselines3")
    from graspbox.learn.sb3.export import export_policy
    from graspbox.sb3 import VecEnv
    from graspbox.sb3.policy import ModelPolicy

    folder = tmp_path_factory.mktemp("observing")
    env: dict[str, Any] = {"obs": ("proprio", "tactile"), "objects": "procedural:can:0"}
    model = sb3.PPO("MultiInputPolicy", VecEnv.make("graspbox/Grasp-v0", 1, **env), device="cpu", seed=0)
    # Initial actions are close to zero.
    model.policy.action_net.weight.data.mul_(100.0)
    told: dict[str, Any] = {"algorithm": "ppo", "env_id": "graspbox/Grasp-v0", "env": env, "policy_kwargs": {}}
    export_policy(folder, "observing", ModelPolicy(model), learned_from=(), **told)
    return folder


@pytest.mark.parametrize("rows", [1, 40])
def test_policies_of_observations_are_restored_from_their_files(observing: Path, rows: int) -> None:
    from graspbox.learn.sb3.export import load_graph

    graph, rng = load_graph(observing), np.random.default_rng(0)
    sizes = {"proprio": 28, "tactile": 27}
    inputs = {one: rng.normal(size=(rows, sizes[one])).astype(np.float32) for one in graph.inputs}
    found = onnx_network(observing / "policy.onnx", 1)(inputs)["action"]
    expected = torch_network(graph)(inputs)["action"]
    assert differ(found, expected) <= PARITY
    assert 0.1 < np.abs(expected).mean() < 1.0


@pytest.mark.parametrize("rows", [1, 40])
def test_stability_networks_are_restored_from_their_file(rows: int) -> None:
    from graspbox.learn.export.weight_files import load_weights, restored
    from graspbox.learn.models.stability.network import StabilityGraph, StabilityNet
    from graspbox.policies.published.configs import FeelPolicyConfig
    from graspbox.policies.published.folders import load
    from graspbox.policies.stability_inputs import STORED_NAME

    config, file = load(POLICIES / "feel", FeelPolicyConfig), POLICIES / "feel/feel.onnx"
    size = len(load_weights(file, "nets.0.")["mean"])
    nets = [restored(lambda: StabilityNet(size, config.width), file, f"nets.{i}.") for i in range(config.members)]
    graph = torch_network(StabilityGraph(nets, config.calibration))
    inputs = {STORED_NAME: np.random.default_rng(0).normal(size=(rows, size)).astype(np.float32)}
    assert differ(onnx_network(file, 1)(inputs)["probability"], graph(inputs)["probability"]) <= PARITY
