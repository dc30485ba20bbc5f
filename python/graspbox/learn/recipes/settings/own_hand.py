"""Options of ``graspbox hand train``."""

import hashlib
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.hands.loading import hand_like
from graspbox.hands.urdf_meshes import LARGEST
from graspbox.learn.recipes.settings.depth import QUICK, QUICK_OBJECTS, DepthSettings, Hours, Sizes
from graspbox.learn.training.options import Options
from graspbox.perception.configs import MANY_FINGERS

__all__ = ["Minutes", "OwnHandSettings"]

#: Shares of the minutes of stage `tuned` that the stages of ``graspbox train depth`` get, and of each later round.
_TUNED = {
    "data": 0.44,
    "scorer": 0.06,
    "head": 0.07,
    "collect": 0.18,
    "round": 0.15,
    "head_rounds": 0.05,
    "calibrate": 0.05,
}
_ROUND = {"collect": 0.45, "round": 0.4}
#: Share of the minutes of stage `own` for what follows its rounds.
_AFTER = {"head_rounds": 0.075, "calibrate": 0.075}
#: Grasps that the policy of a hand with many fingers rehearses.
_REHEARSED = 16
#: Least minutes of stage `tuned`, and those of a round of stage `own`.
_LEAST, _PER_ROUND = 5.0, 18.0


@dataclass(frozen=True)
class Minutes:
    """Time by the clock for each stage, minutes; evaluations are not counted."""

    search: float = 10.0
    """Search for the posture with which the hand holds most."""
    tuned: float = 30.0
    """Trials of this hand, from which the policy of many hands learns: 5 or more."""
    own: float = 0.0
    """The hand's own policy: rounds of 18 minutes, in each of which it tries grasps of its choice, and learns from all.
    A later call with more adds rounds."""


