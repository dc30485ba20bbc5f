"""Stages ``member-N`` and ``calibrate``: an ensemble that predicts the outcome, and slope and offset of its logit."""

from typing import Any

from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.learn.models.stability.network import logits_of, train_stability
from graspbox.learn.recipes.feel.context import FeelContext
from graspbox.learn.recipes.stages import reporter, train_config
from graspbox.learn.training.metrics import auc
from graspbox.policies.published.calibration import fit_logits

__all__ = ["calibrate", "train_member"]


def train_member(context: FeelContext, stage: Run, number: int) -> dict[str, Any]:
    """Train one network of the ensemble."""
    sizes = context.settings.sizes
    train, held_out = context.trials("train"), context.trials("held-out")
    config = train_config(
        stage,
        context.settings,
        number,
        learning_rate=1e-3,
        weight_decay=1e-2,
        batch_size=128,
        max_steps=sizes.steps,
        validate_every=sizes.validate_every,
        patience=12,
    )
    net, trained = train_stability(
        stage.folder,
        train.readings,
        train.held,
        (held_out.readings, held_out.held),
        config,
        width=sizes.width,
        progress=reporter(stage, "minus cross-entropy"),
    )
    logits = logits_of([net], held_out.readings)
    return {"steps": trained.step, "reason": trained.reason, "auc": round(auc(logits, held_out.held), 4)}


def calibrate(context: FeelContext, stage: Run) -> dict[str, Any]:
    """Fit slope and offset on the policy's own choices of held-out objects."""
    del stage
    held_out = context.trials("held-out")
    first = held_out.first
    if not first.any():
        raise ConfigError("no scene of the held-out objects has a grasp; record more scenes")
    slope, offset = fit_logits(logits_of(context.networks(), held_out.readings[first]), held_out.held[first])
    return {"calibration": [slope, offset], "grasps": int(first.sum())}
