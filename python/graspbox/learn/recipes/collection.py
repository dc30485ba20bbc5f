"""Collection of grasp trials from proposals: scenes are rendered; grasps proposed, chosen and simulated.

The folder of trials holds one file per scene, so that an interrupted collection resumes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.data.trials import manifest
from graspbox.data.trials.learned import evaluated_split
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.learn.models.scene_trials import render_scene
from graspbox.learn.models.scenes import SceneSampler
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.training.array_files import CORES, load_or_make_parts
from graspbox.object_sets import ObjectSet, learned_sets
from graspbox.perception.configs import FinderConfig, ProposalConfig
from graspbox.perception.depth_views import Seen
from graspbox.perception.finder import Complete, GraspFinder, Head, Query
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.perception.scoring import Score

__all__ = ["CollectConfig", "check_hand", "collect", "load_trials", "rates_of", "unlearned"]


@dataclass(frozen=True)
class CollectConfig:
    """How trials are collected: the number in each scene, and the pose error between a chosen grasp and its execution.

    The settings of the finder determine how grasps are proposed, and refined if they are scored.
    """

    per_scene: int = 32
    error: PoseNoise = field(default_factory=PoseNoise)
    finder: FinderConfig = field(default_factory=lambda: FinderConfig(ProposalConfig(most=256)))


def collect(
    folder: Path,
    sampler: SceneSampler,
    scenes: range,
    grid: HandGrid,
    config: CollectConfig = CollectConfig(),
    *,
    complete: Complete | None = None,
    score: Score | None = None,
    head: Head | None = None,
    progress: Callable[[int], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> GraspTrials:
    """Collect trials of the scenes with these numbers, skipping those whose file exists.

    Parameters
    ----------
    grid : HandGrid
        Voxel grid of the hand, which is simulated too.
    complete : callable, optional
        Predicts the object's occupancy; the default is ground truth.
    score : callable, optional
        Scores grasps: half of a scene's trials are then the best-scored, the others are random.
    head : Head, optional
        Predicts grasps that are added to the proposals; used only with `score`.
    stop : callable
        Called before each new scene; True ends the collection.

    Raises ConfigError if there are no trials.
    """

    def collected(number: int) -> GraspTrials:
        return _collect_scene(sampler, number, grid, config, complete, score, head)

    return load_or_make_parts(GraspTrials, folder, scenes, collected, workers=CORES, progress=progress, stop=stop)


def rates_of(trials: GraspTrials) -> dict[str, Any]:
    """Return the number of trials, and the shares that succeeded and that were secure."""
    rates = {"success": float(trials.success.mean()), "secure": float(trials.secure.mean())}
    return {"trials": len(trials), **{name: round(rate, 4) for name, rate in rates.items()}}


def check_hand(folders: Iterable[Path], hand: Hand) -> None:
    """Refuse data sets of another hand, and folders without a data set."""
    for folder in folders:
        description = manifest.read(Path(folder))
        if description is None:
            raise ConfigError(f"there is no data set in {str(folder)!r}; graspbox dataset makes one")
        if (name := description["hand"]["name"]) != hand.name:
            raise ConfigError(
                f"the data set in {str(folder)!r} was generated with the hand {name!r}; pass --hand {name}"
            )


def unlearned(objects: str, learned: Iterable[str]) -> ObjectSet:
    """Return the objects of an evaluation's set from which nothing is learned; raises ConfigError if there are none."""
    kept = learned_sets.without(object_sets.load(objects, split=evaluated_split(objects)), list(learned))
    if not kept:
        raise ConfigError(f"--evaluated is {objects!r}; name objects from which nothing is learned")
    return kept


def load_trials(folder: Path) -> GraspTrials:
    """Read all trials of a folder; raises ConfigError if it has no file."""
    return GraspTrials.joined(GraspTrials.load(path) for path in sorted(Path(folder).glob("*.npz")))


def _collect_scene(
    sampler: SceneSampler,
    number: int,
    grid: HandGrid,
    config: CollectConfig,
    complete: Complete | None,
    score: Score | None,
    head: Head | None,
) -> GraspTrials:
    """Collect the trials of one scene; none if the object does not fit or rest, is not visible, or has no grasp."""
    rng = np.random.default_rng([sampler.seed, number, 7])
    rendered = render_scene(sampler, number, rng, grid.hand)
    grasp = None
    if rendered.crops is not None:
        complete = complete or rendered.true_occupancy
        if score is None:
            finder = GraspFinder(grid, complete, _unscored, replace(config.finder, refinements=0))
        else:
            finder = GraspFinder(grid, complete, score, config.finder, head=head)
        grasp = finder.find(Seen(rendered.crops), Query(number, keep_off=rendered.objects.obstacles, order=True))
    if grasp is None or rendered.scene is None:
        return GraspTrials.empty(rendered.source, rendered.world_from_object)
    chosen = _choose(len(grasp.preshapes), config.per_scene, rng, None if score is None else grasp.scores)
    preshapes, error = grasp.preshapes[chosen], config.error
    world_from_hand = perturbed(grasp.world_from_crop @ grasp.poses[chosen], rng, error.position, error.rotation)
    outcomes = rendered.scene.simulate(np.linalg.inv(rendered.world_from_object) @ world_from_hand, preshapes)
    return GraspTrials.of_scene(rendered.source, rendered.world_from_object, world_from_hand, preshapes, outcomes)


def _unscored(
    volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Score all grasps alike."""
    del volume, preshapes
    return np.zeros(len(poses))


def _choose(grasps: int, count: int, rng: np.random.Generator, scores: NDArray[np.float64] | None) -> NDArray[np.int64]:
    """Choose `count` grasps, by index: with scores half are the best, the others random."""
    order = rng.permutation(grasps)
    if scores is None:
        return order[:count]
    best = np.argsort(-scores, kind="stable")[: count // 2]
    others = order[~np.isin(order, best)]
    return np.concatenate([best, others[: count - len(best)]])
