"""Train the reference study's networks again, under its settings and under sane ones, and execute what they predict.

    python scripts/reproduce_study.py --out out/study --minutes-per-network 20
    python scripts/reproduce_study.py --out out/study --minutes-per-network 20 --resume
    python scripts/reproduce_study.py --out out/quick --networks cnn3d --losses psi4 --iterations 200
    python scripts/reproduce_study.py --out out/study --minutes-per-network 20 --resume --publish policies/study

The folder then holds ``study.md``, which shows tables 3.2 and 3.3 beside ours and figures 3.19 to 3.27; ``results.jsonl``
with a row per network; ``data/`` with the samples; and a folder per network (`graspbox.learning.training`), from which
`graspbox.learning.regressor.PoseRegressor` makes a policy.

An interrupted run continues with ``--resume`` and the same arguments: samples are kept, complete networks are not trained
again, and the one that was being trained continues from its last checkpoint. Networks that end by ``--minutes-per-network``
depend on the speed of the machine; those that end by ``--iterations`` or by early stopping do not.

``--publish`` exports the best of the networks that are small enough, with a card, for onnxruntime; `Cnn2d` has 190 MB.

Exit status: 0 at the end, 2 for wrong arguments, 130 for an interrupted run. Needs the extras ``cli``, ``ycb`` and
``train``.
"""  # noqa: E501

import json
import math
import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from rich.progress import Progress, TaskID

import graspbox
from graspbox import learning, object_sets
from graspbox.cli.common import console, print_json, progress
from graspbox.errors import ConfigError, GraspboxError
from graspbox.files import write_text
from graspbox.learning.execution import BASELINES, Scenes, execute
from graspbox.learning.grasps import PRESHAPE, Grasps, collect
from graspbox.learning.samples import Kind, Mapping, Samples, Split, make_samples, observe, split_at_random
from graspbox.learning.study_figures import normalized_figure, read_curve, training_figure
from graspbox.learning.study_results import PARTS, NetworkResult, network_table, page, position_spread
from graspbox.learning.study_settings import SAMPLES, SETTINGS, training_settings
from graspbox.object_sets import ObjectSet
from graspbox.resume_log import ResumeLog
from graspbox.validation.study import study_objects

#: Seeds of the views of unseen objects differ from those of the samples.
UNSEEN_SEED = 500
#: Views of unseen objects per network: as many as the study's test has images.
UNSEEN = 61
#: Arguments on which no network depends.
NOT_RESULTS = ("out", "resume", "json", "torch_threads", "publish", "measured", "trials")


@dataclass(frozen=True)
class Settings:
    """Arguments of a reproduction."""

    out: Path
    """Folder of the results."""
    settings: Literal["legacy", "sane", "both"] = "both"
    """The study's settings, ones under which its networks learn, or both."""
    networks: tuple[Literal["cnn2d", "cnn2d_dropout", "cnn3d"], ...] = ("cnn2d", "cnn2d_dropout", "cnn3d")
    """Networks to train."""
    losses: tuple[Literal["posenet", "psi1", "psi2", "psi3", "psi4", "euler"], ...] = ("psi4", "psi3", "psi2", "euler")
    """Losses to train each of them with; by default those of the study's tables."""
    mapping: Mapping = "many_to_one"
    """Which view goes with which pose; the study chose many_to_one."""
    voxels: Literal["binary", "ternary"] = "ternary"
    """Voxels of the 3D network."""
    objects: tuple[str, ...] = ()
    """Object sets; by default the study's ten objects of the YCB set."""
    samples: int | None = None
    """Number of samples; by default those of the study, 1,230 images and 189 grids."""
    units: Literal["relu", "sigmoid"] = "relu"
    """Units of the networks."""
    optimizer: Literal["sgd", "momentum", "nesterov", "adagrad", "adam", "delta_bar_delta"] | None = None
    """Optimiser instead of that of the settings."""
    learning_rate: float | None = None
    """Learning rate instead of that of the settings."""
    minutes_per_network: float | None = None
    """Wall time after which each network stops; by default early stopping alone ends it."""
    iterations: int | None = None
    """Iterations after which each network stops."""
    seed: int = 0
    """Seed of everything random."""
    resume: bool = False
    """Continue what is in the folder."""
    torch_threads: int = 2
    """Threads of the networks; other numbers round differently."""
    publish: Path | None = None
    """Folder of the best small network as a policy."""
    measured: tuple[str, ...] = ("procedural:unseen:0-19", "ycb/test")
    """Object sets on which that is measured; /SPLIT keeps one split."""
    trials: int = 1000
    """Trials on each of them."""
    json: bool = False
    """Print the results as JSON, and nothing else, on standard output."""


