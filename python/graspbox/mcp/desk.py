"""Objects, files and hands that an agent names: nothing outside the folder and the offer of the server."""

from pathlib import Path, PurePath

from graspbox.errors import ConfigError, FileError, ObjectSetError
from graspbox.mcp.arguments import ObjectArguments
from graspbox.mcp.settings import MAX_BYTES, ToolSettings
from graspbox.object_sets import ObjectSpec, load
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES
from graspbox.remote.offer import Offer

__all__ = ["DEPTH_SUFFIXES", "Desk"]

#: Supported suffixes of depth images.
DEPTH_SUFFIXES = frozenset({".npy", ".png"})
#: Names that an error lists, and entries of the folder that are read to find them.
_LISTED, _READ = 20, 1000


class Desk:
    """Objects, files and hands that an agent may name.

    Parameters
    ----------
    settings : ToolSettings
        The offer of the server.

    Raises
    ------
    ConfigError, ObjectSetError
        If an object set does not exist, or is a path without a name.
    """

    def __init__(self, settings: ToolSettings) -> None:
        self.settings = settings
        self._offer = Offer(settings.objects, settings.hands)

    def file(self, name: str, suffixes: frozenset[str], kind: str) -> Path:
        """Find a file of the folder; links are followed, unless they lead out of it.

        Parameters
        ----------
        name : str
            Path, relative to the folder.
        suffixes : frozenset of str
            The suffixes that the file may have.
        kind : str
            Describes the file in errors.

        Raises
        ------
        ConfigError
            If the path leads out of the folder, or has another suffix.
        FileError
            If there is no such regular file, or it is too large.
        """
        folder = self.settings.folder
        try:
            path = (folder / name).resolve()
        except (OSError, RuntimeError, ValueError):  # a loop of links, a name that is too long, a NUL
            raise ConfigError(f"{name[:100]!r} is no path of a {kind}") from None
        if not path.is_relative_to(folder):
            raise ConfigError(f"{name[:100]!r} leads out of the folder of this server; name a {kind} in it")
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
        if size > MAX_BYTES:
            raise FileError(27, f"it has {size} bytes; this server reads at most {MAX_BYTES}", name[:100])
        return path

    def _listed(self, suffixes: frozenset[str]) -> str:
        """Name files of the folder, for an error."""
        names = []
        for count, entry in enumerate(self.settings.folder.iterdir()):
            if count == _READ:
                break
            if entry.suffix.lower() in suffixes and entry.is_file():
                names.append(entry.name)
        return f"; the folder has {', '.join(sorted(names)[:_LISTED])}" if names else ""

    def object(self, arguments: ObjectArguments) -> ObjectSpec:
        """Find the one object that a call names.

        Raises
        ------
        ObjectSetError
            If the set is not offered, or has several objects, none of which is named.
        ConfigError, FileError
            As `file`.
        """
        source = arguments.object
        # A set has no suffix, except where the server gave it such a name.
        if source not in self._offer.names and PurePath(source).suffix.lower() in MESH_SUFFIXES:
            path = self.file(source, MESH_SUFFIXES, "mesh file")
            return load(path, scale=arguments.scale, mass=arguments.mass)[0]
        found = self._offer.find(source, arguments.scale, arguments.mass)
        named = [spec for spec in found if arguments.name in (None, spec.name)]
        if len(named) == 1:
            return named[0]
        names = ", ".join(found.names[:_LISTED])
        if arguments.name is not None:
            raise ObjectSetError(f"{source!r} has no object {arguments.name[:100]!r}; it has {names}")
        raise ObjectSetError(f"{source!r} has {len(found)} objects; give the name of one, such as {names}")

    def hand(self, name: str | None) -> str:
        """Check the name of a hand; the first that is offered by default.

        Raises
        ------
        ConfigError
            If it is not offered.
        """
        hands = self.settings.hands
        if name is not None and name not in hands:
            raise ConfigError(f"this server does not offer the hand {name[:100]!r}; choose from {', '.join(hands)}")
        return name or hands[0]
