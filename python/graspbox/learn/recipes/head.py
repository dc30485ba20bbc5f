"""A head, one network from a depth image to a grasp, trained and evaluated: ``graspbox train head``."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from graspbox import evaluation, object_sets
from graspbox._common.files import write_text
from graspbox._common.runs import Rows, Run
from graspbox.data.trials.learned import of_datasets
from graspbox.errors import ConfigError
from graspbox.learn.export.exports import export_head
from graspbox.learn.models.head.batches import untried_scenes
from graspbox.learn.models.head.policy import TrainedHead
from graspbox.learn.models.head.training import HeadData, load_head, train_head
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.cards.depth import write_head_card
from graspbox.learn.recipes.cards.writing import package_licence, rate
from graspbox.learn.recipes.collection import check_hand, load_trials
from graspbox.learn.recipes.settings.head import HeadSettings
from graspbox.learn.recipes.stages import reporter
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.options import TrainingOutcome
from graspbox.object_sets import name_and_split
from graspbox.perception import HandGrid
from graspbox.perception.hand_settings import settings_of
from graspbox.policies.published.folders import load
from graspbox.policies.published.head_configs import HeadConfig

__all__ = ["train"]

#: Folder of the trained head in that of the run.
_TRAINED = "trained"


def train(settings: HeadSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train head``: train the head and evaluate it on each object set, with and without its filter.

    Raises ConfigError if the folder holds a run with other settings, or a data set is missing or of another hand.
    """
    check_hand(settings.data, settings.load_hand())
    with settings.run(echo) as run:
        rows = run.rows("results")
        trained = next((row for row in rows if "step" in row), None)
        if trained is None:
            trained = _train(settings, run, _read(settings, run))
            rows.append(trained)
        if settings.trials:
            _measure_all(settings, run, rows)
        measured = [row for row in rows if "objects" in row]
        write_text(run.folder / "head.md", f"# Head\n\n```\n{command}\n```\n\n{_table(measured)}")
        if settings.publish is not None:
            _publish(settings, settings.publish)
            write_head_card(settings.publish, settings, command, trained, measured)
        return TrainingOutcome(measured, _table(measured))


def _rounds_of(run: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Return the trials of all rounds of a run of ``graspbox train depth``, and the object sets of its policy."""
    rounds = sorted(run.glob("collect-*/train"))
    if not rounds or not (run / "policy").is_dir():
        raise ConfigError(f"--on-policy is {str(run)!r}, which has no finished run of graspbox train depth")
    return rounds, load(run / "policy").learned_from


def _read(settings: HeadSettings, run: Run) -> HeadData:
    """Read the data sets."""
    trials, validation = (GraspTrials.from_datasets(settings.data, split) for split in ("train", "validation"))
    if settings.on_policy is not None:
        trials = GraspTrials.joined([trials, *map(load_trials, _rounds_of(settings.on_policy)[0])])
    run.log(f"{len(trials)} trials in {len(trials.source)} scenes; {len(validation)} to validate with")
    if settings.untried:
        objects = object_sets.load(settings.untried)
        more = untried_scenes(objects, settings.untried_scenes, settings.seed)
        trials = GraspTrials.joined([trials, more])
    hand = settings.load_hand()
    fitted = settings_of(hand)
    return HeadData.of(trials, validation, HandGrid(hand, fitted.grid), fitted.anchors, seed=settings.seed)


def _train(settings: HeadSettings, run: Run, data: HeadData) -> dict[str, Any]:
    """Train the head, or resume its training."""
    trials = data.sampler.trials
    config = TrainConfig(
        learning_rate=settings.learning_rate,
        batch_size=16,
        max_steps=settings.steps,
        validate_every=min(250, settings.steps),
        patience=settings.steps,
        max_seconds=60.0 * settings.minutes,
        seed=settings.seed,
        device=settings.device,
    )
    head = HeadConfig(width=settings.width, anchors=data.sampler.anchors.config)
    trained = train_head(run.folder / _TRAINED, data, head, config, reporter(run, "share of holds"))
    return {"trials": len(trials), "scenes": len(trials.source), **asdict(trained)}


def _measure_all(settings: HeadSettings, run: Run, rows: Rows) -> None:
    """Evaluate the head on the object sets on which it was not evaluated yet."""
    known = {(row["objects"], row["filtered"]) for row in rows if "objects" in row}
    for objects in settings.objects:
        for filtered in (False, True):
            if (objects, filtered) not in known:
                rows.append(_measure(settings, run, objects, filtered))


def _measure(settings: HeadSettings, run: Run, objects: str, filtered: bool) -> dict[str, Any]:
    """Evaluate the head in ``GraspPose-v0``."""
    name, split = name_and_split(objects)
    policy = TrainedHead(run.folder / _TRAINED, filtered=filtered)
    result = evaluation.evaluate(
        policy,
        objects=name,
        split=split,
        trials=settings.trials,
        seed=settings.seed,
        hand=settings.named_hand,
        progress=run.counter(settings.trials, f"trials ({objects})"),
    )
    seconds = [grasp.seconds["propose"] for grasp in policy.found if grasp is not None]
    return {
        "filtered": filtered,
        "objects": objects,
        "trials": len(result.trials),
        "success": result.succeeded,
        "secure": result.secure,
        "infeasible": result.failures.get("infeasible", 0),
        "milliseconds": 1e3 * sorted(seconds)[len(seconds) // 2] if seconds else None,
    }


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format the table: rates with Wilson intervals."""
    lines = ["| collisions | objects | trials | success | secure | infeasible |", "|---|---|--:|--:|--:|--:|"]
    for row in rows:
        rates = " | ".join(rate(row[name], row["trials"]) for name in ("success", "secure"))
        filtered = "filtered" if row["filtered"] else "unfiltered"
        lines.append(f"| {filtered} | {row['objects']} | {row['trials']} | {rates} | {row['infeasible']} |")
    return "\n".join(lines) + "\n"


def _publish(settings: HeadSettings, folder: Path) -> None:
    """Export the head."""
    net = load_head(settings.out / _TRAINED, len(HandGrid(settings.named_hand).preshapes))
    chosen = () if settings.on_policy is None else _rounds_of(settings.on_policy)[1]
    export_head(
        folder,
        folder.name,
        net,
        learned_from=[*of_datasets(settings.data), *settings.untried, *chosen],
        hand=settings.named_hand,
        licence=package_licence(),
    )
