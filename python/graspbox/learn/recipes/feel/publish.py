"""Stages ``export`` and ``threshold``: the policy's folder, and the probability below which its hand opens."""

from dataclasses import replace
from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.learn.export.exports import export_feel_policy
from graspbox.learn.recipes.feel.context import FeelContext
from graspbox.learn.recipes.feel.paired import at_threshold, best_threshold
from graspbox.policies.published.configs import FeelPolicyConfig
from graspbox.policies.published.folders import load, read_depth_policy, save

__all__ = ["choose_threshold", "export_policy"]


def export_policy(context: FeelContext, stage: Run) -> dict[str, Any]:
    """Write the policy's folder, with a placeholder threshold that the next stage replaces."""
    del stage
    settings = context.settings
    licence = settings.policy / "LICENSE"
    slope, offset = context.run.stages["calibrate"]["calibration"]
    config = export_feel_policy(
        context.policy_folder,
        f"{read_depth_policy(settings.policy).name}-feel",
        context.networks(),
        (slope, offset),
        depth=settings.policy,
        times=settings.times,
        threshold=0.5,
        learned_from=(settings.objects, settings.held_out),
        licence=licence if licence.is_file() else None,
    )
    return {"files": len(config.files)}


def choose_threshold(context: FeelContext, stage: Run) -> dict[str, Any]:
    """Choose the threshold on trials of held-out objects, each with and without a second attempt."""
    held_out, folder = context.settings.held_out, context.policy_folder
    pairs = context.pairs(stage, held_out, object_sets.load(held_out), context.settings.sizes.rule_trials, 900)
    threshold = best_threshold(pairs)
    save(folder, replace(load(folder, FeelPolicyConfig), threshold=threshold))
    return {"threshold": threshold, "never": at_threshold(pairs, 0.0), "chosen": at_threshold(pairs, threshold)}
