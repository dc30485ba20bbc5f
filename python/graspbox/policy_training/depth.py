"""The stages that make a policy of one depth image, from a data set to a published folder (extra ``train``).

``scripts/train_depth_policy.py`` runs them; each is described there.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from graspbox import dataset, evaluation, learned_sets, object_sets
from graspbox.errors import ConfigError
from graspbox.perception import HandGrid, ProposalConfig
from graspbox.perception.calibration import Calibration, calibration_error, fit_logits
from graspbox.perception.choices import SECURE_WEIGHTS, Choices, try_choices
from graspbox.perception.collect import CollectConfig, collect, load_trials
from graspbox.perception.completion import train_completion
from graspbox.perception.export import FINALISTS, export_completion, export_depth_policy
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.graphs import ScorerGraph
from graspbox.perception.grasp_inputs import ScorerInputs
from graspbox.perception.head_export import write_head
from graspbox.perception.head_training import HeadData, train_head
from graspbox.perception.policy_folders import read_depth_policy, write_learned_from
from graspbox.perception.runtimes import Parts, Scorer, load_parts, torch_network
from graspbox.perception.scene_views import SceneViews
from graspbox.perception.scenes import SceneConfig, SceneSampler
from graspbox.perception.scorer_training import train_scorer
from graspbox.perception.training import TrainConfig, Trained, TrainProgress
from graspbox.perception.trials import GraspTrials
from graspbox.policies import DepthGrasp
from graspbox.policy_training.cards import write_card
from graspbox.policy_training.learned import evaluated_split, of_datasets, of_splits
from graspbox.policy_training.networks import TrainedNetworks
from graspbox.policy_training.settings import QUICK, QUICK_OBJECTS, Settings
from graspbox.policy_training.stages import Run, Stage

__all__ = ["FINDER", "PolicyTraining"]


#: How the policy decides; `Sizes.refinements` says how often it refines.
FINDER = FinderConfig(ProposalConfig(seeds=24, points=600, most=80), predicted=32, children=5)
#: Of how many grasps trials are collected: enough that those at random show what the scorer does not know.
_COLLECTED = {"most": 256, "predicted": 96}


class TimeUp(Exception):  # noqa: N818 (no error)
    """The data set's time is over."""


