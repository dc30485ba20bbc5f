"""``graspbox train feel``: its stages in order.

`graspbox.learn.recipes.settings.feel.FeelSettings` describes each.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from graspbox.learn.recipes.cards.depth import write_feel_card
from graspbox.learn.recipes.collection import unlearned
from graspbox.learn.recipes.feel.context import FeelContext
from graspbox.learn.recipes.feel.evaluate import evaluate
from graspbox.learn.recipes.feel.networks import calibrate, train_member
from graspbox.learn.recipes.feel.publish import choose_threshold, export_policy
from graspbox.learn.recipes.feel.recording import record
from graspbox.learn.recipes.settings.feel import FEEL_QUICK, FeelSettings
from graspbox.learn.recipes.stages import Stage, outcome_of, run_stages
from graspbox.learn.training.options import TrainingOutcome
from graspbox.policies import DepthGrasp
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import read_depth_policy

__all__ = ["train"]


def train(settings: FeelSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train feel``: all stages.

    Raises ConfigError if the folder holds a run with other settings, the policy does not use one depth image, or the
    evaluation has only training objects.
    """
    if settings.quick:
        settings = replace(settings, **FEEL_QUICK)
    settings = replace(settings, policy=folder_of(str(settings.policy)))
    config = read_depth_policy(settings.policy)
    learned = (*DepthGrasp(settings.policy).learned_from, settings.objects, settings.held_out)
    evaluated = {objects: unlearned(objects, learned) for objects in settings.evaluated}
    with settings.run(echo, {**settings.kept(), "policy": dict(config.files), "hand": config.hand}) as run:
        context = FeelContext(settings, run, evaluated)
        run_stages(run, context, _stages(settings))
        folder = context.policy_folder
        write_feel_card(folder, settings, command, run.stages)
        return outcome_of(run, folder)


def _stages(settings: FeelSettings) -> Iterator[Stage[FeelContext]]:
    """List the stages in order."""
    hours = settings.hours
    yield Stage("record-train", hours, partial(record, part="train"))
    yield Stage("record-held-out", hours, partial(record, part="held-out"))
    for number in range(settings.sizes.members):
        yield Stage(f"member-{number}", hours, partial(train_member, number=number))
    yield Stage("calibrate", hours, calibrate)
    yield Stage("export", hours, export_policy)
    yield Stage("threshold", hours, choose_threshold)
    yield Stage("evaluate", hours, evaluate)
