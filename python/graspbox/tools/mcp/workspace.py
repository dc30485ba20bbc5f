"""Objects, files and hands that an agent names: nothing outside the folder and the offer of the server."""

from collections.abc import Collection
from pathlib import Path, PurePath

from graspbox.captures.files import DEPTH_SUFFIXES, RECORDING_SUFFIXES
from graspbox.errors import ConfigError, FileError, ObjectSetError
from graspbox.object_sets import ObjectSpec, load
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES
from graspbox.tools.mcp.arguments import ObjectArguments
from graspbox.tools.mcp.settings import MAX_BYTES, ToolSettings
from graspbox.tools.remote.catalog import Catalog

__all__ = ["CAMERA_SUFFIXES", "CAPTURE_SUFFIXES", "MARK_SUFFIXES", "Workspace"]

#: Suffixes of depth images, clouds and recordings; a recording may also be a folder.
CAPTURE_SUFFIXES = DEPTH_SUFFIXES | RECORDING_SUFFIXES
#: Suffixes of intrinsics, and of masks and labels.
CAMERA_SUFFIXES = frozenset({".json", ".yaml", ".yml", ".npy", ".txt"})
MARK_SUFFIXES = frozenset({".npy", ".png"})
#: Names that an error lists, and entries of the folder that are read to find them.
_LISTED, _READ = 20, 1000


class Workspace:
    """Objects, files and hands that an agent may name; object sets that do not exist are errors."""

    def __init__(self, settings: ToolSettings) -> None:
        self.settings = settings
        self._catalog = Catalog(settings.objects, settings.hands)

    def file(self, name: str, suffixes: Collection[str], kind: str) -> Path:
        """Find a file by its path relative to the folder; links are followed, unless they lead out of it.

        `kind` describes a file with one of the `suffixes` in errors.

        Raises
        ------
        ConfigError
            If the path leads out of the folder, or has another suffix.
        FileError
            If there is no such regular file, or it is too large.
        """
        path = self._inside(name, kind)
        if path.suffix.lower() not in suffixes:
            choices = ", ".join(sorted(suffixes))
            raise ConfigError(f"{name[:100]!r} is no {kind}; the file's name must end in {choices}")
        try:
            if not path.is_file():
                raise FileError(2, f"there is no such {kind}{self._listed(suffixes)}", name[:100])
            size = path.stat().st_size
        except (OSError, ValueError) as error:
            if isinstance(error, FileError):
                raise
            raise ConfigError(f"{name[:100]!r} is no path of a {kind}") from None
        _check_bytes(size, name)
        return path

    def capture(self, name: str) -> Path:
        """Find a depth image, a cloud or a recording; the files of a recording's folder are checked too.

        Raises as `file`.
        """
        path = self._inside(name, "depth image")
        if not path.is_dir():
            return self.file(name, CAPTURE_SUFFIXES, "depth image")
        size = 0
        try:
            for count, entry in enumerate(path.iterdir()):
                if count == _READ:
                    raise ConfigError(f"{name[:100]!r} has more than {_READ} files; name the folder of one recording")
                held = self._inside(f"{name}/{entry.name}", "recording")
                size += held.stat().st_size if held.is_file() else 0
        except OSError:
            raise ConfigError(f"{name[:100]!r} is no path of a recording") from None
        _check_bytes(size, name)
        return path

    def _inside(self, name: str, kind: str) -> Path:
        """Resolve a path relative to the folder; refuse one that leads out of it."""
        folder = self.settings.folder
        try:
            path = (folder / name).resolve()
        except (OSError, RuntimeError, ValueError):  # a loop of links, a name that is too long, a NUL
            raise ConfigError(f"{name[:100]!r} is no path of a {kind}") from None
        if not path.is_relative_to(folder):
            raise ConfigError(f"{name[:100]!r} leads out of the folder of this server; name a {kind} in it")
        return path

    def _listed(self, suffixes: Collection[str]) -> str:
        """List files of the folder, for an error."""
        names = []
        for count, entry in enumerate(self.settings.folder.iterdir()):
            if count == _READ:
                break
            if entry.suffix.lower() in suffixes and entry.is_file():
                names.append(entry.name)
        return f"; the folder has {', '.join(sorted(names)[:_LISTED])}" if names else ""

    def object(self, arguments: ObjectArguments) -> ObjectSpec:
        """Load the object that a call names; refuse sets that are not offered, and several objects."""
        source = arguments.object
        # A set has no suffix, except where the server gave it such a name.
        if source not in self._catalog.names and PurePath(source).suffix.lower() in MESH_SUFFIXES:
            path = self.file(source, MESH_SUFFIXES, "mesh file")
            return load(path, scale=arguments.scale, mass=arguments.mass)[0]
        objects = self._catalog.find(source, arguments.scale, arguments.mass)
        named = [spec for spec in objects if arguments.name in (None, spec.name)]
        if len(named) == 1:
            return named[0]
        names = ", ".join(objects.names[:_LISTED])
        if arguments.name is not None:
            raise ObjectSetError(f"{source!r} has no object {arguments.name[:100]!r}; it has {names}")
        raise ObjectSetError(f"{source!r} has {len(objects)} objects; give the name of one, such as {names}")

    def hand(self, name: str | None) -> str:
        """Return the name of an offered hand, by default the first; refuse others."""
        return self._catalog.hand(name or self._catalog.hands[0])


def _check_bytes(size: int, name: str) -> None:
    if size > MAX_BYTES:
        raise FileError(27, f"it has {size} bytes; this server reads at most {MAX_BYTES}", name[:100])
