"""Stage ``calibrate``: choices tried on held-out objects.

They determine the weight of a secure hold in the choice, and calibrate the scorer's logits to probabilities.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from graspbox._common.runs import Run
from graspbox.learn.recipes.choices import SECURE_WEIGHTS, Choices, try_choices
from graspbox.learn.recipes.depth.collection import scorer_of
from graspbox.learn.recipes.depth.context import DepthContext
from graspbox.perception.finder import GraspFinder
from graspbox.policies.published.calibration import Calibration, fit_logits

__all__ = ["calibrate", "calibration_of", "fitted_calibration"]


def calibrate(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Try choices, and fit the calibration."""
    networks, settings, count = context.networks, context.settings, context.sizes.choices
    scorer, head = scorer_of(context, context.sizes.rounds), networks.predictor()
    name = "-".join(settings.fresh).replace(":", "-")
    choices = try_choices(
        stage.folder / name,
        # As the policy is evaluated: in images with real noise the probabilities are then right too, within 3 points.
        context.sampler(settings.fresh, "validation", settings.seed + 9000, rendered=True),
        range(count),
        GraspFinder(context.grid, networks.completion(), scorer, context.policy_finder, head=head),
        progress=stage.counter(count, f"choices ({', '.join(settings.fresh)})"),
        stop=stage.late,
    )
    rates = zip(choices.success.mean(axis=0).tolist(), choices.secure.mean(axis=0).tolist(), strict=True)
    rounded = [[round(rate, 4) for rate in pair] for pair in rates]
    return fitted_calibration(choices) | {"rates": dict(zip(map(str, SECURE_WEIGHTS), rounded, strict=True))}


def calibration_of(result: Mapping[str, Any]) -> Calibration:
    """Return the calibration of a stage's results."""
    return Calibration(tuple(result["success"]), tuple(result["secure"]), result["secure_weight"])


def fitted_calibration(choices: Choices) -> dict[str, Any]:
    """Choose the weight of a secure hold with the most successes and secure holds, and fit the logits of its choices.

    Returns
    -------
    dict
        ``choices``, the number of scenes; ``secure_weight``; ``success`` and ``secure``, slope and offset of logits.
    """
    best = int(np.argmax(choices.success.mean(axis=0) + choices.secure.mean(axis=0)))
    return {
        "choices": len(choices.success),
        "secure_weight": SECURE_WEIGHTS[best],
        "success": fit_logits(choices.logits[:, best, 0], choices.success[:, best]),
        "secure": fit_logits(choices.logits[:, best, 1], choices.secure[:, best]),
    }
