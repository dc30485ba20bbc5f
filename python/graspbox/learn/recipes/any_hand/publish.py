"""Stages ``export`` and ``evaluate-HAND``: the policy's folder, and trials of the policy with each hand."""

from dataclasses import replace
from typing import Any

from graspbox._common.runs import Run
from graspbox.learn.export.exports import export_depth_policy
from graspbox.learn.models.scorer.shared import SHARED_SHAPE, SharedScorerNet
from graspbox.learn.recipes.any_hand.context import AnyHandContext
from graspbox.learn.recipes.cards.writing import package_licence
from graspbox.learn.recipes.depth.calibration import calibration_of
from graspbox.learn.recipes.depth.context import FINDER
from graspbox.learn.recipes.depth.evaluate import evaluated
from graspbox.learn.recipes.settings.any_hand import EvaluatedHand
from graspbox.perception import HandGridConfig
from graspbox.perception.configs import MANY_FINGERS, RehearsalConfig
from graspbox.policies import DepthGrasp

__all__ = ["evaluate", "export_policy"]


def export_policy(context: AnyHandContext, stage: Run) -> dict[str, Any]:
    """Write the policy's folder."""
    del stage
    rehearsed = context.sizes.rehearsed
    config = export_depth_policy(
        context.policy_folder,
        context.settings.name,
        context.completion_folder,
        [SharedScorerNet.load(context.weights(context.sizes.rounds), [context.hands[0].grid])],
        calibration_of(context.run.stages["calibrate"]),
        learned_from=context.learned,
        crop=context.scenes.crop,
        grid=HandGridConfig(shape=SHARED_SHAPE),
        finder=replace(
            FINDER,
            predicted=0,
            refinements=0,
            rehearsal=RehearsalConfig(grasps=rehearsed, fingers=MANY_FINGERS) if rehearsed else None,
        ),
        licence=package_licence(),
    )
    return {"files": len(config.files)}


def evaluate(context: AnyHandContext, stage: Run, hand: EvaluatedHand) -> dict[str, Any]:
    """Evaluate the policy with a hand."""
    policy, trials = DepthGrasp(context.policy_folder), context.sizes.trials
    results: dict[str, Any] = {"trained": hand.trained}
    return results | {
        objects: evaluated(stage, policy, objects, trials, hand.hand) for objects in context.settings.evaluated
    }
