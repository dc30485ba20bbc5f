"""Stages ``collect-N``: trials of grasps that the scorer after the last round chooses, on fresh objects."""

from dataclasses import replace
from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.learn.export.exports import FINALISTS
from graspbox.learn.export.graphs import ScorerGraph
from graspbox.learn.recipes.collection import CollectConfig, collect, rates_of
from graspbox.learn.recipes.depth.context import DepthContext
from graspbox.policies.published.calibration import Calibration
from graspbox.policies.published.runtimes import Scorer, torch_network

__all__ = ["collect_choices", "scorer_of"]

#: Most proposals of geometry and of the head in a scene: enough that the random ones reveal the scorer's errors.
_PROPOSED, _PREDICTED = 256, 96


def scorer_of(context: DepthContext, rounds: int) -> Scorer:
    """Load the scorer after a number of rounds, before its calibration."""
    graph = ScorerGraph([context.networks.scorer_net(rounds)], Calibration(), FINALISTS)
    return Scorer(torch_network(graph), context.inputs, FINALISTS)


def collect_choices(context: DepthContext, stage: Run, number: int) -> dict[str, Any]:
    """Collect the trials of a round, counted from 1."""
    proposals = replace(context.finder.proposals, most=_PROPOSED)
    config = CollectConfig(finder=replace(context.finder, proposals=proposals, predicted=_PREDICTED))
    scorer, results = scorer_of(context, number - 1), dict[str, Any]()
    counts: dict[object_sets.Split, int] = {
        "validation": context.sizes.held_out_scenes,
        "train": context.sizes.scenes,
    }
    for split, scenes in counts.items():
        trials = collect(
            stage.folder / split,
            context.sampler(context.settings.fresh, split, context.settings.seed + 1000 * number),
            range(scenes),
            context.grid,
            config,
            complete=context.networks.completion(),
            score=scorer,
            head=context.networks.predictor(),
            progress=stage.counter(scenes, f"scenes ({split})"),
            stop=stage.late,
        )
        results[split] = rates_of(trials)
    return results
