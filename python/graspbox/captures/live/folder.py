"""A folder into which a camera's program writes depth files, one after another."""

import os
import time
from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from graspbox.captures.cameras import read_camera
from graspbox.captures.capture import Capture
from graspbox.captures.files import DEPTH_SUFFIXES
from graspbox.captures.live.frames import Image, LiveSource, Settings
from graspbox.captures.reading import read_found
from graspbox.errors import FileError

__all__ = ["FolderSource"]

#: Ends of the names of images of labels and of masks, which are no depth, and the suffixes that are read beside depth.
_LABELS, _MASK, _BESIDE = "labels", "mask", (".png", ".npy")
#: Names of the camera's file, the first that exists.
_CAMERAS = [f"{name}.{kind}" for name in ("camera_info", "camera", "intrinsics") for kind in ("json", "yaml", "yml")]
#: Pause between two looks at the folder, seconds.
_PAUSE = 0.1


class _State(NamedTuple):
    """Modification time, nanoseconds, and size, bytes, of a file."""

    modified: int
    size: int


class FolderSource(LiveSource):
    """The depth files of a folder that grows, in the order of their modification, then of their names.

    A file is read once its size and time are the same in two looks, 0.1 s apart. It is read again when
    it changes. Hidden files and other suffixes are ignored. ``NAME_labels.png`` (or ``.npy``) beside ``NAME.png``
    holds its labels, ``NAME_mask.png`` a mask: write them before the image.

    Parameters
    ----------
    folder : Path
        The folder. For images without intrinsics, ``camera_info``, ``camera`` or ``intrinsics`` (``.json``, ``.yaml``,
        ``.yml``) in it states them.
    settings : Settings
        Settings of every source.
    new_only : bool
        Whether files that are there now are left out.

    Raises
    ------
    FileError
        If the folder cannot be listed.
    """

    def __init__(self, folder: Path, settings: Settings, new_only: bool = False) -> None:
        super().__init__(str(folder), settings)
        self._folder = folder
        self._before: dict[str, _State] = {}
        #: Files in the state in which they were read, or could not be read. Deleted ones are forgotten.
        self._done: dict[str, _State] = self._listed() if new_only else {}

    def _images(self) -> Generator[Image, None, None]:
        while True:
            for name, state in self._complete():
                yield Image(state.modified / 1e9, 0, partial(self._read, name, state))
            left = self._left()
            if left <= 0.0:
                return
            time.sleep(min(_PAUSE, left))

    def _complete(self) -> list[tuple[str, _State]]:
        """Return the files that are new and do not grow any more."""
        now = self._listed()
        self._done = {name: state for name, state in self._done.items() if name in now}
        due = [
            (name, state)
            for name, state in now.items()
            if state.size and self._before.get(name) == state and self._done.get(name) != state
        ]
        self._before = now
        return sorted(due, key=lambda item: (item[1].modified, item[0]))

    def _listed(self) -> dict[str, _State]:
        """Return the depth files of the folder."""
        found = {}
        try:
            with os.scandir(self._folder) as entries:
                for entry in entries:
                    if _is_depth(entry.name) and (state := _state(entry)) is not None:
                        found[entry.name] = state
        except OSError as error:
            raise FileError(error.errno, error.strerror, str(self._folder)) from None
        return found

    def _read(self, name: str, state: _State) -> Capture:
        path = self._folder / name
        self._done[name] = state
        found, given = read_found(path), self._settings.camera(name)
        if given is None and found.camera is None and found.points is None:
            file = next((file for one in _CAMERAS if (file := self._folder / one).is_file()), None)
            given = None if file is None else read_camera(file, name)
        labels = _beside(path, _LABELS)
        mask = _beside(path, _MASK) if labels is None else None
        return self._settings.capture(found, given, mask, labels)


def _is_depth(name: str) -> bool:
    stem, suffix = os.path.splitext(name)
    marks = any(stem == end or stem.endswith(f"_{end}") for end in (_LABELS, _MASK))
    return suffix.lower() in DEPTH_SUFFIXES and not name.startswith(".") and not marks


def _state(entry: os.DirEntry[str]) -> _State | None:
    """Return the state of a file; None if it is none, or is gone."""
    try:
        status = entry.stat()
        return _State(status.st_mtime_ns, status.st_size) if entry.is_file() else None
    except OSError:
        return None


def _beside(path: Path, end: str) -> Path | None:
    return next((one for kind in _BESIDE if (one := path.with_name(f"{path.stem}_{end}{kind}")).is_file()), None)
