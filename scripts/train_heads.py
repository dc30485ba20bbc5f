"""Train heads on grasp trials, one network from one depth image to a grasp, and measure what each grasps.

    graspbox dataset --objects procedural:seen:0-199 --poses 112 --out out/data
    python scripts/train_heads.py --data out/data --out out/heads
    python scripts/train_heads.py --data out/depth/data/set --on-policy out/depth --out out/heads --heads anchor \
        --publish policies/head --trials 1000

Each head (`graspbox.perception.heads`) sees the same scenes for the same number of steps. With ``--on-policy`` it also
learns from what a policy chose in the rounds of ``scripts/train_depth_policy.py``. The folder then has a folder
per head, which `graspbox.policies.load` takes; ``results.jsonl`` with a row per head and object set; and ``heads.md``,
the table of them. With ``--publish`` the head ``anchor`` is exported with its card, for onnxruntime. The same command
continues what was interrupted, and does nothing twice. Runs that end by ``--minutes`` depend on the speed of the
machine; those that end by ``--steps`` do not.

Exit status: 0 at the end, 2 for wrong arguments, 130 for an interrupted run. Needs the extras ``cli``, ``data`` and
``train``, and ``ycb`` for these objects.
"""

import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from graspbox import evaluation, learning, object_sets
from graspbox.cli.common import console, print_json
from graspbox.errors import ConfigError, GraspboxError
from graspbox.files import write_text
from graspbox.object_sets import name_and_split
from graspbox.perception import HandGrid
from graspbox.perception.policy_folders import read_learned_from, write_learned_from
from graspbox.policies import HeadGrasp
from graspbox.resume_log import ResumeLog

#: Heads, from the plainest to the one that learns most from the same trials.
HEADS = ("constant", "regressor", "set", "anchor")


#: Arguments on which no result depends, or which a later run may extend.
NOT_RESULTS = ("out", "heads", "minutes", "json", "torch_threads", "publish")


@dataclass(frozen=True)
class Settings:
    """Arguments of the training."""

    data: tuple[Path, ...]
    """Data sets: their splits `train` and `validation` are used."""
    out: Path
    """Folder of the results."""
    on_policy: Path | None = None
    """Folder of a run of `train_depth_policy.py`: the trials of its rounds are learned from too."""
    untried: tuple[str, ...] = ()
    """Object sets that show the head `anchor` where the open hand can go, without trials."""
    untried_scenes: int = 500
    """Scenes of them."""
    heads: tuple[str, ...] = HEADS
    """Heads to train: constant, regressor, set, anchor."""
    steps: int = 4000
    """Steps of each head; a step shows 16 scenes."""
    minutes: float = 120.0
    """Wall time after which each head stops, if its steps are not done."""
    learning_rate: float = 2e-3
    """Greatest learning rate."""
    width: int = 32
    """Channels of the trunk at half the crop's resolution."""
    seed: int = 0
    """Seed of weights and batches."""
    objects: tuple[str, ...] = ("procedural:unseen:0-39", "ycb/test")
    """Object sets to measure on; /SPLIT keeps one split."""
    publish: Path | None = None
    """Folder of the exported head `anchor`."""
    trials: int = 200
    """Trials of each head on each of them; 0 measures nothing."""
    torch_threads: int = 1
    """Threads of the networks; other numbers round differently."""
    json: bool = False
    """Print the results as JSON, and nothing else, on standard output."""


def check(settings: Settings) -> None:
    """Refuse arguments that are out of range."""
    for name, least in (("steps", 1), ("untried_scenes", 1), ("trials", 0), ("torch_threads", 1), ("seed", 0)):
        if getattr(settings, name) < least:
            raise ConfigError(f"--{name.replace('_', '-')} is {getattr(settings, name)}; give {least} or more")
    if not settings.minutes > 0:
        raise ConfigError(f"--minutes is {settings.minutes}; give a positive number")
    if not settings.heads or not set(settings.heads) <= set(HEADS):
        raise ConfigError(f"--heads is {' '.join(settings.heads)!r}; name some of {', '.join(HEADS)}")


