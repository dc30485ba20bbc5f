"""``graspbox train any-hand``: its stages in order.

`graspbox.learn.recipes.settings.any_hand.AnyHandSettings` describes each.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from graspbox.data.trials.learned import of_splits
from graspbox.learn.recipes.any_hand.calibration import calibrate
from graspbox.learn.recipes.any_hand.collection import collect_trials
from graspbox.learn.recipes.any_hand.context import AnyHandContext
from graspbox.learn.recipes.any_hand.publish import evaluate, export_policy
from graspbox.learn.recipes.any_hand.scorer import learn
from graspbox.learn.recipes.cards.depth import write_any_hand_card
from graspbox.learn.recipes.collection import unlearned
from graspbox.learn.recipes.settings.any_hand import ANY_HAND_QUICK, AnyHandSettings
from graspbox.learn.recipes.stages import Stage, outcome_of, run_stages
from graspbox.learn.training.options import TrainingOutcome
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import read_depth_policy

__all__ = ["train"]


def train(settings: AnyHandSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train any-hand``: all stages.

    Raises ConfigError if the folder holds a run with other settings, if the evaluation has only training objects, or if
    no hand is left to learn from.
    """
    if settings.quick:
        settings = replace(settings, **ANY_HAND_QUICK)
    learned = [*of_splits(settings.objects), *read_depth_policy(folder_of(settings.completion)).learned_from]
    for objects in settings.evaluated:
        unlearned(objects, learned)
    with settings.run(echo) as run:
        context = AnyHandContext(settings, run, learned)
        run_stages(run, context, _stages(settings))
        folder = context.policy_folder
        config = read_depth_policy(folder)
        write_any_hand_card(
            folder, config, command=command, settings=settings, scenes=context.scenes, stages=run.stages
        )
        return outcome_of(run, folder)


def _stages(settings: AnyHandSettings) -> Iterator[Stage[AnyHandContext]]:
    """List the stages in order."""
    hours = settings.hours
    yield Stage("trials", hours.trials, partial(collect_trials, number=0))
    yield Stage("scorer", hours.scorer, partial(learn, rounds=0))
    for number in range(1, settings.sizes.rounds + 1):
        yield Stage(f"collect-{number}", hours.collect, partial(collect_trials, number=number))
        yield Stage(f"round-{number}", hours.round, partial(learn, rounds=number))
    yield Stage("calibrate", hours.calibrate, calibrate)
    yield Stage("export", hours.evaluate, export_policy)
    for name, hand in settings.evaluated_hands().items():
        yield Stage(f"evaluate-{name}", hours.evaluate, partial(evaluate, hand=hand))
