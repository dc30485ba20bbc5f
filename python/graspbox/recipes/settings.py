"""Settings of the trainings of published policies: depth, feel, head, study; without torch."""

from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any, ClassVar, Literal

from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.models.head.configs import Kind
from graspbox.models.stability.inputs import FEEL_TIMES
from graspbox.study.samples import Mapping
from graspbox.training.options import HandOption, Options

__all__ = [
    "ANY_HAND_QUICK",
    "FEEL_QUICK",
    "QUICK",
    "QUICK_OBJECTS",
    "AnyHandHours",
    "AnyHandSettings",
    "AnyHandSizes",
    "DepthSettings",
    "FeelSettings",
    "FeelSizes",
    "HeadSettings",
    "Hours",
    "Sizes",
    "StudySettings",
    "package_licence",
]


def package_licence() -> Path | None:
    """Find the licence of this package, under which trained policies are published."""
    try:
        found = [path for path in files("graspbox") or () if path.name == "LICENSE"]
    except PackageNotFoundError:
        return None
    return Path(str(found[0].locate())) if found else None


@dataclass(frozen=True, kw_only=True)
class _PublishedHand(HandOption):
    """Options of a training whose policies name their hand."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hand not in Hand.names():
            known = ", ".join(Hand.names())
            raise ConfigError(f"--hand is {self.hand!r}; a published policy names its hand: choose from {known}")


@dataclass(frozen=True)
class Hours:
    """Time limits of the stages, hours."""

    data: float = 3.0
    completion: float = 1.75
    scorer: float = 0.6
    head: float = 0.9
    collect: float = 0.3
    """Per round."""
    round: float = 0.35
    """Per round."""
    member: float = 1.0
    """Per further member of the ensemble."""
    calibrate: float = 0.2
    """For all calibrations together."""
    evaluate: float = 0.7


@dataclass(frozen=True)
class Sizes:
    """Upper bounds on data and training; ``--quick`` makes all of them small."""

    poses: int = 128
    """Trials per scene of the data set."""
    rests: int = 2
    """Scenes per object of the data set."""
    completion_steps: int = 12_000
    scorer_steps: int = 15_000
    head_steps: int = 4_000
    round_steps: int = 6_000
    batch: int = 256
    completion_batch: int = 16
    completion_width: int = 16
    """Channels of the completion's first layer."""
    width: int = 48
    """Channels of the scorer's first layer."""
    rounds: int = 6
    members: int = 1
    """Scorers of the ensemble."""
    refinements: tuple[int, ...] = (0,)
    """Refinement counts that the calibration compares; the policy uses the best one for held-out objects."""
    scenes: int = 4_000
    """Scenes of each round."""
    held_out_scenes: int = 150
    """Validation scenes of each round."""
    choices: int = 1_500
    """Scenes for calibration."""
    trials: int = 1_000
    """Trials of each set of objects in the evaluation."""
    validate_every: int = 250

    def __post_init__(self) -> None:
        if self.members < 1:
            raise ConfigError(f"--sizes.members is {self.members}; give 1 or more")
        if not self.refinements or min(self.refinements) < 0:
            raise ConfigError(f"--sizes.refinements is {self.refinements}; give one count or more, each 0 or more")


#: Sizes of ``--quick``.
QUICK = Sizes(
    poses=16,
    rests=1,
    completion_steps=6,
    scorer_steps=12,
    head_steps=6,
    round_steps=6,
    batch=32,
    completion_batch=4,
    completion_width=4,
    width=8,
    rounds=3,
    members=3,
    refinements=(0, 2),
    scenes=4,
    held_out_scenes=2,
    choices=6,
    trials=6,
    validate_every=6,
)
#: Objects of ``--quick``.
QUICK_OBJECTS: dict[str, Any] = {
    "objects": ("procedural:can:0-9",),
    "fresh": ("procedural:can:10-29",),
    "evaluated": ("procedural:bottle:2000-2003",),
}


