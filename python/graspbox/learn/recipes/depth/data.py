"""Stage ``data``: a data set of simulated trials, unless ``--data`` names some or nothing learns from trials."""

from typing import Any

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.data import trials as dataset
from graspbox.errors import ConfigError
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.depth.context import DepthContext

__all__ = ["make_data"]


class TimeUp(Exception):  # noqa: N818 (no error)
    """The time limit of the data set is reached."""


def make_data(context: DepthContext, stage: Run) -> dict[str, Any]:
    """Make the data set, as far as the time limit allows; return the number of trials of each split."""
    sizes, settings = context.sizes, context.settings
    config = dataset.DatasetConfig(
        poses=sizes.poses, rests=sizes.rests, views=0, seed=settings.seed, physics=context.physics
    )

    def report(progress: dataset.Progress) -> None:
        share = progress.trials / max(1, progress.total)
        stage.report(f"{progress.trials} of {progress.total} trials, {progress.rate:.0f}/s", share)
        if stage.late():
            raise TimeUp

    late = False
    try:
        objects = list(settings.objects)
        dataset.generate(objects, context.data[0], hand=context.grid.hand, config=config, progress=report)
    except TimeUp:
        stage.log("time limit reached; continuing with the trials collected")
        late = True
    return {split: _count(context, split, late) for split in ("train", "validation")}


def _count(context: DepthContext, split: object_sets.Split, late: bool) -> int:
    try:
        return len(GraspTrials.from_datasets(context.data, split))
    except ConfigError as error:
        if not late:
            raise
        spent = context.settings.hours.data
        raise ConfigError(
            f"{context.data[0]} has no trials of the split {split!r} after --hours.data {spent:g}; run the same "
            "command with more (graspbox hand train: --minutes.tuned), and it goes on"
        ) from error
