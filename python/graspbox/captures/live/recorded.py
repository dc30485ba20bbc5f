"""A recording, played image by image as fast as it is read."""

from collections.abc import Callable, Generator
from contextlib import closing
from functools import partial
from pathlib import Path

from graspbox.captures.capture import Capture, Found
from graspbox.captures.live.frames import Image, LiveSource, Settings
from graspbox.captures.recordings import recorded_images

__all__ = ["RecordedSource"]


class RecordedSource(LiveSource):
    """All images of a topic of a recording; `Frame.index` is their number, as of `graspbox.captures.read_capture`.

    Parameters
    ----------
    path : Path
        The recording.
    settings : Settings
        Settings of every source.
    topic : str, optional
        The topic; by default the only one with depth.

    Raises
    ------
    ConfigError
        If the intrinsics are wrong.
    """

    def __init__(self, path: Path, settings: Settings, topic: str | None = None) -> None:
        super().__init__(str(path), settings)
        self._path, self._topic, self._given = path, topic, settings.camera()

    def _images(self) -> Generator[Image, None, None]:
        with closing(recorded_images(self._path, self._topic, self._settings.depth_scale)) as images:
            for time, decoded in images:
                yield Image(time, 0, partial(self._read, decoded))

    def _read(self, decoded: Callable[[], Found]) -> Capture:
        return self._settings.capture(decoded(), self._given)
