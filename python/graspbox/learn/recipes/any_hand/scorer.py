"""Stages ``scorer`` and ``round-N``: one network that scores the grasps of all hands, trained on their trials."""

from typing import Any

import torch

from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.learn.models.scorer.shared import SharedScorerNet
from graspbox.learn.models.scorer.training import JoinedSampler, TrialSampler, fit_scorer
from graspbox.learn.recipes.any_hand.context import AnyHandContext
from graspbox.learn.recipes.stages import reporter, results_of, train_config
from graspbox.learn.training.trainer import load_weights
from graspbox.perception.inputs.scorer import ScorerInputs

__all__ = ["learn"]


def learn(context: AnyHandContext, stage: Run, rounds: int) -> dict[str, Any]:
    """Train on the trials of random proposals, and on those of the first `rounds` rounds."""
    sizes = context.sizes
    config = train_config(
        stage,
        context.settings,
        rounds,
        learning_rate=5e-4 if rounds else 1e-3,
        batch_size=sizes.batch,
        max_steps=sizes.round_steps if rounds else sizes.steps,
        validate_every=sizes.validate_every,
    )
    torch.manual_seed(config.seed)
    net = SharedScorerNet([hand.grid for hand in context.hands], sizes.width)
    if rounds:
        load_weights(net, context.weights(rounds - 1))

    def joined(number: int, split: str, seed: int) -> JoinedSampler | None:
        samplers = [
            TrialSampler(trials, ScorerInputs(hand.grid, first), context.views, seed)
            for hand, first in zip(context.hands, net.first, strict=True)
            if (trials := context.trials(number, hand, split)) is not None
        ]
        return JoinedSampler(samplers) if samplers else None

    samplers = [joined(number, "train", config.seed) for number in range(rounds + 1)]
    held_out = joined(rounds, "validation", 0)
    if held_out is None:
        raise ConfigError("no hand has trials; pass a greater --hours.trials")
    settings = {"hands": [hand.name for hand in context.hands], "width": sizes.width, "rounds": rounds}
    used = [sampler for sampler in samplers if sampler is not None]
    progress = reporter(stage, "AUC")
    return results_of(fit_scorer(stage.folder, net, used, held_out, config, settings, progress, trained=rounds > 0))
