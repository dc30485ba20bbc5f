"""Training runs of the study's networks: they learn, stop, resume with the same bits, and become policies."""

import csv
import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from program_files import imported

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")
pytest.importorskip("tensorboard", reason="training needs the extra 'train'")

import graspbox  # noqa: E402
from graspbox import evaluation, object_sets, policies  # noqa: E402
from graspbox.errors import ConfigError, FileError  # noqa: E402
from graspbox.learning import grasps  # noqa: E402
from graspbox.learning.execution import Scenes, execute  # noqa: E402
from graspbox.learning.losses import LossWeights  # noqa: E402
from graspbox.learning.model import ModelConfig, PoseModel  # noqa: E402
from graspbox.learning.regressor import PoseRegressor, cameras  # noqa: E402
from graspbox.learning.samples import Samples, split_at_random  # noqa: E402
from graspbox.learning.training import OPTIMIZERS, TrainConfig, measure, train  # noqa: E402
from graspbox.policies import Task  # noqa: E402
from graspbox.rotations import poses_from, rotation_from_euler  # noqa: E402

pytestmark = pytest.mark.train

SIDE = 32
SMALL = ModelConfig("cnn3d", "psi4", "binary", size=SIDE, fully_connected=(32,))
FAST = TrainConfig(learning_rate=3e-3, batch_size=8, weights=LossWeights(1.0, 10.0), patience=1000)


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


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def steady(found: list[dict[str, str]]) -> list[tuple[str, ...]]:
    """Rows without their times."""
    return [tuple(value for name, value in row.items() if name != "seconds") for row in found]


def test_training_learns_and_logs(tmp_path: Path) -> None:
    """Heights that the training has not shown are predicted to a fraction of their spread."""
    model = train(SMALL, SAMPLES, SPLIT, FAST, tmp_path, iterations=120)
    found = measure(model, SAMPLES[SPLIT.test], FAST.weights)
    spread = SAMPLES.base_from_hand[:, 2, 3].std()
    assert found.position < 0.35 * spread
    assert np.degrees(found.angle) < 10
    steps, tests = rows(tmp_path / "iterations.csv"), rows(tmp_path / "validations.csv")
    assert [int(row["iteration"]) for row in steps] == list(range(1, 121))
    # 51 samples are 6 batches of 8.
    assert [int(row["iteration"]) for row in tests] == list(range(6, 121, 6))
    assert {row["epoch"] for row in steps[:6]} == {"0"}
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["stopped"], result["iteration"]) == ("budget", 120)
    assert result["best"] == pytest.approx(min(float(row["loss"]) for row in tests), rel=1e-3)
    assert any((tmp_path / "tensorboard").glob("events*"))
    assert not (tmp_path / "checkpoint.pt").exists()


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_each_optimiser_lowers_the_error(name: str, tmp_path: Path) -> None:
    rate = {"adam": 3e-3, "adagrad": 3e-3, "delta_bar_delta": 1e-4}.get(name, 0.1)
    batch = 51 if name == "delta_bar_delta" else 8  # Rprop compares gradients, so it needs the same batch
    config = TrainConfig(optimizer=name, learning_rate=rate, batch_size=batch)  # type: ignore[arg-type]
    count = 12 if batch == 51 else 40
    train(SMALL, SAMPLES, SPLIT, config, tmp_path, iterations=count)
    losses = [float(row["loss"]) for row in rows(tmp_path / "iterations.csv")]
    assert np.mean(losses[-5:]) < 0.7 * np.mean(losses[:2])
    kinds = {"adam": torch.optim.Adam, "adagrad": torch.optim.Adagrad, "delta_bar_delta": torch.optim.Rprop}
    made = config.make(PoseModel(SMALL))
    assert type(made) is kinds.get(name, torch.optim.SGD)
    if name not in kinds:
        group = made.param_groups[0]
        assert (group["momentum"], group["nesterov"]) == (0.0 if name == "sgd" else 0.5, name == "nesterov")


