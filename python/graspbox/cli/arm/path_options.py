"""Options of the commands that plan paths of an arm, and what they say and write."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from graspbox.arms import Trajectory
from graspbox.arms.trajectories import FORMATS
from graspbox.cli.common import check_files, console
from graspbox.errors import ConfigError
from graspbox.hands.loading import AssumedWarning

__all__ = ["PathOptions", "check_path_file", "save_path", "told_assumptions"]


@dataclass(frozen=True)
class PathOptions:
    """How a path is timed, and where it puts the object."""

    place: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y YAW", help="Place the object so far from where it is: metres, and degrees about z."),
    ] = None
    speed: Annotated[float, typer.Option(min=0.001, max=1.0, help="Share of the arm's speeds.")] = 1.0
    hand_time: Annotated[float, typer.Option(min=0.0, help="Seconds for the hand to close, and to open.")] = 1.0
    max_duration: Annotated[float | None, typer.Option(help="Refuse a longer path, seconds.")] = None
    hz: Annotated[float, typer.Option(min=0.1, max=10_000.0, help="Samples of the path per second.")] = 100.0
    prefix: Annotated[str, typer.Option(help="Put before the names of the joints in the file, such as fr3_.")] = ""

    def timing(self) -> dict[str, Any]:
        """Return arguments of `graspbox.arms.plan_path`."""
        return {name: getattr(self, name) for name in ("speed", "hand_time", "max_duration", "hz")}

    def moved(self) -> tuple[float, float, float] | None:
        """Return how the object is moved, metres, and turned about z, rad."""
        return None if self.place is None else (*self.place[:2], float(np.radians(self.place[2])))


def check_path_file(option: str, path: Path | None) -> None:
    """Raise ConfigError for a file that cannot be written, or in no format of trajectories."""
    check_files(path)
    if path is not None and path.suffix.lower() not in FORMATS:
        raise ConfigError(f"{option} {str(path)!r} has none of the suffixes {', '.join(FORMATS)}")


@contextmanager
def told_assumptions() -> Iterator[None]:
    """Print on standard error what is assumed of an arm's files."""
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", AssumedWarning)
            yield
    finally:
        for message in dict.fromkeys(str(warning.message) for warning in caught):
            console.print(f"warning: {message}", style="yellow", soft_wrap=True)


def save_path(path: Trajectory, file: Path, following: PathOptions) -> None:
    """Write a trajectory, and say so."""
    path.prefixed(following.prefix).save(file)
    console.print(f"wrote {file}")
