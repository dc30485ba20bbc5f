"""The URDF of a hand for other programs: its own file, with visual and collision shapes and transmissions.

RViz and yourdfpy show visual shapes alone, simulators collide with collision shapes alone, and Drake makes actuators of
transmissions. The text of the file is kept: what it lacks is inserted.
"""

from __future__ import annotations

from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from graspbox.hands.description import HandDescription, independent

__all__ = ["hand_urdf"]

_TRANSMISSION = """\
  <transmission name={transmission}>
    <type>transmission_interface/SimpleTransmission</type>
    <joint name={joint}>
      <hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface>
    </joint>
    <actuator name={actuator}>
      <mechanicalReduction>1</mechanicalReduction>
    </actuator>
  </transmission>
"""


class _Places:
    """Places in the text of a URDF, in bytes, found by one pass of a parser."""

    def __init__(self, text: bytes) -> None:
        #: Where bytes, from and to, are replaced.
        self.edits: list[tuple[int, int, bytes]] = []
        self.has_transmissions = False
        #: Where the file ends but for the closing tag of its root.
        self.end = 0
        self._text, self._open = text, list[tuple[str, int]]()
        self._collisions: list[bytes] = []
        self._visible, self._mesh = False, ""
        self._collides, self._materials = False, list[tuple[int, int]]()
        #: Where visual shapes end, and these as collision shapes.
        self._copies: list[tuple[int, int, bytes]] = []
        parser = self._parser = expat.ParserCreate("utf-8")
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._stop
        parser.Parse(text, True)
        if not self._collides:
            # The core has used the visual shapes, too.
            self.edits += self._copies

    def _path(self) -> list[str]:
        return [tag for tag, _ in self._open][1:]

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._open.append((tag, self._parser.CurrentByteIndex))
        path = self._path()
        self.has_transmissions |= path == ["transmission"]
        if path == ["link"]:
            self._collisions, self._visible = [], False
        elif path == ["link", "visual"]:
            self._mesh, self._materials = "", []
        elif path == ["link", "visual", "geometry", "mesh"]:
            self._mesh = attributes.get("filename", "")

    def _stop(self, tag: str) -> None:
        path, at = self._path(), self._parser.CurrentByteIndex
        begin = self._open.pop()[1]
        # At the end of an empty element, <tag/>, the place is that of its beginning.
        after = self._text.index(b">", at) + 1
        if path == ["link", "collision"]:
            self._collisions.append(self._text[begin:after])
            self._collides = True
        elif path == ["link", "visual", "material"]:
            self._materials.append((begin, after))
        elif path == ["link", "visual"]:
            # Files beside the hand's own are not in the folder of the export.
            if self._mesh and "://" not in self._mesh and not self._mesh.startswith("/"):
                self.edits.append((begin, after, b""))
            else:
                self._visible = True
                self._copies.append((after, after, b"\n    " + self._as_collision(begin, after)))
        elif path == ["link"] and not self._visible and self._collisions:
            shapes = b"".join(b"  " + _as_visual(shape) + b"\n  " for shape in self._collisions)
            self.edits.append((at, at, shapes))
        elif not path:
            self.end = at

    def _as_collision(self, begin: int, end: int) -> bytes:
        """Return a visual shape as a collision shape, which has no colour."""
        shape = self._text[begin:end]
        for first, last in reversed(self._materials):
            shape = shape[: first - begin] + shape[last - begin :]
        shape = shape.replace(b"<visual", b"<collision", 1)
        return b"</collision".join(shape.rsplit(b"</visual", 1))


def _as_visual(collision: bytes) -> bytes:
    return collision.replace(b"<collision", b"<visual", 1).replace(b"</collision", b"</visual")


def hand_urdf(text: str, hand: HandDescription) -> str:
    """Return the URDF `text` of a hand with visual and collision shapes and transmissions.

    Links without visual shapes get their collision shapes, and so do those whose visual meshes are files named relative
    to the hand's. If no link has collision shapes, the visual ones, with which the core simulates the hand, become
    collision shapes, too. Joints that follow no other get a transmission, if there are none yet.
    """
    content = text.encode()
    places = _Places(content)
    edits = list(places.edits)
    if not places.has_transmissions:
        lines = [
            _TRANSMISSION.format(
                transmission=quoteattr(f"{link.joint}_transmission"),
                joint=quoteattr(link.joint),
                actuator=quoteattr(f"{link.joint}_motor"),
            )
            for link in independent(hand.links)
        ]
        edits.append((places.end, places.end, "".join(lines).encode()))
    for begin, end, new in sorted(edits, reverse=True):
        content = content[:begin] + new + content[end:]
    return content.decode()
