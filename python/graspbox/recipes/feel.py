"""The stages that add a grasp-stability check to a policy of one depth image (extra ``train``).

`graspbox.recipes.settings.feel.FeelSettings` describes each; ``graspbox train feel`` runs them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from graspbox import object_sets
from graspbox.artifacts.configs import FeelPolicyConfig
from graspbox.artifacts.downloads import folder_of
from graspbox.artifacts.exports import export_feel_policy
from graspbox.artifacts.folders import load, read_depth_policy, save
from graspbox.dataset.learned import evaluated_split
from graspbox.errors import ConfigError
from graspbox.models.calibration import calibration_error, fit_logits
from graspbox.models.scorer.training import auc
from graspbox.models.stability.network import StabilityNet, logits_of, train_stability
from graspbox.object_sets import ObjectSet, learned_sets
from graspbox.policies import DepthGrasp
from graspbox.recipes.cards import write_card
from graspbox.recipes.depth import reporter
from graspbox.recipes.depth_cards import feel_card
from graspbox.recipes.feel_chart import save_feel_chart
from graspbox.recipes.paired import PairedTrials, at_threshold, best_threshold, run_pairs
from graspbox.recipes.settings.feel import FEEL_QUICK, FeelSettings
from graspbox.recipes.stability_trials import BLOCK, Recorder, StabilityTrials
from graspbox.training.array_files import load_or_make
from graspbox.training.configs import TrainConfig
from graspbox.training.options import Outcome
from graspbox.training.runs import Run
from graspbox.training.trainer import load_weights

__all__ = ["train"]


def train(settings: FeelSettings, command: str, echo: Callable[[str], None]) -> Outcome:
    """Run ``graspbox train feel``: all stages.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings, the policy does not use one depth image, or the evaluation has
        only training objects.
    """
    if settings.quick:
        settings = replace(settings, **FEEL_QUICK)
    settings = replace(settings, policy=folder_of(str(settings.policy)))
    config = read_depth_policy(settings.policy)
    learned = (*DepthGrasp(settings.policy).learned_from, settings.objects, settings.held_out)
    evaluated = {objects: _unlearned(objects, learned) for objects in settings.evaluated}
    with settings.run(echo, {**settings.kept(), "policy": dict(config.files), "hand": config.hand}) as run:
        training = _FeelTraining(settings, run, evaluated)
        training.go(command)
        return Outcome({"folder": str(training.folder), **run.stages}, str(training.folder))


def _unlearned(objects: str, learned: Sequence[str]) -> ObjectSet:
    """Find the objects of a set of the evaluation from which nothing was learned."""
    found = learned_sets.without(object_sets.load(objects, split=evaluated_split(objects)), learned)
    if not found:
        raise ConfigError(f"--evaluated is {objects!r}; name objects from which nothing is learned")
    return found


class _FeelTraining:
    """The stages of one run."""

    def __init__(self, settings: FeelSettings, run: Run, evaluated: Mapping[str, ObjectSet]) -> None:
        self.settings, self.sizes, self.run, self.evaluated = settings, settings.sizes, run, evaluated
        self.out, self.seed = settings.out, settings.seed

    @property
    def folder(self) -> Path:
        """The folder of the policy with the grasp-stability check."""
        return self.settings.publish or self.out / "policy"

    def go(self, command: str) -> None:
        """Run the stages."""

        def stage(name: str, work: Callable[[Run], dict[str, Any]]) -> dict[str, Any]:
            return self.run.stage(name, 3600 * self.settings.hours, work)

        for part in ("train", "held-out"):
            stage(f"record-{part}", partial(self.record, part=part))
        for number in range(self.sizes.members):
            stage(f"member-{number}", partial(self.member, number=number))
        calibration = tuple(stage("calibrate", self.calibrate)["calibration"])
        stage("export", lambda stage: self.export((calibration[0], calibration[1])))
        stage("threshold", self.threshold)
        stage("evaluate", self.evaluate)
        write_card(self.folder, load(self.folder), feel_card(self.folder, self.settings, command, self.run.stages))
        self.run.log(f"the policy is in {self.folder}")

    # --- stages --------------------------------------------------------------------------------------------------

    def record(self, stage: Run, part: str) -> dict[str, Any]:
        """Record sensor readings of grasps, and their outcomes."""
        scenes = self.sizes.scenes if part == "train" else self.sizes.held_out_scenes
        objects = self.settings.objects if part == "train" else self.settings.held_out
        blocks = -(-scenes // BLOCK)
        seed = self.seed + (0 if part == "train" else 500)
        recorder = Recorder(self.settings.policy, objects, self.settings.times, seed, self.sizes.per_scene)

        progress = stage.counter(blocks, "blocks of scenes")
        try:
            found = recorder.record(stage.folder, blocks, progress=progress, stop=stage.late)
        finally:
            recorder.close()
        return {
            "trials": len(found),
            "held": round(float(found.held.mean()), 4),
            "first": round(float(found.held[found.first].mean()), 4) if found.first.any() else None,
        }

    def trials(self, part: str) -> StabilityTrials:
        """Load the recorded trials."""
        folder = self.out / f"record-{part}"
        return StabilityTrials.joined([StabilityTrials.load(path) for path in sorted(folder.glob("*.npz"))])

    def member(self, stage: Run, number: int) -> dict[str, Any]:
        """Train one network."""
        sizes = self.sizes
        train, held_out = self.trials("train"), self.trials("held-out")
        config = TrainConfig(
            learning_rate=1e-3,
            weight_decay=1e-2,
            batch_size=128,
            max_steps=sizes.steps,
            validate_every=sizes.validate_every,
            patience=12,
            max_seconds=stage.limit,
            seed=self.seed + number,
            device=self.settings.device,
        )
        validation = held_out.readings, held_out.held
        net, trained = train_stability(
            stage.folder,
            train.readings,
            train.held,
            validation,
            config,
            width=sizes.width,
            progress=reporter(stage, "minus cross-entropy"),
        )
        logits = logits_of([net], held_out.readings)
        return {"steps": trained.step, "reason": trained.reason, "auc": round(auc(logits, held_out.held), 4)}

    def nets(self) -> list[StabilityNet]:
        """Load the trained networks."""
        inputs = self.trials("held-out").readings.shape[1]
        nets = [StabilityNet(inputs, self.sizes.width) for _ in range(self.sizes.members)]
        for number, net in enumerate(nets):
            load_weights(net, self.out / f"member-{number}" / "weights.pt")
        return nets

    def calibrate(self, stage: Run) -> dict[str, Any]:
        """Fit slope and offset on the policy's own choices of held-out objects."""
        del stage
        held_out = self.trials("held-out")
        first = held_out.first
        if not first.any():
            raise ConfigError("no scene of the held-out objects has a grasp; record more scenes")
        logits = logits_of(self.nets(), held_out.readings[first])
        slope, offset = fit_logits(logits, held_out.held[first])
        return {"calibration": [slope, offset], "grasps": int(first.sum())}

    def export(self, calibration: tuple[float, float]) -> dict[str, Any]:
        """Write the policy's folder, with a placeholder threshold that a later stage replaces."""
        licence = self.settings.policy / "LICENSE"
        config = export_feel_policy(
            self.folder,
            f"{read_depth_policy(self.settings.policy).name}-feel",
            self.nets(),
            calibration,
            depth=self.settings.policy,
            times=self.settings.times,
            threshold=0.5,
            learned_from=(self.settings.objects, self.settings.held_out),
            licence=licence if licence.is_file() else None,
        )
        return {"files": len(config.files)}

    def threshold(self, stage: Run) -> dict[str, Any]:
        """Choose the threshold on trials of held-out objects, each with and without a second attempt."""
        held_out = self.settings.held_out
        pairs = self.pairs(stage, held_out, object_sets.load(held_out), self.sizes.rule_trials, 900)
        found = best_threshold(pairs)
        save(self.folder, replace(load(self.folder, FeelPolicyConfig), threshold=found))
        return {"threshold": found, "never": at_threshold(pairs, 0.0), "chosen": at_threshold(pairs, found)}

    def pairs(self, stage: Run, name: str, objects: ObjectSet, trials: int, offset: int) -> PairedTrials:
        """Run trials with and without a second attempt."""
        path = stage.folder / f"{name.replace(':', '-')}.npz"

        progress = stage.counter(2 * trials, f"trials ({name})")

        def run() -> PairedTrials:
            return run_pairs(self.folder, objects, trials, self.seed + offset, progress=progress)

        return load_or_make(PairedTrials, path, run)

    def evaluate(self, stage: Run) -> dict[str, Any]:
        """Evaluate policy, first attempt alone and grasp-stability predictions on objects excluded from training."""
        threshold = load(self.folder, FeelPolicyConfig).threshold
        results: dict[str, Any] = {}
        found: dict[str, PairedTrials] = {}
        for objects, kept in self.evaluated.items():
            pairs = found[objects] = self.pairs(stage, objects, kept, self.sizes.trials, 1900)
            predicted = pairs.probability
            results[objects] = {
                "first": at_threshold(pairs, 0.0),
                "feel": at_threshold(pairs, threshold),
                "always": at_threshold(pairs, 2.0),
                # Upper bound with perfect predictions: open exactly when the first grasp does not hold.
                "perfect": int((pairs.first | pairs.second).sum()),
                "auc": round(auc(predicted, pairs.first), 4),
                "ece": round(calibration_error(predicted, pairs.first), 4),
            }
        save_feel_chart(self.folder / "feel.png", found, threshold)
        return results