def rounds_of(run: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Find the trials of all rounds of a run of ``scripts/train_depth_policy.py``, and what its policy learned from."""
    found = sorted(run.glob("collect-*/train"))
    if not found or not (run / "policy").is_dir():
        raise ConfigError(f"--on-policy is {str(run)!r}, which holds no finished run of scripts/train_depth_policy.py")
    return found, read_learned_from(run / "policy")


def read(settings: Settings) -> Any:
    """Read the data sets."""
    from graspbox.perception.collect import load_trials
    from graspbox.perception.head_batches import untried_scenes
    from graspbox.perception.head_training import HeadData
    from graspbox.perception.trials import GraspTrials

    trials, validation = (GraspTrials.from_datasets(settings.data, split) for split in ("train", "validation"))
    if settings.on_policy is not None:
        trials = GraspTrials.joined([trials, *map(load_trials, rounds_of(settings.on_policy)[0])])
    console.print(f"{len(trials)} trials in {len(trials.source)} scenes; {len(validation)} to validate with")
    if settings.untried:
        objects = object_sets.load(settings.untried)
        more = untried_scenes(objects, settings.untried_scenes, settings.seed)
        trials = GraspTrials.joined([trials, more])
    return HeadData.of(trials, validation, HandGrid(), seed=settings.seed)


def train(settings: Settings, kind: str, data: Any) -> dict[str, Any]:
    """Train one head, or continue."""
    from graspbox.perception.head_configs import HeadConfig
    from graspbox.perception.head_training import choose_constant, train_head
    from graspbox.perception.training import TrainConfig

    trials = data.sampler.trials
    seen = {"trials": len(trials), "scenes": len(trials.source)}
    if kind == "constant":
        return seen | choose_constant(settings.out / kind, data)
    config = TrainConfig(
        learning_rate=settings.learning_rate,
        batch_size=16,
        max_steps=settings.steps,
        validate_every=min(250, settings.steps),
        patience=settings.steps,
        max_seconds=60.0 * settings.minutes,
        seed=settings.seed,
    )
    head = HeadConfig(kind=kind, width=settings.width)  # type: ignore[arg-type]
    ended = train_head(settings.out / kind, data, head, config)
    return seen | asdict(ended)


def measure(settings: Settings, kind: str, objects: str, filtered: bool) -> dict[str, Any]:
    """Let a head grasp objects in ``GraspPose-v0``."""
    name, split = name_and_split(objects)
    policy = HeadGrasp(settings.out / kind, filtered=filtered)
    found = evaluation.evaluate(policy, objects=name, split=split, trials=settings.trials, seed=settings.seed)
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


def table(rows: list[dict[str, Any]]) -> str:
    """Write the table: shares with Wilson intervals."""
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


def run(settings: Settings, command: str) -> list[dict[str, Any]]:
    """Train and measure every head; what is done already is kept."""
    check(settings)
    learning.require()
    import torch

    torch.set_num_threads(settings.torch_threads)
    fixed = {k: v for k, v in asdict(settings).items() if k not in NOT_RESULTS}
    fixed |= {
        "data": [str(path) for path in settings.data],
        "on_policy": None if settings.on_policy is None else str(settings.on_policy),
        "objects": list(settings.objects),
        "untried": list(settings.untried),
    }
    log = ResumeLog(settings.out / "results.jsonl", fixed)
    done = {row["trained"] for row in log.rows if "trained" in row}
    data = None if set(settings.heads) <= done else read(settings)
    for kind in settings.heads:
        if kind not in done:
            log.append({"trained": kind, **train(settings, kind, data)})
        jobs = [(o, f) for o in settings.objects for f in ((False, True) if kind == "anchor" else (False,))]
        known = {(row["objects"], row["filtered"]) for row in log.rows if row.get("head") == kind}
        for objects, filtered in jobs if settings.trials else ():
            if (objects, filtered) not in known:
                log.append(measure(settings, kind, objects, filtered))
        measured = [row for row in log.rows if "head" in row]
        write_text(settings.out / "heads.md", f"# Heads\n\n```\n{command}\n```\n\n{table(measured)}")
    if settings.publish is not None:
        publish(settings, settings.publish, log.rows, command)
    return [row for row in log.rows if "head" in row]


def publish(settings: Settings, folder: Path, rows: list[dict[str, Any]], command: str) -> None:
    """Export the head ``anchor`` with its card."""
    from graspbox.perception.head_export import export_head
    from graspbox.perception.head_training import load_head
    from graspbox.policy_training.cards import write_head_card
    from graspbox.policy_training.learned import of_datasets

    net = load_head(settings.out / "anchor", len(HandGrid().preshapes))
    config = export_head(folder, folder.name, net, licence=Path(__file__).parents[1] / "LICENSE")
    chosen = () if settings.on_policy is None else rounds_of(settings.on_policy)[1]
    write_learned_from(folder, [*of_datasets(settings.data), *settings.untried, *chosen])
    trained = next(row for row in rows if row.get("trained") == "anchor")
    scores = [row for row in rows if row.get("head") == "anchor"]
    data = ", ".join(f"`{path}`" for path in settings.data)
    if settings.on_policy is not None:
        data += f" and the rounds of `{settings.on_policy}`"
    data += " (split `train`)"
    if settings.untried:
        names = ", ".join(f"`{name}`" for name in settings.untried)
        data += f"; {settings.untried_scenes} of the scenes, of {names}, have no trials"
    write_head_card(
        folder, config=config, command=command, data=data, seed=settings.seed, trained=trained, scores=scores
    )


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and run; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    settings = tyro.cli(Settings, args=given, description=__doc__)
    try:
        rows = run(settings, shlex.join(["python", "scripts/train_heads.py", *given]))
    except KeyboardInterrupt:
        console.print("interrupted; the same command continues")
        return 130
    except (GraspboxError, OSError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    if settings.json:
        print_json(rows)
    else:
        print(table(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