class PolicyTraining:
    """The stages of one run.

    Parameters
    ----------
    settings : Settings
        What is made.
    command : str
        The command that the card names.
    echo : callable
        Shows each line of the log.
    licence : Path, optional
        The licence of the policy, a file.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings, or all objects of an evaluation are learned from.
    """

    def __init__(
        self, settings: Settings, command: str, echo: Callable[[str], None], licence: Path | None = None
    ) -> None:
        if settings.quick:
            settings = replace(settings, sizes=QUICK, **QUICK_OBJECTS)
        self.settings, self.sizes, self.command = settings, settings.sizes, command
        self.learned = [*of_datasets(settings.data), *of_splits((*settings.objects, *settings.fresh))]
        for objects in settings.evaluated:
            if not learned_sets.without(object_sets.load(objects, split=evaluated_split(objects)), self.learned):
                raise ConfigError(f"--evaluated is {objects!r}; name objects from which nothing is learned")
        self.licence = licence
        self.seed, self.out = settings.seed, settings.out
        self.finder, self.scenes = FINDER, SceneConfig()
        self.grid = HandGrid(crop=self.scenes.crop)
        self.inputs = ScorerInputs(self.grid)
        self.networks = TrainedNetworks(self.out, self.sizes, self.grid, self.scenes)
        self.data = settings.data or (self.out / "data" / "set",)
        kept = {k: v for k, v in asdict(settings).items() if k not in ("out", "hours", "publish")}
        self.run = Run(self.out, json.loads(json.dumps(kept, default=str)), echo)

    def sampler(self, objects: str | tuple[str, ...], split: object_sets.Split | None, seed: int) -> SceneSampler:
        """Sample scenes of a set of objects."""
        return SceneSampler(object_sets.load(objects, split=split), self.scenes, seed)

    def go(self) -> Path:
        """Go through the stages; gives the policy's folder."""
        hours, sizes = self.settings.hours, self.sizes
        done: dict[str, dict[str, Any]] = {}

        def stage(name: str, limit: float, work: Callable[[Stage], dict[str, Any]]) -> dict[str, Any]:
            done[name] = self.run.stage(name, 3600 * limit, work)
            return done[name]

        if not self.settings.data:
            stage("data", hours.data, self.make_data)
        stage("completion", hours.completion, self.complete)
        stage("scorer", hours.scorer, partial(self.member, number=0, rounds=0))
        stage("head", hours.head, self.head)
        for n in range(1, sizes.rounds + 1):
            stage(f"collect-{n}", hours.collect, partial(self.collect, number=n))
            stage(f"round-{n}", hours.round, partial(self.member, number=0, rounds=n))
        for n in range(1, sizes.members):
            stage(f"member-{n}", hours.member, partial(self.member, number=n, rounds=sizes.rounds))
        tried = {
            n: stage(f"calibrate-{n}", hours.calibrate / len(sizes.refinements), partial(self.calibrate, refinements=n))
            for n in sizes.refinements
        }
        # Refinement looks for what the scorer likes best, and may find where it is wrong.
        found = tried[count := max(tried, key=lambda count: max(map(sum, tried[count]["rates"].values())))]
        self.finder, weight = replace(self.finder, refinements=count), found["secure_weight"]
        calibration = Calibration(tuple(found["success"]), tuple(found["secure"]), weight)
        stage("export", hours.evaluate, lambda s: self.export(calibration))
        stage("rungs", hours.evaluate, lambda s: self.export_rungs(s.folder, calibration))
        stage("evaluate", hours.evaluate, self.evaluate)
        folder = self.policy_folder()
        write_card(
            folder,
            config=read_depth_policy(folder),
            command=self.command,
            settings=self.settings,
            scenes=self.scenes,
            stages=done,
        )
        self.run.log(f"the policy is in {folder}")
        return folder

    # --- stages --------------------------------------------------------------------------------------------------

    def make_data(self, stage: Stage) -> dict[str, Any]:
        """Make the data set, as far as the time goes."""
        config = dataset.DatasetConfig(poses=self.sizes.poses, rests=self.sizes.rests, views=0, seed=self.seed)

        def report(progress: dataset.Progress) -> None:
            share = progress.trials / max(1, progress.total)
            stage.report(f"{progress.trials} of {progress.total} trials, {progress.rate:.0f}/s", share)
            if stage.late():
                raise TimeUp

        try:
            dataset.generate(list(self.settings.objects), self.data[0], config=config, progress=report)
        except TimeUp:
            self.run.log("data: the time is over; training goes on with what there is")
        return {split: len(GraspTrials.from_datasets(self.data, split)) for split in ("train", "validation")}

    def complete(self, stage: Stage) -> dict[str, Any]:
        """Train the completion and export it, since onnxruntime runs it twice as fast."""
        sizes = self.sizes
        config = TrainConfig(
            batch_size=sizes.completion_batch,
            max_steps=sizes.completion_steps,
            validate_every=sizes.validate_every,
            # It gains most as the learning rate falls, after a long level stretch.
            patience=sizes.completion_steps,
            max_seconds=stage.limit,
            seed=self.seed,
        )
        objects, held_out = (object_sets.load(self.settings.objects, split=s) for s in ("train", "validation"))
        count = 4 if self.settings.quick else 48
        trained = train_completion(
            stage.folder,
            objects,
            held_out,
            config,
            self.scenes,
            validation_objects=count,
            width=sizes.completion_width,
            progress=reporter(stage, "overlap"),
        )
        export_completion(self.networks.completion_net(), stage.folder / "completion.onnx", self.scenes.crop)
        return results_of(trained)

    @cached_property
    def views(self) -> SceneViews:
        """Views that all members and rounds learn from."""
        return SceneViews(self.scenes, self.networks.completion(), self.seed)

    def member(self, stage: Stage, number: int, rounds: int) -> dict[str, Any]:
        """Train a member on the data set and on the trials of so many rounds."""
        sizes = self.sizes
        going_on = number == 0 and rounds > 0
        config = TrainConfig(
            learning_rate=5e-4 if going_on else 1e-3,
            batch_size=sizes.batch,
            max_steps=sizes.round_steps if going_on else sizes.scorer_steps,
            validate_every=sizes.validate_every,
            max_seconds=stage.limit,
            seed=self.seed + 10 * number + rounds,
        )
        train, held_out = (GraspTrials.from_datasets(self.data, split) for split in ("train", "validation"))
        folders = [self.out / f"collect-{n}" for n in range(1, rounds + 1)]
        on_policy = [load_trials(folder / "train") for folder in folders]
        # What decides among weights is what the latest scorer chose.
        validation = load_trials(folders[-1] / "validation") if folders else held_out
        trained = train_scorer(
            stage.folder,
            train,
            validation,
            self.inputs,
            self.views,
            config,
            on_policy=GraspTrials.joined(on_policy) if on_policy else None,
            start=self.networks.folder(0, rounds - 1) / "weights.pt" if going_on else None,
            width=sizes.width,
            progress=reporter(stage, "AUC"),
        )
        return results_of(trained) | {"trials": len(train), "on_policy": sum(len(trials) for trials in on_policy)}

    def head(self, stage: Stage) -> dict[str, Any]:
        """Train the head whose grasps are scored beside the proposals, on the data set, and export it."""
        steps = self.sizes.head_steps
        config = TrainConfig(
            batch_size=16,
            max_steps=steps,
            validate_every=min(250, steps),
            patience=steps,
            max_seconds=stage.limit,
            seed=self.seed,
        )
        train, held_out = (GraspTrials.from_datasets(self.data, split) for split in ("train", "validation"))
        data = HeadData.of(train, held_out, self.grid, scenes=self.scenes, seed=self.seed)
        trained = train_head(stage.folder, data, config=config, progress=reporter(stage, "share of holds"))
        write_head(stage.folder, self.networks.head_net(), self.scenes.crop)
        return results_of(trained) | {"trials": len(train)}

    def collect(self, stage: Stage, number: int) -> dict[str, Any]:
        """Collect trials of what the first member chooses after the last round."""
        graph = ScorerGraph([self.networks.member_net(0, number - 1)], Calibration(), FINALISTS)
        scorer = Scorer(torch_network(graph), self.inputs, FINALISTS)
        results: dict[str, Any] = {}
        counts: dict[object_sets.Split, int] = {"validation": self.sizes.held_out_scenes, "train": self.sizes.scenes}
        for split, scenes in counts.items():
            sampler = self.sampler(self.settings.fresh, split, self.seed + 1000 * number)

            def report(scene: int, trials: GraspTrials, split: str = split, scenes: int = scenes) -> None:
                stage.report(f"{scene + 1} of {scenes} scenes ({split})", (scene + 1) / scenes)

            proposals = replace(self.finder.proposals, most=_COLLECTED["most"])
            finder = replace(self.finder, proposals=proposals, predicted=_COLLECTED["predicted"])
            trials = collect(
                stage.folder / split,
                sampler,
                range(scenes),
                self.grid,
                CollectConfig(finder=finder),
                complete=self.networks.completion(),
                score=scorer,
                head=self.networks.predictor(),
                progress=report,
                stop=stage.late,
            )
            shares = {"success": float(trials.success.mean()), "secure": float(trials.secure.mean())}
            results[split] = {"trials": len(trials), **{k: round(v, 4) for k, v in shares.items()}}
        return results

    def calibrate(self, stage: Stage, refinements: int) -> dict[str, Any]:
        """Try choices on held-out objects; choose the weight of a secure hold, and fit the logits."""
        graph = ScorerGraph(self.networks.members(), Calibration(), FINALISTS)
        scorer = Scorer(torch_network(graph), self.inputs, FINALISTS)
        parts = Parts(self.networks.completion(), scorer, self.networks.predictor())
        finder = replace(self.finder, refinements=refinements)
        found = self.choices(stage, self.settings.fresh, "validation", parts, finder, self.sizes.choices)
        rates = np.stack([found.success.mean(axis=0), found.secure.mean(axis=0)], axis=1)
        best = int(np.argmax(rates.sum(axis=1)))
        return {
            "choices": len(found),
            "secure_weight": SECURE_WEIGHTS[best],
            "rates": {
                str(w): [round(float(r), 4) for r in pair] for w, pair in zip(SECURE_WEIGHTS, rates, strict=True)
            },
            "success": fit_logits(found.logits[:, best, 0], found.success[:, best]),
            "secure": fit_logits(found.logits[:, best, 1], found.secure[:, best]),
        }

    def choices(
        self,
        stage: Stage,
        objects: str | tuple[str, ...],
        split: object_sets.Split | None,
        parts: Parts,
        finder: FinderConfig,
        count: int,
        weights: tuple[float, ...] = SECURE_WEIGHTS,
    ) -> Choices:
        """Try choices on a set of objects."""
        sampler = self.sampler(objects, split, self.seed + 9000)
        folder = stage.folder / "-".join((objects,) if isinstance(objects, str) else objects).replace(":", "-")

        def report(scene: int, choices: Choices) -> None:
            stage.report(f"{scene + 1} of {count} choices ({objects})", (scene + 1) / count)

        return try_choices(
            folder,
            sampler,
            range(count),
            self.grid,
            parts.complete,
            parts.scorer,
            finder,
            head=parts.head,
            weights=weights,
            progress=report,
            stop=stage.late,
        )

    def policy_folder(self) -> Path:
        """Name the folder of the policy."""
        return self.settings.publish or self.out / "policy"

    def export(self, calibration: Calibration) -> dict[str, Any]:
        """Write the policy's folder."""
        config = export_depth_policy(
            self.policy_folder(),
            self.settings.name,
            self.networks.completion_net(),
            self.networks.members(),
            calibration,
            crop=self.scenes.crop,
            finder=self.finder,
            head=self.networks.head_net(),
            licence=self.licence,
        )
        # The completion learns from `settings.objects`, also where data sets are given.
        write_learned_from(self.policy_folder(), [*of_datasets(self.data), *self.learned])
        return {"files": len(config.files)}

    def export_rungs(self, folder: Path, calibration: Calibration) -> dict[str, Any]:
        """Write what the policy was on its way, so that each step can be measured.

        Unrefined: ``scorer`` learned from the data set alone, ``rounds`` also from its own choices, ``ensemble`` has
        all members, if there are more. ``geometry`` is the policy without the head.
        """
        nets, unrefined = self.networks, replace(self.finder, refinements=0)
        rungs = {
            "scorer": ([nets.member_net(0, 0)], unrefined),
            "rounds": ([nets.member_net(0, self.sizes.rounds)], unrefined),
            "ensemble": (nets.members(), unrefined),
            "geometry": (nets.members(), replace(self.finder, predicted=0)),
        }
        if self.sizes.members == 1:
            del rungs["ensemble"]
        for name, (members, finder) in rungs.items():
            head = nets.head_net() if finder.predicted else None
            completion, crop = nets.completion_net(), self.scenes.crop
            export_depth_policy(
                folder / name, name, completion, members, calibration, crop=crop, finder=finder, head=head
            )
        return {"folders": list(rungs)}

    def evaluate(self, stage: Stage) -> dict[str, Any]:
        """Evaluate the policy as ``graspbox evaluate`` does, and measure its calibration."""
        folder = self.policy_folder()
        policy, config = DepthGrasp(folder), read_depth_policy(folder)
        parts = load_parts(folder, config, self.grid)
        results: dict[str, Any] = {}
        for objects in self.settings.evaluated:
            split = evaluated_split(objects)
            count = self.sizes.trials

            def report(done: int, objects: str = objects, count: int = count) -> None:
                stage.report(f"{done} of {count} trials ({objects})", done / count)

            result = evaluation.evaluate(policy, objects=objects, split=split, trials=count, progress=report)
            weights = (config.calibration.secure_weight,)
            tried = self.choices(stage, objects, split, parts, config.finder, count, weights)
            results[objects] = {
                **{k: v for k, v in result.to_json().items() if k != "objects"},
                "ece": round(calibration_error(tried.judged[:, 0, 0], tried.success[:, 0]), 4),
            }
        return results


def reporter(stage: Stage, measure: str) -> Callable[[TrainProgress], None]:
    """Log the progress of a training."""

    def report(progress: TrainProgress) -> None:
        best = f", best {measure} {progress.best:.3f}" if progress.best > -np.inf else ""
        stage.report(f"step {progress.step}{best}", progress.share, progress.remaining)

    return report


def results_of(trained: Trained) -> dict[str, Any]:
    """Give the results of a training."""
    return {"reason": trained.reason, "steps": trained.step, "best": round(trained.best, 4)}
