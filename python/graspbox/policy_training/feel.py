"""The stages that teach a policy of one depth image to feel before it lifts (extra ``train``).

``scripts/train_feel.py`` runs them; each is described there.
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError
from graspbox.perception.array_files import load_or_make
from graspbox.perception.calibration import calibration_error, fit_logits
from graspbox.perception.feel_folders import FeelConfig, read_feel, write_feel
from graspbox.perception.policy_folders import file_hash, read_depth_policy, write_learned_from
from graspbox.perception.scorer_training import auc
from graspbox.perception.stability import FEEL_TIMES
from graspbox.perception.stability_export import export_stability
from graspbox.perception.stability_net import StabilityNet, logits_of, train_stability
from graspbox.perception.training import TrainConfig, load_weights
from graspbox.policy_training.feel_cards import save_feel_chart, write_feel_card
from graspbox.policy_training.felt_trials import BLOCK, FeltTrials, Recorder
from graspbox.policy_training.paired import PairedTrials, at_threshold, best_threshold, run_pairs
from graspbox.policy_training.stages import Run, Stage

__all__ = ["QUICK", "FeelSettings", "FeelSizes", "FeelTraining"]


@dataclass(frozen=True)
class FeelSizes:
    """How much is recorded and learned; ``--quick`` makes all of it small."""

    scenes: int = 2_000
    """Scenes to learn from."""
    held_out_scenes: int = 320
    """Scenes that validate and calibrate."""
    per_scene: int = 8
    """Grasps of each scene."""
    steps: int = 4_000
    validate_every: int = 100
    members: int = 3
    """Networks whose mean logit counts."""
    width: int = 64
    rule_trials: int = 400
    """Trials that choose the threshold, each with and without a second attempt."""
    trials: int = 400
    """Trials of each set of objects in the evaluation, likewise."""


#: What ``--quick`` makes.
QUICK = FeelSizes(
    scenes=16,
    held_out_scenes=8,
    per_scene=3,
    steps=20,
    validate_every=10,
    members=2,
    width=8,
    rule_trials=4,
    trials=4,
)
#: Its objects.
_QUICK_OBJECTS: dict[str, Any] = {
    "objects": "procedural:can:10-19",
    "held_out": "procedural:can:20-23",
    "evaluated": ("procedural:bottle:30-33",),
}


@dataclass(frozen=True)
class FeelSettings:
    """Arguments of a training."""

    policy: Path
    """Folder of the policy of one depth image (scripts/train_depth_policy.py)."""
    out: Path
    """Folder of the run."""
    objects: str = "procedural:seen:400-499"
    """Objects to learn from; the policy should not have learned from them."""
    held_out: str = "procedural:seen:500-549"
    """Objects that validate, calibrate and choose the threshold."""
    evaluated: tuple[str, ...] = ("procedural:unseen:0-19",)
    """Objects of the evaluation."""
    times: tuple[float, ...] = FEEL_TIMES
    """When the hand feels, seconds after it began to close; it closes for 1.3 s and then lifts."""
    publish: Path | None = None
    """Folder of the exported policy; by default `policy` in the run's folder."""
    seed: int = 0
    hours: float = 2.0
    """Limit of each stage."""
    quick: bool = False
    """Go through all stages in a minute."""
    sizes: FeelSizes = field(default_factory=FeelSizes)


