"""The reference study's networks, retrained, executed and published: ``graspbox train study``."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np

import graspbox
from graspbox import object_sets
from graspbox._common.files import write_text
from graspbox._common.progress import shown_time
from graspbox._common.runs import Rows, Run
from graspbox.errors import ConfigError
from graspbox.learn.export.weight_files import LARGEST_NETWORK
from graspbox.learn.recipes.cards.networks import measure
from graspbox.learn.recipes.cards.writing import package_licence, write_card
from graspbox.learn.training.options import TrainingOutcome
from graspbox.learn.training.trainer import TrainProgress
from graspbox.object_sets import ObjectSet
from graspbox.study.comparison import study_objects
from graspbox.study.execution import BASELINES, ObjectScenes, execute
from graspbox.study.export import export_pose_model
from graspbox.study.figures import normalized_figure, read_curve, training_figure
from graspbox.study.grasps import PRESHAPE, Grasps, collect
from graspbox.study.losses import LOSSES, LossWeights
from graspbox.study.model import ModelConfig, PoseModel, moved
from graspbox.study.model_configs import LossName, NetworkName
from graspbox.study.reproduction.protocol import SAMPLES, SETTINGS, SettingsName, training_settings
from graspbox.study.reproduction.results import PARTS, NetworkResult, network_table, page, position_spread
from graspbox.study.reproduction.settings import StudySettings
from graspbox.study.samples import Kind, Samples, Split, make_samples, observe, split_at_random
from graspbox.study.training import STUDY, Objective
from graspbox.study.training import measure as measure_errors
from graspbox.study.training import train as train_network

__all__ = ["best_small", "train"]

#: Number of views on which an export is checked.
_CHECKED = 16
#: Seeds of the views of unseen objects differ from those of the samples.
_UNSEEN_SEED = 500
#: Views of unseen objects per network: as many as the study has test images.
_UNSEEN = 61

Data = Mapping[str, tuple[Samples, Samples]]


def train(settings: StudySettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train study``: make the data, train the networks, and update the page after each network."""
    objects = object_sets.load(list(settings.objects) or study_objects())
    with settings.run(echo, {**settings.kept(), "objects": list(objects.names)}) as run:
        rows = run.rows("results")
        data = _make_data(settings, objects, run)
        unseen = next(iter(data.values()))[1].names
        others = (spec for spec in object_sets.load("ycb") if spec.name in unseen)
        scenes = ObjectScenes(ObjectSet("all", (*objects, *others)), settings.hand)
        if not any("baselines" in row for row in rows):
            rows.append({"baselines": _run_baselines(settings, data, scenes)})
        names = SETTINGS if settings.settings == "both" else (settings.settings,)
        jobs = [(name, network, loss) for network in settings.networks for loss in settings.losses for name in names]
        known = {(r["settings"], r["network"], r["loss"]) for r in rows if "network" in r}
        todo, started = [job for job in jobs if job not in known], time.monotonic()
        for i, job in enumerate(todo):
            rows.append(_run_network(settings, *job, data[_kind_of(settings, job[1])], scenes, run).row())
            _write_page(settings, command, rows, data)
            left = (time.monotonic() - started) / (i + 1) * (len(todo) - i - 1)
            done = len(jobs) - len(todo) + i + 1
            run.log(f"{' '.join(job)} is complete: {done} of {len(jobs)}, about {shown_time(left)} left")
        results = _write_page(settings, command, rows, data)
        if settings.publish is not None:
            learned = [spec.source for spec in objects]
            _publish(settings, settings.publish, results, data, learned, command, run)
    tables = [network_table(network, results) for network in dict.fromkeys(result.network for result in results)]
    return TrainingOutcome([result.row() for result in results], "\n".join([*tables, str(settings.out / "study.md")]))


def _preshape(settings: StudySettings) -> float:
    """Return the preshape of the hand that is nearest to the study's."""
    nearest = min(settings.load_hand().preshapes.values(), key=lambda preshape: abs(preshape - PRESHAPE))
    return PRESHAPE if np.isclose(nearest, PRESHAPE) else nearest