def check(settings: Settings) -> None:
    """Refuse arguments that are out of range."""
    for name, least in (("samples", 20), ("iterations", 1), ("torch_threads", 1), ("seed", 0), ("trials", 1)):
        value = getattr(settings, name)
        if value is not None and value < least:
            raise ConfigError(f"--{name.replace('_', '-')} is {value}; give {least} or more")
    for name in ("minutes_per_network", "learning_rate"):
        value = getattr(settings, name)
        if value is not None and not 0 < value < math.inf:
            raise ConfigError(f"--{name.replace('_', '-')} is {value}; give a positive number")
    for name in ("networks", "losses"):
        if not getattr(settings, name) or len(set(getattr(settings, name))) < len(getattr(settings, name)):
            raise ConfigError(f"--{name} is {' '.join(getattr(settings, name))!r}; name each once, one or more")


def kind_of(settings: Settings, network: str) -> Kind:
    """Kind of the inputs of a network."""
    return settings.voxels if network == "cnn3d" else "image"


def unseen_objects(objects: ObjectSet) -> ObjectSet:
    """YCB objects of the test split that are not among the objects, nor of their kind: same number, other letter."""
    known = {name[:3] for name in objects.names}
    kept = tuple(spec for spec in object_sets.load("ycb", split="test") if spec.name[:3] not in known)
    return ObjectSet("unseen", kept)


def make_data(settings: Settings, objects: ObjectSet) -> dict[str, tuple[Samples, Samples]]:
    """Make the samples, and views of unseen objects, of each kind; or read them if they have been made.

    The poses of the latter are not known: they are zeros, and only the objects are used.
    """
    folder = settings.out / "data"
    kinds = {kind_of(settings, network): network for network in settings.networks}
    counts = {kind: settings.samples or SAMPLES[network] for kind, network in kinds.items()}
    grasps: dict[int, Any] = {}
    data = {}
    with progress() as bar:
        for kind, count in counts.items():
            paths = [folder / f"{part}_{kind}.npz" for part in ("samples", "unseen")]
            if not paths[0].is_file():
                task = bar.add_task(f"{count} grasps", total=count)
                if count not in grasps:
                    grasps[count] = collect(objects, count, seed=settings.seed, done=counter(bar, task))
                    without_inputs(grasps[count]).save(folder / f"grasps_{count}.npz")
                task = bar.add_task(f"{count} samples, {kind}", total=count)
                options: dict[str, Any] = {"kind": kind, "mapping": settings.mapping, "seed": settings.seed}
                make_samples(objects, grasps[count], **options, done=counter(bar, task)).save(paths[0])
            if not paths[1].is_file():
                make_unseen(unseen_objects(objects), kind).save(paths[1])
            data[kind] = (Samples.load(paths[0]), Samples.load(paths[1]))
    return data


def without_inputs(grasps: Grasps) -> Samples:
    """Give grasps as samples that show nothing, for the baseline that averages all of an object's grasps."""
    nothing = np.zeros((len(grasps), 0), dtype=np.uint8)
    return Samples(grasps.names, nothing, grasps.object, grasps.base_from_hand, grasps.preshape)


def counter(bar: Progress, task: TaskID) -> Callable[[int], None]:
    """Make a function that shows how many are done."""
    return lambda done: bar.update(task, completed=done)


def make_unseen(objects: ObjectSet, kind: Kind) -> Samples:
    """See each of the unseen objects equally often."""
    views = math.ceil(UNSEEN / len(objects))
    inputs, rows = [], []
    for i, spec in enumerate(objects):
        seen = observe(graspbox.Scene(spec.load()), kind, views, UNSEEN_SEED + i)
        inputs.append(seen)
        rows += [i] * len(seen)
    count = len(rows)
    poses, preshape = np.zeros((count, 4, 4)), np.full(count, PRESHAPE)
    return Samples(objects.names, np.concatenate(inputs), np.array(rows), poses, preshape)


def parts_of(samples: Samples, split: Split, seed: int) -> dict[str, Samples]:
    """Parts of the samples for the errors of the tables; of the training part as many as the validation has."""
    chosen = np.random.default_rng(seed).permutation(split.train)[: len(split.validation)]
    return {"train": samples[np.sort(chosen)], "test": samples[split.test], "validation": samples[split.validation]}


