"""The URDF of a hand for other programs: its own file, with visual shapes and transmissions.

RViz and yourdfpy show visual shapes alone, and Drake makes actuators of transmissions. The text of the file is kept:
what it lacks is inserted.
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
        parser = self._parser = expat.ParserCreate("utf-8")
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._stop
        parser.Parse(text, True)

    def _path(self) -> list[str]:
        return [tag for tag, _ in self._open][1:]

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._open.append((tag, self._parser.CurrentByteIndex))
        path = self._path()
        self.has_transmissions |= path == ["transmission"]
        if path == ["link"]:
            self._collisions, self._visible = [], False
        elif path == ["link", "visual"]:
            self._mesh = ""
        elif path == ["link", "visual", "geometry", "mesh"]:
            self._mesh = attributes.get("filename", "")

    def _stop(self, tag: str) -> None:
        path, at = self._path(), self._parser.CurrentByteIndex
        begin = self._open.pop()[1]
        # At the end of an empty element, <tag/>, the place is that of its beginning.
        after = self._text.index(b">", at) + 1
        if path == ["link", "collision"]:
            self._collisions.append(self._text[begin:after])
        elif path == ["link", "visual"]:
            # Files beside the hand's own are not in the folder of the export.
            if self._mesh and "://" not in self._mesh and not self._mesh.startswith("/"):
                self.edits.append((begin, after, b""))
            else:
                self._visible = True
        elif path == ["link"] and not self._visible and self._collisions:
            shapes = b"".join(b"  " + _as_visual(shape) + b"\n  " for shape in self._collisions)
            self.edits.append((at, at, shapes))
        elif not path:
            self.end = at


def _as_visual(collision: bytes) -> bytes:
    return collision.replace(b"<collision", b"<visual", 1).replace(b"</collision", b"</visual")


def hand_urdf(text: str, hand: HandDescription) -> str:
    """Return the URDF `text` of a hand with visual shapes and transmissions.

    Links without visual shapes get their collision shapes, and so do those whose visual meshes are files named relative
    to the hand's. Joints that follow no other get a transmission, if there are none yet.
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
