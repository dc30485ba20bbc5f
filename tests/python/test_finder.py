"""Grasps of a head joined with geometric proposals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.learn.models.scene_trials import render_scene
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.perception import HandGrid, ProposalConfig
from graspbox.perception.anchors import Candidates
from graspbox.perception.configs import FinderConfig, SeenConfig
from graspbox.perception.crops import Crops
from graspbox.perception.depth_views import Seen
from graspbox.perception.finder import FoundGrasp, GraspFinder, Query, observed_only
from graspbox.perception.outputs import Judged
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.scoring import Score

CONFIG = FinderConfig(ProposalConfig(most=24), predicted=3, refinements=0)


class Ladder:
    """Predicts grasps straight down over the crop's middle: two inside the object, then ever higher ones."""

    def __init__(self, top: float) -> None:
        self.asked, self._top = 0, top

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Give as many as it is asked for."""
        del volume
        self.asked = count
        heights = self._top + np.concatenate([[-0.03, -0.02], 0.02 + 0.002 * np.arange(count - 2)])
        poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (count, 1, 1))
        poses[:, 2, 3] = heights
        return Candidates(poses, np.zeros(count, dtype=np.int64), np.linspace(1.0, 0.5, count))


@pytest.fixture(scope="module")
def crops() -> Crops:
    sampler = SceneSampler(object_sets.load("procedural:can:0"), SceneConfig(), 0)
    seen = render_scene(sampler, 0, np.random.default_rng(0), load_hand())
    assert seen.crops is not None
    return seen.crops


def top_of(crops: Crops) -> float:
    """Height of the highest voxel that is seen, metres."""
    config = SceneConfig().crop
    filled = np.flatnonzero((crops.channels[0, 0] >= 64).any(axis=(0, 1)))
    return float(config.origin[2] + (filled[-1] + 1) * config.voxel_size)


def highest(
    volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Score by height."""
    del volume, preshapes
    return np.asarray(poses[:, 2, 3])


def decide(crops: Crops, config: FinderConfig, head: Ladder | None, score: Score = highest) -> FoundGrasp:
    found = GraspFinder(HandGrid(), observed_only, score, config, head=head).find(Seen(crops))
    assert found is not None
    return found


def test_the_best_that_the_hand_reaches_are_scored_too(crops: Crops) -> None:
    head = Ladder(top_of(crops))
    alone, both = decide(crops, CONFIG, None), decide(crops, CONFIG, head)
    assert head.asked > CONFIG.predicted
    # Those of geometry come first and are unchanged, then the head's, best first, without the two inside the object.
    assert len(both.scores) == len(alone.scores) + CONFIG.predicted
    np.testing.assert_array_equal(both.poses[: len(alone.poses)], alone.poses)
    added = both.poses[len(alone.poses) :, 2, 3]
    np.testing.assert_allclose(added, top_of(crops) + np.array([0.02, 0.022, 0.024]))
    assert (both.preshapes[len(alone.poses) :] == HandGrid().preshapes[0]).all()


def test_a_grasp_of_the_head_is_chosen_where_it_scores_best(crops: Crops) -> None:
    found = GraspFinder(
        HandGrid(),
        observed_only,
        lambda volume, poses, preshapes: -np.linalg.norm(poses[:, :2, 3], axis=1) - np.abs(poses[:, 2, 2] + 1),
        CONFIG,
        head=Ladder(top_of(crops)),
    ).find(Seen(crops))
    assert found is not None
    np.testing.assert_allclose(found.world_from_hand[:2, 3], found.world_from_crop[:2, 3], atol=1e-12)


def test_without_predictions_the_head_is_not_asked(crops: Crops) -> None:
    head = Ladder(top_of(crops))
    alone, none = decide(crops, CONFIG, None), decide(crops, replace(CONFIG, predicted=0), head)
    assert head.asked == 0
    np.testing.assert_array_equal(none.poses, alone.poses)


def test_the_head_is_asked_only_where_geometry_proposes_too_few(crops: Crops) -> None:
    alone = decide(crops, CONFIG, None)
    count = len(alone.poses)
    assert 0 < count <= CONFIG.proposals.most
    for enough, asks in ((count, False), (count + 1, True), (0, False), (None, True)):
        head = Ladder(top_of(crops))
        found = decide(crops, replace(CONFIG, enough=enough), head)
        assert (head.asked > 0, len(found.poses)) == (asks, count + CONFIG.predicted * asks), enough
    with pytest.raises(ConfigError, match=r"enough is -1 \(int\); give a number from 0 to 1024"):
        FinderConfig(enough=-1)