@dataclass(frozen=True, kw_only=True)
class DepthSettings(HandOption):
    """Train a policy that grasps from one depth image, from nothing to a folder that `graspbox evaluate` runs.

        graspbox train depth --out out/depth
        graspbox train depth --out out/depth --data out/data --publish policies/depth
        graspbox train depth --out out/panda --hand panda_gripper --completion policies/depth
        graspbox train depth --out out/quick --quick

    Stages, each with a time limit (--hours.NAME; together at most 12 hours), a log (log.txt) and results (NAME.json):

    1. data: a data set of trials (graspbox dataset), unless --data names some.
    2. completion: the object's occupancy from one camera's view; labels are rendered. --completion takes that of
       another policy, of any hand.
    3. scorer: the first member, on the data set. --start takes its initial weights from a scorer of many hands, which
       needs few trials of this one.
    4. head: one network that predicts grasps (graspbox train head), on the data set. Its best grasps are scored
       together with the geometric proposals.
    5. collect-N, round-N: trials of grasps chosen by the proposals and the scorer on fresh objects; training resumes
       with half of each batch from them.
    6. member-N: further members of the ensemble, on all trials (--sizes.members 3; by default there is one scorer).
    7. calibrate-N: choices on held-out objects, refined N times (--sizes.refinements 0 2 compares two settings; the
       default is 0). They determine the weight of a secure hold in the choice, and calibrate the scorer's logits to
       probabilities.
    8. export, ablations: the policy's folder, and in ablations the policy before the rounds, before the ensemble,
       before the refinement, and without the head; scripts/evaluate_policies.py measures the effect of each step.
    9. evaluate: the exported policy in GraspPose-v0 on objects excluded from training, and its calibration
       there.

    The same command resumes after an interruption, even after SIGKILL. With a larger --sizes.rounds it adds rounds to a
    finished run. --quick runs all stages in minutes, as a check of the pipeline; such a policy grasps badly. Needs the
    extras cli, data, ycb and train.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "hours", "publish")
    growing: ClassVar[dict[str, tuple[str, ...]]] = {
        "sizes.rounds": ("member-*", "calibrate-*", "export*", "ablations*", "evaluate*")
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
    completion: str | None = None
    """A policy of one depth image, by folder or name, whose completion is used: it knows no hand. By default one is
    trained."""
    start: Path | None = None
    """A run of `graspbox train any-hand`, with whose scorer the first member begins, for any hand."""
    publish: Path | None = None
    """Folder of the exported policy; by default ``policy`` in the run's folder."""
    name: str = "depth"
    """Name of the policy."""
    quick: bool = False
    """Run all stages in minutes."""
    hours: Hours = field(default_factory=Hours)
    sizes: Sizes = field(default_factory=Sizes)


@dataclass(frozen=True)
class AnyHandHours:
    """Time limits of the stages, hours."""

    trials: float = 1.0
    scorer: float = 0.75
    collect: float = 0.5
    """Per round."""
    round: float = 0.5
    """Per round."""
    calibrate: float = 0.2
    evaluate: float = 0.3
    """Per hand."""


@dataclass(frozen=True)
class AnyHandSizes:
    """Upper bounds on data and training; ``--quick`` makes all of them small."""

    scenes: int = 2_000
    """Training scenes of each named hand."""
    random_scenes: int = 100
    """Training scenes of each random hand."""
    round_share: float = 0.5
    """Share of these scenes in each round."""
    held_out_scenes: int = 60
    """Validation scenes of each named hand."""
    views: int = 4
    """Views of each scene."""
    steps: int = 15_000
    round_steps: int = 6_000
    batch: int = 256
    width: int = 64
    """Channels of the scorer's first layer."""
    rounds: int = 2
    choices: int = 1_000
    """Scenes for calibration, all hands together."""
    trials: int = 300
    """Trials of each hand with each set of objects in the evaluation."""
    validate_every: int = 250


#: Values of `AnyHandSettings` with ``--quick``.
ANY_HAND_QUICK: dict[str, Any] = {
    "hands": ("panda_gripper",),
    "without": ("robotiq_2f_85",),
    "jaws": 1,
    "fingers": 1,
    "objects": ("procedural:can:10-29",),
    "evaluated": ("procedural:bottle:2000-2003",),
    "sizes": AnyHandSizes(
        scenes=4,
        random_scenes=2,
        held_out_scenes=2,
        views=1,
        steps=12,
        round_steps=6,
        batch=32,
        width=8,
        rounds=1,
        choices=4,
        trials=4,
        validate_every=6,
    ),
}