def _kind_of(settings: StudySettings, network: str) -> Kind:
    """Kind of a network's inputs."""
    return settings.voxels if network == "cnn3d" else "image"


def _unseen_objects(objects: ObjectSet) -> ObjectSet:
    """YCB objects of the test split that are no training objects, nor variants of them (same number, other letter)."""
    known = {name[:3] for name in objects.names}
    kept = tuple(spec for spec in object_sets.load("ycb", split="test") if spec.name[:3] not in known)
    return ObjectSet("unseen", kept)


def _make_data(settings: StudySettings, objects: ObjectSet, run: Run) -> dict[str, tuple[Samples, Samples]]:
    """Make the samples, and views of unseen objects, of each kind; or read them if they exist.

    The poses of the latter are unknown and set to zeros; only their objects are used.
    """
    folder = run.folder / "data"
    kinds = {_kind_of(settings, network): network for network in settings.networks}
    counts = {kind: settings.samples or SAMPLES[network] for kind, network in kinds.items()}
    grasps: dict[int, Any] = {}
    data: dict[str, tuple[Samples, Samples]] = {}
    for kind, count in counts.items():
        paths = [folder / f"{part}_{kind}.npz" for part in ("samples", "unseen")]
        if not paths[0].is_file():
            if count not in grasps:
                arguments: dict[str, Any] = {"hand": settings.hand, "preshape": _preshape(settings)}
                counted = run.counter(count, "grasps")
                grasps[count] = collect(objects, count, seed=settings.seed, done=counted, **arguments)
                _without_inputs(grasps[count]).save(folder / f"grasps_{count}.npz")
            options: dict[str, Any] = {"kind": kind, "mapping": settings.mapping, "seed": settings.seed}
            counted = run.counter(count, f"samples, {kind}")
            make_samples(objects, grasps[count], **options, done=counted).save(paths[0])
        if not paths[1].is_file():
            _make_unseen(_unseen_objects(objects), kind, _preshape(settings)).save(paths[1])
        data[kind] = (Samples.load(paths[0]), Samples.load(paths[1]))
    return data


def _without_inputs(grasps: Grasps) -> Samples:
    """Convert grasps to samples without inputs, for the baseline that averages all of an object's grasps."""
    nothing = np.zeros((len(grasps), 0), dtype=np.uint8)
    return Samples(grasps.names, nothing, grasps.object, grasps.base_from_hand, grasps.preshape)


def _make_unseen(objects: ObjectSet, kind: Kind, grasped: float) -> Samples:
    """Render each of the unseen objects equally often."""
    views = math.ceil(_UNSEEN / len(objects))
    scenes = enumerate(graspbox.Scene(spec.load()) for spec in objects)
    inputs = [observe(scene, kind, views, _UNSEEN_SEED + i) for i, scene in scenes]
    rows = np.repeat(np.arange(len(objects)), [len(rendered) for rendered in inputs])
    poses, preshape = np.zeros((len(rows), 4, 4)), np.full(len(rows), grasped)
    return Samples(objects.names, np.concatenate(inputs), rows, poses, preshape)


def _parts_of(samples: Samples, split: Split, seed: int) -> dict[str, Samples]:
    """Parts of the samples for the errors of the tables; the training part is as long as the validation part."""
    chosen = np.random.default_rng(seed).permutation(split.train)[: len(split.validation)]
    return {"train": samples[np.sort(chosen)], "test": samples[split.test], "validation": samples[split.validation]}