def test_grasps_near_the_middle_of_an_object_win_where_levers_count(crops: Crops) -> None:
    """Scores are those of the scorer less the penalty: a score that is a little better elsewhere does not decide."""

    def prefers_the_end(
        volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        del volume, preshapes
        return np.asarray(0.5 + 0.1 * poses[:, 0, 3])

    def levers(found: FoundGrasp) -> NDArray[np.float64]:
        return HandGrid().levers(found.occupancy, found.poses, found.preshapes)

    settings = replace(CONFIG, predicted=0, refinements=0)
    free = decide(crops, settings, None, prefers_the_end)
    held = decide(crops, replace(settings, lever_penalty=4.0), None, prefers_the_end)
    np.testing.assert_array_equal(free.poses, held.poses)
    np.testing.assert_allclose(held.scores, free.scores - 4.0 * levers(free), atol=1e-12)
    assert levers(held)[held.chosen] < levers(free)[free.chosen] - 0.005
    erring = replace(settings, lever_penalty=4.0, hand_error=PoseNoise(0.001, 0.01), neighbours=0)
    assert decide(crops, erring, None, prefers_the_end).score == pytest.approx(held.score, abs=0.02)
    with pytest.raises(ConfigError, match=r"lever_penalty is -1.0 \(float\); give a number from 0 to 100"):
        FinderConfig(lever_penalty=-1.0)


def test_a_hand_that_errs_takes_a_good_grasp_among_good_ones(crops: Crops) -> None:
    """Not the best one, if those beside it are bad."""
    proposed = decide(crops, CONFIG, None).poses[:, :3, 3]
    apart = np.linalg.norm(proposed[:, None] - proposed, axis=2)
    peak, middle = np.unravel_index(np.argmax(apart), apart.shape)
    assert apart.max() > 0.05

    def score(
        volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        del volume, preshapes
        to_peak, to_middle = (np.linalg.norm(poses[:, :3, 3] - proposed[i], axis=1) for i in (peak, middle))
        return np.where(to_peak < 1e-4, 1.0, np.where(to_middle < 0.02, 0.8, 0.1))

    def chosen(config: FinderConfig) -> NDArray[np.float64]:
        found = GraspFinder(HandGrid(), observed_only, score, config).find(Seen(crops))
        assert found is not None
        assert found.score == found.scores.max() <= (1.0 if config.hand_error is None else 0.8)
        return np.asarray(found.poses[found.chosen][:3, 3])

    refined = replace(CONFIG, refinements=2)
    np.testing.assert_allclose(chosen(refined), proposed[peak], atol=1e-4)
    tolerant = CONFIG.tolerating(PoseNoise(0.005, 0.05))
    assert tolerant == replace(refined, hand_error=PoseNoise(0.005, 0.05))
    assert np.linalg.norm(chosen(tolerant) - proposed[middle]) < 0.02
    np.testing.assert_array_equal(chosen(tolerant), chosen(tolerant))


def test_without_errors_the_mean_is_the_score(crops: Crops) -> None:
    still = replace(CONFIG, hand_error=PoseNoise(0.0, 0.0), finalists=5)
    found, alone = decide(crops, still, None), decide(crops, CONFIG, None)
    assert len(found.scores) == 5
    np.testing.assert_allclose(found.scores, np.sort(alone.scores)[::-1][:5])
    assert "average" in found.seconds
    assert "average" not in alone.seconds


@pytest.mark.parametrize(("values", "said"), [((4, 0.07), "position .* metres"), ((0.004, 10), "rotation .* radians")])
def test_errors_in_other_units_are_refused(values: tuple[float, float], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        PoseNoise(*values)
    with pytest.raises(ConfigError):
        PoseNoise(float("nan"))


def test_the_hand_avoids_what_is_seen_where_the_completion_lacks_it(crops: Crops) -> None:
    """The completion forgets the upper half of the can."""
    crop = SceneConfig().crop
    middle = int((top_of(crops) / 2 - crop.origin[2]) / crop.voxel_size)

    def lower(volumes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        completed = observed_only(volumes).copy()
        completed[..., middle:] = 0
        return completed

    def touching(config: FinderConfig) -> int:
        grid = HandGrid(load_hand("leap"))
        found = GraspFinder(grid, lower, highest, config).find(Seen(crops))
        assert found is not None
        surface = np.where(crops.channels[0, 0] >= 128, np.uint8(255), np.uint8(0))
        return int((~grid.meets(surface, found.poses, found.preshapes)[0]).sum())

    assert touching(CONFIG) > 0
    assert touching(replace(CONFIG, seen=SeenConfig())) == 0
    # A hand with fewer fingers leaves it out.
    assert touching(replace(CONFIG, seen=SeenConfig(fingers=5))) == touching(CONFIG)
    with pytest.raises(ConfigError, match="surface is 0"):
        SeenConfig(surface=0)


def test_grasps_keep_off_what_is_known_to_stand_there(crops: Crops) -> None:
    """A wall beside the can: grasps do not touch it; where a block takes all the room, they may."""
    grid, frame = HandGrid(), crops.world_from_crop[0]
    free = GraspFinder(grid, observed_only, highest, CONFIG)
    every = free.find(Seen(crops))
    assert every is not None

    def touched(found: FoundGrasp, obstacles: NDArray[np.float64]) -> int:
        local = (obstacles - frame[:3, 3]) @ frame[:3, :3]
        nothing = np.zeros_like(found.occupancy)
        return int((~grid.meets(nothing, found.poses, found.preshapes, obstacles=local)[0]).sum())

    side, height = np.meshgrid(np.linspace(-0.2, 0.2, 60), np.linspace(0.0, 0.25, 40))
    wall = np.stack([np.full_like(side, 0.07), side, height], axis=-1).reshape(-1, 3) @ frame[:3, :3].T + frame[:3, 3]
    careful = free.find(Seen(crops), Query(keep_off=wall))
    assert careful is not None
    assert touched(every, wall) > 0
    assert touched(careful, wall) == 0
    block = np.stack(np.meshgrid(*[np.linspace(-0.3, 0.3, 40)] * 2, np.linspace(0.0, 0.4, 40)), axis=-1).reshape(-1, 3)
    cornered = free.find(Seen(crops), Query(keep_off=block + frame[:3, 3]))
    assert cornered is not None
    np.testing.assert_array_equal(cornered.poses, every.poses)


def test_each_attempt_that_failed_is_avoided(crops: Crops) -> None:
    finder = GraspFinder(HandGrid(), observed_only, highest, CONFIG)
    first = finder.find(Seen(crops))
    assert first is not None
    second = finder.find(Seen(crops), Query(failed=(first,)))
    assert second is not None
    third = finder.find(Seen(crops), Query(failed=(first, second)))
    assert third is not None
    assert len({found.chosen for found in (first, second, third)}) == 3


class Recorder:
    """A trained scorer that keeps the grasps it is asked for."""

    def __init__(self) -> None:
        self.asked: list[bytes] = []

    def judge(self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> Judged:
        """Judge by height."""
        self.asked += [pose.tobytes() + preshape.tobytes() for pose, preshape in zip(poses, preshapes, strict=True)]
        success = 1.0 / (1.0 + np.exp(-highest(volume, poses, preshapes)))
        return Judged(success, success, 0.5 * success, np.zeros((len(poses), 2)))

    judge_each = judge

    def __call__(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Score by height."""
        return self.judge(volume, poses, preshapes).choice


def test_no_grasp_is_scored_twice(crops: Crops) -> None:
    scorer = Recorder()
    found = decide(crops, replace(CONFIG, refinements=2), None, scorer)
    assert len(scorer.asked) == len(set(scorer.asked)) == len(found.scores)
    assert found.success == found.score
    assert len(scorer.asked) == len(found.scores)
    # Under errors of the hand, probabilities stay those of a hand without.
    erring = decide(crops, replace(CONFIG, hand_error=PoseNoise(0.005, 0.05), refinements=2), None, Recorder())
    assert erring.judged is not None
    expected = 1.0 / (1.0 + np.exp(-erring.poses[:, 2, 3]))
    np.testing.assert_array_equal(erring.judged.success, expected)