@dataclass(frozen=True, kw_only=True)
class AnyHandSettings(Options):
    """Train one scorer on the trials of many hands, to grasp with a hand from which nothing was learned.

        graspbox train any-hand --out out/any_hand
        graspbox train any-hand --out out/without_panda --without panda_gripper
        graspbox train any-hand --out out/quick --quick

    The scorer's inputs describe the hand: the cells that its fingers sweep, and numbers such as its width, its strength
    and its friction. It learns from the hands of --hands and from random ones (graspbox.hand_tools.random_hand).

    Stages, each with a time limit (--hours.NAME), a log (log.txt) and results (NAME.json):

    1. trials: grasps that geometry proposes, tried with every hand.
    2. scorer: one network, on the trials of all hands.
    3. collect-N, round-N: trials of grasps that it chose with every hand; training resumes with them.
    4. calibrate: choices on held-out objects map the scorer's logits to probabilities, for all hands together.
    5. export: the policy's folder.
    6. evaluate-HAND: the exported policy with each hand in GraspPose-v0, on objects excluded from training. Nothing was
       learned from the hands of --without.

    The same command resumes after an interruption, even after SIGKILL. With a larger --sizes.rounds it adds rounds to a
    finished run. --quick runs all stages in minutes, as a check
    of the pipeline. Needs the extras cli, ycb and train.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "hours", "publish")
    growing: ClassVar[dict[str, tuple[str, ...]]] = {"sizes.rounds": ("calibrate*", "export*", "evaluate*")}

    hands: tuple[str, ...] = tuple(Hand.names())
    """Hands by name, whose policies are evaluated."""
    without: tuple[str, ...] = ()
    """Hands that are evaluated only."""
    jaws: int = 40
    """Random parallel jaws."""
    fingers: int = 60
    """Random hands of two to six fingers."""
    completion: str = "depth"
    """A policy of one depth image, by folder or name, whose completion is used."""
    objects: tuple[str, ...] = DepthSettings.fresh
    """Objects of the trials (split train), and of validation and calibration (split validation)."""
    evaluated: tuple[str, ...] = DepthSettings.evaluated
    """Objects of the evaluation; only the split test, except for unseen families."""
    publish: Path | None = None
    """Folder of the exported policy; by default ``policy`` in the run's folder."""
    name: str = "any_hand"
    """Name of the policy."""
    quick: bool = False
    """Run all stages in minutes."""
    hours: AnyHandHours = field(default_factory=AnyHandHours)
    sizes: AnyHandSizes = field(default_factory=AnyHandSizes)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(jaws=0, fingers=0)


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
    """Objects of the evaluation."""
    times: tuple[float, ...] = FEEL_TIMES
    """Times of the grasp-stability check, seconds after closing began; the hand closes for 1.3 s and then lifts."""
    publish: Path | None = None
    """Folder of the exported policy; by default `policy` in the run's folder."""
    hours: float = 2.0
    """Time limit of each stage, hours."""
    quick: bool = False
    """Run all stages in a minute."""
    sizes: FeelSizes = field(default_factory=FeelSizes)


