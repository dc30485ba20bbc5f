"""Options of ``graspbox train depth``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, get_args

from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.learn.training.options import HandOption, Options
from graspbox.simulation.layouts import SceneLayout

__all__ = ["HEAD_OF_ROUNDS", "QUICK", "QUICK_OBJECTS", "DepthSettings", "Hours", "Sizes"]


@dataclass(frozen=True)
class Hours:
    """Time limits of the stages, hours: together less than 4 with the default rounds."""

    data: float = 0.6
    completion: float = 0.65
    scorer: float = 0.35
    head: float = 0.3
    head_rounds: float = 0.15
    collect: float = 0.12
    """Per round."""
    round: float = 0.15
    """Per round."""
    calibrate: float = 0.1
    evaluate: float = 0.2
    """An estimate: the evaluation runs all its trials."""


@dataclass(frozen=True)
class Sizes:
    """Upper bounds on data and training; ``--quick`` makes all of them small."""

    poses: int = 128
    """Trials per scene of the data set."""
    rests: int = 2
    """Scenes per object of the data set."""
    completion_steps: int = 12_000
    """0 keeps the completion of --completion as it is."""
    scorer_steps: int = 15_000
    """0 keeps the scorer of --start as it is."""
    head_steps: int = 4_000
    head_round_steps: int = 2_000
    """Steps that the head learns further after the rounds; 0 for none, as with several objects."""
    untried: int = 1_000
    """Scenes without trials from which it then learns where the open hand can go."""
    round_steps: int = 6_000
    batch: int = 256
    completion_batch: int = 16
    completion_width: int = 16
    """Channels of the completion's first layer."""
    width: int = 48
    """Channels of the scorer's first layer; with --start they are those of its scorer."""
    rounds: int = 6
    proposed: int = 80
    """Most geometric proposals that the policy scores."""
    predicted: int = 32
    """Most grasps of its head that it scores too."""
    enough: int | None = None
    """Number of geometric proposals from which on the policy does not ask its head; by default it always does."""
    lever_penalty: float | None = None
    """What the score of a grasp loses for each metre from the hand to the middle of the object; by default nothing."""
    rehearsed: int = 0
    """Grasps of a single object that the policy tries on the completed shape before it chooses one; 0 for none."""
    scenes: int = 4_000
    """Scenes of each round."""
    held_out_scenes: int = 150
    """Validation scenes of each round."""
    choices: int = 1_500
    """Scenes for calibration."""
    trials: int = 1_000
    """Trials of each set of objects in the evaluation."""
    cleared: int = 40
    """Rounds of each layout of several objects, and set of objects, in the evaluation."""
    validate_every: int = 250


#: Sizes of ``--quick``.
QUICK = Sizes(
    poses=16,
    rests=1,
    completion_steps=6,
    scorer_steps=12,
    head_steps=6,
    head_round_steps=6,
    untried=2,
    round_steps=6,
    batch=32,
    completion_batch=4,
    completion_width=4,
    width=8,
    rounds=3,
    scenes=4,
    held_out_scenes=2,
    choices=6,
    trials=6,
    cleared=2,
    validate_every=6,
)
#: Objects of ``--quick``.
QUICK_OBJECTS: dict[str, Any] = {
    "objects": ("procedural:can:0-9",),
    "fresh": ("procedural:can:10-29",),
    "evaluated": ("procedural:bottle:2000-2003",),
}


#: Stage in which the head learns from the rounds.
HEAD_OF_ROUNDS = "head-rounds"
#: Stages that depend on which scorers decide.
_DECISION_STAGES = ("calibrate*", "export*", "ablations*", "evaluate*", "clear*")


