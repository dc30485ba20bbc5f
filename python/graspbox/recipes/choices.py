"""A policy's choices, tried in simulation to calibrate and evaluate its scorer."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.artifacts.runtimes import Scorer
from graspbox.hands import Hand
from graspbox.models.scene_trials import render_scene
from graspbox.models.scenes import SceneSampler
from graspbox.perception.configs import FinderConfig
from graspbox.perception.finder import Complete, GraspFinder, Head
from graspbox.perception.hand_grids import HandGrid
from graspbox.training.array_files import CORES, ArrayTable, load_or_make_parts

__all__ = ["SECURE_WEIGHTS", "Choices", "try_choices"]

#: Weights of a secure hold that are compared.
SECURE_WEIGHTS = (0.0, 0.3, 1.0)


@dataclass(frozen=True, eq=False)
class Choices(ArrayTable):
    """One choice for each of w weights in each of n scenes; scenes without a grasp have none.

    Attributes
    ----------
    logits : (n, w, 2) float64
        Logits of success and of a secure hold, before calibration.
    judged : (n, w, 2) float64
        Calibrated probabilities of both.
    success, secure : (n, w) bool
        Outcome of the trial.
    """

    logits: NDArray[np.float64]
    judged: NDArray[np.float64]
    success: NDArray[np.bool_]
    secure: NDArray[np.bool_]

    nothing = "no grasp was chosen in any scene; the networks or the proposals find nothing"


def try_choices(
    folder: Path,
    sampler: SceneSampler,
    scenes: range,
    grid: HandGrid,
    complete: Complete,
    scorer: Scorer,
    finder: FinderConfig = FinderConfig(),  # noqa: B008 (frozen)
    *,
    head: Head | None = None,
    weights: Sequence[float] = SECURE_WEIGHTS,
    progress: Callable[[int], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> Choices:
    """Choose a grasp in each scene by each weight and try it without pose error; resumes as `collect` does.

    Parameters
    ----------
    folder : Path
        Folder with one file per scene.
    sampler : SceneSampler
        Samples objects and how they rest.
    scenes : range
        Numbers of the scenes.
    grid, complete, scorer, finder
        Components of the decision.
    head : Head, optional
        As for `graspbox.perception.finder.GraspFinder`.
    weights : sequence of float
        Weights w: a grasp is chosen by (success + w secure) / (1 + w), both probabilities, less what it loses for its
        lever (`FinderConfig.lever_penalty`).
    progress : callable
        Called with the number of scenes so far.
    stop : callable
        Asked before each new scene; True ends the collection.

    Raises
    ------
    ConfigError
        If no scene has a grasp.
    """
    chosen = GraspFinder(grid, complete, scorer, finder, head=head)

    def attempt(number: int) -> Choices:
        return _try_scene(sampler, number, chosen, grid.hand, scorer, weights)

    return load_or_make_parts(Choices, folder, scenes, attempt, workers=CORES, progress=progress, stop=stop)


def _try_scene(
    sampler: SceneSampler, number: int, finder: GraspFinder, hand: Hand, scorer: Scorer, weights: Sequence[float]
) -> Choices:
    """Choose and try grasps in one scene."""
    rendered = render_scene(sampler, number, np.random.default_rng([sampler.seed, number, 7]), hand)
    finder = finder.keeping_off(rendered.objects.obstacles)
    found = None if rendered.crops is None else finder.decide(rendered.crops, seed=number)
    if found is None or rendered.scene is None or rendered.crops is None:
        flags, numbers = np.zeros((0, len(weights)), dtype=np.bool_), np.zeros((0, len(weights), 2))
        return Choices(numbers, numbers, flags, flags)
    judged = scorer.judge(found.volume, found.poses, found.preshapes)
    # As in the exported policy, where the first terms are the score of its scorer.
    penalty = finder.config.lever_penalty or 0.0
    lost = penalty * finder.grid.levers(found.occupancy, found.poses, found.preshapes)
    scores = [(judged.success + weight * judged.secure) / (1.0 + weight) - lost for weight in weights]
    best = np.argmax(scores, axis=1)
    object_from_hand = np.linalg.inv(rendered.world_from_object) @ found.world_from_crop @ found.poses[best]
    outcomes = rendered.scene.simulate(object_from_hand, found.preshapes[best])
    probabilities = np.stack([judged.success[best], judged.secure[best]], axis=1)
    return Choices(judged.logits[best][None], probabilities[None], outcomes.success[None], outcomes.secure[None])
