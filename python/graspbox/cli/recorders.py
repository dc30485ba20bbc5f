"""The options ``--rerun`` and ``--rerun-episodes``, whose recorder is an entry point of ``graspbox.recorders``."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Protocol

import typer

from graspbox._common.entry_points import entry_points_of, load_entry_point
from graspbox._common.files import check_output
from graspbox.configs import TrialConfig
from graspbox.data.episodes import Demonstrations
from graspbox.errors import MissingExtraError
from graspbox.evaluation.planner_trials import SetResult
from graspbox.evaluation.replays import Replay
from graspbox.hands import Hand
from graspbox.policies.grasp_image import ImageGrasps

__all__ = ["MAX_EPISODES", "RECORDERS", "CommandRecorder", "Rerun", "RerunEpisodes", "rerun_recorder"]

#: Group of the entry points; each names a function of a path that returns a `CommandRecorder`.
RECORDERS = "graspbox.recorders"
#: Most episodes of a recording.
MAX_EPISODES = 1000

Rerun = Annotated[
    Path | None, typer.Option(metavar="FILE.rrd", help="Write a recording for the viewer of rerun into this file.")
]
RerunEpisodes = Annotated[
    int, typer.Option(min=1, max=MAX_EPISODES, help="Most episodes of that recording, the first ones.")
]


class CommandRecorder(Protocol):
    """Writes the results of a command into one file."""

    def write_replays(self, replays: Sequence[Replay]) -> None:
        """Write episodes of environments; one that cannot be run again is left out with a remark."""

    def write_demonstrations(self, made: Demonstrations, count: int) -> None:
        """Write the first episodes of demonstrations."""

    def write_grasps(self, result: SetResult, hand: Hand, trial: TrialConfig, count: int) -> None:
        """Write trials of planned grasps: the best of every object first, then the second ones."""

    def write_image_grasps(self, found: ImageGrasps) -> None:
        """Write the grasps of a depth image."""

    def stream_image_grasps(self) -> AbstractContextManager[Callable[[ImageGrasps, float], None]]:
        """Open the file for the grasps of several depth images, each with its time, seconds.

        The file is written when the block ends without an error.
        """


def rerun_recorder(file: Path | None) -> CommandRecorder | None:
    """Open the recorder of ``--rerun``; refuse a file that cannot be written before anything is computed."""
    if file is None:
        return None
    if "rerun" not in entry_points_of(RECORDERS):
        raise MissingExtraError("--rerun needs a recorder: pip install 'graspbox[rerun]'")
    recorder: CommandRecorder = load_entry_point(RECORDERS, "rerun", "recorder", "graspbox --help lists all")(file)
    check_output(file)
    return recorder