def _run_network(
    settings: StudySettings,
    name: SettingsName,
    network: str,
    loss: str,
    data: tuple[Samples, Samples],
    scenes: ObjectScenes,
    run: Run,
) -> NetworkResult:
    """Train one network, or resume its training, and execute its predictions."""
    samples, unseen = data
    split = split_at_random(len(samples), settings.seed)
    chosen = training_settings(name, network)
    zero_output = chosen.pop("zero_output")
    fits = {name: chosen.pop(name) for name in ("reduction", "fit_scaling")}
    objective = Objective(LossWeights(**chosen.pop("weights")), **fits)
    chosen |= {k: v for k in ("optimizer", "learning_rate") if (v := getattr(settings, k)) is not None}
    chosen |= {"optimizer": {"adam": "fused_adam"}.get(chosen["optimizer"], chosen["optimizer"])}
    if settings.minutes_per_network is not None:
        chosen["max_seconds"] = 60 * settings.minutes_per_network
    if settings.iterations is not None:
        chosen["max_steps"] = settings.iterations
    config = replace(STUDY, **chosen, seed=settings.seed, device=settings.device)
    kind, preshape = _kind_of(settings, network), _preshape(settings)
    names = cast(NetworkName, network), cast(LossName, loss)
    made = ModelConfig(*names, kind, settings.units, zero_output, preshape)
    folder = run.folder / name / network / loss

    def show(done: TrainProgress) -> None:
        run.report(f"{name} {network} {loss}: iteration {done.step}, error {done.losses['loss']:.4g}", done.share)

    model, trained = train_network(made, samples, split, folder, config, objective, show)
    parts = _parts_of(samples, split, settings.seed)
    errors = {part: asdict(measure_errors(model, parts[part], objective.weights)) for part in PARTS}
    test = parts["test"]
    poses = model.predict(test.inputs)
    norms = read_curve(folder).train["orientation_norm"]
    return NetworkResult(
        settings=name,
        network=network,
        loss=loss,
        stopped=trained.reason,
        iterations=trained.step,
        seconds=trained.seconds,
        errors=errors,
        test=execute(scenes, test, poses),
        unseen=execute(scenes, unseen, model.predict(unseen.inputs)),
        spread={"predicted": position_spread(poses), "labels": position_spread(test.base_from_hand)},
        orientation_norm=tuple(float(norms[i]) for i in (0, min(1, len(norms) - 1), -1)),
        moved=moved(PoseModel(made, settings.seed), model),
    )


def _run_baselines(settings: StudySettings, data: Data, scenes: ObjectScenes) -> dict[str, Any]:
    """Execute the predictions of the baselines, for each kind of data."""
    scores: dict[str, Any] = {}
    for kind, (samples, unseen) in data.items():
        split = split_at_random(len(samples), settings.seed)
        train, test = samples[split.train], samples[split.test]
        scores[kind] = {name: asdict(execute(scenes, test, guess(train, test))) for name, guess in BASELINES.items()}
        blind = {name: BASELINES[name](train, unseen) for name in ("nearest", "constant")}
        scores[f"{kind}, unseen objects"] = {name: asdict(execute(scenes, unseen, it)) for name, it in blind.items()}
    # Optimum of a network that minimizes its error over all valid poses of an input.
    for path in sorted((settings.out / "data").glob("grasps_*.npz")):
        known = Samples.load(path)
        first = known[np.unique(known.object, return_index=True)[1]]
        score = execute(scenes, first, BASELINES["average"](known, first))
        scores[f"all {len(known)} grasps, one trial per object"] = {"average": asdict(score)}
    return scores


def _write_figures(settings: StudySettings, results: list[NetworkResult]) -> dict[str, str]:
    """Plot the figures; returns their file names by caption."""
    curves = {(r.settings, r.network, r.loss): read_curve(_trained(settings.out, r)) for r in results}
    figures = {}
    for network, loss in product(settings.networks, settings.losses):
        if columns := {name: curve for (name, *rest), curve in curves.items() if rest == [network, loss]}:
            file = f"{network}_{loss}.png"
            training_figure(settings.out / file, f"{network}, loss {loss}", columns)
            figures[f"{network}, {loss} (figures 3.19 to 3.26)"] = file
    panels = {}
    for name, network in product(SETTINGS, settings.networks):
        own = {loss: curve for (*rest, loss), curve in curves.items() if rest == [name, network]}
        if own:
            panels[f"{network}, {name}"] = [(loss, LOSSES[loss].greatest, curve) for loss, curve in own.items()]
    normalized_figure(settings.out / "normalized.png", panels)
    return {**figures, "Orientation errors of all losses, normalized to their maximum (figure 3.27)": "normalized.png"}


