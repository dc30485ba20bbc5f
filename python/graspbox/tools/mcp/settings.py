"""Settings of a server of tools, and its limits."""

from dataclasses import dataclass
from pathlib import Path

from graspbox._common.arguments import check_range
from graspbox.errors import ConfigError, FileError
from graspbox.hands import Hand

__all__ = ["MAX_BYTES", "MAX_GRASPS", "MAX_PIXELS", "MAX_SIDE", "ToolSettings"]

#: Most grasps of a call, of its answer and of its simulation.
MAX_GRASPS = 100
#: Longest side of a picture that an agent requests, pixels.
MAX_SIDE = 1024
#: Largest file, and recording of several, that is read, bytes.
MAX_BYTES = 64 << 20
#: Most pixels of a depth image: as many as a camera of 4096 x 3072 has.
MAX_PIXELS = 4096 * 3072


@dataclass(frozen=True)
class ToolSettings:
    """Offer and limits of a server of tools.

    Attributes
    ----------
    folder : Path
        Folder whose mesh files, depth images and recordings agents may name; nothing else of the machine can be read.
    objects : tuple of str
        Object sets that agents may name: ``SET`` allows the set and its parts, ``NAME=SET`` offers it under another
        name, as in `graspbox.tools.remote.ServerSettings`.
    hands : tuple of str
        Hands that agents may name; the first is the default.
    policy : str or None
        Folder of a published policy of one depth image, or ``hf://owner/name``; without one there is no tool
        ``grasp_image``.
    time_limit : float
        Seconds after which a call is ended, 1 to 3600.
    threads : int or None
        Threads that plan and simulate; all by default. Results do not depend on it.
    """

    folder: Path
    objects: tuple[str, ...] = ("procedural",)
    hands: tuple[str, ...] = tuple(Hand.names())
    policy: str | None = None
    time_limit: float = 120.0
    threads: int | None = None

    def __post_init__(self) -> None:
        check_range(self, "time_limit", 1.0, 3600.0)
        if not self.hands:
            raise ConfigError("hands is empty; name the hands that agents may use")
        for hand in self.hands:
            if hand not in Hand.names():
                raise ConfigError(f"hands has {hand!r}; choose from {', '.join(Hand.names())}")
        if not Path(self.folder).is_dir():
            raise FileError(20, "there is no such folder for the tools to read", str(self.folder))
        # Links in the folder's own path are the user's; those in it are resolved when a file is named.
        object.__setattr__(self, "folder", Path(self.folder).resolve())
