"""`FeelThenLift`: sensor readings, releases, second looks and choices, and its folder."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
import tiny_policy
from graspbox import errors, evaluation, policies
from graspbox.perception import HandGrid
from graspbox.perception.finder import FoundGrasp
from graspbox.policies import FeelThenLift
from graspbox.policies.published.configs import FeelPolicyConfig
from graspbox.policies.published.folders import load, save, use_of
from graspbox.policies.stability_inputs import StabilityInputs, StabilityReading

pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
ENV = "graspbox/Grasp-v0"
CANS = "procedural:can:0-3"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a policy with a grasp-stability check."""
    made = tmp_path_factory.mktemp("feel") / "policy"
    tiny_policy.make_feel(made)
    return made


class Watched(FeelThenLift):
    """Keeps the segmentation of every look."""

    def __init__(self, folder: Path, threshold: float) -> None:
        super().__init__(folder, threshold=threshold)
        self.obs = (*self.obs, "segmentation")
        self.looks: list[Any] = []

    def act(self, observation: Any) -> Any:
        """Act as the policy does."""
        before = list(self.found)
        actions = super().act(observation)
        self.looks += [
            observation["segmentation"][env].copy()
            for env, (old, new) in enumerate(zip(before, self.found, strict=True))
            if old is not new
        ]
        return actions


def run(policy: FeelThenLift, trials: int = 1, **settings: Any) -> evaluation.Evaluation:
    return evaluation.evaluate(policy, ENV, CANS, trials=trials, seed=3, num_envs=trials, **settings)


def test_it_opens_looks_past_the_hand_and_takes_another_grasp(folder: Path) -> None:
    policy = Watched(folder, 2.0)
    once = Watched(folder, 0.0)
    results = run(policy, 2), run(once, 2)
    for env in range(2):
        first, second = policy.attempts[env]
        assert first.released
        # The second grasp is lifted in any case.
        assert not second.released
        (only,) = once.attempts[env]
        # Until it decides, both runs are the same.
        np.testing.assert_array_equal(only.readings, first.readings)
        assert only.probability == first.probability
        assert not only.released
        here, there = first.found.world_from_hand, second.found.world_from_hand
        turn = np.arccos(np.clip((np.trace(here[:3, :3].T @ there[:3, :3]) - 1) / 2, -1, 1))
        assert np.linalg.norm(here[:3, 3] - there[:3, 3]) > 0.02 or turn > 0.3
    assert len(policy.looks) == 4
    assert len(once.looks) == 2
    for seen in policy.looks:
        assert (seen == 2).any()
        assert not (seen >= 3).any()
    # The lowest grasp of a can pushes it or misses it; another one does not. Both attempts end within the time limit.
    twice, alone = results
    assert twice.succeeded > alone.succeeded
    assert all(150 < trial.steps < policy.settings["max_episode_steps"] for trial in twice.trials if trial.success)


def test_its_bits_do_not_depend_on_the_number_of_environments(folder: Path) -> None:
    wide = evaluation.evaluate(FeelThenLift(folder, threshold=2.0), ENV, CANS, trials=3, seed=1, num_envs=3)
    narrow = evaluation.evaluate(FeelThenLift(folder, threshold=2.0), ENV, CANS, trials=3, seed=1, num_envs=1)
    assert wide.trials == narrow.trials


def test_pairs_say_what_a_threshold_would_have_done(folder: Path) -> None:
    pytest.importorskip("torch", reason="trainings of policies need the extra 'train'")
    from graspbox.learn.recipes.feel.paired import at_threshold, run_pairs

    pairs = run_pairs(folder, CANS, 4, 5, num_envs=4)
    middle = float(np.sort(pairs.probability)[1:3].mean())
    policy = FeelThenLift(folder, threshold=middle)
    actual = evaluation.evaluate(policy, ENV, CANS, trials=4, seed=5, num_envs=4)
    found = at_threshold(pairs, middle)
    assert found["opened"] == 2
    assert found["succeeded"] == actual.succeeded
    assert found["secure"] == actual.secure
    opened = pairs.probability < middle
    expected = np.where(opened, pairs.second_steps, pairs.first_steps)
    assert [trial.steps for trial in actual.trials] == expected.tolist()


def test_the_threshold_with_most_successes_is_chosen() -> None:
    pytest.importorskip("torch", reason="trainings of policies need the extra 'train'")
    from graspbox.learn.recipes.feel.paired import PairedTrials, at_threshold, best_threshold

    rng = np.random.default_rng(0)
    probability = rng.uniform(size=4000)
    first = rng.uniform(size=4000) < probability
    second = rng.uniform(size=4000) < 0.6
    steps = np.full(4000, 100)
    pairs = PairedTrials(probability, first, second, first, second, steps, steps + 150)
    # To open pays where the first grasp holds less often than the second.
    assert best_threshold(pairs) == pytest.approx(0.6, abs=0.06)
    never, always = at_threshold(pairs, 0.0), at_threshold(pairs, 2.0)
    assert (never["opened"], always["opened"]) == (0, 4000)
    assert never["succeeded"] == first.sum()
    assert always["succeeded"] == second.sum()
    assert always["saved"] - always["lost"] == always["succeeded"] - never["succeeded"]
    sure = PairedTrials(probability, np.ones_like(first), second, first, second, steps, steps)
    assert at_threshold(sure, best_threshold(sure))["opened"] <= 0.1 * 4000


