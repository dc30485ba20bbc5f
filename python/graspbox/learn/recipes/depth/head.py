"""Stages ``head`` and ``head-rounds``: the network whose grasps are scored together with the geometric proposals.

The first stage learns from the data set, or takes the head of the published policy with which the training begins. The
second trains it further on the trials of the rounds and on scenes without trials. The trials of the rounds show
what is wrong with grasps that seem good, the scenes without trials where the hand can go: objects at rest are seldom
tall.
"""

from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.learn.export.exports import write_head
from graspbox.learn.models.head.batches import untried_scenes
from graspbox.learn.models.head.network import AnchorNet
from graspbox.learn.models.head.training import HeadData, load_head, train_head
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.collection import load_trials
from graspbox.learn.recipes.depth.context import TUNING_RATE, DepthContext
from graspbox.learn.recipes.networks import is_published
from graspbox.learn.recipes.stages import reporter, results_of, train_config
from graspbox.learn.training.configs import TrainConfig
from graspbox.policies.published.head_configs import HeadConfig

__all__ = ["train_first_head", "train_head_further"]


def train_first_head(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Train the head before the rounds."""
    start, networks = context.settings.start, context.networks
    if start is not None and is_published(start) and networks.adopt_head(start):
        write_head(networks.head_net(), stage.folder / "head.onnx", context.scenes.crop)
        return {"policy": str(start)}
    return _train(context, stage, *context.trials(), context.sizes.head_steps)


def train_head_further(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Train the head after the rounds, on the trials of these too."""
    settings, sizes = context.settings, context.sizes
    train, held_out = context.trials()
    chosen = [load_trials(settings.out / f"collect-{n}" / "train") for n in range(1, sizes.rounds + 1)]
    objects = object_sets.load(settings.objects, split="train")
    untried = [untried_scenes(objects, sizes.untried, settings.seed)] if sizes.untried else []
    joined = GraspTrials.joined([train, *chosen, *untried])
    return _train(context, stage, joined, held_out, sizes.head_round_steps, context.networks.head_net())


def _train(
    context: DepthContext,
    stage: Run,
    train: GraspTrials,
    held_out: GraspTrials,
    steps: int,
    start: AnchorNet | None = None,
) -> dict[str, Any]:
    """Train a head in the stage's folder, and export it."""
    config = train_config(
        stage,
        context.settings,
        learning_rate=TrainConfig.learning_rate if start is None else TUNING_RATE,
        batch_size=16,
        max_steps=steps,
        validate_every=min(250, steps),
        patience=steps,
    )
    head = HeadConfig(anchors=context.anchors) if start is None else start.config
    data = HeadData.of(train, held_out, context.grid, head.anchors, context.scenes, context.settings.seed)
    trained = train_head(stage.folder, data, head, config, reporter(stage, "share of holds"), start)
    net = load_head(stage.folder, len(context.grid.preshapes), context.scenes.crop)
    write_head(net, stage.folder / "head.onnx", context.scenes.crop)
    return results_of(trained) | {"trials": len(train)}
