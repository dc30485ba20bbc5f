"""Heads: each overfits a batch, anchors interpolate, training resumes, and a trained head is a policy."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors, evaluation, object_sets
from graspbox.perception import CropConfig, DepthNoise, HandGrid, HeadFinder
from graspbox.perception.anchors import AnchorConfig, Anchors, Candidates
from graspbox.policies import DepthPolicy, Observer
from graspbox.simulation import Scene

torch = pytest.importorskip("torch")

from graspbox._common.runs import Rows  # noqa: E402
from graspbox.learn.models.head.batches import HeadBatch, HeadSampler, untried_scenes  # noqa: E402
from graspbox.learn.models.head.network import AnchorNet, AnchorSamples  # noqa: E402
from graspbox.learn.models.head.policy import TrainedHead  # noqa: E402
from graspbox.learn.models.head.training import HeadData, anchor_losses, load_head, train_head  # noqa: E402
from graspbox.learn.models.scenes import SceneConfig  # noqa: E402
from graspbox.learn.models.trials import GraspTrials  # noqa: E402
from graspbox.learn.training.trainer import TrainConfig  # noqa: E402
from graspbox.policies.published.head_configs import HeadConfig  # noqa: E402

pytestmark = pytest.mark.train

SMALL = HeadConfig(width=8, features=8, hidden=16, anchors=AnchorConfig(cells=12, heights=14))
SCENES = SceneConfig(image_size=96)


@pytest.fixture(scope="module")
def grid() -> HandGrid:
    return HandGrid()


@pytest.fixture(scope="module")
def trials() -> GraspTrials:
    """Random steep grasps of two cans and two boxes, simulated."""
    rng = np.random.default_rng(0)
    parts = []
    for name in ("procedural:can:0-1", "procedural:box:0-1"):
        for spec in object_sets.load(name):
            mesh = spec.load()
            scene = Scene(mesh, world_from_object=mesh.resting_poses()[0][0])
            at_rest = scene.world_from_object
            place = rng.uniform([4, 4, 1, 0], [11, 11, 8, 16], (40, 4))
            poses = Anchors(3).poses(place, np.zeros((40, 2)))
            poses[:, :2, 3] += at_rest[:2, 3]
            preshape = rng.choice(HandGrid().preshapes, 40)
            outcomes = scene.simulate(np.linalg.inv(at_rest) @ poses, preshape)
            parts.append(GraspTrials.of_scene(spec.source, at_rest, poses, preshape, outcomes))
    return GraspTrials.joined(parts)


def sampler(trials: GraspTrials, grid: HandGrid, head: HeadConfig = SMALL) -> HeadSampler:
    return HeadSampler(trials, grid, Anchors(3, head.anchors), SCENES, 0, 2)


def test_trials_are_mixed(trials: GraspTrials) -> None:
    """The other tests need successes and failures."""
    assert 0.1 < trials.success.mean() < 0.9


def test_batches_follow_from_their_number(trials: GraspTrials, grid: HandGrid) -> None:
    every = np.arange(4)
    first, again = (sampler(trials, grid).sample(3, every, 24, augment=True) for _ in range(2))
    torch.testing.assert_close(first.volumes, again.volumes, rtol=0, atol=0)
    torch.testing.assert_close(first.probes.place, again.probes.place, rtol=0, atol=0)
    assert first.volumes.shape == (4, 2, *(CropConfig().resolution,) * 3)
    assert len(first.success) == len(first.reached) == 4 * 24
    assert len(first.trials.place) == int(first.inside.sum())
    assert 0 < float(first.reached.mean()) < 1


def test_scenes_without_trials_show_where_the_hand_can_go(trials: GraspTrials, grid: HandGrid) -> None:
    objects = object_sets.load("procedural:bottle:0-1")
    more = untried_scenes(objects, 3, 0)
    assert len(more) == 0
    assert set(more.source) <= {spec.source for spec in objects}
    for source, pose in zip(more.source, more.world_from_object, strict=True):
        heights = object_sets.load(str(source))[0].load().vertices @ pose[2, :3] + pose[2, 3]
        assert heights.min() == pytest.approx(0.0, abs=1e-12)
    drawn = sampler(GraspTrials.joined([trials, more]), grid)
    assert drawn.scenes.tolist() == [0, 1, 2, 3]
    assert drawn.untried.tolist() == [4, 5, 6]
    batch = drawn.sample(0, np.array([4, 0, 6]), 24)
    assert set(batch.sample_of.tolist()) == {1}
    assert batch.probes.sample_of.tolist() == [0] * 24 + [1] * 24 + [2] * 24
    alone = drawn.sample(0, np.array([5]), 200)
    assert 0 < float(alone.reached.mean()) < 1
    losses = anchor_losses(AnchorNet(3, SMALL), alone)
    assert set(losses) == {"reached"}


def test_mirrored_views_have_mirrored_trials(trials: GraspTrials, grid: HandGrid) -> None:
    """A batch is mirrored as a whole: the views, and the trials."""
    drawn = sampler(trials, grid)
    assert drawn.symmetries == ((1.0, -1.0, 1.0),)
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    view = drawn.view(0, 0)
    assert view is not None
    found = []
    for number in range(12):
        batch = drawn.sample(number, np.array([0]), 40, augment=True)
        seen = next(v for k in range(2) if (v := drawn.view(0, k)) is not None and _same(batch, v.volume))
        flipped = not np.array_equal(batch.volumes[0].numpy(), seen.volume)
        poses = batch.poses.double().numpy()
        own = mirror @ poses @ mirror if flipped else poses
        tried = np.linalg.inv(seen.world_from_crop) @ trials.world_from_hand[trials.scene_of == 0]
        apart = np.abs(own[:, None] - tried[None]).max(axis=(2, 3)).min(axis=1)
        assert apart.max() < 1e-6
        found.append(flipped)
    assert len(set(found)) == 2


def _same(batch: HeadBatch, volume: NDArray[np.uint8]) -> bool:
    """Whether a batch of one shows a view, or its mirror image."""
    shown = batch.volumes[0].numpy()
    return np.array_equal(shown, volume) or np.array_equal(shown, volume[:, :, ::-1])


def volumes(count: int) -> Any:
    """Draw channels at random."""
    shape = (count, 2, *(CropConfig().resolution,) * 3)
    return torch.from_numpy(np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8))


def test_logits_between_anchors_are_those_of_the_anchors_at_the_anchors() -> None:
    torch.manual_seed(0)
    net, given = AnchorNet(3, SMALL).eval(), volumes(3)
    rng = np.random.default_rng(0)
    index, of = rng.integers(len(net.anchors), size=60), rng.integers(3, size=60)
    preshape, height, roll, x, y = np.unravel_index(index, net.anchors.shape)
    place = np.stack([x, y, height, roll], axis=1).astype(np.float64)
    with torch.no_grad():
        logits, features = net(given).flatten(2), net.seen(given)
        found = net.values(features, AnchorSamples.of(of, place, preshape))
        torch.testing.assert_close(found, logits[of, :, index], rtol=1e-4, atol=1e-5)
        # Between two heights they are on a straight line, and a full turn leads back.
        place[:, 2] = np.minimum(place[:, 2], net.anchors.shape[1] - 2)
        steps = np.array([[0, 0, 0, 0], [0, 0, 0.25, 0], [0, 0, 1, 0], [0, 0, 0, net.anchors.shape[2]]])
        ends = [net.values(features, AnchorSamples.of(of, place + step, preshape)) for step in steps]
        torch.testing.assert_close(ends[1], 0.75 * ends[0] + 0.25 * ends[2], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(ends[3], ends[0], rtol=1e-4, atol=1e-4)


def test_a_turned_scene_has_turned_logits() -> None:
    """Features that turn with the scene give the anchors that turn with it the same logits, for any weights."""
    torch.manual_seed(0)
    net = AnchorNet(3, SMALL).eval()
    side, (_, _, rolls, cells, _) = CropConfig().resolution // 2, net.anchors.shape
    features = torch.rand(2, SMALL.features, side, side)
    features[1] = features[0].rot90(1, (1, 2))  # x to y: a quarter turn to the left
    rng = np.random.default_rng(0)
    place, preshape = rng.uniform(0, [cells - 1, cells - 1, 13, rolls], (50, 4)), rng.integers(3, size=50)
    middle = 0.5 * (cells - 1)
    turned = place.copy()
    turned[:, 0], turned[:, 1] = middle - (place[:, 1] - middle), place[:, 0]
    turned[:, 3] = place[:, 3] + rolls / 4
    with torch.no_grad():
        first = net.values(features, AnchorSamples.of(np.zeros(50, dtype=np.int64), place, preshape))
        second = net.values(features, AnchorSamples.of(np.ones(50, dtype=np.int64), turned, preshape))
    torch.testing.assert_close(first, second, rtol=1e-4, atol=1e-5)
    assert float(first.std(0).min()) > 1e-4


def test_the_best_anchor_is_chosen_and_its_residual_applied() -> None:
    torch.manual_seed(0)
    net = AnchorNet(3, SMALL).eval()
    volume = np.random.default_rng(1).integers(0, 256, (3, *(CropConfig().resolution,) * 3), dtype=np.uint8)
    given = torch.from_numpy(volume[None])
    with torch.no_grad():
        reached, success, secure = torch.sigmoid(net(given))[0].double().numpy()
        scores = reached * (success + 0.5 * secure) / 1.5
        best = np.argsort(-scores.ravel())[:4]
        offsets = net.residuals_at(net.seen(given), torch.zeros(4, dtype=torch.int64), torch.from_numpy(best))
    found = net.candidates(volume, 4)
    np.testing.assert_allclose(found.scores, scores.ravel()[best], rtol=1e-5)
    bounds = [0.5] * 4 + [1.0] * 2
    poses, preshape = net.anchors.decode(best, np.clip(offsets.double().numpy(), np.negative(bounds), bounds))
    np.testing.assert_allclose(found.poses, poses, atol=1e-6)
    np.testing.assert_array_equal(found.preshape, preshape)


def test_the_own_choices_of_a_head_are_looked_up(trials: GraspTrials, grid: HandGrid) -> None:
    torch.manual_seed(0)
    drawn = sampler(trials, grid)
    batch, net = drawn.sample(0, np.arange(4), 40), AnchorNet(3, SMALL).eval()
    features = net.seen(batch.volumes)
    best = net.best_of_each(features[:1]).numpy()
    logits = torch.nn.functional.logsigmoid(net(batch.volumes[:1]))[0].detach().numpy()
    scores = logits[0] + logits[1]
    preshape, height, roll, x, y = np.unravel_index(best, net.anchors.shape)
    assert sorted(zip(preshape.tolist(), roll.tolist(), strict=True)) == [(p, r) for p in range(3) for r in range(16)]
    np.testing.assert_allclose(scores[preshape, height, roll, x, y], scores.max(axis=(1, 3, 4)).ravel(), rtol=1e-5)
    # Where none of them is reached, the loss drives the logits of reach down.
    blocked = replace(batch, solids=np.full_like(batch.solids, 255))
    anchor_losses(net, blocked, drawn)["chosen"].backward()
    assert float(net.logits.bias.grad[: 3 * net.anchors.shape[1]].min()) >= 0.0
    assert float(net.logits.bias.grad.max()) > 0.0
    assert "chosen" not in anchor_losses(net, batch)


def test_a_head_learns_one_batch_by_heart(trials: GraspTrials, grid: HandGrid) -> None:
    torch.manual_seed(0)
    batch = sampler(trials, grid).sample(0, np.arange(4), 40)
    net = AnchorNet(3, replace(SMALL, width=16, hidden=64))
    optimizer = torch.optim.Adam(net.parameters(), 5e-3)
    first = {name: float(loss.detach()) for name, loss in anchor_losses(net, batch).items()}
    for _ in range(120):
        optimizer.zero_grad()
        torch.stack(list(anchor_losses(net, batch).values())).sum().backward()
        optimizer.step()
    losses = {name: float(loss.detach()) for name, loss in anchor_losses(net, batch).items()}
    with torch.no_grad():
        logits = net.values(net.seen(batch.volumes), batch.trials)[:, 1]
    right = (logits > 0) == (batch.success[batch.inside] > 0.5)
    assert float(right.float().mean()) > 0.97
    assert losses["reached"] < 0.5 * first["reached"]
    assert losses["residual"] < first["residual"]


def test_a_head_is_trained_resumed_and_loaded(tmp_path: Path, trials: GraspTrials, grid: HandGrid) -> None:
    data = HeadData.of(trials, trials, grid, SMALL.anchors, SCENES)
    settings: dict[str, Any] = {"batch_size": 2, "max_steps": 4, "validate_every": 2}

    def train(folder: str, **changed: Any) -> str:
        config = TrainConfig(**settings | changed)
        return train_head(tmp_path / folder, data, SMALL, config).reason

    assert train("whole") == "steps"
    assert train("parts", max_seconds=1e-3) == "time"
    assert train("parts") == "steps"
    # At their end, not at their best, which depends on when they were validated.
    ends = [torch.load(tmp_path / name / "checkpoint.pt", weights_only=True)["net"] for name in ("whole", "parts")]
    torch.testing.assert_close(ends[0], ends[1], rtol=0, atol=0)
    rows = Rows(tmp_path / "whole" / "losses.jsonl")
    assert [row["step"] for row in rows] == [2, 4]
    for row in rows:
        assert 0.0 <= row["secure"] <= row["success"] <= 1.0
        assert row["held"] == pytest.approx(0.5 * (row["secure"] + row["success"]))
        assert row["auc"] >= 0.0
    policy = TrainedHead(tmp_path / "whole")
    assert policy.obs == ("depth", "proprio")
    result = evaluation.evaluate(policy, objects="procedural:can:0", trials=2, seed=0, num_envs=2)
    again = evaluation.evaluate(policy, objects="procedural:can:0", trials=2, seed=0, num_envs=1)
    assert result.trials == again.trials
    with pytest.raises(errors.ConfigError, match="begun with other settings: width was 8, is now 16"):
        train_head(tmp_path / "whole", data, replace(SMALL, width=16))
    with pytest.raises(errors.ConfigError, match="pass both the same"):
        train_head(tmp_path / "whole", data, replace(SMALL, anchors=AnchorConfig()))


class Central:
    """Knows one grasp: straight down on the middle of the visible surface, after one inside the object."""

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Give one grasp, or both."""
        filled = np.flatnonzero((volume[0] >= 64).any(axis=(0, 1)))
        top = CropConfig().origin[2] + (filled[-1] + 1) * CropConfig().voxel_size
        poses = np.tile(np.eye(4), (2, 1, 1))
        poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
        poses[:, 2, 3] = top + np.array([-0.02, 0.03])
        order = [0, 1] if count > 1 else [1]
        return Candidates(poses[order], np.zeros(len(order), dtype=np.int64), np.array([0.9, 0.8])[order])


