"""Stages ``export`` and ``ablations``: the policy's folder, and folders that show the effect of each step.

Of the ablations, ``scorer`` was trained on the data set only, before the rounds; ``geometry`` has no head.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from graspbox._common.runs import Run
from graspbox.learn.export.exports import export_depth_policy
from graspbox.learn.models.completion.network import CompletionNet
from graspbox.learn.recipes.cards.writing import package_licence
from graspbox.learn.recipes.depth.calibration import calibration_of
from graspbox.learn.recipes.depth.context import DepthContext
from graspbox.perception.configs import FinderConfig
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import completion_folder, read_depth_policy

__all__ = ["export_ablations", "export_policy"]


def export_policy(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Write the folder of the policy."""
    del stage
    rounds, finder = context.sizes.rounds, context.published_finder
    config = _export(context, context.policy_folder, context.settings.name, rounds, finder, licence=package_licence())
    return {"files": len(config.files)}


def export_ablations(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Write the folders of the ablations."""
    finder = context.published_finder
    ablations = {"scorer": (0, finder), "geometry": (context.sizes.rounds, replace(finder, predicted=0))}
    for name, (rounds, changed) in ablations.items():
        _export(context, stage.folder / name, name, rounds, changed, with_head=changed.predicted > 0)
    return {"folders": list(ablations)}


def _export(
    context: DepthContext,
    folder: Path,
    name: str,
    rounds: int,
    finder: FinderConfig,
    *,
    with_head: bool = True,
    licence: Path | None = None,
) -> DepthPolicyConfig:
    """Write the folder of a policy with the scorer after a number of rounds."""
    return export_depth_policy(
        folder,
        name,
        _completion(context),
        [context.networks.scorer_net(rounds)],
        calibration_of(context.run.stages["calibrate"]),
        learned_from=context.learned_from,
        hand=context.grid.hand,
        crop=context.scenes.crop,
        grid=context.grid.config,
        finder=finder,
        head=context.networks.head_net() if with_head else None,
        licence=licence,
    )


def _completion(context: DepthContext) -> CompletionNet | Path:
    """Return the trained completion, or the folder of the policy that has it."""
    if context.settings.completion is None or context.has_several:
        return context.networks.completion_net()
    folder = folder_of(context.settings.completion)
    return completion_folder(folder, read_depth_policy(folder))
