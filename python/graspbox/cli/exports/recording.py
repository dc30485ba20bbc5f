"""The options ``--rerun`` and ``--rerun-episodes``, and the logs of the commands."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox._common.files import check_output
from graspbox.cli.common import console, progress
from graspbox.configs import TrialConfig
from graspbox.demonstrations import Demonstrations
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation.planner_trials import SetResult
from graspbox.evaluation.replays import Replay
from graspbox.hands import Hand

#: Most episodes of a recording.
MAX_EPISODES = 1000

Rerun = Annotated[
    Path | None,
    typer.Option("--rerun", metavar="FILE.rrd", help="Write a recording for the viewer of rerun into this file."),
]
RerunEpisodes = Annotated[
    int,
    typer.Option("--rerun-episodes", min=1, max=MAX_EPISODES, help="Most episodes of that recording, the first ones."),
]


def check_rerun(file: Path | None) -> None:
    """Refuse a recording that cannot be written before anything is computed.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `graspbox.rerun.log`.
    """
    if file is None:
        return
    from graspbox.rerun import check_file

    check_output(check_file(file))


def write_replays(file: Path | None, replays: Sequence[Replay]) -> None:
    """Log episodes of environments; one that cannot be run again is left out with a remark."""
    if file is None:
        return
    from graspbox.rerun import of_replay

    _write(file, len(replays), ((replay.object, partial(of_replay, replay)) for replay in replays))


def write_demonstrations(file: Path | None, made: Demonstrations, count: int) -> None:
    """Log the first episodes of demonstrations."""
    if file is None:
        return
    from graspbox.rerun import of_demonstrations

    write_replays(file, of_demonstrations(made, count))


def write_grasps(file: Path | None, result: SetResult, hand: Hand, trial: TrialConfig, count: int) -> None:
    """Log trials of planned grasps: the best of every object first, then the second ones."""
    if file is None:
        return
    grasps = list(islice(_in_turn(result), count))
    _write(file, len(grasps), ((obj.name, partial(_trial, obj, rank, hand, trial)) for obj, rank in grasps))


def _in_turn(result: SetResult) -> Iterator[tuple[Any, int]]:
    most = max((len(obj.plan) for obj in result.objects if obj.plan is not None), default=0)
    for rank in range(most):
        for obj in result.objects:
            if obj.plan is not None and rank < len(obj.plan):
                yield obj, rank


def _trial(obj: Any, rank: int, hand: Hand, trial: TrialConfig) -> Any:
    from graspbox.rerun import of_trial
    from graspbox.simulation import Scene

    scene = Scene(obj.spec.load(), hand=hand, world_from_object=obj.plan.world_from_object)
    title = f"{obj.name}, pose {rank + 1} of the ranking"
    pose, preshape = obj.plan.poses[rank], float(obj.plan.preshape[rank])
    return of_trial(scene, pose, preshape, config=trial, name=title)


def _write(file: Path, total: int, motions: Iterator[tuple[str, Callable[[], Any]]]) -> None:
    from graspbox.rerun import recording

    logged = 0
    with recording(file) as recorder, progress() as bar:
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
