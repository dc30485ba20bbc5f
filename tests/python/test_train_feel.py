"""``graspbox train feel``: all stages, also after SIGKILL; its export and its predictions."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tiny_policy
from graspbox import errors, evaluation, policies
from graspbox.perception import HandGrid, HandGridConfig
from graspbox.policies import FeelThenLift
from graspbox.policies.published.configs import FeelPolicyConfig
from graspbox.policies.published.folders import load, used_folder
from interrupting import train_despite_kills

pytestmark = pytest.mark.train
STAGES = ["record-train", "record-held-out", "member-0", "member-1", "calibrate", "export", "threshold", "evaluate"]


def command(base: Path, out: Path) -> list[str]:
    words = ["--policy", str(base), "--out", str(out), "--quick"]
    return [sys.executable, "-m", "graspbox", "train", "feel", *words]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train quickly; the command is killed in two stages, and each time continues."""
    for module in ("torch", "typer", "onnx", "onnxruntime", "onnxscript", "matplotlib"):
        pytest.importorskip(module, reason="the training needs the extras 'cli' and 'train'")
    base = tmp_path_factory.mktemp("base") / "policy"
    tiny_policy.make(base)
    out = tmp_path_factory.mktemp("feel") / "run"
    train_despite_kills(command(base, out), out, ("record-train/0000000.npz", "export.json"))
    return out


def test_all_stages_leave_their_results(trained: Path) -> None:
    results = {name: json.loads((trained / f"{name}.json").read_text()) for name in STAGES}
    assert results["record-train"]["trials"] > 20
    assert results["member-0"]["steps"] == 20
    first = results["evaluate"]["procedural:bottle:2000-2003"]["first"]
    assert first["trials"] == 4
    assert first["opened"] == 0
    card = (trained / "policy" / "README.md").read_text()
    assert "| `procedural:bottle:2000-2003`, paired trials | 4 |" in card
    assert "--quick" in card
    assert "`load` and `tactile`, without the noise" in " ".join(card.split())
    assert (trained / "policy" / "feel.png").stat().st_size > 10_000
    assert (trained / "log.txt").read_text().count("member-0: begins") == 1
    base = used_folder(trained / "policy", load(trained / "policy"), "depth")
    again = subprocess.run([*command(base, trained), "--seed", "1"], capture_output=True, text=True)
    assert again.returncode == 2
    assert "was begun with other settings: seed was 0, is now 1" in " ".join(again.stderr.split())


def test_objects_that_were_learned_are_no_evaluation(tmp_path: Path) -> None:
    """Sets with nothing else are refused before the work; of others the rest is evaluated, of files the test split."""
    pytest.importorskip("typer")
    pytest.importorskip("torch")
    from graspbox.learn.recipes import feel
    from graspbox.learn.recipes.collection import unlearned
    from graspbox.learn.recipes.settings.feel import FeelSettings

    tiny_policy.make(tmp_path / "base")
    settings = FeelSettings(
        policy=tmp_path / "base",
        out=tmp_path / "run",
        objects="procedural:can:0-3",
        evaluated=("procedural:can:0-3",),
    )
    with pytest.raises(
        errors.ConfigError, match="--evaluated is 'procedural:can:0-3'; name objects from which nothing"
    ):
        feel.train(settings, "", print)
    assert not (tmp_path / "run").exists()
    kept = unlearned("procedural:can:0-3", ("procedural:can:1-9",))
    assert [spec.name for spec in kept] == ["can-000000"]
    assert {spec.split for spec in unlearned("ycb", ())} == {"test"}


