"""Recipes as lists of stages, run one after the other in a run directory; a later call continues with the next one."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from graspbox._common.runs import Run
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.options import Options, TrainingOutcome
from graspbox.learn.training.trainer import Trained, TrainProgress

__all__ = ["Stage", "outcome_of", "reporter", "results_of", "run_stages", "train_config"]

Context = TypeVar("Context")


@dataclass(frozen=True)
class Stage(Generic[Context]):
    """A stage of a recipe: its name, its time limit, and a function that does the work.

    The name is unique within the run: results of the stage are in ``NAME.json``, its files in the folder ``NAME``. The
    function takes the recipe's context, which all stages share, and the stage's own run; it reads what earlier stages
    made from the folder of the recipe's run, and returns results that JSON can hold.
    """

    name: str
    hours: float
    work: Callable[[Context, Run], dict[str, Any]]


def run_stages(run: Run, context: Context, stages: Iterable[Stage[Context]]) -> None:
    """Run the stages in order, except those that are done."""
    logger = logging.getLogger("graspbox")
    logger.addFilter(_is_news)
    try:
        for stage in stages:

            def work(own: Run, stage: Stage[Context] = stage) -> dict[str, Any]:
                return stage.work(context, own)

            run.stage(stage.name, 3600 * stage.hours, work)
    finally:
        logger.removeFilter(_is_news)


def _is_news(record: logging.LogRecord) -> bool:
    """Whether a warning says more than that an object fell over from a sampled pose, as many do."""
    return "before it came to rest" not in record.getMessage()


def train_config(stage: Run, options: Options, offset: int = 0, **settings: Any) -> TrainConfig:
    """Return how a stage trains a network; the offset is added to the seed."""
    return TrainConfig(max_seconds=stage.limit, seed=options.seed + offset, device=options.device, **settings)


def outcome_of(run: Run, folder: Path) -> TrainingOutcome:
    """Return the outcome of a recipe that made a policy in a folder."""
    run.log(f"the policy is in {folder}")
    return TrainingOutcome({"folder": str(folder), **run.stages}, str(folder))


def reporter(run: Run, measure: str) -> Callable[[TrainProgress], None]:
    """Return a function that logs the progress of a training in a run."""

    def report(progress: TrainProgress) -> None:
        best = f", best {measure} {progress.best:.3f}" if progress.best > -np.inf else ""
        run.report(f"step {progress.step}{best}", progress.share)

    return report


def results_of(trained: Trained) -> dict[str, Any]:
    """Return the results of a training."""
    return {"reason": trained.reason, "steps": trained.step, "best": round(trained.best, 4)}
