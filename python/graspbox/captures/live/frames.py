"""What every live source shares: its frames, its settings, and the loop that skips images that cannot be read."""

import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.captures.capture import Camera, Capture, Found
from graspbox.captures.reading import PathLike, capture_of, given_camera
from graspbox.errors import ConfigError, FileError, MissingExtraError
from graspbox.perception.real import DepthKind

__all__ = ["Frame", "Image", "LiveSource", "Settings", "needed"]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Frame:
    """An image of a live source.

    Attributes
    ----------
    capture : Capture
        The depth image.
    time : float
        Seconds of the source's clock: modification time of a file, timestamp of the camera or of the message.
    index : int
        Number of the image in the source, from 0; images that were skipped count.
    skipped : int
        How many images since the last frame could not be read, or came while you were busy.
    """

    capture: Capture
    time: float
    index: int
    skipped: int


class Image(NamedTuple):
    """An image that a source has, before it is read: its time, the images missed before it, and how it is read."""

    time: float
    missed: int
    read: Callable[[], Capture]


@dataclass(frozen=True)
class Settings:
    """Settings of every source, as of `graspbox.captures.open_camera`."""

    intrinsics: ArrayLike | PathLike | None = None
    depth_scale: float | None = None
    depth_is: DepthKind = "z"
    limits: tuple[float, float] | None = None
    seconds: float | None = None
    timeout: float = 5.0

    def camera(self, image: str = "") -> Camera | None:
        """Return the camera of the argument `intrinsics`, for an image of a name; errors as of `read_capture`."""
        return given_camera(self.intrinsics, Path(image))

    def capture(
        self,
        found: Found,
        given: Camera | None,
        mask: PathLike | None = None,
        labels: NDArray[np.integer] | PathLike | None = None,
    ) -> Capture:
        """Convert what a source found; errors as of `read_capture`."""
        values: dict[str, Any] = {"depth_scale": self.depth_scale, "depth_is": self.depth_is, "limits": self.limits}
        return capture_of(found, given, mask=mask, labels=labels, **values)


class LiveSource(ABC):
    """A source of depth images, one after another: iterate over its `Frame`, and close it, or use it in ``with``.

    An image that cannot be read is skipped with a warning of `logging`.

    Attributes
    ----------
    name : str
        The source, for people.
    skipped : int
        Images that were skipped so far.
    refusal : str
        Why the last image that could not be read was skipped; empty if none was.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self.name, self.skipped, self.refusal = name, 0, ""
        self._settings, self._end, self._closed = settings, math.inf, False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the iteration, and give the camera back."""
        self._closed = True

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over the frames, until the source or the given time ends.

        Raises
        ------
        ConnectionLostError
            If a camera or a topic sends nothing any more.
        ConfigError, FileError, MissingExtraError
            If the whole source cannot be read, or a package is missing.
        """
        if self._settings.seconds is not None:
            self._end = time.monotonic() + self._settings.seconds
        index, before = -1, self.skipped
        with closing(self._images()) as images:
            for image in images:
                index, self.skipped = index + image.missed + 1, self.skipped + image.missed
                try:
                    capture = image.read()
                except (ConfigError, FileError, OSError) as error:  # such as a file that is gone
                    self.refusal, self.skipped = str(error), self.skipped + 1
                    _LOG.warning("an image of %s is skipped: %s", self.name, error)
                else:
                    skipped, before = self.skipped - before, self.skipped
                    yield Frame(capture, image.time, index, skipped)
                if self._left() <= 0.0:
                    return

    @abstractmethod
    def _images(self) -> Generator[Image, None, None]:
        """Iterate over the images; each is read before the next one is taken."""

    def _left(self) -> float:
        """Return the seconds that are left; infinite if no end is given."""
        return 0.0 if self._closed else self._end - time.monotonic()


def needed(module: str, what: str, advice: str) -> Any:
    """Import a module that no extra of graspbox installs; a `MissingExtraError` gives the advice."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(f"{what} needs {module.partition('.')[0]} ({error}): {advice}") from None
