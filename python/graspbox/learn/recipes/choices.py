"""A policy's choices, tried in simulation to calibrate its scorer."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.learn.models.scene_trials import render_scene
from graspbox.learn.models.scenes import SceneSampler
from graspbox.learn.training.array_files import CORES, ArrayTable, load_or_make_parts
from graspbox.perception.depth_views import Seen
from graspbox.perception.finder import GraspFinder, Query

__all__ = ["SECURE_WEIGHTS", "Choices", "try_choices"]

#: Weights of a secure hold that are compared.
SECURE_WEIGHTS = (0.0, 0.3, 1.0)


@dataclass(frozen=True, eq=False)
class Choices(ArrayTable):
    """One choice for each of w `SECURE_WEIGHTS` in each of n scenes; scenes without a grasp have none.

    Logits (n, w, 2) of success and of a secure hold, before calibration; `judged`, calibrated probabilities of both;
    outcomes (n, w) of the trials.
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
    finder: GraspFinder,
    *,
    progress: Callable[[int], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> Choices:
    """Choose a grasp in each scene by each weight and try it without pose error; arguments and errors as `collect`.

    With a weight w, the grasp has the greatest (success + w secure) / (1 + w), both probabilities of a trained scorer,
    less what it loses for its lever (`FinderConfig.lever_penalty`).
    """

    def attempt(number: int) -> Choices:
        return _try_scene(sampler, number, finder)

    return load_or_make_parts(Choices, folder, scenes, attempt, workers=CORES, progress=progress, stop=stop)


def _try_scene(sampler: SceneSampler, number: int, finder: GraspFinder) -> Choices:
    rng = np.random.default_rng([sampler.seed, number, 7])
    rendered = render_scene(sampler, number, rng, finder.grid.hand)
    query = Query(number, keep_off=rendered.objects.obstacles, order=True)
    grasp = None if rendered.crops is None else finder.find(Seen(rendered.crops), query)
    if grasp is None or grasp.judged is None or rendered.scene is None:
        flags, numbers = np.zeros((0, len(SECURE_WEIGHTS)), dtype=np.bool_), np.zeros((0, len(SECURE_WEIGHTS), 2))
        return Choices(numbers, numbers, flags, flags)
    penalty, judged = finder.config.lever_penalty or 0.0, grasp.judged
    lost = penalty * finder.grid.levers(grasp.occupancy, grasp.poses, grasp.preshapes)
    scores = [(judged.success + weight * judged.secure) / (1.0 + weight) - lost for weight in SECURE_WEIGHTS]
    best = np.argmax(scores, axis=1)
    object_from_hand = np.linalg.inv(rendered.world_from_object) @ grasp.world_from_crop @ grasp.poses[best]
    outcomes = rendered.scene.simulate(object_from_hand, grasp.preshapes[best])
    chosen = judged.rows(best)
    probabilities = np.stack([chosen.success, chosen.secure], axis=1)
    return Choices(chosen.logits[None], probabilities[None], outcomes.success[None], outcomes.secure[None])
