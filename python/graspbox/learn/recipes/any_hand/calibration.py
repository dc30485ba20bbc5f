"""Stage ``calibrate``: choices on held-out objects with every named hand; the logits of all are fitted together."""

from typing import Any

from graspbox._common.runs import Run
from graspbox.learn.recipes.any_hand.context import AnyHandContext
from graspbox.learn.recipes.choices import Choices, try_choices
from graspbox.learn.recipes.depth.calibration import fitted_calibration
from graspbox.perception.finder import GraspFinder

__all__ = ["calibrate"]


def calibrate(context: AnyHandContext, stage: Run) -> dict[str, Any]:
    """Try choices, and fit the calibration."""
    sampler = context.sampler("validation", context.settings.seed + 9000)
    hands = [hand for hand in context.hands if hand.named] or context.hands[:4]
    scenes = range(max(1, context.sizes.choices // len(hands)))
    parts, rates = [], {}
    for number, hand in enumerate(hands, 1):
        share = number / len(hands)

        def late(end: float = share * stage.limit) -> bool:
            return stage.seconds >= end

        scorer = context.scorer(hand, context.sizes.rounds)
        finder = GraspFinder(hand.grid, context.completion, scorer, hand.finder)
        choices = try_choices(stage.folder / hand.name, sampler, scenes, finder, stop=late)
        parts.append(choices)
        rates[hand.name] = round(float(choices.success[:, 0].mean()), 4)
        stage.report(f"{number} of {len(hands)} hands", share)
    return fitted_calibration(Choices.joined(parts)) | {"hands": rates}
