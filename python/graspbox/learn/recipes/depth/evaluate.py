"""Stages ``evaluate`` and ``clear``: trials of the exported policy on objects from which nothing is learned."""

from typing import Any

from graspbox import evaluation
from graspbox._common.runs import Run
from graspbox.data.trials.learned import evaluated_split
from graspbox.evaluation.rounds import clear_rounds
from graspbox.hands import HandLike
from graspbox.learn.recipes.depth.context import DepthContext
from graspbox.policies import DepthGrasp, Policy
from graspbox.simulation.layouts import layout_named

__all__ = ["clear", "evaluate", "evaluated"]


def evaluated(stage: Run, policy: Policy, objects: str, trials: int, hand: HandLike) -> dict[str, Any]:
    """Evaluate a policy as ``graspbox evaluate`` does, on the objects of the set from which nothing is learned."""
    result = evaluation.evaluate(
        policy,
        objects=objects,
        split=evaluated_split(objects),
        trials=trials,
        progress=stage.counter(trials, f"trials ({objects})"),
        hand=hand,
    )
    return {name: value for name, value in result.to_json().items() if name != "objects"}


def evaluate(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Evaluate the policy on single objects."""
    policy, results = DepthGrasp(context.policy_folder), dict[str, Any]()
    for objects in context.settings.evaluated:
        result = evaluated(stage, policy, objects, context.sizes.trials, context.settings.named_hand)
        results[objects] = {**result, "ece": round(result["calibration_error"], 4)}
    return results


def clear(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Clear scenes of several objects with the policy: see `graspbox.evaluation.rounds`."""
    policy, results = DepthGrasp(context.policy_folder), dict[str, Any]()
    for layout in (name for name in context.settings.layout if name != "single"):
        for objects in context.settings.evaluated:
            rounds = clear_rounds(
                policy,
                objects=objects,
                split=evaluated_split(objects),
                layout=layout_named(layout),
                rounds=context.sizes.cleared,
                hand=context.settings.named_hand,
                progress=stage.counter(context.sizes.cleared, f"rounds ({layout}, {objects})"),
            )
            results[f"{layout} {objects}"] = rounds.to_json()
    return results
