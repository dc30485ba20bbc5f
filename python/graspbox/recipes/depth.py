"""The stages that train a policy of one depth image, from a data set to a published folder (extra ``train``).

`graspbox.recipes.settings.depth.DepthSettings` describes each; ``graspbox train depth`` runs them.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from graspbox import dataset, evaluation, object_sets
from graspbox.artifacts.downloads import folder_of
from graspbox.artifacts.exports import FINALISTS, export_depth_policy, write_completion, write_head
from graspbox.artifacts.folders import completion_folder, read_depth_policy
from graspbox.artifacts.graphs import ScorerGraph
from graspbox.artifacts.runtimes import Parts, Scorer, load_parts, torch_network
from graspbox.configs import PhysicsConfig
from graspbox.dataset.learned import evaluated_split, of_datasets, of_splits
from graspbox.errors import ConfigError
from graspbox.evaluation.rounds import clear_rounds
from graspbox.layouts import SceneLayout, layout_named
from graspbox.models.calibration import Calibration, calibration_error, fit_logits
from graspbox.models.completion.network import CompletionNet, train_completion
from graspbox.models.head.batches import untried_scenes
from graspbox.models.head.configs import HeadConfig
from graspbox.models.head.network import AnchorNet
from graspbox.models.head.training import HeadData, load_head, train_head
from graspbox.models.scene_views import SceneViews
from graspbox.models.scenes import SceneConfig, SceneSampler
from graspbox.models.scorer.inputs import ScorerInputs
from graspbox.models.scorer.training import train_scorer
from graspbox.models.trials import GraspTrials
from graspbox.object_sets import learned_sets
from graspbox.perception import CropConfig, HandGrid, ProposalConfig
from graspbox.perception.configs import EVERYTHING, FinderConfig
from graspbox.perception.hand_settings import seeing_both_sides, settings_of
from graspbox.policies import DepthGrasp
from graspbox.recipes.cards import package_licence, write_card
from graspbox.recipes.choices import SECURE_WEIGHTS, Choices, try_choices
from graspbox.recipes.collection import CollectConfig, check_hand, collect, load_trials
from graspbox.recipes.depth_cards import depth_card
from graspbox.recipes.networks import TrainedNetworks, grid_shape, is_published, learned_before, scorer_width
from graspbox.recipes.settings.depth import HEAD_OF_ROUNDS, QUICK, QUICK_OBJECTS, DepthSettings, Sizes
from graspbox.training.configs import TrainConfig
from graspbox.training.options import Outcome
from graspbox.training.runs import Run
from graspbox.training.trainer import Trained, TrainProgress

__all__ = ["FINDER", "train"]


#: Settings of the policy's decision where `Sizes` says nothing else.
FINDER = FinderConfig(ProposalConfig(seeds=24, points=600, most=Sizes.proposed), predicted=Sizes.predicted, children=5)
#: Learning rate with which a completion or a head is trained further.
_TUNING_RATE = 3e-4
#: Number of trials per scene: enough that the random ones reveal the scorer's errors.
_COLLECTED = {"most": 256, "predicted": 96}


class TimeUp(Exception):  # noqa: N818 (no error)
    """The time limit of the data set is reached."""


def train(settings: DepthSettings, command: str, echo: Callable[[str], None]) -> Outcome:
    """Run ``graspbox train depth``: all stages.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings, if the evaluation has only training objects, or if a data set or
        the policy with which it begins is of another hand.
    """
    if settings.quick:
        settings = replace(settings, sizes=QUICK, **QUICK_OBJECTS)
    if settings.start is not None:
        start = folder_of(str(settings.start))
        settings = replace(settings, start=start, sizes=replace(settings.sizes, width=scorer_width(start)))
    learned = [*of_datasets(settings.data), *of_splits((*settings.objects, *settings.fresh))]
    if settings.completion is not None:
        learned += read_depth_policy(folder_of(settings.completion)).learned_from
    if settings.start is not None:
        learned += learned_before(settings.start)
    for objects in settings.evaluated:
        if not learned_sets.without(object_sets.load(objects, split=evaluated_split(objects)), learned):
            raise ConfigError(f"--evaluated is {objects!r}; name objects from which nothing is learned")
    check_hand(settings.data, settings.load_hand())
    if settings.start is not None and is_published(settings.start):
        read_depth_policy(settings.start).settings_for(settings.load_hand())
    with settings.run(echo) as run:
        training = _DepthTraining(settings, run, learned)
        training.go(command)
        return Outcome({"folder": str(training.policy_folder()), **run.stages}, str(training.policy_folder()))


class _DepthTraining:
    """The stages of one run."""

    def __init__(self, settings: DepthSettings, run: Run, learned: list[str]) -> None:
        self.settings, self.sizes, self.run, self.learned = settings, settings.sizes, run, learned
        self.seed, self.out = settings.seed, settings.out
        self.layouts = cast("tuple[SceneLayout, ...]", settings.layout)
        #: Whether the completion of another policy learns more: that of single objects is poor in heaps.
        self.tunes_completion = (
            settings.completion is not None and self.layouts != ("single",) and self.sizes.completion_steps > 0
        )
        several = self.layouts != ("single",)
        self.physics = PhysicsConfig(dt=settings.time_step)
        self.scenes = SceneConfig(crop=CropConfig(gap=EVERYTHING if several else CropConfig.gap))
        hand = settings.load_hand()
        shape = None if settings.start is None else grid_shape(settings.start)
        fitted = settings_of(hand, FINDER.proposals, shape=shape)
        # Among several objects wide proposals grasp less; a scorer of many hands learned from narrow ones.
        narrow = several or shape is not None
        proposals = fitted.proposals if narrow else seeing_both_sides(fitted.proposals, hand)
        self.finder, self.anchors = replace(FINDER, proposals=proposals), fitted.anchors
        self.grid = HandGrid(hand, fitted.grid, crop=self.scenes.crop)
        self.inputs = ScorerInputs(self.grid)
        self.networks = TrainedNetworks(self.out, self.sizes, self.grid, self.scenes)
        self.data = settings.data or (self.out / "data" / "set",)

    def sampler(self, objects: str | tuple[str, ...], split: object_sets.Split | None, seed: int) -> SceneSampler:
        """Sample scenes of a set of objects."""
        return SceneSampler(object_sets.load(objects, split=split), self.scenes, seed, self.layouts, self.physics)

    def go(self, command: str) -> None:
        """Run the stages."""
        hours, sizes = self.settings.hours, self.sizes

        def stage(name: str, limit: float, work: Callable[[Run], dict[str, Any]]) -> dict[str, Any]:
            return self.run.stage(name, 3600 * limit, work)

        if self.settings.data:
            # Without held-out trials nothing can be selected: better said now than after the completion.
            GraspTrials.from_datasets(self.data, "validation")
        elif self.learns_trials:
            stage("data", hours.data, self.make_data)
        stage("completion", hours.completion, self.complete)
        stage("scorer", hours.scorer, partial(self.member, number=0, rounds=0))
        stage("head", hours.head, self.head)
        for n in range(1, sizes.rounds + 1):
            stage(f"collect-{n}", hours.collect, partial(self.collect, number=n))
            stage(f"round-{n}", hours.round, partial(self.member, number=0, rounds=n))
        if sizes.rounds and sizes.head_round_steps and self.layouts == ("single",):
            stage(HEAD_OF_ROUNDS, hours.head_rounds, self.head_of_rounds)
        for n in range(1, sizes.members):
            stage(f"member-{n}", hours.member, partial(self.member, number=n, rounds=sizes.rounds))
        finder = replace(
            self.finder,
            proposals=replace(self.finder.proposals, most=sizes.proposed),
            predicted=sizes.predicted,
            enough=sizes.enough,
            lever_penalty=sizes.lever_penalty,
        )
        tried = {}
        for n in sizes.refinements:
            work = partial(self.calibrate, finder=replace(finder, refinements=n))
            tried[n] = stage(f"calibrate-{n}", hours.calibrate / len(sizes.refinements), work)
        # Refinement exploits errors of the scorer.
        best = max(tried, key=lambda count: max(map(sum, tried[count]["rates"].values())))
        self.finder, found = replace(finder, refinements=best), tried[best]
        calibration = Calibration(tuple(found["success"]), tuple(found["secure"]), found["secure_weight"])
        stage("export", hours.evaluate, lambda s: self.export(calibration))
        stage("ablations", hours.evaluate, lambda s: self.export_ablations(s.folder, calibration))
        stage("evaluate", hours.evaluate, self.evaluate)
        if layouts := [layout for layout in self.settings.layout if layout != "single"]:
            stage("clear", hours.evaluate, partial(self.clear, layouts=layouts))
        folder = self.policy_folder()
        config, settings = read_depth_policy(folder), self.settings
        card = depth_card(
            folder, config, command=command, settings=settings, scenes=self.scenes, stages=self.run.stages
        )
        write_card(folder, config, card)
        self.run.log(f"the policy is in {folder}")

    @property
    def learns_trials(self) -> bool:
        """Whether a scorer or a head learns: otherwise no data set is needed."""
        sizes, start = self.sizes, self.settings.start
        adopted = start is not None and is_published(start) and read_depth_policy(start).head is not None
        return sizes.scorer_steps > 0 or sizes.rounds > 0 or sizes.members > 1 or not adopted

    # --- stages --------------------------------------------------------------------------------------------------

    def make_data(self, stage: Run) -> dict[str, Any]:
        """Make the data set, as far as the time limit allows."""
        sizes, physics = self.sizes, self.physics
        config = dataset.DatasetConfig(poses=sizes.poses, rests=sizes.rests, views=0, seed=self.seed, physics=physics)

        def report(progress: dataset.Progress) -> None:
            share = progress.trials / max(1, progress.total)
            stage.report(f"{progress.trials} of {progress.total} trials, {progress.rate:.0f}/s", share)
            if stage.late():
                raise TimeUp

        try:
            objects, hand = list(self.settings.objects), self.grid.hand
            dataset.generate(objects, self.data[0], hand=hand, config=config, progress=report)
        except TimeUp:
            stage.log("time limit reached; continuing with the trials collected")
            late = True
        else:
            late = False
        return {split: self._count_trials(split, late) for split in ("train", "validation")}

    def _count_trials(self, split: object_sets.Split, late: bool) -> int:
        try:
            return len(GraspTrials.from_datasets(self.data, split))
        except ConfigError as error:
            if not late:
                raise
            spent = self.settings.hours.data
            raise ConfigError(
                f"{self.data[0]} has no trials of the split {split!r} after --hours.data {spent:g}; run the same "
                "command with more, and it goes on"
            ) from error

    def common(self, stage: Run) -> dict[str, Any]:
        """Return the settings that all trainings share."""
        return {"max_seconds": stage.limit, "seed": self.seed, "device": self.settings.device}

    def complete(self, stage: Run) -> dict[str, Any]:
        """Train the completion, or adopt one, and export it: onnxruntime runs it twice as fast."""
        sizes, start = self.sizes, None
        adopted: dict[str, Any] = {}
        if self.settings.completion is not None:
            policy = self.networks.adopt_completion(folder_of(self.settings.completion))
            adopted = {"policy": policy.name, "sha256": policy.files["completion.onnx"]}
            if not self.tunes_completion:
                return adopted
            start = self.networks.completion_net()
        config = TrainConfig(
            learning_rate=_TUNING_RATE if adopted else TrainConfig.learning_rate,
            batch_size=sizes.completion_batch,
            max_steps=sizes.completion_steps,
            validate_every=sizes.validate_every,
            # Most of the gain comes as the learning rate falls, after a long plateau.
            patience=sizes.completion_steps,
            **self.common(stage),
        )
        objects, held_out = (object_sets.load(self.settings.objects, split=s) for s in ("train", "validation"))
        count = 4 if self.settings.quick else 48
        trained = train_completion(
            stage.folder,
            objects,
            held_out,
            config,
            self.scenes,
            layouts=self.layouts,
            validation_scenes=count,
            width=sizes.completion_width,
            start=start,
            progress=reporter(stage, "overlap"),
        )
        if start is not None:
            self.networks.keep_tuned(start)
        write_completion(self.networks.completion_net(), stage.folder / "completion.onnx", self.scenes.crop)
        return adopted | results_of(trained)

    @cached_property
    def views(self) -> SceneViews:
        """Views shared by all members and rounds."""
        return SceneViews(self.scenes, self.networks.completion(), self.seed)

    def member(self, stage: Run, number: int, rounds: int) -> dict[str, Any]:
        """Train a member on the data set and on the on-policy trials of the first `rounds` rounds."""
        sizes = self.sizes
        going_on = number == 0 and rounds > 0
        start = self.networks.folder(0, rounds - 1) / "weights.pt" if going_on else None
        if number == rounds == 0 and self.settings.start is not None:
            start = self.networks.adopt_scorer(self.settings.start)
            if not sizes.scorer_steps:
                self.networks.keep_scorer(self.settings.start)
                return {"policy": str(self.settings.start)}
        config = TrainConfig(
            learning_rate=1e-3 if start is None else 5e-4,
            batch_size=sizes.batch,
            max_steps=sizes.round_steps if going_on else sizes.scorer_steps,
            validate_every=sizes.validate_every,
            **{**self.common(stage), "seed": self.seed + 10 * number + rounds},
        )
        train, held_out = (GraspTrials.from_datasets(self.data, split) for split in ("train", "validation"))
        folders = [self.out / f"collect-{n}" for n in range(1, rounds + 1)]
        on_policy = [load_trials(folder / "train") for folder in folders]
        # The latest choices select the weights.
        validation = load_trials(folders[-1] / "validation") if folders else held_out
        trained = train_scorer(
            stage.folder,
            train,
            validation,
            self.inputs,
            self.views,
            config,
            on_policy=GraspTrials.joined(on_policy) if on_policy else None,
            start=start,
            width=sizes.width,
            progress=reporter(stage, "AUC"),
        )
        return results_of(trained) | {"trials": len(train), "on_policy": sum(len(trials) for trials in on_policy)}

    def head(self, stage: Run) -> dict[str, Any]:
        """Train the head whose grasps are scored together with the proposals, on the data set, and export it.

        A published policy with which the training begins brings its own.
        """
        start = self.settings.start
        if start is not None and is_published(start) and self.networks.adopt_head(start):
            write_head(self.networks.head_net(), stage.folder / "head.onnx", self.scenes.crop)
            return {"policy": str(start)}
        train, held_out = (GraspTrials.from_datasets(self.data, split) for split in ("train", "validation"))
        return self.train_head(stage, train, held_out, self.sizes.head_steps)

    def head_of_rounds(self, stage: Run) -> dict[str, Any]:
        """Train the head further, on the trials of the rounds and on scenes without trials too.

        The trials of the rounds show what is wrong with grasps that seem good, the scenes without trials where the hand
        can go: objects at rest are seldom tall.
        """
        train, held_out = (GraspTrials.from_datasets(self.data, split) for split in ("train", "validation"))
        chosen = [load_trials(self.out / f"collect-{n}" / "train") for n in range(1, self.sizes.rounds + 1)]
        objects = object_sets.load(self.settings.objects, split="train")
        untried = [untried_scenes(objects, self.sizes.untried, self.seed)] if self.sizes.untried else []
        joined = GraspTrials.joined([train, *chosen, *untried])
        return self.train_head(stage, joined, held_out, self.sizes.head_round_steps, self.networks.head_net())

    def train_head(
        self, stage: Run, train: GraspTrials, held_out: GraspTrials, steps: int, start: AnchorNet | None = None
    ) -> dict[str, Any]:
        """Train a head in the stage's folder, and export it."""
        config = TrainConfig(
            learning_rate=TrainConfig.learning_rate if start is None else _TUNING_RATE,
            batch_size=16,
            max_steps=steps,
            validate_every=min(250, steps),
            patience=steps,
            **self.common(stage),
        )
        head = HeadConfig(anchors=self.anchors) if start is None else start.config
        data = HeadData.of(train, held_out, self.grid, head.anchors, self.scenes, self.seed)
        trained = train_head(stage.folder, data, head, config, reporter(stage, "share of holds"), start)
        net = load_head(stage.folder, len(self.grid.preshapes), self.scenes.crop)
        assert isinstance(net, AnchorNet)
        write_head(net, stage.folder / "head.onnx", self.scenes.crop)
        return results_of(trained) | {"trials": len(train)}

    def collect(self, stage: Run, number: int) -> dict[str, Any]:
        """Collect trials of grasps chosen by the first member after the last round."""
        graph = ScorerGraph([self.networks.member_net(0, number - 1)], Calibration(), FINALISTS)
        scorer = Scorer(torch_network(graph), self.inputs, FINALISTS)
        results: dict[str, Any] = {}
        counts: dict[object_sets.Split, int] = {"validation": self.sizes.held_out_scenes, "train": self.sizes.scenes}
        for split, scenes in counts.items():
            sampler = self.sampler(self.settings.fresh, split, self.seed + 1000 * number)
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
                progress=stage.counter(scenes, f"scenes ({split})"),
                stop=stage.late,
            )
            shares = {"success": float(trials.success.mean()), "secure": float(trials.secure.mean())}
            results[split] = {"trials": len(trials), **{k: round(v, 4) for k, v in shares.items()}}
        return results

    def calibrate(self, stage: Run, finder: FinderConfig) -> dict[str, Any]:
        """Try choices on held-out objects; choose the weight of a secure hold, and fit the logits."""
        graph = ScorerGraph(self.networks.members(), Calibration(), FINALISTS)
        scorer = Scorer(torch_network(graph), self.inputs, FINALISTS)
        parts = Parts(self.networks.completion(), scorer, self.networks.predictor())
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
        stage: Run,
        objects: str | tuple[str, ...],
        split: object_sets.Split | None,
        parts: Parts,
        finder: FinderConfig,
        count: int,
        weights: tuple[float, ...] = SECURE_WEIGHTS,
        *,
        limited: bool = True,
    ) -> Choices:
        """Try choices on a set of objects, until the stage's time is over if they are `limited`."""
        sampler = self.sampler(objects, split, self.seed + 9000)
        names = (objects,) if isinstance(objects, str) else objects
        folder = stage.folder / "-".join(names).replace(":", "-")
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
            progress=stage.counter(count, f"choices ({', '.join(names)})"),
            stop=stage.late if limited else lambda: False,
        )

    def completion_of_export(self) -> CompletionNet | Path:
        """Return the trained completion, or the folder of the policy that has it."""
        if self.settings.completion is None or self.layouts != ("single",):
            return self.networks.completion_net()
        folder = folder_of(self.settings.completion)
        return completion_folder(folder, read_depth_policy(folder))

    def learned_from(self) -> list[str]:
        """Name the objects from which the policy learned: `settings.objects` too, since its completion did."""
        return list(dict.fromkeys([*(of_datasets(self.data) if self.learns_trials else ()), *self.learned]))

    def policy_folder(self) -> Path:
        """Name the folder of the policy."""
        return self.settings.publish or self.out / "policy"

    def export(self, calibration: Calibration) -> dict[str, Any]:
        """Write the policy's folder."""
        config = export_depth_policy(
            self.policy_folder(),
            self.settings.name,
            self.completion_of_export(),
            self.networks.members(),
            calibration,
            learned_from=self.learned_from(),
            hand=self.grid.hand,
            crop=self.scenes.crop,
            grid=self.grid.config,
            finder=self.finder,
            head=self.networks.head_net(),
            licence=package_licence(),
        )
        return {"files": len(config.files)}

    def export_ablations(self, folder: Path, calibration: Calibration) -> dict[str, Any]:
        """Write the ablations: earlier stages of the policy, to measure the effect of each step.

        Unrefined: ``scorer`` was trained on the data set alone, ``rounds`` also on its own choices, ``ensemble`` has
        all members, if there are several. ``geometry`` is the policy without the head.
        """
        nets, unrefined = self.networks, replace(self.finder, refinements=0)
        ensemble = nets.members()
        ablations = {
            "scorer": ([nets.member_net(0, 0)], unrefined),
            "rounds": ([nets.member_net(0, self.sizes.rounds)], unrefined),
            "ensemble": (ensemble, unrefined),
            "geometry": (ensemble, replace(self.finder, predicted=0)),
        }
        if len(ensemble) == 1:
            del ablations["ensemble"]
        for name, (members, finder) in ablations.items():
            export_depth_policy(
                folder / name,
                name,
                self.completion_of_export(),
                members,
                calibration,
                learned_from=self.learned_from(),
                hand=self.grid.hand,
                crop=self.scenes.crop,
                grid=self.grid.config,
                finder=finder,
                head=nets.head_net() if finder.predicted else None,
            )
        return {"folders": list(ablations)}

    def evaluate(self, stage: Run) -> dict[str, Any]:
        """Evaluate the policy as ``graspbox evaluate`` does, and measure its calibration."""
        folder = self.policy_folder()
        policy, config = DepthGrasp(folder), read_depth_policy(folder)
        parts = load_parts(folder, config, self.grid)
        results: dict[str, Any] = {}
        for objects in self.settings.evaluated:
            split = evaluated_split(objects)
            count = self.sizes.trials
            hand = self.settings.named_hand
            progress = stage.counter(count, f"trials ({objects})")
            result = evaluation.evaluate(
                policy, objects=objects, split=split, trials=count, progress=progress, hand=hand
            )
            weights = (config.calibration.secure_weight,)
            tried = self.choices(stage, objects, split, parts, config.finder, count, weights, limited=False)
            results[objects] = {
                **{k: v for k, v in result.to_json().items() if k != "objects"},
                "ece": round(calibration_error(tried.judged[:, 0, 0], tried.success[:, 0]), 4),
            }
        return results

    def clear(self, stage: Run, layouts: list[str]) -> dict[str, Any]:
        """Clear scenes of several objects with the policy: see `graspbox.evaluation.rounds`."""
        policy, results = DepthGrasp(self.policy_folder()), dict[str, Any]()
        for layout in layouts:
            for objects in self.settings.evaluated:
                progress = stage.counter(self.sizes.cleared, f"rounds ({layout}, {objects})")
                found = clear_rounds(
                    policy,
                    objects=objects,
                    split=evaluated_split(objects),
                    layout=layout_named(layout),
                    rounds=self.sizes.cleared,
                    hand=self.settings.named_hand,
                    progress=progress,
                )
                results[f"{layout} {objects}"] = found.to_json()
        return results


def reporter(run: Run, measure: str, name: str = "") -> Callable[[TrainProgress], None]:
    """Log the progress of a training in a run, either all of it or a named part."""

    def report(progress: TrainProgress) -> None:
        best = f", best {measure} {progress.best:.3f}" if progress.best > -np.inf else ""
        run.report(f"{name and f'{name}, '}step {progress.step}{best}", progress.share, progress.remaining)

    return report


def results_of(trained: Trained) -> dict[str, Any]:
    """Return the results of a training."""
    return {"reason": trained.reason, "steps": trained.step, "best": round(trained.best, 4)}