def run_network(
    settings: Settings, name: str, network: str, loss: str, data: tuple[Samples, Samples], scenes: Scenes
) -> NetworkResult:
    """Train one network, or continue, and execute its predictions."""
    from graspbox.learning.losses import LossWeights
    from graspbox.learning.model import ModelConfig, PoseModel, moved
    from graspbox.learning.training import TrainConfig, measure, train

    samples, unseen = data
    split = split_at_random(len(samples), settings.seed)
    chosen = training_settings(name, network)
    chosen |= {k: v for k in ("optimizer", "learning_rate") if (v := getattr(settings, k)) is not None}
    zero_output = chosen.pop("zero_output")
    weights = LossWeights(**chosen.pop("weights"))
    config = TrainConfig(**chosen, weights=weights, seed=settings.seed)
    made = ModelConfig(network, loss, kind_of(settings, network), settings.units, zero_output, PRESHAPE)
    folder = settings.out / name / network / loss
    budget = {"minutes": settings.minutes_per_network, "iterations": settings.iterations}
    with progress() as bar:
        task = bar.add_task(f"{name} {network} {loss}", total=None)

        def show(iteration: int, row: dict[str, float]) -> None:
            bar.update(task, description=f"{name} {network} {loss}: iteration {iteration}, error {row['loss']:.4g}")

        model = train(made, samples, split, config, folder, **budget, resume=settings.resume, done=show)
    parts = parts_of(samples, split, settings.seed)
    errors = {part: asdict(measure(model, parts[part], weights)) for part in PARTS}
    test = parts["test"]
    poses = model.predict(test.inputs)
    curve = read_curve(folder).train
    norms = [curve["orientation_norm"][i] for i in (0, min(1, len(curve["iteration"]) - 1), -1)]
    return NetworkResult(
        settings=name,
        network=network,
        loss=loss,
        **stopped(folder),
        errors=errors,
        test=execute(scenes, test, poses),
        unseen=execute(scenes, unseen, model.predict(unseen.inputs)),
        spread={"predicted": position_spread(poses), "labels": position_spread(test.base_from_hand)},
        orientation_norm=tuple(norms),
        moved=moved(PoseModel(made, settings.seed), model),
    )


def stopped(folder: Path) -> dict[str, Any]:
    """Read why and when a run stopped."""
    result = json.loads((folder / "result.json").read_text())
    return {"stopped": result["stopped"], "iterations": result["iteration"], "seconds": result["seconds"]}


def run_baselines(settings: Settings, data: dict[str, tuple[Samples, Samples]], scenes: Scenes) -> dict[str, Any]:
    """Execute what the baselines predict, for each kind of data."""
    found: dict[str, Any] = {}
    for kind, (samples, unseen) in data.items():
        split = split_at_random(len(samples), settings.seed)
        train, test = samples[split.train], samples[split.test]
        found[kind] = {name: asdict(execute(scenes, test, guess(train, test))) for name, guess in BASELINES.items()}
        blind = {name: BASELINES[name](train, unseen) for name in ("nearest", "constant")}
        found[f"{kind}, unseen objects"] = {name: asdict(execute(scenes, unseen, it)) for name, it in blind.items()}
    # What a network learns that minimizes its error over all poses that are right for what it sees.
    for path in sorted((settings.out / "data").glob("grasps_*.npz")):
        known = Samples.load(path)
        first = known[np.unique(known.object, return_index=True)[1]]
        score = execute(scenes, first, BASELINES["average"](known, first))
        found[f"all {len(known)} grasps, one trial per object"] = {"average": asdict(score)}
    return found


def write_figures(settings: Settings, results: list[NetworkResult]) -> dict[str, str]:
    """Write the figures; gives their file names by caption."""
    from graspbox.learning.losses import LOSSES

    curves = {
        (r.settings, r.network, r.loss): read_curve(settings.out / r.settings / r.network / r.loss) for r in results
    }
    figures = {}
    for network in settings.networks:
        for loss in settings.losses:
            columns = {name: curve for (name, *rest), curve in curves.items() if rest == [network, loss]}
            if columns:
                file = f"{network}_{loss}.png"
                training_figure(settings.out / file, f"{network}, loss {loss}", columns)
                figures[f"{network}, {loss} (figures 3.19 to 3.26)"] = file
    panels = {}
    for name in SETTINGS:
        for network in settings.networks:
            found = [
                (loss, LOSSES[loss].greatest, curve)
                for (s, n, loss), curve in curves.items()
                if (s, n) == (name, network)
            ]
            if found:
                panels[f"{network}, {name}"] = found
    normalized_figure(settings.out / "normalized.png", panels)
    return {**figures, "Orientation errors of all losses, normalized to their maximum (figure 3.27)": "normalized.png"}


