"""``graspbox train depth``: its stages in order.

`graspbox.learn.recipes.settings.depth.DepthSettings` describes each.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from graspbox.data.trials.learned import of_datasets, of_splits
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.cards.depth import write_depth_card
from graspbox.learn.recipes.collection import check_hand, unlearned
from graspbox.learn.recipes.depth.calibration import calibrate
from graspbox.learn.recipes.depth.collection import collect_choices
from graspbox.learn.recipes.depth.completion import complete
from graspbox.learn.recipes.depth.context import DepthContext
from graspbox.learn.recipes.depth.data import make_data
from graspbox.learn.recipes.depth.evaluate import clear, evaluate
from graspbox.learn.recipes.depth.head import train_first_head, train_head_further
from graspbox.learn.recipes.depth.publish import export_ablations, export_policy
from graspbox.learn.recipes.depth.scorer import learn
from graspbox.learn.recipes.networks import is_published, learned_before, scorer_width
from graspbox.learn.recipes.settings.depth import HEAD_OF_ROUNDS, QUICK, QUICK_OBJECTS, DepthSettings
from graspbox.learn.recipes.stages import Stage, outcome_of, run_stages
from graspbox.learn.training.options import TrainingOutcome
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import read_depth_policy

__all__ = ["train"]


def train(settings: DepthSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train depth``: all stages.

    Raises ConfigError if the folder holds a run with other settings, if the evaluation has only training objects, if a
    data set has no held-out trials, or if a data set or the policy with which it begins is of another hand.
    """
    if settings.quick:
        settings = replace(settings, sizes=QUICK, **QUICK_OBJECTS)
    if settings.start is not None:
        start = folder_of(str(settings.start))
        settings = replace(settings, start=start, sizes=replace(settings.sizes, width=scorer_width(start)))
    learned = _learned(settings)
    for objects in settings.evaluated:
        unlearned(objects, learned)
    check_hand(settings.data, settings.load_hand())
    if settings.start is not None and is_published(settings.start):
        read_depth_policy(settings.start).settings_for(settings.load_hand())
    with settings.run(echo) as run:
        context = DepthContext(settings, run, learned)
        if settings.data:
            # Without held-out trials nothing can be selected.
            GraspTrials.from_datasets(settings.data, "validation")
        run_stages(run, context, _stages(context))
        folder = context.policy_folder
        config = read_depth_policy(folder)
        write_depth_card(folder, config, command=command, settings=settings, scenes=context.scenes, stages=run.stages)
        return outcome_of(run, folder)


def _learned(settings: DepthSettings) -> list[str]:
    """Name the objects from which the policy learns, also by the networks with which it begins."""
    learned = [*of_datasets(settings.data), *of_splits((*settings.objects, *settings.fresh))]
    if settings.completion is not None:
        learned += read_depth_policy(folder_of(settings.completion)).learned_from
    if settings.start is not None:
        learned += learned_before(settings.start)
    return learned


def _stages(context: DepthContext) -> Iterator[Stage[DepthContext]]:
    """List the stages in order."""
    hours, sizes = context.settings.hours, context.sizes
    if not context.settings.data and context.learns_from_trials:
        yield Stage("data", hours.data, make_data)
    yield Stage("completion", hours.completion, complete)
    yield Stage("scorer", hours.scorer, partial(learn, rounds=0))
    yield Stage("head", hours.head, train_first_head)
    for number in range(1, sizes.rounds + 1):
        yield Stage(f"collect-{number}", hours.collect, partial(collect_choices, number=number))
        yield Stage(f"round-{number}", hours.round, partial(learn, rounds=number))
    if sizes.rounds and sizes.head_round_steps and not context.has_several:
        yield Stage(HEAD_OF_ROUNDS, hours.head_rounds, train_head_further)
    yield Stage("calibrate", hours.calibrate, calibrate)
    yield Stage("export", hours.evaluate, export_policy)
    yield Stage("ablations", hours.evaluate, export_ablations)
    yield Stage("evaluate", hours.evaluate, evaluate)
    if any(layout != "single" for layout in context.layouts):
        yield Stage("clear", hours.evaluate, clear)