def central(filtered: bool = False) -> DepthPolicy:
    """Make a policy that takes the grasp of `Central`; it needs no weights."""
    return DepthPolicy(
        partial(Observer, noise=DepthNoise.none()),
        lambda hand: HeadFinder(HandGrid(hand), Central(), filtered=filtered),
    )


@pytest.mark.parametrize("filtered", [False, True])
def test_it_does_what_the_head_says(filtered: bool) -> None:
    policy = central(filtered)
    result = evaluation.evaluate(policy, objects="procedural:can:0-3", trials=4, seed=0, num_envs=4)
    assert result.succeeded >= 3
    found = policy.found[0]
    assert found is not None
    # The filter leaves out the grasp in which the palm is inside the object.
    assert found.score == 0.8
    assert set(found.seconds) == {"crop", "complete", "propose"}


def test_in_the_closed_loop_the_hand_goes_there() -> None:
    result = evaluation.evaluate(central(), "graspbox/Grasp-v0", "procedural:can:1", trials=1, seed=1, num_envs=1)
    assert result.succeeded == 1


def test_what_is_no_head_is_refused(tmp_path: Path) -> None:
    with pytest.raises(errors.ConfigError, match="run graspbox train head"):
        load_head(tmp_path, 3)
    (tmp_path / "head.json").write_text('{"depth": 3}')
    with pytest.raises(errors.ConfigError, match="no field 'depth'"):
        load_head(tmp_path, 3)
    (tmp_path / "head.json").write_text('{"width": 8}')
    with pytest.raises(errors.ConfigError, match="no weights"):
        load_head(tmp_path, 3)
    for changed in ({"width": 0}, {"secure": -1.0}):
        with pytest.raises(errors.ConfigError, match=next(iter(changed))):
            HeadConfig(**changed)
