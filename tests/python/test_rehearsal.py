"""Grasps tried in simulation on the completed shape, before the robot moves."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import tiny_policy
from graspbox import object_sets, policies
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.learn.models.scene_trials import RenderedScene, render_scene
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.perception import HandGrid, PoseNoise, ProposalConfig
from graspbox.perception.configs import CropConfig, FinderConfig, RehearsalConfig
from graspbox.perception.crops import OCCUPIED
from graspbox.perception.depth_views import Seen
from graspbox.perception.finder import FoundGrasp, GraspFinder, Query
from graspbox.perception.shapes import Rehearsal, rehearsed_score, rehearsed_success, surface_of
from graspbox.policies.published.folders import read_depth_policy, save

CROP = CropConfig()
CONFIG = FinderConfig(ProposalConfig(most=48), predicted=0, refinements=0, rehearsal=RehearsalConfig(grasps=48))


@pytest.fixture(scope="module")
def scene() -> RenderedScene:
    sampler = SceneSampler(object_sets.load("procedural:can:0"), SceneConfig(), 0)
    seen = render_scene(sampler, 0, np.random.default_rng(0), load_hand())
    assert seen.crops is not None
    assert seen.scene is not None
    return seen


def highest(
    volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Prefer grasps with the palm up high, from where the fingers hardly reach the object."""
    del volume, preshapes
    return np.asarray(np.clip(poses[:, 2, 3], 0.0, 1.0))


def decide(scene: RenderedScene, config: FinderConfig, *, order: bool = True) -> FoundGrasp:
    finder = GraspFinder(HandGrid(), scene.true_occupancy, highest, config)
    assert scene.crops is not None
    found = finder.find(Seen(scene.crops), Query(order=order))
    assert found is not None
    return found


