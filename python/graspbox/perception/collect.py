"""Grasp trials on what the proposals give: scenes are seen, grasps proposed, chosen and simulated.

A folder of trials holds a file per scene, so that an interrupted collection continues.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.perception.array_files import load_or_make_parts
from graspbox.perception.configs import ProposalConfig
from graspbox.perception.crops import Crops
from graspbox.perception.finder import Complete, GraspFinder, Head, Score
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.perception.scenes import SceneSampler
from graspbox.perception.seen_scenes import see
from graspbox.perception.trials import GraspTrials

__all__ = ["CollectConfig", "collect", "load_trials"]


@dataclass(frozen=True)
class CollectConfig:
    """How trials are collected.

    Attributes
    ----------
    per_scene : int
        Trials in each scene.
    error : PoseNoise
        How far the hand goes from the grasps that are chosen.
    finder : FinderConfig
        How grasps are proposed, and refined where they are scored.
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
    progress: Callable[[int, GraspTrials], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> GraspTrials:
    """Collect trials of the scenes of those numbers, leaving out those whose file is there.

    Parameters
    ----------
    folder : Path
        Where the files are.
    sampler : SceneSampler
        Samples objects and how they rest.
    scenes : range
        Numbers of the scenes.
    grid : HandGrid
        The hand, of which the ReFlex alone is simulated.
    config : CollectConfig
        How trials are collected.
    complete : callable, optional
        Tells the object's occupancy; by default it is the true one.
    score : callable, optional
        Scores grasps: half of a scene's trials are then those that it finds best, the others at random.
    head : Head, optional
        Predicts grasps that are added to the proposals, where there is something to score with.
    progress : callable, optional
        Called with the number of each scene and its trials.
    stop : callable
        Asked before each scene that is not there yet; once it says so, no other is made.

    Returns
    -------
    GraspTrials
        Those of all scenes of the range that are there.

    Raises
    ------
    ConfigError
        If that is none.
    """

    def collected(number: int) -> GraspTrials:
        return _collect_scene(sampler, number, grid, config, complete, score, head)

    return load_or_make_parts(GraspTrials, folder, scenes, collected, progress=progress, stop=stop)


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
    """Collect the trials of one scene; none where the object does not come to rest, is not seen, or has no grasp."""
    rng = np.random.default_rng([sampler.seed, number, 7])
    seen = see(sampler, number, rng)
    nothing = GraspTrials.empty(seen.source, seen.world_from_object)
    if seen.scene is None or seen.crops is None:
        return nothing
    found = _find(seen.crops, grid, config, complete or seen.truth, score, head, number)
    if found is None:
        return nothing
    poses, preshapes, scores = found
    chosen = _choose(len(preshapes), config.per_scene, rng, scores)
    world_from_hand = perturbed(
        seen.crops.world_from_crop[0] @ poses[chosen], rng, config.error.position, config.error.rotation
    )
    outcomes = seen.scene.simulate(np.linalg.inv(seen.world_from_object) @ world_from_hand, preshapes[chosen])
    return GraspTrials.of_scene(seen.source, seen.world_from_object, world_from_hand, preshapes[chosen], outcomes)


def _find(
    crops: Crops,
    grid: HandGrid,
    config: CollectConfig,
    complete: Complete,
    score: Score | None,
    head: Head | None,
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None] | None:
    """Find grasps to choose from: poses, preshapes, and scores if there is something to score with."""
    if score is None:
        proposals = grid.propose(complete(crops.channels)[0], config.finder.proposals)
        return (proposals.poses, proposals.preshape, None) if len(proposals) else None
    found = GraspFinder(grid, complete, score, config.finder, head=head).decide(crops, seed=seed)
    return None if found is None else (found.poses, found.preshapes, found.scores)


def _choose(grasps: int, count: int, rng: np.random.Generator, scores: NDArray[np.float64] | None) -> NDArray[np.int64]:
    """Choose `count` grasps, by index: half of them the best, if there are scores, the others at random."""
    order = rng.permutation(grasps)
    if scores is None:
        return order[:count]
    best = np.argsort(-scores, kind="stable")[: count // 2]
    others = order[~np.isin(order, best)]
    return np.concatenate([best, others[: count - len(best)]])