def test_the_studys_settings_do_not_learn(tmp_path: Path) -> None:
    """The first step throws the orientation from zero to far away; after it nothing moves any more."""
    legacy = TrainConfig(
        optimizer="momentum", learning_rate=1e-9, batch_size=6, reduction="sum", fit_scaling=False, patience=1000
    )
    config = ModelConfig("cnn3d", "psi4", "binary", zero_output=True, size=SIDE, fully_connected=(32,))
    model = train(config, SAMPLES, SPLIT, legacy, tmp_path, iterations=60)
    norms = [float(row["orientation_norm"]) for row in rows(tmp_path / "iterations.csv")]
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
    config = TrainConfig(learning_rate=3e-3, batch_size=8, patience=3)
    train(SMALL, noise, SPLIT, config, tmp_path, iterations=2000)
    result = json.loads((tmp_path / "result.json").read_text())
    losses = [float(row["loss"]) for row in rows(tmp_path / "validations.csv")]
    assert result["stopped"] == "patience"
    assert result["stale"] == 3
    assert min(losses[-3:]) > 0.999 * min(losses)
    assert len(rows(tmp_path / "validations.csv")) == result["iteration"] / 6


def test_training_ends_after_its_epochs_and_minutes(tmp_path: Path) -> None:
    train(SMALL, SAMPLES, SPLIT, TrainConfig(batch_size=8, max_epochs=2), tmp_path / "epochs")
    result = json.loads((tmp_path / "epochs" / "result.json").read_text())
    assert (result["stopped"], result["iteration"]) == ("max_epochs", 12)
    train(SMALL, SAMPLES, SPLIT, FAST, tmp_path / "minutes", minutes=1e-9)
    result = json.loads((tmp_path / "minutes" / "result.json").read_text())
    assert (result["stopped"], result["iteration"]) == ("budget", 1)
    assert len(rows(tmp_path / "minutes" / "validations.csv")) == 1


@pytest.mark.parametrize("network", ["cnn3d", "cnn2d_dropout"])
def test_an_interrupted_run_gives_the_same_bits(network: str, tmp_path: Path) -> None:
    """Interrupted after its checkpoint, in the middle of an epoch; with dropout too."""
    model, samples = SMALL, SAMPLES
    if network == "cnn2d_dropout":
        model = ModelConfig(network, "euler", "image", size=64, fully_connected=(16,))
        flat = np.repeat(np.repeat(SAMPLES.inputs[:, 16], 2, axis=1), 2, axis=2)
        samples = Samples(SAMPLES.names, flat, SAMPLES.object, SAMPLES.base_from_hand, SAMPLES.preshape)
    options = {"iterations": 15, "checkpoint_minutes": 0.0}
    whole = train(model, samples, SPLIT, FAST, tmp_path / "whole", **options)  # type: ignore[arg-type]

    class StoppedError(Exception):
        pass

    def stop(iteration: int, row: dict[str, float]) -> None:
        assert row["iteration"] == iteration
        if iteration == 10:
            raise StoppedError

    folder = tmp_path / "parts"
    with pytest.raises(StoppedError):
        train(model, samples, SPLIT, FAST, folder, **options, done=stop)  # type: ignore[arg-type]
    with (folder / "iterations.csv").open("a") as file:
        file.write("11,1,0.5,0.1,0.1,0.1,0.1\n12,1,0.")
    with pytest.raises(ConfigError, match="holds a run; continue it with resume"):
        train(model, samples, SPLIT, FAST, folder, **options)  # type: ignore[arg-type]
    again = train(model, samples, SPLIT, FAST, folder, **options, resume=True)  # type: ignore[arg-type]
    for name, weight in whole.state_dict().items():
        assert torch.equal(weight, again.state_dict()[name]), name
    for log in ("iterations.csv", "validations.csv"):
        assert steady(rows(folder / log)) == steady(rows(tmp_path / "whole" / log))
    # A run that is complete gives its model; other settings are refused.
    calls: list[int] = []
    done = train(model, samples, SPLIT, FAST, folder, **options, resume=True, done=lambda i, _: calls.append(i))  # type: ignore[arg-type]
    assert not calls
    np.testing.assert_array_equal(done.labels(samples.inputs), whole.labels(samples.inputs))
    other = TrainConfig(learning_rate=1e-2)
    with pytest.raises(ConfigError, match=r"begun with other settings \(training\)"):
        train(model, samples, SPLIT, other, folder, **options, resume=True)  # type: ignore[arg-type]


