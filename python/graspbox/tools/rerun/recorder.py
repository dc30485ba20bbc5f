"""What ``--rerun FILE.rrd`` of the commands writes: an entry point of the group ``graspbox.recorders``."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from graspbox.cli.common import console, progress
from graspbox.configs import TrialConfig
from graspbox.data.episodes import Demonstrations
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation.planner_trials import SetResult
from graspbox.evaluation.replays import Replay
from graspbox.hands import Hand
from graspbox.policies.grasp_image import ImageGrasps
from graspbox.simulation import Scene
from graspbox.tools import rerun


class RerunRecorder:
    """Writes the results of a command for the viewer of rerun (`graspbox.cli.recorders.CommandRecorder`).

    Parameters
    ----------
    file : Path
        File with the suffix ``.rrd``.

    Raises
    ------
    ConfigError, MissingExtraError
        As `graspbox.tools.rerun.log`.
    """

    def __init__(self, file: Path) -> None:
        rerun.check_file(file)
        self._file = file

    def write_replays(self, replays: Sequence[Replay]) -> None:
        """Write episodes of environments; one that cannot be run again is skipped with a message."""
        _write(self._file, len(replays), ((replay.object, partial(rerun.of_replay, replay)) for replay in replays))

    def write_demonstrations(self, made: Demonstrations, count: int) -> None:
        """Write the first episodes of demonstrations."""
        self.write_replays(rerun.of_demonstrations(made, count))

    def write_grasps(self, result: SetResult, hand: Hand, trial: TrialConfig, count: int) -> None:
        """Write trials of planned grasps: the best of every object first, then the second ones."""
        grasps = list(islice(_in_turn(result), count))
        trials = ((obj.name, partial(_trial, obj, rank, hand, trial)) for obj, rank in grasps)
        _write(self._file, len(grasps), trials)

    def write_image_grasps(self, found: ImageGrasps) -> None:
        """Write the grasps of a depth image."""
        rerun.log(found, self._file)
        console.print(f"wrote {self._file}")

    @contextmanager
    def stream_image_grasps(self) -> Iterator[Callable[[ImageGrasps, float], None]]:
        """Open the file for the grasps of several depth images, each with its time, seconds."""
        with rerun.recording(self._file) as recorder:
            yield recorder.image_grasps
        console.print(f"wrote {self._file}")


def _in_turn(result: SetResult) -> Iterator[tuple[Any, int]]:
    most = max((len(obj.plan) for obj in result.objects if obj.plan is not None), default=0)
    for rank in range(most):
        for obj in result.objects:
            if obj.plan is not None and rank < len(obj.plan):
                yield obj, rank


def _trial(obj: Any, rank: int, hand: Hand, trial: TrialConfig) -> Any:
    scene = Scene(obj.spec.load(), hand=hand, world_from_object=obj.plan.world_from_object)
    title = f"{obj.name}, pose {rank + 1} of the ranking"
    pose, preshape = obj.plan.poses[rank], float(obj.plan.preshape[rank])
    return rerun.of_trial(scene, pose, preshape, config=trial, name=title)


def _write(file: Path, total: int, motions: Iterator[tuple[str, Callable[[], Any]]]) -> None:
    logged = 0
    with rerun.recording(file) as recorder, progress() as bar:
        task = bar.add_task("recording", total=total)
        for name, run in motions:
            try:
                recorder.motion(run())
                logged += 1
            except GraspboxError as error:
                console.print(f"{name} is not in the recording: {error}", style="red", soft_wrap=True)
            bar.advance(task)
        if not logged:
            raise ConfigError(f"--rerun {str(file)!r}: no episode can be run again; nothing was written")
    console.print(f"wrote {file}: {logged} episodes")
