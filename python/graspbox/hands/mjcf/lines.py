"""Files and lines of an MJCF file's elements, which a compiled model does not have."""

from pathlib import Path
from xml.parsers import expat

__all__ = ["Lines"]

#: Most files that are read, and largest of each, bytes; elements of others have no line.
_MOST_FILES, _LARGEST = 64, 8 << 20
#: Sections whose elements have one kind, whatever their tags.
_SECTIONS = ("equality", "tendon", "actuator")


class Lines:
    """Places of the named elements of an MJCF file, and of the files that it includes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._places: dict[tuple[str, str], str] = {}
        #: Whether a ``<compiler>`` states the unit of angles.
        self.states_angle = False
        self._files = {path}
        self._read(path)

    def of(self, kind: str, name: str, *others: tuple[str, str]) -> str:
        """Return ``FILE:LINE`` of an element, else that of the first other one that has a line, else the file."""
        found = (self._places.get(key) for key in ((kind, name), *others))
        return next((place for place in found if place is not None), str(self._path))

    def _read(self, path: Path) -> None:
        parser, stack = expat.ParserCreate(), list[str]()

        def start(tag: str, attributes: dict[str, str]) -> None:
            if tag == "include" and "file" in attributes:
                self._include(attributes["file"], path)
            self.states_angle |= tag == "compiler" and "angle" in attributes
            section = stack[1] if len(stack) > 1 else ""
            kind = section if section in _SECTIONS else "joint" if tag == "freejoint" else tag
            if "name" in attributes and "default" not in stack:
                self._places.setdefault((kind, attributes["name"]), f"{path}:{parser.CurrentLineNumber}")
            stack.append(tag)

        def end(_: str) -> None:
            stack.pop()

        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            with path.open("rb") as file:
                content = file.read(_LARGEST + 1)
            if len(content) <= _LARGEST:
                parser.Parse(content, True)
        except (OSError, ValueError, expat.ExpatError):
            # MuJoCo has read the file; what its reader takes and this one does not has no line.
            return

    def _include(self, name: str, path: Path) -> None:
        """Read an included file, which is named from the folder of the main file or of the one that includes it."""
        for folder in (self._path.parent, path.parent):
            file = folder / name
            if file not in self._files and len(self._files) < _MOST_FILES and file.is_file():
                self._files.add(file)
                self._read(file)
                return