def test_divergence_is_an_error(tmp_path: Path) -> None:
    config = TrainConfig(optimizer="sgd", learning_rate=1e30, batch_size=8)
    with pytest.raises(ConfigError, match="diverged; give a smaller learning_rate"):
        train(SMALL, SAMPLES, SPLIT, config, tmp_path, iterations=20)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"optimizer": "lbfgs"}, "optimizer is 'lbfgs'; choose from sgd, momentum, nesterov, adagrad, adam"),
        ({"learning_rate": 0.0}, "learning_rate is 0.0; give a positive number"),
        ({"momentum": 1.0}, "momentum is 1.0"),
        ({"batch_size": 0}, "batch_size is 0; give 1 or more"),
        ({"reduction": "max"}, "reduction is 'max'; choose sum or mean"),
    ],
)
def test_wrong_settings_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        TrainConfig(**change)  # type: ignore[arg-type]


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
    with pytest.raises(ConfigError, match=r"holds no weights of the network of model\.json"):
        PoseModel.load(tmp_path)
    (tmp_path / "weights.pt").write_bytes(b"no weights")
    with pytest.raises(ConfigError, match=r"holds no weights of the network of model\.json"):
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
    """A model that predicts one pose, and keeps what it was shown."""

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
    out = execute(Scenes(objects), Samples(objects.names, np.zeros((1, 1), dtype=np.uint8), np.zeros(1, dtype=np.int64),
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
    with pytest.raises(ConfigError, match=r"make the environments with cameras=graspbox\.learning\.regressor"):
        policy.bind(Task.of(wrong))
    closed = gymnasium.make_vec("graspbox/Grasp-v0", num_envs=1, objects="procedural:can:0", obs="voxels")
    with pytest.raises(ConfigError, match="acts in graspbox/GraspPose-v0"):
        policy.bind(Task.of(closed))
    for envs in (wrong, closed):
        envs.close()
    loaded = policies.load(str(tmp_path))
    assert loaded.name == "cnn3d-psi4"
    assert len(evaluation.evaluate(loaded, objects="procedural:can:0", trials=2).trials) == 2


def test_the_study_is_reproduced_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A small one: results per network, a page with all pictures, and nothing trained twice."""
    pytest.importorskip("tyro", reason="the script needs the extra 'train'")
    module = imported(Path(__file__).parents[2] / "scripts" / "reproduce_study.py")
    out = tmp_path / "study"
    arguments = ["--out", str(out), "--networks", "cnn3d", "--losses", "psi4", "--samples", "20", "--iterations", "2",
                 "--objects", "procedural:can:0", "procedural:mug:3", "--torch-threads", "1", "--json"]  # fmt: skip
    assert module.main(arguments) == 0
    results = json.loads(capsys.readouterr().out)
    assert [(row["settings"], row["network"], row["loss"]) for row in results] == [
        ("legacy", "cnn3d", "psi4"),
        ("sane", "cnn3d", "psi4"),
    ]
    for row in results:
        assert row["test"]["tried"] == 1
        assert row["unseen"]["tried"] >= 61
        assert row["iterations"] == 2
    text = (out / "study.md").read_text()
    pictures = [part.partition(")")[0] for part in text.split("](")[1:]]
    assert {"cnn3d_psi4.png", "normalized.png"} == set(pictures)
    assert all((out / name).is_file() for name in pictures)
    assert module.main(arguments) == 2
    assert "holds results; continue with --resume" in capsys.readouterr().err
    times = {path: path.stat().st_mtime_ns for path in out.rglob("weights.pt")}
    assert module.main([*arguments, "--resume"]) == 0
    assert json.loads(capsys.readouterr().out) == results
    assert {path: path.stat().st_mtime_ns for path in out.rglob("weights.pt")} == times
    pytest.importorskip("onnxruntime")
    folder = tmp_path / "policies/study"
    more = ["--publish", str(folder), "--measured", "procedural:can:0-3", "--trials", "2"]
    assert module.main([*arguments, "--resume", *more]) == 0
    card = (folder / "README.md").read_text()
    assert all(title in card for title in ("## Scores", "## Data and training", "## Limits", "## Licence"))
    assert "| `procedural:can:0-3` | 1 of 4 | 2 | " in card
    assert card.count("| cnn3d | psi4 | ") == 2
    assert sum(path.stat().st_size for path in folder.iterdir()) < 4e6
    assert policies.load(str(folder)).name == "study"
    capsys.readouterr()
    assert module.main([*arguments, "--resume", "--seed", "1"]) == 2
    assert "begun with other settings: seed was 0, is now 1" in capsys.readouterr().err
    assert module.main(["--out", str(tmp_path / "x"), "--samples", "5"]) == 2
    assert "--samples is 5; give 20 or more" in capsys.readouterr().err
