"""Stages ``scorer`` and ``round-N``: the network that scores grasps, trained on trials.

The first stage learns from the data set, each round also from the trials that the scorer chose before it.
"""

from typing import Any

from graspbox._common.runs import Run
from graspbox.learn.models.scorer.training import train_scorer
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.collection import load_trials
from graspbox.learn.recipes.depth.context import DepthContext
from graspbox.learn.recipes.stages import reporter, results_of, train_config

__all__ = ["learn"]


def learn(context: DepthContext, stage: Run, rounds: int) -> dict[str, Any]:
    """Train on the data set and on the on-policy trials of the first `rounds` rounds."""
    settings, sizes, networks = context.settings, context.sizes, context.networks
    start = networks.scorer_folder(rounds - 1) / "weights.pt" if rounds else None
    if not rounds and settings.start is not None:
        start = networks.adopt_scorer(settings.start)
        if not sizes.scorer_steps:
            networks.keep_scorer(settings.start)
            return {"policy": str(settings.start)}
    config = train_config(
        stage,
        settings,
        rounds,
        learning_rate=1e-3 if start is None else 5e-4,
        batch_size=sizes.batch,
        max_steps=sizes.round_steps if rounds else sizes.scorer_steps,
        validate_every=sizes.validate_every,
    )
    train, held_out = context.trials()
    folders = [settings.out / f"collect-{n}" for n in range(1, rounds + 1)]
    on_policy = [load_trials(folder / "train") for folder in folders]
    # The latest choices select the weights.
    validation = load_trials(folders[-1] / "validation") if folders else held_out
    trained = train_scorer(
        stage.folder,
        train,
        validation,
        context.inputs,
        context.views,
        config,
        on_policy=GraspTrials.joined(on_policy) if on_policy else None,
        start=start,
        width=sizes.width,
        progress=reporter(stage, "AUC"),
    )
    return results_of(trained) | {"trials": len(train), "on_policy": sum(len(trials) for trials in on_policy)}