def test_sensor_readings_are_read_by_name() -> None:
    inputs = StabilityInputs(graspbox.load_hand("reflex"), (0.5, 1.0))
    env: Any = gymnasium.make(ENV, objects=CANS, obs=("proprio", "tactile")).unwrapped
    seen, _ = env.reset(seed=0)
    # 3 joints, 3 actuators with speeds and loads, 27 sensors.
    assert inputs.sensed(seen).shape == (39,)
    moved = {**seen, "proprio": seen["proprio"].copy()}
    moved["proprio"][:15] += 0.3
    np.testing.assert_array_equal(inputs.sensed(moved), inputs.sensed(seen))
    moved["tactile"] = seen["tactile"] + 1.0
    np.testing.assert_array_equal(inputs.sensed(moved)[12:], np.ones(27))
    reading = StabilityReading(inputs, grasp())
    assert [reading.add(time, seen) for time in (0.3, 0.5, 0.7, 1.0, 1.2)] == [False, False, False, True, False]
    assert reading.vector().shape == (19 + 2 * 39,)
    with pytest.raises(errors.ConfigError, match="ascending"):
        StabilityInputs(graspbox.load_hand("reflex"), (1.0, 0.5))


def test_a_hand_without_sensors_feels_its_joints() -> None:
    inputs = StabilityInputs(graspbox.load_hand("panda_gripper"))
    assert inputs.obs == ("proprio",)
    env: Any = gymnasium.make(ENV, objects=CANS, obs=("proprio",), hand="panda_gripper").unwrapped
    assert inputs.sensed(env.reset(seed=0)[0]).shape == (4,)


def grasp() -> FoundGrasp:
    """Make a grasp of a block of 6 x 6 x 10 cm from above."""
    crop = HandGrid().crop
    n = crop.resolution
    centers = (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * crop.voxel_size + np.array(crop.origin)
    inside = (np.abs(centers[:, :2]) < 0.03).all(axis=1) & (centers[:, 2] > 0) & (centers[:, 2] < 0.1)
    volume = np.zeros((3, n, n, n), dtype=np.uint8)
    volume[0] = (255 * inside).astype(np.uint8).reshape(n, n, n)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.15
    world = np.eye(4)
    world[:2, 3] = 0.1, -0.05
    return FoundGrasp(
        chosen=0,
        crop=crop,
        world_from_crop=world,
        object=np.zeros((4, 4), dtype=np.bool_),
        volume=volume,
        poses=np.stack([pose, pose]),
        preshapes=np.array([0.0, 1.5]),
        scores=np.array([0.7, 0.3]),
        seconds={},
    )


def test_what_is_known_of_a_grasp_is_in_the_frame_of_the_hand() -> None:
    inputs = StabilityInputs(graspbox.load_hand("reflex"))
    known = inputs.known(grasp())
    np.testing.assert_allclose(known[:5], [0.7, 0.7, 0.5, 0.02, 0.0], atol=1e-6)
    np.testing.assert_allclose(known[5:9], [0.15, 0.0, 0.0, -1.0], atol=1e-6)
    np.testing.assert_allclose(known[9], 0.36, rtol=0.1)
    # The block is 5 to 15 cm in front of the palm, in the middle.
    np.testing.assert_allclose(known[10:13], [0.0, 0.0, 0.1], atol=0.004)
    np.testing.assert_allclose(known[13:16], [-0.03, -0.03, 0.05], atol=0.007)
    other = inputs.known(grasp().other(1))
    np.testing.assert_allclose(other[[0, 1, 4]], [0.3, 0.7, 1.5], atol=1e-6)


def test_a_folder_that_feels_is_loaded_and_names_the_policy_that_chooses(folder: Path, tmp_path: Path) -> None:
    policy = policies.load(str(folder))
    assert isinstance(policy, FeelThenLift)
    assert policy.name == "tiny-feel"
    assert policy.threshold == load(folder, FeelPolicyConfig).threshold == 0.5
    with pytest.raises(errors.ConfigError, match="--env graspbox/Grasp-v0"):
        evaluation.evaluate(policy, "graspbox/GraspPose-v0", CANS, trials=1)
    made = tmp_path / "policy"
    config = tiny_policy.make_feel(made)
    tiny_policy.make(made / "chooser", learned_from=("procedural:can:0",))
    with pytest.raises(errors.ConfigError, match=r"uses\.depth\.policy is 'chooser', but .* differs from the policy"):
        policies.load(str(made))
    save(made, replace(config, uses={"depth": use_of(made, made / "chooser")}, learned_from=("ycb",)))
    assert policies.load(str(made)).learned_from == ("procedural:can:0-0", "ycb")
