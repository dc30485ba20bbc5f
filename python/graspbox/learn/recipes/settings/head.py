"""Options of ``graspbox train head``."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from graspbox.learn.training.options import HandOption, Options

__all__ = ["HeadSettings"]


@dataclass(frozen=True, kw_only=True)
class HeadSettings(HandOption):
    r"""Train a head on grasp trials, one network from one depth image to a grasp, and evaluate it.

        graspbox dataset --objects procedural:seen:0-199 --poses 112 --out out/data
        graspbox train head --data out/data --out out/head
        graspbox train head --data out/depth/data/set --on-policy out/depth --out out/head \
            --publish policies/head --trials 1000

    The head scores the poses of a grid, the anchors (graspbox.learn.models.head.network). With --on-policy it also
    learns from the grasps that a policy chose in the rounds of `graspbox train depth`. The folder holds the trained
    head in `trained`; results.jsonl with a row per object set, with and without the filter of collisions; and head.md,
    the table of results.
    With --publish the head is exported with its card, for onnxruntime. The same command resumes an interrupted run,
    and repeats nothing. Runs that end by --minutes depend on the speed of the machine; those that end by --steps do
    not. Needs the extras cli, data and train, and ycb for these objects.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "minutes", "publish")

    data: tuple[Path, ...]
    """Data sets of this hand; training uses their splits `train` and `validation`."""
    on_policy: Path | None = None
    """Folder of a run of `graspbox train depth`: training also uses the trials of its rounds."""
    untried: tuple[str, ...] = ()
    """Object sets that show the head where the open hand can go, without trials."""
    untried_scenes: int = 500
    """Number of these scenes."""
    steps: int = 4000
    """Training steps; a step uses 16 scenes."""
    minutes: float = 120.0
    """Time limit of the training, wall time."""
    learning_rate: float = 2e-3
    """Peak learning rate."""
    width: int = 32
    """Channels of the trunk at half the crop's resolution."""
    objects: tuple[str, ...] = ("procedural:unseen:0-39", "ycb/test")
    """Object sets for the evaluation; /SPLIT keeps one split."""
    publish: Path | None = None
    """Folder of the exported head."""
    trials: int = 200
    """Trials per object set; 0 skips the evaluation."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(steps=1, untried_scenes=1, trials=0)
        self._positive("minutes", "learning_rate")