def reproduce(settings: Settings, command: str) -> list[NetworkResult]:
    """Make the data, train the networks one after another, and write the page after each of them."""
    check(settings)
    learning.require()
    import torch

    torch.set_num_threads(settings.torch_threads)
    objects = object_sets.load(list(settings.objects) or study_objects())
    path = settings.out / "results.jsonl"
    if path.is_file() and not settings.resume:
        raise ConfigError(f"{str(settings.out)!r} holds results; continue with --resume, or name another folder")
    fixed = {k: v for k, v in asdict(settings).items() if k not in NOT_RESULTS}
    fixed |= {"objects": list(objects.names), "networks": list(settings.networks), "losses": list(settings.losses)}
    log = ResumeLog(path, fixed)
    data = make_data(settings, objects)
    unseen = next(iter(data.values()))[1].names
    everything = ObjectSet("all", (*objects, *(s for s in object_sets.load("ycb") if s.name in unseen)))
    scenes = Scenes(everything)
    if not any("baselines" in row for row in log.rows):
        log.append({"baselines": run_baselines(settings, data, scenes)})
    names = SETTINGS if settings.settings == "both" else (settings.settings,)
    jobs = [(name, network, loss) for network in settings.networks for loss in settings.losses for name in names]
    known = {(r["settings"], r["network"], r["loss"]) for r in log.rows if "network" in r}
    started = time.monotonic()
    todo = [job for job in jobs if job not in known]
    for i, job in enumerate(todo):
        log.append(run_network(settings, *job, data[kind_of(settings, job[1])], scenes).row())
        results = write_page(settings, command, log, data)
        left = (time.monotonic() - started) / (i + 1) * (len(todo) - i - 1) / 60
        console.print(
            f"{' '.join(job)} is complete: {len(jobs) - len(todo) + i + 1} of {len(jobs)}, about {left:.0f} min left"
        )
    results = results if todo else write_page(settings, command, log, data)
    if settings.publish is not None:
        publish(settings, settings.publish, results, data, objects, command)
    return results


def publish(
    settings: Settings,
    folder: Path,
    results: list[NetworkResult],
    data: dict[str, tuple[Samples, Samples]],
    learned: ObjectSet,
    command: str,
) -> None:
    """Publish the best small network."""
    from graspbox.policy_training.study import publish_best

    with progress() as bar:
        task = bar.add_task(folder.name, total=settings.trials * len(settings.measured))
        publish_best(
            folder,
            settings.out,
            results,
            data,
            mapping=settings.mapping,
            learned_from=[spec.source for spec in learned],
            objects=settings.measured,
            trials=settings.trials,
            seed=settings.seed,
            command=command,
            licence=Path(__file__).parents[1] / "LICENSE",
            progress=counter(bar, task),
        )


def write_page(
    settings: Settings, command: str, log: ResumeLog, data: dict[str, tuple[Samples, Samples]]
) -> list[NetworkResult]:
    """Write figures and page of the networks that are complete."""
    results = [NetworkResult.from_row(row) for row in log.rows if "network" in row]
    baselines = next(row["baselines"] for row in log.rows if "baselines" in row)
    facts = {"graspbox": graspbox.__version__, "mapping": settings.mapping, "preshape": f"{PRESHAPE:.4f} rad"}
    for kind, (samples, unseen) in data.items():
        split = split_at_random(len(samples), settings.seed)
        sizes = f"{len(split.train)}/{len(split.validation)}/{len(split.test)} for training, validation and test"
        facts[f"{kind} samples"] = (
            f"{len(samples)} of {len(samples.names)} objects, {sizes}; {len(unseen)} of unseen objects"
        )
        facts["objects"] = ", ".join(samples.names)
        facts["unseen objects"] = ", ".join(unseen.names)
    figures = write_figures(settings, results)
    write_text(settings.out / "study.md", page(command, facts, results, baselines, figures))
    return results


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and run; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    settings = tyro.cli(Settings, args=given, description=__doc__)
    command = shlex.join(["python", "scripts/reproduce_study.py", *given])
    try:
        results = reproduce(settings, command)
    except KeyboardInterrupt:
        console.print("interrupted; continue with --resume")
        return 130
    except (GraspboxError, OSError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    if settings.json:
        print_json([result.row() for result in results])
    else:
        for network in dict.fromkeys(result.network for result in results):
            print(network_table(network, results))
        print(settings.out / "study.md")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
