"""``graspbox dataset``: simulated grasp trials as Parquet files."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from graspbox._common.progress import shown_time
from graspbox.cli import common
from graspbox.configs import ShakeConfig, TrialConfig
from graspbox.data import trials as data
from graspbox.simulation import layouts

#: Time between two lines of progress where nothing can be drawn again, seconds.
_LINE_EVERY = 30.0


class _Reporter:
    """Shows trials, their rate and the remaining time: a bar, or a line every 30 s in a log."""

    def __init__(self) -> None:
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"))
        self.bar = Progress(TextColumn("trials"), *columns, console=common.console, transient=True)
        self.task = self.bar.add_task("", total=None, rate="")
        self.last = time.monotonic()

    def __call__(self, progress: data.Progress) -> None:
        rate = f"{progress.rate:.1f}/s, {shown_time(progress.remaining)} left"
        self.bar.update(self.task, completed=progress.trials, total=progress.total, rate=rate)
        if not common.console.is_terminal and time.monotonic() - self.last > _LINE_EVERY:
            self.last = time.monotonic()
            common.console.print(f"{progress.trials} of {progress.total} trials, {rate}")


def _print(result: data.Result) -> None:
    table = result.table()
    keys = ("trials", "success", "secure", "infeasible")
    for title, counts in (("split", table["counts"]), ("candidates", table["candidates"])):
        rows = [(name, *(str(numbers[key]) for key in keys)) for name, numbers in counts.items()]
        sums = [str(sum(numbers[key] for numbers in counts.values())) for key in keys]
        common.print_table(str(result.folder), (title, *keys), [*rows, ("total", *sums)])
    shards = table["shards"]
    typer.echo(
        f"{shards['made']} shards made, {shards['resumed']} kept; {table['trials_made']} trials in "
        f"{shown_time(table['seconds'])}, {table['trials_per_s']:.1f} trials/s"
    )


def _runner(ray: bool, workers: int | None) -> data.Runner | None:
    if ray and workers is not None:
        raise typer.BadParameter("Ray counts its own workers; leave --workers out", param_hint="--workers")
    return data.on_ray() if ray else None if workers is None else data.local(workers)


Rests = Annotated[int, typer.Option(min=1, help="Scenes per object, each with its own resting pose and cameras.")]
Replays = Annotated[int, typer.Option(min=0, help="Further trials of each pose of the splits validation and test.")]
ShardTrials = Annotated[int, typer.Option(min=1, help="Trials per file, the unit of work that an interruption loses.")]
PerScene = Annotated[
    tuple[int, int],
    typer.Option("--objects-per-scene", help="Least and greatest number of objects in scenes of several."),
]
Workers = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Processes; one per core by default. Rows do not depend on them.")
]
Ray = Annotated[
    bool, typer.Option("--ray", help="Make the shards on a Ray cluster: that of RAY_ADDRESS, or a local one.")
]
_DEFAULT = data.DatasetConfig()


def dataset(
    out: Annotated[Path, typer.Option(help="Folder of the data set; an existing data set is continued.")],
    objects: common.Objects = None,
    poses: Annotated[int, typer.Option(min=1, help="Trials per scene.")] = _DEFAULT.poses,
    rests: Rests = _DEFAULT.rests,
    layout: Annotated[
        str, typer.Option(help="Layout of a scene: single (only the target), packed, pile or bin.")
    ] = _DEFAULT.layout,
    per_scene: PerScene = _DEFAULT.objects_per_scene,
    spread: common.Spread = _DEFAULT.spread,
    views: Annotated[int, typer.Option(min=0, help="Cameras per scene.")] = _DEFAULT.views,
    replays: Replays = _DEFAULT.replays,
    shake: Annotated[bool, typer.Option("--shake", help="Shake every success on six axes with 2 g.")] = False,
    images: Annotated[bool, typer.Option("--images", help="Store the images of the cameras too.")] = False,
    image_size: Annotated[int, typer.Option(min=1, help="Rows and columns of stored images.")] = _DEFAULT.image_size[0],
    shard_trials: ShardTrials = _DEFAULT.shard_trials,
    hand: common.HandName = "reflex",
    split: common.Split = None,
    scale: common.Scale = 1.0,
    mass: common.Mass = None,
    seed: common.Seed = 0,
    workers: Workers = None,
    ray: Ray = False,
    resume: Annotated[bool, typer.Option(help="Continue the data set in the folder.")] = True,
    as_json: common.Json = False,
) -> None:
    """Try candidate poses on every object of a set and store each trial as a row of Parquet files.

    The exit status is 1 if some objects cannot be used.
    """
    object_set, loaded = common.find(objects, split, scale, mass), common.find_hand(hand)
    config = data.DatasetConfig(
        poses=poses,
        rests=rests,
        layout=layouts.scene_layout_named(layout),
        objects_per_scene=per_scene,
        spread=spread,
        views=views,
        seed=seed,
        replays=replays,
        trial=TrialConfig(shake=ShakeConfig() if shake else None),
        images=images,
        image_size=(image_size, image_size),
        shard_trials=shard_trials,
    )
    runner = _runner(ray, workers)
    reporter = _Reporter()
    report: Callable[[data.Progress], None] = reporter
    with reporter.bar:
        result = data.generate(
            object_set, out, hand=loaded, config=config, resume=resume, runner=runner, progress=report
        )
    if as_json:
        common.print_json(result.table())
    else:
        _print(result)
    common.end_with(result.manifest["refused"])
