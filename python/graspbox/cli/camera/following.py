"""The loop over the frames of a camera: a line of JSON and a line for people each, and a summary at the end."""

import json
import statistics
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from graspbox._common.files import check_output
from graspbox.captures import Frame, LiveSource
from graspbox.cli.camera.grasping import Answer, Grasping
from graspbox.cli.common import console
from graspbox.errors import ConfigError, FileError, GraspboxError, InternalError
from graspbox.policies.grasp_image import ImageGrasps

__all__ = ["Summary", "follow", "lines_into"]

#: Most times of which the summary gives the median, the last ones; most warnings that are printed.
_TIMES, _WARNINGS = 10_000, 20


@dataclass
class Summary:
    """What became of the frames.

    Attributes
    ----------
    answered, refused, skipped : int
        Frames with an answer, frames that the policy refused, and images without a frame.
    grasped : int
        Frames with a grasp.
    times : deque of float
        Seconds of the last answers.
    failure : GraspboxError, optional
        The error that ended the stream.
    interrupted : bool
        Whether Ctrl-C ended it.
    """

    answered: int = 0
    refused: int = 0
    skipped: int = 0
    grasped: int = 0
    times: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES))
    failure: GraspboxError | None = None
    interrupted: bool = False

    @property
    def frames(self) -> int:
        """Count the frames."""
        return self.answered + self.refused

    def __str__(self) -> str:
        """Return a line for people."""
        median = f", median {1e3 * statistics.median(self.times):.0f} ms" if self.times else ""
        return (
            f"{self.frames} frames: {self.answered} answered ({self.grasped} with a grasp), {self.refused} refused; "
            f"{self.skipped} images skipped{median}"
        )


@contextmanager
def lines_into(out: Path | None, as_json: bool) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Open the outputs of JSON lines, the end of a file and standard output; each line is there at once."""
    outputs: list[TextIO] = [sys.stdout] if as_json else []
    if out is None:
        yield lambda value: _write(outputs, value)
        return
    try:
        file = check_output(out).open("a", encoding="utf-8")
    except OSError as error:
        raise FileError(error.errno, error.strerror, str(out)) from None
    with file:
        yield lambda value: _write([*outputs, file], value)


def _write(outputs: list[TextIO], value: dict[str, Any]) -> None:
    for output in outputs:
        output.write(json.dumps(value, allow_nan=False) + "\n")
        output.flush()


def follow(
    source: LiveSource,
    grasping: Grasping,
    write: Callable[[dict[str, Any]], None],
    frames: int | None,
    record: Callable[[ImageGrasps, float], None] | None = None,
) -> Summary:
    """Find the grasps of each frame until the source ends, Ctrl-C, or `frames` frames.

    Parameters
    ----------
    source : LiveSource
        The source.
    grasping : Grasping
        Finds the grasps; a frame that it refuses is told, and the stream goes on.
    write : callable
        Takes the JSON of each frame.
    frames : int, optional
        Most frames.
    record : callable, optional
        Takes the grasps of each frame, and its time since the first one, seconds.
    """
    summary, warned = Summary(), set[str]()
    start: float | None = None
    try:
        for frame in source:
            start = frame.time if start is None else start
            answer = _answer(frame, grasping, write, summary)
            if answer is not None:
                _warn(answer, warned)
                if record is not None and answer.grasps is not None:
                    record(answer.grasps, frame.time - start)
            if summary.frames == frames:
                break
    except KeyboardInterrupt:
        summary.interrupted = True
    except InternalError:
        raise
    except GraspboxError as error:
        summary.failure = error
    summary.skipped = source.skipped
    console.print(str(summary), soft_wrap=True)
    return summary


def _answer(
    frame: Frame, grasping: Grasping, write: Callable[[dict[str, Any]], None], summary: Summary
) -> Answer | None:
    """Find and write the grasps of a frame; return None if it is refused."""
    line = {"frame": frame.index, "time": frame.time, "source": frame.capture.source}
    began = time.perf_counter()
    try:
        answer = grasping(frame.capture)
    except ConfigError as error:
        summary.refused += 1
        write({**line, "seconds": time.perf_counter() - began, "skipped": frame.skipped, "refused": str(error)})
        console.print(f"frame {frame.index}: refused: {error}", style="yellow", soft_wrap=True)
        return None
    seconds = time.perf_counter() - began
    summary.answered += 1
    summary.grasped += answer.count > 0
    summary.times.append(seconds)
    write({**line, "seconds": seconds, "skipped": frame.skipped, **answer.told})
    found = "no grasp"
    if answer.best is not None:
        place = " ".join(f"{x:.3f}" for x in answer.best.position)
        found = f"{answer.count} grasps, the best at {place} m, success {answer.best.success:.0%}"
    console.print(f"frame {frame.index}: {found}, {1e3 * seconds:.0f} ms", soft_wrap=True)
    return answer


def _warn(answer: Answer, warned: set[str]) -> None:
    """Print each warning of frames once, and not too many."""
    for warning in answer.told["warnings"]:
        if warning not in warned and len(warned) < _WARNINGS:
            warned.add(warning)
            console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