def _write_page(settings: StudySettings, command: str, log: Rows, data: Data) -> list[NetworkResult]:
    """Write figures and page of the complete networks."""
    results = [NetworkResult.from_row(row) for row in log if "network" in row]
    baselines = next(row["baselines"] for row in log if "baselines" in row)
    facts = {"graspbox": graspbox.__version__, "mapping": settings.mapping}
    facts |= {"hand": settings.hand, "preshape": f"{_preshape(settings):.4f} rad"}
    for kind, (samples, unseen) in data.items():
        split = split_at_random(len(samples), settings.seed)
        sizes = f"{len(split.train)}/{len(split.validation)}/{len(split.test)} for training, validation and test"
        count = f"{len(samples)} of {len(samples.names)} objects"
        facts[f"{kind} samples"] = f"{count}, {sizes}; {len(unseen)} of unseen objects"
        facts |= {"objects": ", ".join(samples.names), "unseen objects": ", ".join(unseen.names)}
    figures = _write_figures(settings, results)
    write_text(settings.out / "study.md", page(command, facts, results, baselines, figures))
    return results


def _trained(out: Path, result: NetworkResult) -> Path:
    return out / result.settings / result.network / result.loss


def best_small(out: Path, results: Sequence[NetworkResult]) -> tuple[NetworkResult, list[NetworkResult]]:
    """Return the network to publish, and all that are small enough, at least one.

    Among those whose weights take at most `graspbox.learn.export.weight_files.LARGEST_NETWORK` bytes, it is the one
    whose predictions for the test samples succeed most often; ties go to the lowest validation angle.
    """
    sizes = [(_trained(out, result) / "weights.pt").stat().st_size for result in results]
    small = [result for result, size in zip(results, sizes, strict=True) if size <= LARGEST_NETWORK]
    if not small:
        found = {r.network: f"{r.network} has {size / 1e6:.0f} MB" for r, size in zip(results, sizes, strict=True)}
        raise ConfigError(
            f"no network is small enough to be published, at most {LARGEST_NETWORK / 1e6:.0f} MB: "
            f"{', '.join(found.values())}; train cnn3d too"
        )

    def order(result: NetworkResult) -> tuple[float, float]:
        return result.test.success / max(result.test.tried, 1), -result.errors["validation"]["angle"]

    return max(small, key=order), small


def _publish(
    settings: StudySettings,
    folder: Path,
    results: Sequence[NetworkResult],
    data: Data,
    learned_from: Sequence[str],
    command: str,
    run: Run,
) -> None:
    """Export the best small network, evaluate it in ``GraspPose-v0``, and write its card."""
    best, small = best_small(settings.out, results)
    model = PoseModel.load(_trained(settings.out, best))
    samples, unseen = data[model.config.kind]
    made: dict[str, Any] = {"learned_from": learned_from, "hand": settings.hand, "licence": package_licence()}
    config = export_pose_model(folder, folder.name, model, unseen.inputs[:_CHECKED], **made)
    progress = run.counter(settings.trials * len(settings.measured), "trials")
    seed = settings.seed
    scores = measure(str(folder), settings.measured, settings.trials, seed, progress=progress, hand=settings.hand)
    facts = {
        "objects": ", ".join(samples.names),
        "samples": f"{len(samples)}, `{settings.mapping}`; seed {seed}",
        "training": f"settings `{best.settings}`, {best.iterations} iterations, {shown_time(best.seconds)}, "
        f"stopped by {best.stopped}",
        "errors on the test samples": f"{100 * best.errors['test']['position']:.1f} cm, "
        f"{np.degrees(best.errors['test']['angle']):.0f} degrees",
    }
    write_card(
        folder,
        config,
        Path(__file__).parent / "card.md.jinja",
        [score.row() for score in scores],
        command=command,
        seed=seed,
        facts=facts,
        small=small,
        limit=LARGEST_NETWORK / 1e6,
    )