def outcomes(scene: RenderedScene, found: FoundGrasp, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Try grasps on the object itself."""
    assert scene.scene is not None
    object_from_crop = np.linalg.inv(scene.world_from_object) @ found.world_from_crop
    return scene.scene.simulate(object_from_crop @ found.poses[rows], found.preshapes[rows]).success


def ball(radius: float, height: float) -> NDArray[np.uint8]:
    """Fill a ball in the middle of the crop, its centre at a height, metres."""
    axes = (np.asarray(CROP.origin)[:, None] + (np.arange(CROP.resolution) + 0.5) * CROP.voxel_size).tolist()
    x, y, z = np.meshgrid(*axes, indexing="ij")
    return np.where(np.sqrt(x**2 + y**2 + (z - height) ** 2) < radius, 255, 0).astype(np.uint8)


def test_trials_on_the_true_shape_agree_with_the_object(scene: RenderedScene) -> None:
    """The completion is the truth here: what holds in the rehearsal holds on the object, what fails fails."""
    found = decide(scene, CONFIG)
    assert found.rehearsed is not None
    tried = np.flatnonzero(~np.isnan(found.rehearsed))
    assert len(tried) >= 12
    held = outcomes(scene, found, tried)
    sure = np.abs(found.rehearsed[tried] - 0.5) > 0.4
    assert sure.sum() >= 6
    assert (held == (found.rehearsed[tried] > 0.5))[sure].mean() >= 0.8


def test_a_rehearsal_outvotes_a_wrong_score(scene: RenderedScene) -> None:
    trusting = replace(CONFIG, rehearsal=RehearsalConfig(grasps=48, trials=3, gain=8.0))
    misled, found = decide(scene, replace(CONFIG, rehearsal=None)), decide(scene, trusting)
    assert misled.rehearsed is None
    assert found.rehearsed is not None
    np.testing.assert_array_equal(found.poses, misled.poses)
    assert found.rehearsed[found.chosen] == np.nanmax(found.rehearsed)
    assert found.rehearsed[found.chosen] > found.rehearsed[misled.chosen]
    assert outcomes(scene, found, np.array([found.chosen])).all()
    assert "rehearse" in found.seconds


def test_grasps_without_trials_stay_behind(scene: RenderedScene) -> None:
    found = decide(scene, replace(CONFIG, rehearsal=RehearsalConfig(grasps=2)))
    assert found.rehearsed is not None
    tried = ~np.isnan(found.rehearsed)
    assert tried.sum() == 2
    assert found.scores[tried].min() >= found.scores[~tried].max()


@pytest.mark.parametrize(("slope", "gain"), [(0.55, 1.65), (0.0, 1.65), (2.0, 1.0)])
def test_trials_end_once_nothing_better_can_come(scene: RenderedScene, slope: float, gain: float) -> None:
    """The choice is that of all trials; where scores weigh much, few are needed, and where they weigh nothing, all."""
    config = replace(CONFIG, rehearsal=RehearsalConfig(grasps=48, slope=slope, gain=gain))
    every, few = decide(scene, config), decide(scene, config, order=False)
    assert few.rehearsed is not None
    assert every.rehearsed is not None
    assert (few.chosen, few.score) == (every.chosen, every.score)
    tried = ~np.isnan(few.rehearsed)
    np.testing.assert_array_equal(few.rehearsed[tried], every.rehearsed[tried])
    assert 0 < tried.sum() <= np.isfinite(every.rehearsed).sum()
    if slope == 2.0:
        assert tried.sum() < np.isfinite(every.rehearsed).sum()
    if slope == 0.0:
        assert tried.sum() == np.isfinite(every.rehearsed).sum()


def test_the_same_image_gives_the_same_bits(scene: RenderedScene) -> None:
    first, again = decide(scene, CONFIG), decide(scene, CONFIG)
    np.testing.assert_array_equal(first.scores, again.scores)
    config, hand = RehearsalConfig(), load_hand()
    shares = []
    for threads in (1, 2):
        rehearsal = Rehearsal.of(first.occupancy, CROP, hand, config, num_threads=threads)
        assert rehearsal is not None
        shares.append(rehearsal.shares(first.poses[:6], first.preshapes[:6]))
    np.testing.assert_array_equal(shares[0], shares[1])


def test_a_shape_stands_on_the_table_with_the_mass_of_its_volume() -> None:
    config = RehearsalConfig(thresholds=(64, 128), density=1000.0)
    rehearsal = Rehearsal.of(ball(0.03, 0.05), CROP, load_hand(), config)
    assert rehearsal is not None
    assert len(rehearsal.scenes) == 2
    wide, narrow = (np.ptp(scene.mesh.vertices, axis=0) for scene in rehearsal.scenes)
    assert (wide > narrow).all()
    for scene in rehearsal.scenes:
        assert scene.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(scene.world_from_object, np.eye(4), atol=1e-9)
        assert scene.mesh.mass == pytest.approx(1000.0 * 4 / 3 * np.pi * 0.03**3, rel=0.05)


def test_a_heavy_object_slips_where_a_light_one_is_held(scene: RenderedScene) -> None:
    """Each trial is repeated with the greater mass; a mass below the shape's own repeats nothing."""
    found = decide(scene, CONFIG)
    assert found.rehearsed is not None
    best = np.argsort(-np.nan_to_num(found.rehearsed))[:4]
    shares = {}
    for heavy in (0.0, 10.0):
        rehearsal = Rehearsal.of(found.occupancy, CROP, load_hand(), RehearsalConfig(heavy=heavy))
        assert rehearsal is not None
        shares[heavy] = rehearsal.shares(found.poses[best], found.preshapes[best])
    assert (shares[0.0] > 0.7).all()
    # No grasp of the ReFlex hand lifts 10 kg: that half of the trials fails.
    np.testing.assert_allclose(shares[10.0], shares[0.0] / 2, atol=1e-12)


def test_masses_are_lifted_by_one_closed_hand(scene: RenderedScene) -> None:
    """The first mass is that of an ordinary trial; a mass that is lost is lost for all after it."""
    assert scene.scene is not None
    found = decide(scene, CONFIG)
    object_from_crop = np.linalg.inv(scene.world_from_object) @ found.world_from_crop
    poses, preshapes = object_from_crop @ found.poses[:12], found.preshapes[:12]
    plain = scene.scene.simulate(poses, preshapes)
    success, secure = scene.scene.simulate_masses(poses, preshapes, [1.0, 3.0, 100.0])
    np.testing.assert_array_equal(success[:, 0], plain.success)
    np.testing.assert_array_equal(secure[:, 0], plain.secure)
    assert 0 < success[:, 0].sum() < len(poses)
    assert not (np.diff(success.astype(int), axis=1) > 0).any()
    assert not success[:, 2].any()
    assert not (secure & ~success).any()
    with pytest.raises(ConfigError, match=r"number of masses. is 0"):
        scene.scene.simulate_masses(poses, preshapes, [])
    with pytest.raises(ConfigError, match=r"mass factor. is 0"):
        scene.scene.simulate_masses(poses, preshapes, [0.0, 1.0])
    with pytest.raises(ConfigError, match=r"masses are \[3.0, 1.0\]; pass the lightest first"):
        scene.scene.simulate_masses(poses, preshapes, [3.0, 1.0])


def test_an_error_of_the_hand_makes_trials_fail(scene: RenderedScene) -> None:
    """Good grasps fail with errors that no grasp tolerates; a finder for such a hand knows them."""
    found = decide(scene, CONFIG)
    assert found.rehearsed is not None
    best = np.argsort(-np.nan_to_num(found.rehearsed))[:4]
    shares, config = [], RehearsalConfig(trials=9)
    for error in (PoseNoise(0.0, 0.0), PoseNoise(0.05, 0.5)):
        rehearsal = Rehearsal.of(found.occupancy, CROP, load_hand(), config, error=error)
        assert rehearsal is not None
        shares.append(rehearsal.shares(found.poses[best], found.preshapes[best]))
    assert (shares[1] < shares[0]).all()
    wild = decide(scene, replace(CONFIG, hand_error=PoseNoise(0.05, 0.5), finalists=16, neighbours=0))
    assert wild.rehearsed is not None
    assert np.nanmax(wild.rehearsed) < np.nanmax(found.rehearsed)


@pytest.mark.parametrize("filled", [0, 1])
def test_a_volume_without_a_shape_changes_no_score(filled: int) -> None:
    volume = np.zeros((CROP.resolution,) * 3, dtype=np.uint8)
    volume[:filled] = OCCUPIED - 1
    assert Rehearsal.of(volume, CROP, load_hand(), RehearsalConfig(thresholds=(64,))) is None
    assert surface_of(volume, CROP) is None
    assert (surface_of(volume, CROP, threshold=OCCUPIED - 1) is None) == (filled == 0)


def test_scores_rise_with_the_score_and_with_the_share() -> None:
    config = RehearsalConfig()
    scores, shares = np.meshgrid(np.linspace(-0.5, 1.5, 21), np.linspace(0.0, 1.0, 11), indexing="ij")
    joined = rehearsed_score(scores.ravel(), shares.ravel(), config).reshape(scores.shape)
    assert ((joined > 0.0) & (joined < 1.0)).all()
    assert (np.diff(joined, axis=1) > 0.0).all()
    assert (np.diff(joined, axis=0) >= 0.0).all()
    logit = np.log(0.8 / 0.2)
    known = 1 / (1 + np.exp(-(config.offset + config.slope * logit + config.gain * 0.5)))
    assert rehearsed_score(np.array([0.8]), np.array([0.5]), config)[0] == pytest.approx(known)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"grasps": 0}, "grasps is 0 .*; give a number from 1 to 256"),
        ({"trials": 100}, "trials is 100 .*; give a number from 1 to 64"),
        ({"density": 0.5}, "density is 0.5 .*; give a number from 10"),
        ({"thresholds": ()}, r"thresholds is \(\); pass 1 to 16 numbers of 1 to 255"),
        ({"thresholds": (0, 64)}, r"thresholds is \(0, 64\); pass 1 to 16 numbers"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        RehearsalConfig(**wrong)  # type: ignore[arg-type]


def test_a_policy_rehearses_if_it_is_asked_to(tmp_path: Path) -> None:
    tiny_policy.make(tmp_path)
    policy = policies.load(tmp_path, rehearsed=3)
    assert isinstance(policy, policies.DepthGrasp)
    envs = gymnasium.make_vec("graspbox/GraspPose-v0", 1, objects="procedural:can:0", obs=policy.obs, **policy.settings)
    policy.bind(policies.Task.of(envs))
    observation, info = envs.reset(seed=0)
    policy.reset(seed=0, info=info)
    policy.act(observation)
    found, confidence = policy.found[0], policy.confidence(0)
    envs.close()
    assert found is not None
    assert found.rehearsed is not None
    assert 1 <= (~np.isnan(found.rehearsed)).sum() <= 3
    assert confidence is not None
    assert 0.0 < confidence < 1.0


def test_only_policies_that_score_grasps_of_single_objects_rehearse(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the policy 'top_down' rehearses no grasps; take one of a depth image"):
        policies.load("top_down", rehearsed=8)
    head = tmp_path / "head"
    tiny_policy.make_head(head)
    with pytest.raises(ConfigError, match="of the kind 'head' does not take 'rehearsed'"):
        policies.load(head, rehearsed=8)
    tiny_policy.make(tmp_path / "depth")
    policy = policies.load(tmp_path / "depth", rehearsed=8)
    envs = gymnasium.make_vec("graspbox/Clear-v0", 1, objects="procedural:can:0-3", obs=policy.obs, **policy.settings)
    with pytest.raises(ConfigError, match="rehearses grasps of a single object, and 'graspbox/Clear-v0'"):
        policy.bind(policies.Task.of(envs))
    envs.close()
    policies.load(tmp_path / "depth", rehearsed=0)


def test_a_policy_that_rehearses_by_its_folder_does_so_with_single_objects(tmp_path: Path) -> None:
    tiny_policy.make(tmp_path)
    published = read_depth_policy(tmp_path)
    save(tmp_path, replace(published, finder=published.finder.rehearsing(3)))
    policy = policies.load(tmp_path)
    assert isinstance(policy, policies.DepthGrasp)
    tried = {}
    for env_id, objects in (("GraspPose-v0", "procedural:can:0"), ("Clear-v0", "procedural:can:0-3")):
        envs = gymnasium.make_vec(f"graspbox/{env_id}", 1, objects=objects, obs=policy.obs, **policy.settings)
        policy.bind(policies.Task.of(envs))
        observation, info = envs.reset(seed=0)
        policy.reset(seed=0, info=info)
        policy.act(observation)
        envs.close()
        assert policy.found[0] is not None
        tried[env_id] = policy.found[0].rehearsed is not None
    assert tried == {"GraspPose-v0": True, "Clear-v0": False}


def test_the_probability_of_a_grasp_without_trials_is_that_of_the_scorer(scene: RenderedScene) -> None:
    config, success = RehearsalConfig(), np.array([0.9, 0.9, 0.2])
    stated = rehearsed_success(success, np.array([np.nan, 0.0, 1.0]), config)
    assert stated[0] == 0.9
    np.testing.assert_array_equal(stated[1:], rehearsed_score(success[1:], np.array([0.0, 1.0]), config))
    finder = GraspFinder(HandGrid(), scene.true_occupancy, highest, CONFIG)
    assert scene.crops is not None
    targeted = Seen(scene.crops, np.ones((CROP.resolution,) * 3, dtype=np.bool_))
    with pytest.raises(ConfigError, match="takes all that is seen for one object; rehearse none, or pass no target"):
        finder.find(targeted, Query(rehearsed=4))


def test_the_command_line_rehearses(tmp_path: Path) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")

    from command_line import invoke

    tiny_policy.make(tmp_path)
    words = ["evaluate", str(tmp_path), "--objects", "procedural:can:0", "--trials", "2", "--json"]
    plain, tried = (invoke([*words, "--rehearse", grasps]) for grasps in ("0", "4"))
    assert (plain.exit_code, tried.exit_code) == (0, 0), tried.output
    assert plain.output != tried.output
    refused = invoke([*words, "--rehearse", "1000"])
    assert refused.exit_code == 2
    served = invoke(["evaluate", "ws://localhost:1", "--rehearse", "8"])
    assert served.exit_code != 0
