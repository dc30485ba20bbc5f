"""Options of ``graspbox train feel``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from graspbox.learn.training.options import Options
from graspbox.policies.stability_inputs import FEEL_TIMES

__all__ = ["FEEL_QUICK", "FeelSettings", "FeelSizes"]


@dataclass(frozen=True)
class FeelSizes:
    """Upper bounds on recording and training; ``--quick`` makes all of them small."""

    scenes: int = 2_000
    """Training scenes."""
    held_out_scenes: int = 320
    """Scenes for validation and calibration."""
    per_scene: int = 8
    """Grasps of each scene."""
    steps: int = 4_000
    validate_every: int = 100
    members: int = 3
    """Networks of the ensemble, which averages their logits."""
    width: int = 64
    rule_trials: int = 400
    """Trials for the choice of the threshold, each with and without a second attempt."""
    trials: int = 400
    """Trials of each set of objects in the evaluation, likewise."""


#: Values of `FeelSettings` with ``--quick``.
FEEL_QUICK: dict[str, Any] = {
    "sizes": FeelSizes(
        scenes=16,
        held_out_scenes=8,
        per_scene=3,
        steps=20,
        validate_every=10,
        members=2,
        width=8,
        rule_trials=4,
        trials=4,
    ),
    "objects": "procedural:can:10-19",
    "held_out": "procedural:can:20-23",
    "evaluated": ("procedural:bottle:2000-2003",),
}


@dataclass(frozen=True, kw_only=True)
class FeelSettings(Options):
    """Add a grasp-stability check before the lift to a policy of one depth image.

        graspbox train feel --policy policies/depth --out out/feel
        graspbox train feel --policy policies/depth --out out/feel --publish policies/feel
        graspbox train feel --policy policies/depth --out out/closed --times 1.3
        graspbox train feel --policy out/quick/policy --out out/feel-quick --quick

    Stages, each with a time limit (--hours), a log (log.txt) and results (NAME.json):

    1. record-train, record-held-out: grasps of the policy, its own choice and others that it scored, are closed and
       lifted in Grasp-v0. The recording keeps joints, loads and tactile forces of the closing hand, and whether the
       hand held the object.
    2. member-N: small networks that predict the outcome; their mean counts.
    3. calibrate: slope and offset of the logit, on the policy's own choices of held-out objects.
    4. export: the policy's folder, including these networks.
    5. threshold: trials of held-out objects, each with and without a second attempt, determine the probability below
       which the hand opens.
    6. evaluate: the first attempt alone and with a second one, on objects excluded from training; the card and a chart
       are made from it.

    The hand is that of the policy. By default it checks grasp stability once the hand has closed and 10 cm into the
    lift; with --times 1.3 it checks before the lift. --evaluated names other objects for the evaluation;
    --sizes.scenes, --sizes.held-out-scenes, --sizes.rule-trials and --sizes.trials set the counts of scenes and trials.

    The same command resumes after an interruption, even after SIGKILL. --quick runs all stages in a minute, as a check
    of the pipeline. Needs the extras cli and train.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "policy", "hours", "publish")

    policy: Path
    """Folder of the policy of one depth image (graspbox train depth), or the name of an installed one."""
    objects: str = "procedural:seen:400-499"
    """Training objects; the policy should not have been trained on them."""
    held_out: str = "procedural:seen:500-549"
    """Objects for validation, calibration and the choice of the threshold."""
    evaluated: tuple[str, ...] = ("procedural:unseen:0-19",)
    """Objects of the evaluation: the test split of sets that are not procedural."""
    times: tuple[float, ...] = FEEL_TIMES
    """Times of the grasp-stability check, seconds after closing began; the hand closes for 1.3 s and then lifts."""
    publish: Path | None = None
    """Folder of the exported policy; by default `policy` in the run's folder."""
    hours: float = 2.0
    """Time limit of each stage, hours."""
    quick: bool = False
    """Run all stages in a minute."""
    sizes: FeelSizes = field(default_factory=FeelSizes)
