"""Collection of grasp trials from proposals: scenes are rendered; grasps proposed, chosen and simulated.

The folder of trials holds one file per scene, so that an interrupted collection resumes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.dataset import manifest
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.models.scene_trials import RenderedScene, render_scene
from graspbox.models.scenes import SceneSampler
from graspbox.models.trials import GraspTrials
from graspbox.perception.configs import FinderConfig, ProposalConfig
from graspbox.perception.finder import Complete, GraspFinder, Head, Score
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.training.array_files import CORES, load_or_make_parts

__all__ = ["CollectConfig", "check_hand", "collect", "load_trials"]


@dataclass(frozen=True)
class CollectConfig:
    """How trials are collected.

    Attributes
    ----------
    per_scene : int
        Trials in each scene.
    error : PoseNoise
        Pose error between a chosen grasp and its execution.
    finder : FinderConfig
        How grasps are proposed, and refined if they are scored.
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
    folder : Path
        Folder of the files.
    sampler : SceneSampler
        Samples objects and how they rest.
    scenes : range
        Numbers of the scenes.
    grid : HandGrid
        Voxel grid of the hand, which is simulated too.
    config : CollectConfig
        How trials are collected.
    complete : callable, optional
        Predicts the object's occupancy; the default is ground truth.
    score : callable, optional
        Scores grasps: half of a scene's trials are then the best-scored, the others are random.
    head : Head, optional
        Predicts grasps that are added to the proposals; used only with `score`.
    progress : callable
        Called with the number of scenes so far.
    stop : callable
        Asked before each new scene; True ends the collection.

    Returns
    -------
    GraspTrials
        The trials of all scenes of the range collected so far.

    Raises
    ------
    ConfigError
        If there are none.
    """

    def collected(number: int) -> GraspTrials:
        return _collect_scene(sampler, number, grid, config, complete, score, head)

    return load_or_make_parts(GraspTrials, folder, scenes, collected, workers=CORES, progress=progress, stop=stop)


def check_hand(folders: Iterable[Path], hand: Hand) -> None:
    """Refuse data sets of another hand.

    Raises
    ------
    ConfigError
        If a data set is of another hand, or a folder holds none.
    """
    for folder in folders:
        made = manifest.read(Path(folder))
        if made is None:
            raise ConfigError(f"there is no data set in {str(folder)!r}; graspbox dataset makes one")
        if (name := made["hand"]["name"]) != hand.name:
            raise ConfigError(
                f"the data set in {str(folder)!r} was generated with the hand {name!r}; give --hand {name}"
            )


def load_trials(folder: Path) -> GraspTrials:
    """Read all trials of a folder.

    Raises
    ------
    ConfigError
        If there are none.
    """
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
    nothing = GraspTrials.empty(rendered.source, rendered.world_from_object)
    if rendered.scene is None or rendered.crops is None:
        return nothing
    found = _find(rendered, grid, config, complete or rendered.true_occupancy, score, head, number)
    if found is None:
        return nothing
    poses, preshapes, scores = found
    chosen = _choose(len(preshapes), config.per_scene, rng, scores)
    world_from_hand = perturbed(
        rendered.crops.world_from_crop[0] @ poses[chosen], rng, config.error.position, config.error.rotation
    )
    outcomes = rendered.scene.simulate(np.linalg.inv(rendered.world_from_object) @ world_from_hand, preshapes[chosen])
    return GraspTrials.of_scene(
        rendered.source, rendered.world_from_object, world_from_hand, preshapes[chosen], outcomes
    )


def _find(
    rendered: RenderedScene,
    grid: HandGrid,
    config: CollectConfig,
    complete: Complete,
    score: Score | None,
    head: Head | None,
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None] | None:
    """Find grasps to choose from, off walls where they can be: poses, preshapes, and scores if they are scored."""
    assert rendered.crops is not None
    if score is None:
        finder = GraspFinder(grid, complete, _unscored, replace(config.finder, refinements=0))
    else:
        finder = GraspFinder(grid, complete, score, config.finder, head=head)
    found = finder.keeping_off(rendered.objects.obstacles).decide(rendered.crops, seed=seed)
    return None if found is None else (found.poses, found.preshapes, None if score is None else found.scores)


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
