"""Grasp trials on what the proposals give: scenes are seen, grasps proposed, chosen and simulated.

A folder of trials holds a file per scene, so that an interrupted collection continues.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError, SimulationError
from graspbox.files import replacing
from graspbox.object_sets import ObjectSpec
from graspbox.perception.configs import ProposalConfig
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.finder import Complete, Score
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import perturbed
from graspbox.perception.scenes import SceneSampler, look
from graspbox.perception.trials import GraspTrials
from graspbox.simulation import Scene

__all__ = ["CollectConfig", "collect", "load_trials", "source_of"]


@dataclass(frozen=True)
class CollectConfig:
    """How trials are collected.

    Attributes
    ----------
    per_scene : int
        Trials in each scene.
    position_error, rotation_error : float
        Standard deviation of the hand's error along and about each of its axes, metres and radians.
    proposals : ProposalConfig
        How grasps are proposed.
    """

    per_scene: int = 32
    position_error: float = 0.003
    rotation_error: float = 0.05
    proposals: ProposalConfig = field(default_factory=lambda: ProposalConfig(most=256))


def collect(
    folder: Path,
    sampler: SceneSampler,
    scenes: range,
    grid: HandGrid,
    config: CollectConfig = CollectConfig(),
    *,
    complete: Complete | None = None,
    score: Score | None = None,
    progress: Callable[[int, GraspTrials], None] | None = None,
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
    progress : callable, optional
        Called with the number of each scene and its trials.

    Returns
    -------
    GraspTrials
        Those of all scenes of the range that gave any.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for number in scenes:
        path = folder / f"{number:07d}.npz"
        if not path.exists():
            trials = _collect_scene(sampler, number, grid, config, complete, score)
            with replacing(path) as temporary:
                trials.save(temporary)
        found.append(GraspTrials.load(path))
        if progress is not None:
            progress(number, found[-1])
    return GraspTrials.joined(found)


def load_trials(folder: Path) -> GraspTrials:
    """Read all trials of a folder.

    Raises
    ------
    ConfigError
        If there are none.
    """
    return GraspTrials.joined(GraspTrials.load(path) for path in sorted(Path(folder).glob("*.npz")))


def source_of(spec: ObjectSpec) -> str:
    """Name an object set that holds this object alone, as `graspbox.object_sets.load` takes it.

    Raises
    ------
    ConfigError
        For an object that is scaled: no set names it.
    """
    if spec.scale != 1.0:
        raise ConfigError(f"object {spec.name!r} is scaled by {spec.scale}; collect trials on sets without a scale")
    if spec.family is not None:
        return f"procedural:{spec.family}:{spec.seed}"
    return str(spec.path)


def _collect_scene(
    sampler: SceneSampler,
    number: int,
    grid: HandGrid,
    config: CollectConfig,
    complete: Complete | None,
    score: Score | None,
) -> GraspTrials:
    """Collect the trials of one scene; none where the object does not come to rest, is not seen, or has no grasp."""
    rng = np.random.default_rng([sampler.seed, number, 7])
    index, mesh, start = sampler.rest(rng)
    source = source_of(sampler.objects[index])
    nothing = GraspTrials.empty(source, start)
    try:
        scene = Scene(mesh, world_from_object=start)
    except SimulationError:
        return nothing
    at_rest = scene.world_from_object
    crops = look(mesh, at_rest, sampler.config, [sampler.seed, number], 1)
    if not crops.found[0]:
        return nothing
    world_from_crop = crops.world_from_crop[0]
    if complete is None:
        inside = np.linalg.inv(world_from_crop) @ at_rest
        occupancy = solid_occupancy([mesh], [0], inside[None], config=sampler.config.crop)[0]
    else:
        occupancy = complete(crops.channels)[0]
    proposals = grid.propose(occupancy, config.proposals)
    if not len(proposals):
        return nothing
    volume = np.concatenate([occupancy[None], crops.channels[0, :2]])
    scores = None if score is None else score(volume, proposals.poses, proposals.preshape)
    chosen = _choose(len(proposals), config.per_scene, rng, scores)
    world_from_hand = perturbed(
        world_from_crop @ proposals.poses[chosen], rng, config.position_error, config.rotation_error
    )
    outcomes = scene.simulate(np.linalg.inv(at_rest) @ world_from_hand, proposals.preshape[chosen])
    return GraspTrials.of_scene(source, at_rest, world_from_hand, proposals.preshape[chosen], outcomes)


def _choose(
    proposals: int, count: int, rng: np.random.Generator, scores: NDArray[np.float64] | None
) -> NDArray[np.int64]:
    """Choose `count` proposals, by index: half of them the best, if there are scores, the others at random."""
    order = rng.permutation(proposals)
    if scores is None:
        return order[:count]
    best = np.argsort(-scores, kind="stable")[: count // 2]
    others = order[~np.isin(order, best)]
    return np.concatenate([best, others[: count - len(best)]])