@dataclass(frozen=True, kw_only=True)
class OwnHandSettings(Options):
    """Make a policy for your hand, from its file: search, check, tuning and training in one folder.

        graspbox hand train hand.urdf --out out/hand
        graspbox hand train hand.urdf --out out/hand --minutes.own 120
        graspbox hand train hand.urdf,hand.toml --out out/hand
        graspbox hand train hand.urdf --out out/quick --quick

    Stages, each with a folder and results (NAME.json):

    1. hand: hand.urdf and hand.toml; simulated grasps decide how the hand opens, closes and grasps
       (graspbox hand new --search).
    2. check: findings and a picture of the closing hand (graspbox hand check). Errors end the command; correct
       hand/hand.toml, and repeat it.
    3. start: the policy of many hands with this hand, as it is (graspbox evaluate).
    4. tuned: that policy after minutes of this hand's trials (graspbox train depth --start any_hand). With three
       fingers or more it tries its 16 best grasps in simulation before it chooses.
    5. own: the hand's own policy, by the clock: rounds of grasps of its choice, in the run of stage 4. Without
       --minutes.own it is left out, and a later call adds it.

    Policies are evaluated with objects from which nothing is learned; the run of stages 4 and 5 is in the folder
    training. The same command resumes after an interruption, even after SIGKILL. --quick runs all stages in minutes, as
    a check of the pipeline; such a policy grasps badly. Needs the extras cli, data, search, ycb and train.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "minutes")
    growing: ClassVar[dict[str, tuple[str, ...]]] = {"rounds_of_minutes_own": ("own*",)}

    file: Annotated[str, typer.Argument()]
    """URDF, xacro or MJCF file of the hand. Nothing is searched with its hand.toml after a comma, or a name instead."""
    name: str | None = None
    """Name of the hand and of its policies; that of the file by default."""
    base: str | None = None
    """Palm of the hand, a link; by default where chains of joints branch."""
    start: str = "any_hand"
    """The policy of many hands, by folder or name."""
    completion: str = "depth"
    """A policy of one depth image, by folder or name, whose completion is used."""
    evaluated: tuple[str, ...] = DepthSettings.evaluated
    """Objects of the evaluations; only the split test, except for unseen families."""
    trials: int = 300
    """Trials of each of these sets."""
    quick: bool = False
    """Run all stages in minutes."""
    minutes: Minutes = field(default_factory=Minutes)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(trials=1)
        least = {"search": math.ulp(0.0), "tuned": math.ulp(0.0) if self.quick else _LEAST, "own": 0.0}
        for name, bound in least.items():
            value = getattr(self.minutes, name)
            if not bound <= value < math.inf:
                text = {0.0: "0 or more", _LEAST: f"{_LEAST:g} or more"}.get(bound, "a positive number")
                raise ConfigError(f"--minutes.{name} is {value:g}; pass {text}")
        if 0.0 < self.minutes.own < _PER_ROUND and not self.quick:
            raise ConfigError(
                f"--minutes.own is {self.minutes.own:g}; a round takes {_PER_ROUND:g}, so pass 0 or at least that"
            )
        if self.base is not None and self.given is not None:
            raise ConfigError(f"--base is {self.base!r}, but the hand has its hand.toml; name the URDF alone")
        if "," in str(self.out):
            raise ConfigError(f"--out is {str(self.out)!r}; a comma separates the two files of a hand, so pass another")

    @property
    def given(self) -> str | tuple[str, str] | None:
        """The hand, if the user has one already: a name or two files."""
        named = hand_like(self.file)
        return named if named in Hand.names() or isinstance(named, tuple) else None

    @property
    def own_rounds(self) -> int:
        """Rounds of stage `own`."""
        return 0 if not self.minutes.own else max(1, int(self.minutes.own / _PER_ROUND))

    @property
    def more_minutes(self) -> float:
        """Minutes of stage `own` for a later call."""
        return _PER_ROUND * max(6, 2 * self.own_rounds)

    def kept(self) -> dict[str, Any]:
        """Return the options on which the results depend; of the files their names and contents, wherever they are."""
        files = [] if self.given == self.file else [Path(word) for word in self.file.split(",", 1)]
        content = hashlib.sha256(b"\0".join(read_bounded(path, LARGEST) for path in files)).hexdigest()[:16]
        named = ",".join(path.name for path in files) or self.file
        return {**super().kept(), "file": named, "contents": content, "rounds_of_minutes_own": self.own_rounds}

    @property
    def tested(self) -> tuple[tuple[str, ...], int]:
        """Objects of the evaluations, and trials of each set."""
        return (QUICK_OBJECTS["evaluated"], QUICK.trials) if self.quick else (self.evaluated, self.trials)

    def training(self, hand: str, name: str, publish: Path, *, fingers: int, own: bool) -> DepthSettings:
        """Return the options of ``graspbox train depth`` for a stage: `tuned`, or `own`, which adds rounds to it."""
        minutes, (evaluated, trials) = self.minutes, self.tested
        hours = {stage: share * minutes.tuned / 60 for stage, share in _TUNED.items()}
        if own:
            hours |= {stage: share * minutes.own / 60 / self.own_rounds for stage, share in _ROUND.items()}
            hours |= {stage: share * minutes.own / 60 for stage, share in _AFTER.items()}
        # Of few minutes more objects, of both splits, are worth more than more grasps of each.
        sizes = QUICK if self.quick else Sizes(poses=32, held_out_scenes=40, choices=500)
        rehearsed = _REHEARSED if fingers >= MANY_FINGERS else 0
        objects: dict[str, Any] = {**(QUICK_OBJECTS if self.quick else {}), "evaluated": evaluated}
        return DepthSettings(
            out=self.out / "training",
            seed=self.seed,
            device=self.device,
            torch_threads=self.torch_threads,
            hand=hand,
            name=name,
            start=Path(self.start),
            completion=self.completion,
            publish=publish,
            hours=Hours(**hours),
            sizes=replace(sizes, rounds=1 + (self.own_rounds if own else 0), trials=trials, rehearsed=rehearsed),
            **objects,
        )
