"""Options of ``graspbox train any-hand``."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from graspbox.errors import ConfigError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.hands.loading import hand_like
from graspbox.learn.recipes.settings.depth import DepthSettings
from graspbox.learn.training.options import Options

__all__ = ["ANY_HAND_QUICK", "AnyHandHours", "AnyHandSettings", "AnyHandSizes", "EvaluatedHand"]


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
    rehearsed: int = 32
    """Grasps of a single object that hands with three fingers or more try on the completed shape; 0 for none."""
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


#: Names of hands for which the run can have folders beside those of random hands.
_FOLDER = re.compile(r"(?!(jaws|fingers)-\d)\w[\w.-]{0,99}")


class EvaluatedHand(NamedTuple):
    """A hand of --hands or --without: its name or files, and whether the policy learns from its trials."""

    hand: HandLike
    trained: bool


@dataclass(frozen=True, kw_only=True)
class AnyHandSettings(Options):
    """Train one scorer on the trials of many hands, to grasp with a hand from which nothing was learned.

        graspbox train any-hand --out out/any_hand
        graspbox train any-hand --out out/without_panda --without panda_gripper
        graspbox train any-hand --out out/quick --quick

    The scorer's inputs describe the hand: the cells that its fingers sweep, and numbers such as its width, its strength
    and its friction. It learns from the hands of --hands and from random ones
    (graspbox.learn.random_hands.random_hand).

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
    """Hands whose policies are evaluated, by their names, or by two files with a comma between: hand.urdf,hand.toml."""
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

    def evaluated_hands(self) -> dict[str, EvaluatedHand]:
        """Return the hands of --without and --hands by name.

        Raises ConfigError if two have the same name or one is no name of a folder, and as `graspbox.hands.load_hand`.
        """
        found: dict[str, EvaluatedHand] = {}
        for text in dict.fromkeys((*self.without, *self.hands)):
            hand = hand_like(text)
            name = load_hand(hand).name
            if name in found or not _FOLDER.fullmatch(name):
                wrong = "as another has" if name in found else "which cannot name a folder beside those of random hands"
                raise ConfigError(f"the hand {text!r} has the name {name!r}, {wrong}; write another into its hand.toml")
            found[name] = EvaluatedHand(hand, text not in self.without)
        return found