def test_the_exported_policy_predicts_as_the_networks_do(trained: Path) -> None:
    import torch

    from graspbox.learn.export.onnx_files import PARITY
    from graspbox.learn.models.stability.network import StabilityGraph, StabilityNet
    from graspbox.learn.recipes.feel.stability_trials import StabilityTrials
    from graspbox.learn.training.trainer import load_weights
    from graspbox.policies.published.runtimes import load_stability

    folder = trained / "policy"
    config = load(folder, FeelPolicyConfig)
    assert config.threshold == json.loads((trained / "threshold.json").read_text())["threshold"]
    parts = [StabilityTrials.load(path) for path in sorted((trained / "record-train").glob("*.npz"))]
    trials = StabilityTrials.joined(parts)
    nets = [StabilityNet(trials.readings.shape[1], config.width) for _ in range(config.members)]
    for number, net in enumerate(nets):
        load_weights(net, trained / f"member-{number}" / "weights.pt")
    with torch.no_grad():
        expected = StabilityGraph(nets, config.calibration)(torch.from_numpy(trials.readings)).numpy()
    stability = load_stability(folder)
    np.testing.assert_allclose([stability(row) for row in trials.readings], expected, atol=PARITY)
    policy = policies.load(str(folder))
    assert isinstance(policy, FeelThenLift)
    assert policy.learned_from == ("procedural:can:10-19", "procedural:can:20-23")
    evaluation.evaluate(policy, "graspbox/Grasp-v0", "procedural:can:20", trials=1, num_envs=1, include_learned=True)
    assert 0.0 < policy.attempts[0][0].probability < 1.0


def test_what_is_recorded_is_what_the_policy_feels(trained: Path) -> None:
    """The recording looks and tries in other environments, from another start; its first grasps are the policy's."""
    from graspbox.learn.recipes.feel.stability_trials import StabilityTrials

    trials = StabilityTrials.load(trained / "record-train" / "0000000.npz")
    policy = FeelThenLift(trained / "policy", threshold=0.0)
    found = evaluation.evaluate(
        policy, "graspbox/Grasp-v0", "procedural:can:10-19", trials=8, seed=0, include_learned=True, num_envs=8
    )
    readings = np.stack([attempts[0].readings for attempts in policy.attempts])
    own = trials.readings[trials.first]
    assert readings.shape == own.shape
    # The same image gives the same grasp, bit by bit; scores of this tiny policy are often equal, though.
    same = (readings[:, :19] == own[:, :19]).all(axis=1)
    assert same.mean() >= 0.75
    # The hand comes from elsewhere, and so a little earlier or later within a control period.
    assert np.median(np.abs(readings - own)[same].max(axis=1)) < 1.0
    assert np.mean(trials.held[trials.first] == [trial.success for trial in found.trials]) >= 0.75


def test_a_network_learns_what_tells_grasps_apart(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from graspbox.learn.models.stability.network import logits_of, train_stability
    from graspbox.learn.training.metrics import auc
    from graspbox.learn.training.trainer import TrainConfig

    rng = np.random.default_rng(0)
    readings = (rng.normal(size=(1200, 10)) * np.logspace(-1, 2, 10)).astype(np.float32)
    readings[:, 3] = 7.0
    held = readings[:, 0] / 0.1 + readings[:, 9] / 100 + rng.normal(size=1200) * 0.3 > 0
    config = TrainConfig(learning_rate=3e-3, batch_size=128, max_steps=300, validate_every=50)
    net, trained = train_stability(tmp_path, readings[:900], held[:900], (readings[900:], held[900:]), config, width=32)
    assert trained.reason in ("steps", "patience")
    assert auc(logits_of([net], readings[900:]), held[900:]) > 0.95
    with pytest.raises(errors.ConfigError, match="no grasps to learn from"):
        train_stability(tmp_path / "none", readings[:0], held[:0], (readings, held), config)


def test_a_hand_without_tactile_sensors_learns_from_its_joints(tmp_path: Path) -> None:
    """The hand is that of the policy: all stages run, and the check acts with it."""
    for module in ("torch", "typer", "onnx", "onnxruntime", "onnxscript", "matplotlib"):
        pytest.importorskip(module, reason="the training needs the extras 'cli' and 'train'")
    base, out = tmp_path / "policy", tmp_path / "run"
    # Its scorer takes the cells of a ReFlex.
    tiny_policy.make(base, hand="panda_gripper", grid=HandGridConfig(shape=HandGrid().shape))
    done = subprocess.run(command(base, out), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    policy = policies.load(out / "policy")
    assert isinstance(policy, FeelThenLift)
    assert policy.settings["hand"] == "panda_gripper"
    assert "tactile" not in policy.obs
    card = " ".join((out / "policy" / "README.md").read_text().split())
    assert "sensors of the simulated hand, `finger_joint1`, `actuator`, `actuator_speed` and `load`, without" in card
    found = evaluation.evaluate(policy, objects="procedural:can:0-1", trials=2, seed=0, num_envs=2)
    assert len(found.trials) == 2
    assert all(trial.confidence is not None for trial in found.trials)
