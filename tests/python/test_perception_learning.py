"""Networks of perception: both overfit one batch, from trials of scenes; choices are cautious."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors, object_sets
from graspbox.perception import CropConfig, HandGrid, ProposalConfig

torch = pytest.importorskip("torch")

from graspbox._common.runs import Rows  # noqa: E402
from graspbox.learn.export.graphs import CompletionGraph, ScorerGraph  # noqa: E402
from graspbox.learn.models.cluttered import read_scene  # noqa: E402
from graspbox.learn.models.completion.network import (  # noqa: E402
    CompletionBatch,
    CompletionNet,
    completion_losses,
    iou,
    train_completion,
)
from graspbox.learn.models.scene_views import SceneViews  # noqa: E402
from graspbox.learn.models.scenes import SceneConfig, SceneSampler  # noqa: E402
from graspbox.learn.models.scorer.network import ScorerBatch, ScorerNet, scorer_losses  # noqa: E402
from graspbox.learn.models.scorer.training import TrialSampler, train_scorer  # noqa: E402
from graspbox.learn.models.trials import GraspTrials  # noqa: E402
from graspbox.learn.recipes.collection import CollectConfig, collect, load_trials  # noqa: E402
from graspbox.learn.training.metrics import auc  # noqa: E402
from graspbox.learn.training.trainer import TrainConfig, load_weights  # noqa: E402
from graspbox.perception.configs import EVERYTHING, FinderConfig  # noqa: E402
from graspbox.perception.inputs.scorer import ScorerInputs  # noqa: E402
from graspbox.perception.perturbations import PoseNoise  # noqa: E402
from graspbox.policies.published.calibration import Calibration  # noqa: E402
from graspbox.policies.published.runtimes import Completion, Scorer, torch_network  # noqa: E402

pytestmark = pytest.mark.train

N = CropConfig().resolution


@pytest.fixture(scope="module")
def inputs() -> ScorerInputs:
    return ScorerInputs(HandGrid())


def sampler(name: str = "procedural:can:0-1") -> SceneSampler:
    return SceneSampler(object_sets.load(name), SceneConfig(image_size=96), 0)


def test_scenes_follow_from_their_number() -> None:
    first, again, other = sampler().sample(3, 2, 2), sampler().sample(3, 2, 2), sampler().sample(4, 2, 2)
    np.testing.assert_array_equal(first.crops.channels, again.crops.channels)
    assert first.crops.channels.shape[1:] == (3, N, N, N)
    assert not np.array_equal(first.crops.channels[:2], other.crops.channels[:2])
    # Visible points are on the object's surface: within a voxel and a half of it.
    solids = first.occupancies(CropConfig())
    for channels, solid in zip(first.crops.channels, solids, strict=True):
        near = solid >= 128
        for axis in range(3):
            near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
        seen = channels[0] >= 128
        assert seen.sum() > 50
        assert (seen & near).sum() > 0.97 * seen.sum()


@pytest.mark.usefixtures("one_thread")
def test_a_completion_learns_one_batch_by_heart() -> None:
    torch.manual_seed(0)
    scenes = sampler("procedural:box:0-1").sample(0, 2, 2)
    channels = torch.from_numpy(scenes.crops.channels).float() / 255
    batch = CompletionBatch(channels, torch.from_numpy(scenes.occupancies(CropConfig())).float() / 255)
    net = CompletionNet(width=8)
    optimizer = torch.optim.Adam(net.parameters(), 1e-2)
    for _ in range(100):
        optimizer.zero_grad()
        torch.stack(list(completion_losses(net, batch).values())).sum().backward()
        optimizer.step()
    with torch.no_grad():
        found = iou(torch.sigmoid(net(batch.channels)), batch.solid)
    # The visible surface alone covers far less.
    assert float(iou(channels[:, 0], batch.solid).max()) < 0.5
    assert float(found.min()) > 0.7


def test_a_scorer_learns_one_batch_by_heart(inputs: ScorerInputs) -> None:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    volumes = (rng.random((4, 3, N, N, N)) * 255).astype(np.uint8)
    poses = np.tile(np.eye(4), (48, 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = rng.uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.2], (48, 3))
    made = inputs.make(volumes, np.arange(48) % 4, poses, rng.choice(inputs.grid.preshapes, 48))
    batch = ScorerBatch.of(made, (rng.random((48, 3)) < 0.5).astype(np.float32))
    net, targets = ScorerNet(inputs.grid, width=32), batch.targets
    optimizer = torch.optim.Adam(net.parameters(), 2e-3)
    for _ in range(40):
        optimizer.zero_grad()
        torch.stack(list(scorer_losses(net, batch).values())).sum().backward()
        optimizer.step()
    with torch.no_grad():
        logits = net(batch.cells, batch.poses, batch.preshape)
        loss = float(scorer_losses(net, batch)["success"])
    assert ((logits[:, 0] > 0) == (targets[:, 0] > 0.5)).all()
    assert loss < 0.3


def test_scalars_of_a_grasp_are_what_they_say(inputs: ScorerInputs) -> None:
    volume = np.zeros((1, 3, N, N, N), dtype=np.uint8)
    # A lump 0.05 m beside the hand's axis and 0.08 m in front of the palm.
    at = np.round((np.array([0.05, 0.0, 0.07]) - np.array(CropConfig().origin)) / CropConfig().voxel_size).astype(int)
    volume[0, 0, at[0] - 2 : at[0] + 2, at[1] - 2 : at[1] + 2, at[2] - 2 : at[2] + 2] = 255
    pose = np.eye(4)
    pose[:3, :3], pose[2, 3] = np.diag([1.0, -1.0, -1.0]), 0.15
    cells, poses, preshape = inputs.make(volume, np.zeros(1, dtype=np.int64), pose[None], np.array([1.5]))
    scalars = ScorerNet(inputs.grid, width=8).scalars(torch.from_numpy(cells), torch.from_numpy(poses))
    values = scalars[0].numpy()
    np.testing.assert_allclose(values[:3], [0, 0, 1], atol=1e-6)
    assert values[3] == pytest.approx(1.5)
    middle = inputs.grid.origin + 0.5 * np.array(inputs.grid.shape) * inputs.grid.cell
    np.testing.assert_allclose(values[4:7] / 10 + middle, [0.05, 0.0, 0.08], atol=4e-3)
    assert inputs.grid.preshapes[int(preshape[0])] == pytest.approx(np.pi / 2)
    assert values[7] == pytest.approx(float(cells[0, 0].sum()) / 255 / cells[0, 0].size * 10, rel=1e-5)


def test_the_hardest_three_quarters_count() -> None:
    logits = torch.tensor([[5.0, 0, 0], [5.0, 0, 0], [0.0, 0, 0], [-2.0, 0, 0]])

    class Fixed(torch.nn.Module):  # type: ignore[misc, name-defined]
        def forward(self, *_: Any) -> Any:
            return logits

    empty = torch.zeros(0)
    found = scorer_losses(Fixed(), ScorerBatch(empty, empty, empty, torch.ones(4, 3)))
    entropies = np.log1p(np.exp(-np.array([5.0, 0.0, -2.0])))
    assert float(found["success"]) == pytest.approx(entropies.mean(), rel=1e-5)
    assert float(found["secure"]) == pytest.approx(0.5 * np.log(2), rel=1e-5)


def test_auc_counts_pairs() -> None:
    rng = np.random.default_rng(0)
    scores, success = rng.integers(0, 8, 40).astype(float), rng.random(40) < 0.4
    pairs = [(a > b) + 0.5 * (a == b) for a in scores[success] for b in scores[~success]]
    assert auc(scores, success) == pytest.approx(np.mean(pairs))
    assert auc(scores, np.ones(40, dtype=np.bool_)) == 0.5


def graph_of(inputs: ScorerInputs, biases: list[float], calibration: Calibration, finalists: int = 24) -> ScorerGraph:
    """Make an ensemble whose members give their bias for any input."""
    members = []
    for bias in biases:
        members.append(ScorerNet(inputs.grid, width=8))
        for parameter in members[-1].head[-1].parameters():
            torch.nn.init.zeros_(parameter)
        torch.nn.init.constant_(members[-1].head[-1].bias, bias)
    return ScorerGraph(members, calibration, finalists)


def test_an_ensemble_chooses_by_mean_minus_half_a_deviation(inputs: ScorerInputs) -> None:
    volume = np.zeros((3, N, N, N), dtype=np.uint8)
    poses, preshape = np.tile(np.eye(4), (30, 1, 1)), np.zeros(30)
    biases = [2.0, 0.0, -1.0]
    calibration = Calibration(success=(0.5, 0.1), secure=(2.0, 0.0), secure_weight=0.5)
    judged = Scorer(torch_network(graph_of(inputs, biases, calibration)), inputs, 24).judge(volume, poses, preshape)
    logit = np.mean(biases) - 0.5 * np.std(biases)
    for expected, count in ((logit, 24), (biases[0] - 1.0, 6)):
        rows = np.isclose(judged.logits[:, 0], expected, atol=1e-6)
        assert rows.sum() == count
        success, secure = 1 / (1 + np.exp(-0.5 * expected - 0.1)), 1 / (1 + np.exp(-2.0 * expected))
        np.testing.assert_allclose(judged.success[rows], success, atol=1e-6)
        np.testing.assert_allclose(judged.secure[rows], secure, atol=1e-6)
        np.testing.assert_allclose(judged.choice[rows], (success + 0.5 * secure) / 1.5, atol=1e-6)
    first = int(np.flatnonzero(np.isclose(judged.logits[:, 0], logit))[0])
    # Scores to average are those of all members, for every grasp.
    each = Scorer(torch_network(graph_of(inputs, biases, calibration)), inputs, 24, len(biases)).judge_each
    np.testing.assert_allclose(each(volume, poses, preshape).choice, np.full(30, judged.choice[first]), atol=1e-6)
    # Fewer grasps than finalists are padded, and one member alone loses nothing.
    alone = Scorer(torch_network(graph_of(inputs, [1.0], Calibration())), inputs, 24)
    few = alone.judge(volume, poses[:3], preshape[:3])
    np.testing.assert_allclose(few.success, 1 / (1 + np.exp(-np.ones(3))), atol=1e-6)
    assert len(alone(volume, poses[:0], preshape[:0])) == 0


def test_views_of_a_scene_are_the_same_when_they_are_made_again() -> None:
    poses = np.stack([object_sets.load(f"procedural:can:{i}")[0].load().resting_poses()[0][0] for i in range(2)])
    settings = SceneConfig(image_size=96)
    kept, small = SceneViews(settings, seed=5), SceneViews(settings, seed=5, memory=1)
    volumes = []
    for scene, view in ((0, 0), (0, 1), (1, 0), (0, 0)):
        given = (f"procedural:can:{scene}", poses[scene], view)
        one, other = kept.get(*given), small.get(*given)
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
        volumes.append(one[0])
    assert volumes[0].shape == (3, N, N, N)
    np.testing.assert_array_equal(volumes[0], volumes[3])
    assert not np.array_equal(volumes[0], volumes[1])


def trials() -> GraspTrials:
    """Make up five trials in three scenes."""
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = np.arange(5)
    flags = np.array([True, False, True, False, True])
    sources = np.array(["procedural:can:0", "procedural:can:1", "procedural:can:1"])
    objects = np.tile(np.eye(4), (3, 1, 1))
    objects[2, 0, 3] = 0.1
    return GraspTrials(sources, objects, np.array([0, 1, 1, 2, 2]), poses, np.zeros(5), flags, flags, ~flags)


def test_trials_are_kept_by_scene(tmp_path: Path) -> None:
    assert [rows.tolist() for rows in trials().rows_of_scenes()] == [[0], [1, 2], [3, 4]]
    both = GraspTrials.joined([trials(), trials()])
    assert both.scene_of.tolist() == [0, 1, 1, 2, 2, 3, 4, 4, 5, 5]
    both.save(tmp_path / "some.npz")
    assert len(load_trials(tmp_path)) == 10
    with pytest.raises(errors.ConfigError, match="no trials"):
        GraspTrials.joined([])


def test_columns_of_a_data_set_are_grouped_by_scene() -> None:
    given = trials()
    order = [3, 0, 4, 2, 1]
    columns = {
        "source": given.source[given.scene_of][order].tolist(),
        "world_from_object": [pose.ravel().tolist() for pose in given.world_from_object[given.scene_of][order]],
        "executed_world_from_hand": [pose.ravel().tolist() for pose in given.world_from_hand[order]],
        "preshape": given.preshape[order],
        "success": given.success[order],
        "secure": given.secure[order],
        "failure": ["slipped", "", "", "", "no_contact"],
        "mass": [1.0] * 5,
    }
    found = GraspTrials.from_columns(columns)
    assert found.scene_of.tolist() == [0, 1, 0, 2, 2]
    assert found.source.tolist() == ["procedural:can:1", "procedural:can:0", "procedural:can:1"]
    assert found.world_from_object[:, 0, 3].tolist() == [0.1, 0.0, 0.0]
    assert found.slip.tolist() == [True, False, False, False, False]
    with pytest.raises(errors.ConfigError, match="lack success"):
        GraspTrials.from_columns({k: v for k, v in columns.items() if k != "success"})


def test_collection_continues_and_its_trials_train_a_scorer(tmp_path: Path, inputs: ScorerInputs) -> None:
    config = CollectConfig(per_scene=4, finder=FinderConfig(ProposalConfig(most=32), refinements=0))
    calls: list[int] = []

    def noted(volume: NDArray[np.uint8], poses: NDArray[np.float64], preshape: NDArray[np.float64]) -> Any:
        calls.append(len(preshape))
        return -poses[:, 2, 3]

    scenes = sampler()
    found = collect(tmp_path / "trials", scenes, range(2), inputs.grid, config, score=noted)
    assert len(found) == 8
    assert len(calls) == 2
    again = collect(tmp_path / "trials", scenes, range(3), inputs.grid, config, score=noted)
    assert len(calls) == 3
    np.testing.assert_array_equal(again.world_from_hand[:8], found.world_from_hand)
    train = TrainConfig(batch_size=16, max_steps=2, validate_every=1)
    views = SceneViews(SceneConfig(image_size=96))
    result = train_scorer(tmp_path / "run", again, found, inputs, views, train, width=8)
    assert result.step == 2
    rows = Rows(tmp_path / "run" / "losses.jsonl")
    assert {"auc", "entropy", "chosen", "all", "train_success", "train_slip"} <= set(rows[0])
    assert rows[0]["all"] == pytest.approx(found.success.mean())
    # The next round begins with these weights, and has trials of both kinds in each batch.
    start = tmp_path / "run" / "weights.pt"
    shares: list[float] = []
    result = train_scorer(
        tmp_path / "next",
        again,
        found,
        inputs,
        views,
        TrainConfig(batch_size=16, max_steps=1, validate_every=1, learning_rate=1e-9),
        on_policy=found,
        start=start,
        width=8,
        progress=lambda progress: shares.append(progress.share),
    )
    assert shares == [1.0]
    first, second = (torch.load(path, weights_only=True) for path in (start, tmp_path / "next" / "weights.pt"))
    torch.testing.assert_close(first["head.0.weight"], second["head.0.weight"], atol=1e-6, rtol=0)
    stopped = collect(tmp_path / "trials", scenes, range(9), inputs.grid, config, score=noted, stop=lambda: True)
    assert len(stopped.source) == 3


def test_some_scenes_are_seen_as_by_real_cameras() -> None:
    """Their cameras are farther away, their images have holes, and of several objects the crop lies around one."""
    objects = object_sets.load("procedural:can:0-3")
    real, same = (SceneSampler(objects, SceneConfig(real=1.0), 0).sample(1, 6, 2) for _ in range(2))
    np.testing.assert_array_equal(real.crops.channels, same.crops.channels)
    assert len(real) > 8
    # What is seen is near the object.
    for channels, solid in zip(real.crops.channels, real.occupancies(CropConfig()), strict=True):
        near = solid >= 64
        for _ in range(3):
            for axis in range(3):
                near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
        assert near[channels[0] >= 128].mean() > 0.8
    rng = np.random.default_rng(0)
    drawn = [SceneConfig().as_real(rng) for _ in range(50)]
    assert max(one.distance[1] for one in drawn) > 1.3
    assert min(one.distance[0] for one in drawn) < 0.5
    assert all(one.noise.correlated_growth <= 0.004 and one.noise.holes <= 0.25 for one in drawn)
    several = SceneConfig(real=1.0, crop=CropConfig(gap=EVERYTHING))
    crops = SceneSampler(objects, several, 0, ("packed",)).sample(0, 4, 2).crops
    rendered = SceneSampler(objects, replace(several, real=0.0), 0, ("packed",)).sample(0, 4, 2).crops
    assert len({tuple(pose[:2, 3].round(3)) for pose in crops.world_from_crop}) == len(crops)
    assert not np.array_equal(crops.channels[:2], rendered.channels[:2])


def test_collected_grasps_keep_off_the_walls_of_a_bin(tmp_path: Path, inputs: ScorerInputs) -> None:
    scenes = SceneSampler(object_sets.load("procedural:can:0-3"), SceneConfig(image_size=96), 0, ("bin",))
    still = PoseNoise(position=0.0, rotation=0.0)
    config = CollectConfig(per_scene=64, error=still, finder=FinderConfig(ProposalConfig(most=64)))
    found = collect(tmp_path / "trials", scenes, range(3), inputs.grid, config)
    nothing, met = np.zeros((N, N, N), dtype=np.uint8), 0
    for number, source in enumerate(found.source):
        walls = read_scene(source).obstacles
        assert len(walls) > 100
        mine = found.scene_of == number
        poses, preshapes = found.world_from_hand[mine], found.preshape[mine]
        free, _ = inputs.grid.meets(nothing, poses, preshapes, obstacles=walls)
        met += len(free)
        assert free.all()
    assert met > 30


def test_a_completion_trains_and_is_read_again(tmp_path: Path) -> None:
    objects = object_sets.load("procedural:can:0-1")
    settings = SceneConfig(image_size=64)
    config = TrainConfig(batch_size=4, max_steps=2, validate_every=2)
    result = train_completion(tmp_path, objects, objects, config, settings)
    assert 0.0 <= result.best <= 1.0
    scenes = SceneSampler(objects, settings, 0).sample(0, 1, 2)
    net = CompletionNet()
    load_weights(net, tmp_path / "weights.pt")
    found = Completion(torch_network(CompletionGraph(net)))(scenes.crops.channels)
    assert found.shape == (2, N, N, N)
    assert found.dtype == np.uint8


def test_the_scorer_sees_a_trial_as_far_from_the_hand_as_the_hand_errs(tmp_path: Path, inputs: ScorerInputs) -> None:
    found = collect(tmp_path, sampler(), range(2), inputs.grid, CollectConfig(per_scene=16))
    views = SceneViews(SceneConfig(image_size=96))
    sure, erring = (
        TrialSampler(found, inputs, views, 0, error).sample(0, np.arange(2), 16).batch.poses.numpy()
        for error in (PoseNoise(0.0, 0.0), PoseNoise(0.004, 0.05))
    )
    moved = np.linalg.inv(sure) @ erring
    assert moved.shape == (32, 4, 4)
    # 96 numbers each: their deviation is within 30 % of the requested one, except in one of 10,000 samples.
    assert moved[:, :3, 3].std() == pytest.approx(0.004, rel=0.3)
    turns = np.stack([moved[:, 2, 1], moved[:, 0, 2], moved[:, 1, 0]])
    assert turns.std() == pytest.approx(0.05, rel=0.3)