@dataclass(frozen=True, kw_only=True)
class DepthSettings(HandOption):
    """Train a policy that grasps from one depth image, from nothing to a folder that `graspbox evaluate` runs.

        graspbox train depth --out out/depth
        graspbox train depth --out out/depth --data out/data --publish policies/depth
        graspbox train depth --out out/panda --hand panda_gripper --completion policies/depth
        graspbox train depth --out out/quick --quick

    Stages, each with a time limit (--hours.NAME; together less than 4 hours), a log (log.txt) and results (NAME.json):

    1. data: a data set of trials (graspbox dataset), unless --data names some.
    2. completion: the object's occupancy from one camera's view; labels are rendered. --completion takes that of
       another policy, of any hand, and trains it further if --layout has several objects.
    3. scorer: the network that scores grasps, on the data set. --start takes its initial weights from an earlier
       run, from a published policy, or from a scorer of many hands, which needs few trials of this one.
    4. head: one network that predicts grasps (graspbox train head), on the data set. Its best grasps are scored
       together with the geometric proposals; with --sizes.enough 32 only where these are fewer than 32.
    5. collect-N, round-N: trials of grasps chosen by the proposals and the scorer on fresh objects; training resumes
       with half of each batch from them.
    6. head-rounds: the head learns further, from the trials of the rounds too, and from scenes without trials where the
       open hand can go; it is kept as it was where that makes it no better. With one object in a scene only.
    7. calibrate: choices on held-out objects. They determine the weight of a secure hold in the choice, and calibrate
       the scorer's logits to probabilities. --sizes.lever-penalty 4 prefers grasps near the middle of an object.
    8. export, ablations: the policy's folder, and in ablations the policy before the rounds, and without the head;
       scripts/evaluate_policies.py measures the effect of each step. With --sizes.rehearsed 16 the policy tries its 16
       best grasps in simulation before it chooses, which helps hands of many fingers.
    9. evaluate: the exported policy in GraspPose-v0 on objects excluded from training, and its calibration there.
    10. clear: rounds of clearing scenes of several objects (graspbox benchmark clutter), if --layout has any.

    The same command resumes after an interruption, even after SIGKILL. With a larger --sizes.rounds it adds rounds to a
    finished run. Where a published policy is named by --start and --completion, and --sizes.rounds,
    --sizes.scorer-steps and --sizes.completion-steps are 0, nothing is learned and no data set is made: the policy is
    calibrated again. --quick runs all stages in minutes, as a check of the pipeline; such a policy grasps badly. Needs
    the extras cli, data, ycb and train.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "hours", "publish")
    growing: ClassVar[dict[str, tuple[str, ...]]] = {
        "sizes.rounds": (f"{HEAD_OF_ROUNDS}*", *_DECISION_STAGES),
    }

    data: tuple[Path, ...] = ()
    """Existing data sets of trials, with this hand; by default one is made in the run's folder."""
    objects: tuple[str, ...] = (
        "procedural:seen:0-199",
        "procedural:prism:200-799",
        "procedural:bracket:200-799",
        "procedural:carton:200-799",
        "ycb",
    )
    """Objects of the generated data set, and of the completion."""
    fresh: tuple[str, ...] = (
        "procedural:seen:200-399",
        "procedural:prism:1000-1799",
        "procedural:bracket:1000-1799",
        "procedural:carton:1000-1799",
    )
    """Objects of the rounds (split train), and of validation and calibration (split validation)."""
    evaluated: tuple[str, ...] = ("procedural:unseen:0-19", "ycb")
    """Objects of the evaluation; only the split test, except for unseen families."""
    layout: tuple[str, ...] = ("single",)
    """How objects lie in the scenes of the rounds and of the calibration, in turn: single, packed, pile, bin. With
    several objects the policy looks at all of them at once, and clears scenes (Clear-v0)."""
    completion: str | None = None
    """A policy of one depth image, by folder or name, whose completion is used: it knows no hand. With several objects
    it is trained further on scenes of the layouts. By default one is trained."""
    start: Path | None = None
    """A run of `graspbox train depth` with this hand, or of `graspbox train any-hand`, or a published policy, by folder
    or name, with whose scorer the training begins. It brings the head of a published policy."""
    publish: Path | None = None
    """Folder of the exported policy; by default ``policy`` in the run's folder."""
    name: str = "depth"
    """Name of the policy."""
    time_step: float = PhysicsConfig.dt
    """Time step of the simulation of all trials from which the policy learns, seconds, 0.0001 to 0.01. The evaluation
    uses that of the environments, 0.002."""
    real: float = 0.0
    """Share of the scenes that are seen as by a real camera: from 0.35 to 1.5 m, with noise that neighbouring pixels
    share, with holes, and with a crop around one thing. With more than 0 the completion of --completion is trained
    further for single objects too."""
    quick: bool = False
    """Run all stages in minutes."""

    hours: Hours = field(default_factory=Hours)
    sizes: Sizes = field(default_factory=Sizes)

    def __post_init__(self) -> None:
        super().__post_init__()
        known = get_args(SceneLayout)
        for layout in self.layout:
            if layout not in known:
                raise ConfigError(f"--layout has {layout!r}; choose from {', '.join(known)}")
        if not self.sizes.scorer_steps and self.start is None:
            raise ConfigError("--sizes.scorer-steps is 0; pass more, or name the policy to keep by --start")
        if not self.sizes.completion_steps and self.completion is None:
            raise ConfigError("--sizes.completion-steps is 0; pass more, or name the policy to keep by --completion")
        if not 0.0 <= self.real <= 1.0:
            raise ConfigError(f"--real is {self.real}; it is a share of the scenes, 0 to 1")
        if not 1e-4 <= self.time_step <= 0.01:
            raise ConfigError(f"--time-step is {self.time_step}; it must be 0.0001 to 0.01 seconds")
        if not self.layout:
            raise ConfigError(f"--layout is empty; pass one or more of {', '.join(known)}")
