"""Training runs of the study's networks: they learn, stop, resume with the same bits, and become policies."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")
pytest.importorskip("tensorboard", reason="training needs the extra 'train'")

import graspbox  # noqa: E402
from graspbox import evaluation, object_sets, policies  # noqa: E402
from graspbox._common.rotations import poses_from, rotation_from_euler  # noqa: E402
from graspbox._common.runs import Rows  # noqa: E402
from graspbox.errors import ConfigError, FileError  # noqa: E402
from graspbox.learn.commands import train as command  # noqa: E402
from graspbox.learn.training.configs import OPTIMIZERS  # noqa: E402
from graspbox.learn.training.trainer import TrainProgress  # noqa: E402
from graspbox.policies import Task  # noqa: E402
from graspbox.study import grasps  # noqa: E402
from graspbox.study.execution import ObjectScenes, execute  # noqa: E402
from graspbox.study.figures import read_curve  # noqa: E402
from graspbox.study.losses import LossWeights  # noqa: E402
from graspbox.study.model import ModelConfig, PoseModel  # noqa: E402
from graspbox.study.regressor import PoseRegressor, cameras  # noqa: E402
from graspbox.study.samples import Samples, split_at_random  # noqa: E402
from graspbox.study.training import STUDY, Objective, measure, train  # noqa: E402

pytestmark = pytest.mark.train

SIDE = 32
SMALL = ModelConfig("cnn3d", "psi4", "binary", size=SIDE, fully_connected=(32,))
FAST = replace(STUDY, learning_rate=3e-3, batch_size=8, patience=1000)
WEIGHTS = Objective(LossWeights(1.0, 10.0))


def blocks(count: int, seed: int = 0) -> Samples:
    """Grids with a block whose height is the label: the position above it, and the hand turned the more the higher."""
    random = np.random.default_rng(seed)
    height = random.integers(6, SIDE - 2, size=count)
    inputs = np.zeros((count, SIDE, SIDE, SIDE), dtype=np.uint8)
    for grid, top in zip(inputs, height, strict=True):
        grid[8:24, 8:24, :top] = 255
    share = height / SIDE
    turns = rotation_from_euler(np.stack([np.zeros(count), np.zeros(count), 1.5 * share], axis=1))
    positions = np.stack([np.zeros(count), 0.05 * np.ones(count), 0.2 * share], axis=1)
    return Samples(("block",), inputs, np.zeros(count, dtype=np.int64), poses_from(positions, turns), np.zeros(count))


SAMPLES = blocks(60)
SPLIT = split_at_random(60)


def test_training_learns_and_logs(tmp_path: Path) -> None:
    """Heights that the training has not shown are predicted to a fraction of their spread."""
    model, trained = train(SMALL, SAMPLES, SPLIT, tmp_path, replace(FAST, max_steps=120), WEIGHTS)
    found = measure(model, SAMPLES[SPLIT.test], WEIGHTS.weights)
    spread = SAMPLES.base_from_hand[:, 2, 3].std()
    assert found.position < 0.35 * spread
    assert np.degrees(found.angle) < 10
    curve = read_curve(tmp_path)
    assert curve.train["step"].tolist() == list(range(1, 121))
    # 51 samples are 6 batches of 8.
    assert curve.validation["step"].tolist() == list(range(6, 121, 6))
    assert (trained.reason, trained.step) == ("steps", 120)
    assert -trained.best == pytest.approx(curve.validation["loss"].min(), rel=1e-3)
    assert any((tmp_path / "tensorboard").glob("events*"))
    # A training that is complete gives its model, and does not continue.
    assert not (tmp_path / "checkpoint.pt").exists()
    steps: list[int] = []
    again, known = train(
        SMALL, SAMPLES, SPLIT, tmp_path, replace(FAST, max_steps=120), WEIGHTS, lambda done: steps.append(done.step)
    )
    assert (known, steps) == (trained, [])
    np.testing.assert_array_equal(again.labels(SAMPLES.inputs), model.labels(SAMPLES.inputs))


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_each_optimizer_lowers_the_error(name: Any, tmp_path: Path) -> None:
    rates = {**dict.fromkeys(("adam", "fused_adam", "adamw", "adagrad"), 3e-3), "delta_bar_delta": 1e-4}
    # Rprop compares gradients, so it needs the same batch.
    batch = 51 if name == "delta_bar_delta" else 8
    config = replace(STUDY, optimizer=name, learning_rate=rates.get(name, 0.1), batch_size=batch)
    train(SMALL, SAMPLES, SPLIT, tmp_path, replace(config, max_steps=12 if batch == 51 else 40))
    losses = read_curve(tmp_path).train["loss"]
    assert np.mean(losses[-5:]) < 0.7 * np.mean(losses[:2])


def test_the_studys_settings_do_not_learn(tmp_path: Path) -> None:
    """The first step throws the orientation from zero to far away; after it nothing moves any more."""
    legacy = replace(STUDY, optimizer="momentum", learning_rate=1e-9, batch_size=6, patience=1000, max_steps=60)
    config = ModelConfig("cnn3d", "psi4", "binary", zero_output=True, size=SIDE, fully_connected=(32,))
    objective = Objective(reduction="sum", fit_scaling=False)
    model, _ = train(config, SAMPLES, SPLIT, tmp_path, legacy, objective)
    norms = read_curve(tmp_path).train["orientation_norm"]
    assert norms[0] == 0.0
    assert norms[1] > 1.0
    labels = model.labels(SAMPLES.inputs)
    assert np.ptp(labels[:, :3], axis=0).max() < 1e-6
    before = PoseModel(config, legacy.seed)
    for a, b in zip(list(before.network.parameters())[:-2], model.network.parameters(), strict=False):
        torch.testing.assert_close(a, b, rtol=0, atol=1e-6)


def test_training_stops_early(tmp_path: Path) -> None:
    """Labels that have nothing to do with the inputs: the validation error soon stops falling."""
    shuffled = np.random.default_rng(1).permutation(60)
    noise = Samples(SAMPLES.names, SAMPLES.inputs, SAMPLES.object, SAMPLES.base_from_hand[shuffled], SAMPLES.preshape)
    _, trained = train(SMALL, noise, SPLIT, tmp_path, replace(FAST, patience=3, max_steps=2000))
    losses = read_curve(tmp_path).validation["loss"]
    assert trained.reason == "patience"
    assert min(losses[-3:]) > 0.999 * min(losses)
    assert len(losses) == trained.step / 6


def test_training_stops_at_its_time_limit_and_continues_with_more(tmp_path: Path) -> None:
    _, trained = train(SMALL, SAMPLES, SPLIT, tmp_path, replace(FAST, max_seconds=1e-9, max_steps=8))
    assert (trained.reason, trained.step) == ("time", 1)
    assert len(read_curve(tmp_path).validation["loss"]) == 1
    _, trained = train(SMALL, SAMPLES, SPLIT, tmp_path, replace(FAST, max_steps=8))
    assert (trained.reason, trained.step) == ("steps", 8)


@pytest.mark.parametrize("network", ["cnn3d", "cnn2d_dropout"])
def test_an_interrupted_training_gives_the_same_bits(network: Any, tmp_path: Path) -> None:
    """Interrupted after its checkpoint, in the middle of an epoch; with dropout too."""
    model, samples = SMALL, SAMPLES
    if network == "cnn2d_dropout":
        model = ModelConfig(network, "euler", "image", size=64, fully_connected=(16,))
        flat = np.repeat(np.repeat(SAMPLES.inputs[:, 16], 2, axis=1), 2, axis=2)
        samples = Samples(SAMPLES.names, flat, SAMPLES.object, SAMPLES.base_from_hand, SAMPLES.preshape)
    config = replace(FAST, max_steps=15)
    whole, _ = train(model, samples, SPLIT, tmp_path / "whole", config)

    def stop(done: TrainProgress) -> None:
        if done.step == 10:
            raise KeyboardInterrupt

    folder = tmp_path / "parts"
    with pytest.raises(KeyboardInterrupt):
        train(model, samples, SPLIT, folder, config, progress=stop)
    assert Rows(folder / "losses.jsonl")[-1]["step"] == 10
    with (folder / "losses.jsonl").open("a") as file:
        file.write('{"step": 11, "seconds": 0.')
    seen: list[int] = []
    again, _ = train(model, samples, SPLIT, folder, config, progress=lambda done: seen.append(done.step))
    assert seen == list(range(7, 16))
    for name, weight in whole.state_dict().items():
        assert torch.equal(weight, again.state_dict()[name]), name
    logs = [Rows(path / "losses.jsonl") for path in (folder, tmp_path / "whole")]
    assert [row | {"seconds": 0} for row in logs[0]] == [row | {"seconds": 0} for row in logs[1]]
    with pytest.raises(ConfigError, match=r"begun with other settings: learning_rate was 0\.003, is now 0\.01"):
        train(model, samples, SPLIT, folder, replace(config, learning_rate=1e-2))


def test_divergence_is_an_error(tmp_path: Path) -> None:
    config = replace(STUDY, optimizer="sgd", learning_rate=1e30, batch_size=8, max_steps=20)
    with pytest.raises(ConfigError, match=r"lower learning_rate|not finite"):
        train(SMALL, SAMPLES, SPLIT, tmp_path, config)


def test_a_reduction_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ConfigError, match="reduction is 'max'; choose sum or mean"):
        Objective(reduction="max")  # type: ignore[arg-type]


def test_scaling_is_that_of_the_training_samples() -> None:
    """Scaled inputs and positions have mean 0 and variance 1, and outputs are metres again."""
    model = PoseModel(SMALL)
    labels = np.concatenate([SAMPLES.base_from_hand[:, :3, 3], np.zeros((60, 4))], axis=1).astype(np.float32)
    model.fit_scaling(SAMPLES.inputs, labels)
    values = SAMPLES.inputs / 255
    assert float(model.input_shift) == pytest.approx(values.mean(), rel=1e-5)
    assert float(model.input_scale) == pytest.approx(values.std(), rel=1e-5)
    np.testing.assert_allclose(model.position_shift, labels[:, :3].mean(axis=0), rtol=1e-5)
    torch.nn.init.zeros_(model.network.layers[-1].weight)
    np.testing.assert_allclose(model.labels(SAMPLES.inputs[:2])[:, :3], [labels[:, :3].mean(axis=0)] * 2, atol=1e-6)


def test_models_are_saved(tmp_path: Path) -> None:
    model = PoseModel(SMALL, seed=4)
    model.save(tmp_path)
    again = PoseModel.load(tmp_path)
    assert again.config == model.config
    np.testing.assert_array_equal(again.predict(SAMPLES.inputs[:3]), model.predict(SAMPLES.inputs[:3]))
    with pytest.raises(ConfigError, match=r"inputs have shape \(2, 8, 8, 8\)"):
        model.predict(np.zeros((2, 8, 8, 8), dtype=np.uint8))
    with pytest.raises(ConfigError, match="kind 'image' has not"):
        PoseModel(ModelConfig("cnn3d", "psi4", "image"))
    PoseModel(ModelConfig("cnn3d", "euler", "binary", size=SIDE)).save(tmp_path / "other")
    (tmp_path / "other" / "weights.pt").replace(tmp_path / "weights.pt")
    with pytest.raises(ConfigError, match=r"does not have the weights of the network of model\.json"):
        PoseModel.load(tmp_path)
    (tmp_path / "weights.pt").write_bytes(b"no weights")
    with pytest.raises(ConfigError, match=r"does not have the weights of the network of model\.json"):
        PoseModel.load(tmp_path)
    (tmp_path / "weights.pt").unlink()
    with pytest.raises(FileError, match="no weights of a model"):
        PoseModel.load(tmp_path)
    for text in ("{", "[]", "{}", '{"network": "cnn3d", "loss": "psi4", "kind": "binary", "depth": 3}'):
        (tmp_path / "model.json").write_text(text)
        with pytest.raises(ConfigError):
            PoseModel.load(tmp_path)
    with pytest.raises(FileError):
        PoseModel.load(tmp_path / "none")


class Known(PoseModel):
    """A model that predicts one pose, and records its inputs."""

    pose: np.ndarray
    shown: np.ndarray

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """Predict the one pose."""
        self.shown = inputs
        super().labels(inputs)
        return np.broadcast_to(self.pose, (len(inputs), 4, 4))


@pytest.mark.parametrize(("network", "kind"), [("cnn2d_dropout", "image"), ("cnn3d", "ternary"), ("cnn3d", "binary")])
def test_models_act_in_the_environment(network: str, kind: str) -> None:
    """A can is round, so that a grasp from above in its base frame holds wherever the policy finds it."""
    objects = object_sets.load("procedural:can:0")
    scene = graspbox.Scene(objects[0].load())
    plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best()
    plan = plan[np.flatnonzero(np.isclose(plan.preshape, grasps.PRESHAPE))]
    base_from_hand = np.linalg.inv(grasps.base_pose(scene)) @ scene.world_from_object @ plan.poses
    above = base_from_hand[base_from_hand[:, 2, 2] < -0.98]
    model = Known(ModelConfig(network, "psi4", kind, preshape=grasps.PRESHAPE, fully_connected=(8,)))  # type: ignore[arg-type]
    model.pose = above[0]
    scenes = ObjectScenes(objects)
    out = execute(scenes, Samples(objects.names, np.zeros((1, 1), dtype=np.uint8), np.zeros(1, dtype=np.int64),
                  above[:1], np.array([grasps.PRESHAPE])), above[:1])  # fmt: skip
    assert out.success == 1
    policy = PoseRegressor(model)
    obs = policy.obs
    envs = gymnasium.make_vec(
        "graspbox/GraspPose-v0", num_envs=6, objects="procedural:can:0", obs=obs, cameras=cameras(kind)
    )
    policy.bind(Task.of(envs))
    observation, info = envs.reset(seed=0)
    policy.reset(seed=0, info=info)
    actions = policy.act(observation)
    _, _, _, _, info = envs.step(actions)
    assert info["is_success"].sum() >= 5
    assert model.shown.shape[0] == 6
    if kind == "image":
        # The object is darker than the table, and in the middle of every picture.
        for picture in model.shown:
            dark = np.argwhere(picture < np.median(picture) - 20)
            assert np.abs((dark.min(axis=0) + dark.max(axis=0)) / 2 - 128).max() < 40
    else:
        assert all((picture == 255).any() for picture in model.shown)
    envs.close()


def test_policies_say_what_they_need(tmp_path: Path) -> None:
    PoseModel(ModelConfig("cnn3d", "psi4", "binary", fully_connected=(8,))).save(tmp_path)
    policy = PoseRegressor(tmp_path)
    wrong = gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=1, objects="procedural:can:0", obs="voxels")
    with pytest.raises(ConfigError, match=r"make the environments with cameras=graspbox\.study\.regressor"):
        policy.bind(Task.of(wrong))
    closed = gymnasium.make_vec("graspbox/Grasp-v0", num_envs=1, objects="procedural:can:0", obs="voxels")
    with pytest.raises(ConfigError, match="acts in graspbox/GraspPose-v0"):
        policy.bind(Task.of(closed))
    for envs in (wrong, closed):
        envs.close()
    assert policy.name == "cnn3d-psi4"
    assert len(evaluation.evaluate(policy, objects="procedural:can:0", trials=2).trials) == 2


def test_the_study_is_reproduced_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A small one: results per network, a page with all pictures, and nothing trained twice."""
    out = tmp_path / "study"
    arguments = ["--out", str(out), "--networks", "cnn3d", "--losses", "psi4", "--samples", "20", "--iterations", "2",
                 "--objects", "procedural:can:0", "--objects", "procedural:mug:3",
                 "--torch-threads", "1", "--json"]  # fmt: skip
    assert command("study", arguments) == 0
    results = json.loads(capsys.readouterr().out)
    assert [(row["settings"], row["network"], row["loss"]) for row in results] == [
        ("legacy", "cnn3d", "psi4"),
        ("sane", "cnn3d", "psi4"),
    ]
    for row in results:
        assert row["test"]["tried"] == 1
        assert row["unseen"]["tried"] >= 61
        assert (row["stopped"], row["iterations"]) == ("steps", 2)
    text = (out / "study.md").read_text()
    pictures = [part.partition(")")[0] for part in text.split("](")[1:]]
    assert {"cnn3d_psi4.png", "normalized.png"} == set(pictures)
    assert all((out / name).is_file() for name in pictures)
    with pytest.raises(ConfigError, match="holds a run; resume it, or name another folder"):
        command("study", [*arguments, "--no-resume"])
    times = {path: path.stat().st_mtime_ns for path in out.rglob("weights.pt")}
    assert command("study", arguments) == 0
    assert json.loads(capsys.readouterr().out) == results
    assert {path: path.stat().st_mtime_ns for path in out.rglob("weights.pt")} == times
    pytest.importorskip("onnxruntime")
    folder = tmp_path / "policies/study"
    more = ["--publish", str(folder), "--measured", "procedural:can:0-3", "--trials", "2"]
    assert command("study", [*arguments, *more]) == 0
    card = (folder / "README.md").read_text()
    assert all(title in card for title in ("## Scores", "## Data and training", "## Limits", "## Licence"))
    assert "| `procedural:can:0-3` | 2 | " in card
    assert " | 1 of 4 | " in card
    assert card.count("| cnn3d | psi4 | ") == 2
    assert sum(path.stat().st_size for path in folder.iterdir()) < 4e6
    assert policies.load(str(folder)).name == "study"
    with pytest.raises(ConfigError, match="begun with other settings: seed was 0, is now 1"):
        command("study", [*arguments, "--seed", "1"])
    capsys.readouterr()
    with pytest.raises(SystemExit):
        command("study", ["--out", str(tmp_path / "x"), "--samples", "5"])
    assert "--samples is 5; pass 20 or more" in capsys.readouterr().err