@dataclass(frozen=True, kw_only=True)
class HeadSettings(HandOption):
    r"""Train heads on grasp trials, one network from one depth image to a grasp, and evaluate each.

        graspbox dataset --objects procedural:seen:0-199 --poses 112 --out out/data
        graspbox train head --data out/data --out out/heads
        graspbox train head --data out/depth/data/set --on-policy out/depth --out out/heads --heads anchor \
            --publish policies/head --trials 1000

    Each head (graspbox.models.head.heads) is trained on the same scenes for the same number of steps. With --on-policy
    it also learns from the grasps that a policy chose in the rounds of `graspbox train depth`. The folder holds a
    folder per head, in the format of graspbox.policies.load; results.jsonl with a row per head and object set; and
    heads.md, the table of results.
    With --publish the head anchor is exported with its card, for onnxruntime. The same command resumes an interrupted
    run, and repeats nothing. Runs that end by --minutes depend on the speed of the machine; those that end by --steps
    do not. Needs the extras cli, data and train, and ycb for these objects.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "heads", "minutes", "publish")

    data: tuple[Path, ...]
    """Data sets of this hand; training uses their splits `train` and `validation`."""
    on_policy: Path | None = None
    """Folder of a run of `graspbox train depth`: training also uses the trials of its rounds."""
    untried: tuple[str, ...] = ()
    """Object sets that show the head `anchor` where the open hand can go, without trials."""
    untried_scenes: int = 500
    """Number of these scenes."""
    heads: tuple[Kind, ...] = ("constant", "regressor", "set", "anchor")
    """Heads to train, from the simplest to the one that learns most from the same trials."""
    steps: int = 4000
    """Training steps of each head; a step uses 16 scenes."""
    minutes: float = 120.0
    """Time limit of each head, wall time."""
    learning_rate: float = 2e-3
    """Peak learning rate."""
    width: int = 32
    """Channels of the trunk at half the crop's resolution."""
    objects: tuple[str, ...] = ("procedural:unseen:0-39", "ycb/test")
    """Object sets for the evaluation; /SPLIT keeps one split."""
    publish: Path | None = None
    """Folder of the exported head `anchor`."""
    trials: int = 200
    """Trials per head and object set; 0 skips the evaluation."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(steps=1, untried_scenes=1, trials=0)
        self._positive("minutes", "learning_rate")
        if not self.heads:
            raise ConfigError("--heads is empty; name one head or more")


@dataclass(frozen=True, kw_only=True)
class StudySettings(_PublishedHand):
    """Retrain the reference study's networks, with its settings and with sane ones, and execute their poses.

        graspbox train study --out out/study --minutes-per-network 20
        graspbox train study --out out/quick --networks cnn3d --losses psi4 --iterations 200
        graspbox train study --out out/study --minutes-per-network 20 --publish policies/study

    The folder has study.md, which shows tables 3.2 and 3.3 next to ours and figures 3.19 to 3.27; results.jsonl with a
    row per network; data with the samples; and a folder per network (graspbox.study.training), which
    graspbox.study.regressor.PoseRegressor loads as a policy.

    The same command resumes an interrupted run: samples are kept, complete networks are not trained again, and an
    incomplete one resumes from its last checkpoint. Networks that end by --minutes-per-network depend on
    the speed of the machine; those that end by --iterations or by early stopping do not.

    --publish exports the best of the networks that are small enough, with a card, for onnxruntime; Cnn2d has 190 MB.
    Needs the extras cli, ycb and train.
    """

    free: ClassVar[tuple[str, ...]] = (
        *(*Options.free, "minutes_per_network"),
        *("publish", "measured", "trials"),
    )

    torch_threads: int = 2
    """CPU threads of the networks; another number rounds differently."""
    settings: Literal["legacy", "sane", "both"] = "both"
    """The study's settings, sane ones under which its networks learn, or both."""
    networks: tuple[Literal["cnn2d", "cnn2d_dropout", "cnn3d"], ...] = ("cnn2d", "cnn2d_dropout", "cnn3d")
    """Networks to train."""
    losses: tuple[Literal["posenet", "psi1", "psi2", "psi3", "psi4", "euler"], ...] = ("psi4", "psi3", "psi2", "euler")
    """Losses to train each network with; by default those of the study's tables."""
    mapping: Mapping = "many_to_one"
    """Pairing of views and poses; the study chose many_to_one."""
    voxels: Literal["binary", "ternary"] = "ternary"
    """Voxels of the 3D network."""
    objects: tuple[str, ...] = ()
    """Object sets; by default the study's ten objects of the YCB set."""
    samples: int | None = None
    """Number of samples; by default those of the study, 1,230 images and 189 grids."""
    units: Literal["relu", "sigmoid"] = "relu"
    """Units of the networks."""
    optimizer: Literal["sgd", "momentum", "nesterov", "adagrad", "adam", "delta_bar_delta"] | None = None
    """Optimizer; overrides the settings."""
    learning_rate: float | None = None
    """Learning rate; overrides the settings."""
    minutes_per_network: float | None = None
    """Time limit of each network, wall time; by default early stopping alone ends it."""
    iterations: int | None = None
    """Greatest number of iterations of each network."""
    publish: Path | None = None
    """Folder of the best small network as a policy."""
    measured: tuple[str, ...] = ("procedural:unseen:0-19", "ycb/test")
    """Object sets for the evaluation of that policy; /SPLIT keeps one split."""
    trials: int = 1000
    """Trials per object set."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(samples=20, iterations=1, trials=1)
        self._positive("minutes_per_network", "learning_rate")
        for name in ("networks", "losses"):
            if not getattr(self, name) or len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ConfigError(f"--{name} is {' '.join(getattr(self, name))!r}; name each once, one or more")