class FeelTraining:
    """The stages of one run.

    Parameters
    ----------
    settings : FeelSettings
        What is made.
    command : str
        The command that the card names.
    echo : callable
        Shows each line of the log.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings, or the policy is none of one depth image.
    """

    def __init__(self, settings: FeelSettings, command: str, echo: Callable[[str], None]) -> None:
        if settings.quick:
            settings = replace(settings, sizes=QUICK, **_QUICK_OBJECTS)
        self.settings, self.sizes, self.command = settings, settings.sizes, command
        self.out, self.seed = settings.out, settings.seed
        config = read_depth_policy(settings.policy)
        kept = {k: v for k, v in asdict(settings).items() if k not in ("out", "hours", "publish", "policy")}
        kept["policy"] = dict(config.files)
        self.run = Run(self.out, json.loads(json.dumps(kept, default=str)), echo)

    @property
    def folder(self) -> Path:
        """The folder of the policy that feels."""
        return self.settings.publish or self.out / "policy"

    def go(self) -> Path:
        """Go through the stages; gives the policy's folder."""
        done: dict[str, dict[str, Any]] = {}

        def stage(name: str, work: Callable[[Stage], dict[str, Any]]) -> dict[str, Any]:
            done[name] = self.run.stage(name, 3600 * self.settings.hours, work)
            return done[name]

        for part in ("train", "held-out"):
            stage(f"record-{part}", partial(self.record, part=part))
        for number in range(self.sizes.members):
            stage(f"member-{number}", partial(self.member, number=number))
        calibration = tuple(stage("calibrate", self.calibrate)["calibration"])
        stage("export", lambda stage: self.export((calibration[0], calibration[1])))
        stage("threshold", self.threshold)
        stage("evaluate", self.evaluate)
        write_feel_card(self.folder, self.settings, self.command, done)
        self.run.log(f"the policy is in {self.folder}")
        return self.folder

    # --- stages --------------------------------------------------------------------------------------------------

    def record(self, stage: Stage, part: str) -> dict[str, Any]:
        """Record what is felt, and what came of it."""
        scenes = self.sizes.scenes if part == "train" else self.sizes.held_out_scenes
        objects = self.settings.objects if part == "train" else self.settings.held_out
        blocks = -(-scenes // BLOCK)
        seed = self.seed + (0 if part == "train" else 500)
        recorder = Recorder(self.settings.policy, objects, self.settings.times, seed, self.sizes.per_scene)

        def report(number: int, trials: FeltTrials) -> None:
            del trials
            stage.report(f"{number + 1} of {blocks} blocks of scenes", (number + 1) / blocks)

        try:
            found = recorder.record(stage.folder, blocks, progress=report, stop=stage.late)
        finally:
            recorder.close()
        return {
            "trials": len(found),
            "held": round(float(found.held.mean()), 4),
            "first": round(float(found.held[found.first].mean()), 4) if found.first.any() else None,
        }

    def trials(self, part: str) -> FeltTrials:
        """Load what was recorded."""
        folder = self.out / f"record-{part}"
        return FeltTrials.joined([FeltTrials.load(path) for path in sorted(folder.glob("*.npz"))])

    def member(self, stage: Stage, number: int) -> dict[str, Any]:
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
        )
        validation = held_out.felt, held_out.held
        net, trained = train_stability(stage.folder, train.felt, train.held, validation, config, width=sizes.width)
        logits = logits_of([net], held_out.felt)
        return {"steps": trained.step, "reason": trained.reason, "auc": round(auc(logits, held_out.held), 4)}

    def nets(self) -> list[StabilityNet]:
        """Load the trained networks."""
        inputs = self.trials("held-out").felt.shape[1]
        nets = [StabilityNet(inputs, self.sizes.width) for _ in range(self.sizes.members)]
        for number, net in enumerate(nets):
            load_weights(net, self.out / f"member-{number}" / "weights.pt")
        return nets

    def calibrate(self, stage: Stage) -> dict[str, Any]:
        """Fit slope and offset on the policy's own choices of held-out objects."""
        del stage
        held_out = self.trials("held-out")
        first = held_out.first
        if not first.any():
            raise ConfigError("no scene of the held-out objects has a grasp; record more scenes")
        logits = logits_of(self.nets(), held_out.felt[first])
        slope, offset = fit_logits(logits, held_out.held[first])
        return {"calibration": [slope, offset], "grasps": int(first.sum())}

    def export(self, calibration: tuple[float, float], threshold: float = 0.5) -> dict[str, Any]:
        """Copy the policy of one depth image and write what feels beside it."""
        folder, nets = self.folder, self.nets()
        folder.mkdir(parents=True, exist_ok=True)
        source = self.settings.policy
        names = (*read_depth_policy(source).files, "config.json", "LICENSE")
        for name in names:
            if (source / name).is_file() and folder.resolve() != source.resolve():
                shutil.copyfile(source / name, folder / name)
        written = export_stability(folder, nets, calibration)
        config = FeelConfig(
            times=self.settings.times,
            threshold=threshold,
            calibration=calibration,
            width=self.sizes.width,
            members=len(nets),
            files={name: file_hash(folder / name) for name in written},
        )
        write_feel(folder, config)
        write_learned_from(folder, (self.settings.objects, self.settings.held_out))
        return {"files": len(names) + len(written) + 1}

    def threshold(self, stage: Stage) -> dict[str, Any]:
        """Choose the threshold by trials of held-out objects, each with and without a second attempt."""
        pairs = self.pairs(stage, self.settings.held_out, self.sizes.rule_trials, 900)
        found = best_threshold(pairs)
        write_feel(self.folder, replace(read_feel(self.folder), threshold=found))
        return {"threshold": found, "never": at_threshold(pairs, 0.0), "chosen": at_threshold(pairs, found)}

    def pairs(self, stage: Stage, objects: str, trials: int, offset: int) -> PairedTrials:
        """Run trials with and without a second attempt."""

        def report(done: int) -> None:
            stage.report(f"{done} of {2 * trials} trials ({objects})", done / (2 * trials))

        path = stage.folder / f"{objects.replace(':', '-')}.npz"

        def run() -> PairedTrials:
            return run_pairs(self.folder, objects, trials, self.seed + offset, progress=report)

        return load_or_make(PairedTrials, path, run)

    def evaluate(self, stage: Stage) -> dict[str, Any]:
        """Measure policy, first attempt alone and how well it feels, on objects from which nothing was learned."""
        threshold = read_feel(self.folder).threshold
        results: dict[str, Any] = {}
        found: dict[str, PairedTrials] = {}
        for objects in self.settings.evaluated:
            pairs = found[objects] = self.pairs(stage, objects, self.sizes.trials, 1900)
            felt = pairs.probability
            results[objects] = {
                "first": at_threshold(pairs, 0.0),
                "feel": at_threshold(pairs, threshold),
                "always": at_threshold(pairs, 2.0),
                # What perfect feeling would give: it opens where the first grasp does not hold.
                "perfect": int((pairs.first | pairs.second).sum()),
                "auc": round(auc(felt, pairs.first), 4),
                "ece": round(calibration_error(felt, pairs.first), 4),
            }
        save_feel_chart(self.folder / "feel.png", found, threshold)
        return results
