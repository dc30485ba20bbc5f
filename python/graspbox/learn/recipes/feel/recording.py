"""Stages ``record-train`` and ``record-held-out``: sensor readings of the policy's grasps, and their outcomes."""

from typing import Any

from graspbox._common.runs import Run
from graspbox.learn.recipes.feel.context import FeelContext
from graspbox.learn.recipes.feel.stability_trials import BLOCK, Recorder

__all__ = ["record"]


def record(context: FeelContext, stage: Run, part: str) -> dict[str, Any]:
    """Record the trials of a part: train or held-out."""
    settings, sizes = context.settings, context.settings.sizes
    if part == "train":
        objects, scenes, seed = settings.objects, sizes.scenes, settings.seed
    else:
        objects, scenes, seed = settings.held_out, sizes.held_out_scenes, settings.seed + 500
    blocks = -(-scenes // BLOCK)
    recorder = Recorder(settings.policy, objects, settings.times, seed, sizes.per_scene)
    try:
        progress = stage.counter(blocks, "blocks of scenes")
        trials = recorder.record(stage.folder, blocks, progress=progress, stop=stage.late)
    finally:
        recorder.close()
    return {
        "trials": len(trials),
        "held": round(float(trials.held.mean()), 4),
        "first": round(float(trials.held[trials.first].mean()), 4) if trials.first.any() else None,
    }
