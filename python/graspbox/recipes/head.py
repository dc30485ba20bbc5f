"""Heads, each one network from a depth image to a grasp, trained and evaluated: ``graspbox train head``."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from graspbox import evaluation, object_sets
from graspbox._common.files import write_text
from graspbox.artifacts.exports import export_head
from graspbox.artifacts.folders import load
from graspbox.dataset.learned import of_datasets
from graspbox.errors import ConfigError
from graspbox.models.head.batches import untried_scenes
from graspbox.models.head.configs import HeadConfig, Kind
from graspbox.models.head.training import HeadData, choose_constant, load_head, train_head
from graspbox.models.trials import GraspTrials
from graspbox.object_sets import name_and_split
from graspbox.perception import HandGrid
from graspbox.perception.hand_settings import settings_of
from graspbox.policies import HeadGrasp
from graspbox.recipes.cards import package_licence, write_card
from graspbox.recipes.collection import check_hand, load_trials
from graspbox.recipes.depth import reporter
from graspbox.recipes.depth_cards import head_card
from graspbox.recipes.settings.head import HeadSettings
from graspbox.training.configs import TrainConfig
from graspbox.training.options import Outcome
from graspbox.training.runs import Rows, Run

__all__ = ["train"]


def train(settings: HeadSettings, command: str, echo: Callable[[str], None]) -> Outcome:
    """Run ``graspbox train head``: train and evaluate the heads that are missing.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings, or a data set is missing or of another hand.
    """
    check_hand(settings.data, settings.load_hand())
    with settings.run(echo) as run:
        rows = run.rows("results")
        done = {row["trained"] for row in rows if "trained" in row}
        data = None if set(settings.heads) <= done else _read(settings, run)
        for kind in settings.heads:
            if data is not None and kind not in done:
                rows.append({"trained": kind, **_train(settings, run, kind, data)})
            known = {(row["objects"], row["filtered"]) for row in rows if row.get("head") == kind}
            jobs = [(o, f) for o in settings.objects for f in ((False, True) if kind == "anchor" else (False,))]
            for objects, filtered in jobs if settings.trials else ():
                if (objects, filtered) not in known:
                    rows.append(_measure(settings, run, kind, objects, filtered))
        measured = [row for row in rows if "head" in row]
        write_text(run.folder / "heads.md", f"# Heads\n\n```\n{command}\n```\n\n{_table(measured)}")
        if settings.publish is not None:
            _publish(settings, settings.publish, rows, command)
        return Outcome(measured, _table(measured))


def _rounds_of(run: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Find the trials of all rounds of a run of ``graspbox train depth``, and the object sets of its policy."""
    found = sorted(run.glob("collect-*/train"))
    if not found or not (run / "policy").is_dir():
        raise ConfigError(f"--on-policy is {str(run)!r}, which has no finished run of graspbox train depth")
    return found, load(run / "policy").learned_from


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


def _train(settings: HeadSettings, run: Run, kind: Kind, data: HeadData) -> dict[str, Any]:
    """Train one head, or resume its training."""
    trials = data.sampler.trials
    sizes = {"trials": len(trials), "scenes": len(trials.source)}
    if kind == "constant":
        return sizes | choose_constant(run.folder / kind, data)
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
    head = HeadConfig(kind=kind, width=settings.width, anchors=data.sampler.anchors.config)
    return sizes | asdict(train_head(run.folder / kind, data, head, config, reporter(run, "share of holds", kind)))


def _measure(settings: HeadSettings, run: Run, kind: Kind, objects: str, filtered: bool) -> dict[str, Any]:
    """Evaluate a head in ``GraspPose-v0``."""
    name, split = name_and_split(objects)
    policy = HeadGrasp(run.folder / kind, filtered=filtered)
    found = evaluation.evaluate(
        policy,
        objects=name,
        split=split,
        trials=settings.trials,
        seed=settings.seed,
        hand=settings.named_hand,
        progress=run.counter(settings.trials, f"trials of {kind} ({objects})"),
    )
    seconds = [one.seconds["head"] for one in policy.found if one is not None]
    return {
        "head": kind,
        "filtered": filtered,
        "objects": objects,
        "trials": len(found.trials),
        "success": found.succeeded,
        "secure": found.secure,
        "infeasible": found.failures.get("infeasible", 0),
        "milliseconds": 1e3 * sorted(seconds)[len(seconds) // 2] if seconds else None,
    }


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format the table: rates with Wilson intervals."""
    lines = [
        "| head | objects | trials | success | secure | infeasible |",
        "|---|---|--:|--:|--:|--:|",
    ]
    for row in rows:
        name = f"{row['head']}, collisions filtered" if row["filtered"] else row["head"]
        shares = []
        for count in (row["success"], row["secure"]):
            low, high = evaluation.wilson(count, row["trials"])
            shares.append(f"{100 * count / row['trials']:.1f} % ({100 * low:.0f} to {100 * high:.0f})")
        lines.append(f"| {name} | {row['objects']} | {row['trials']} | {' | '.join(shares)} | {row['infeasible']} |")
    return "\n".join(lines) + "\n"


def _publish(settings: HeadSettings, folder: Path, rows: Rows, command: str) -> None:
    """Export the head ``anchor``, with its card."""
    trained = next((row for row in rows if row.get("trained") == "anchor"), None)
    if trained is None:
        raise ConfigError("the head 'anchor' is published, but was not trained; add it to --heads")
    net = load_head(settings.out / "anchor", len(HandGrid(settings.named_hand).preshapes))
    chosen = () if settings.on_policy is None else _rounds_of(settings.on_policy)[1]
    learned = [*of_datasets(settings.data), *settings.untried, *chosen]
    made: dict[str, Any] = {"learned_from": learned, "hand": settings.named_hand, "licence": package_licence()}
    config = export_head(folder, folder.name, net, **made)
    scores = [row for row in rows if row.get("head") == "anchor"]
    data = ", ".join(f"`{path}`" for path in settings.data)
    if settings.on_policy is not None:
        data += f" and the rounds of `{settings.on_policy}`"
    data += " (split `train`)"
    if settings.untried:
        names = ", ".join(f"`{name}`" for name in settings.untried)
        data += f"; {settings.untried_scenes} of the scenes, of {names}, have no trials"
    card = head_card(folder, command=command, data=data, seed=settings.seed, trained=trained, scores=scores)
    write_card(folder, config, card)
