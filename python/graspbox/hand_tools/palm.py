"""Where a hand begins in the URDF of a robot: the palm is the link from which chains of joints branch."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from graspbox.errors import HandError

__all__ = ["Cut", "cut_above_palm", "without_blank_lines"]

#: A chain without branches and with at least so many independent joints is an arm with a jaw, not a finger.
_ARM = 4
#: Joints between two bodies from which chains branch, from which on the first one is no palm.
_WRIST = 3
#: Most links, as in the core.
_LINKS = 192
#: A tag; quoted values may have its last character.
_TAG = re.compile(rb"""<(?:[^>"']|"[^"]*"|'[^']*')*>""")
#: Most candidates that an error names.
_NAMED = 8


@dataclass(frozen=True)
class Cut:
    """A URDF without what is above the palm.

    Attributes
    ----------
    text : str
        Its content, blank where something was left out: every line has the number that it has in the file.
    base : str
        The link with which the hand begins.
    joints : tuple of str
        Joints above it that move, from the root on.
    links : int
        Number of links that were left out.
    """

    text: str
    base: str
    joints: tuple[str, ...]
    links: int


@dataclass
class _Link:
    """A link with the joint above it, and what hangs on it."""

    name: str
    shapes: bool
    joint: str = ""
    moves: bool = False
    follows: str = ""
    axis: tuple[float, ...] = (1.0, 0.0, 0.0)
    parent: str = ""
    children: list[str] = field(default_factory=list)


class _Tree:
    """The links of a URDF as a tree; rigid bodies are given by their first links.

    Raises ValueError for what is no tree, or too large.
    """

    def __init__(self, robot: ElementTree.Element) -> None:
        if len(robot.findall("link")) > _LINKS:
            raise ValueError("too many links")
        self.links = {
            name: _Link(name, link.find("collision") is not None or link.find("visual") is not None)
            for link in robot.findall("link")
            if (name := link.get("name")) is not None
        }
        for joint in robot.findall("joint"):
            parent, child = (_attribute(joint, kind, "link") for kind in ("parent", "child"))
            if parent not in self.links or child not in self.links or self.links[child].parent:
                raise ValueError("joints between other links than those of a tree")
            link = self.links[child]
            link.parent, link.joint = parent, joint.get("name", "")
            link.moves, link.follows = joint.get("type") != "fixed", _attribute(joint, "mimic", "joint")
            link.axis = _axis(joint)
            self.links[parent].children.append(child)
        roots = [name for name, link in self.links.items() if not link.parent]
        if len(roots) != 1 or len(self.under(roots[0])) < len(robot.findall("link")):
            raise ValueError("several roots, joints in a ring, or links with the same name")
        self.root = roots[0]

    def first(self, name: str) -> str:
        """Return the first link of the rigid body of a link."""
        seen = {name}
        while (link := self.links[name]).parent and not link.moves and link.parent not in seen:
            name = link.parent
            seen.add(name)
        return name

    def body(self, first: str) -> list[str]:
        """Return the links of a rigid body."""
        found = [first]
        for name in found:
            found += [child for child in self.links[name].children if not self.links[child].moves]
        return found

    def under(self, name: str) -> list[str]:
        """Return a link and all links that hang on it."""
        found = [name]
        for each in found:
            found += self.links[each].children
        return found

    def branches(self, first: str) -> list[str]:
        """Return the first links of the chains that leave a rigid body, move, and have something to touch with."""
        children = [child for name in self.body(first) for child in self.links[name].children]
        return [child for child in children if self.links[child].moves and any(map(self._solid, self.under(child)))]

    def _solid(self, name: str) -> bool:
        return self.links[name].shapes

    def independent(self, names: list[str]) -> list[_Link]:
        """Return the links among some whose joints move by themselves."""
        return [self.links[name] for name in names if self.links[name].moves and not self.links[name].follows]

    def above(self, first: str) -> Iterator[_Link]:
        """Give the links above a link and itself, from the root on, whose joints move."""
        names = [first]
        while self.links[names[-1]].parent:
            names.append(self.links[names[-1]].parent)
        return (self.links[name] for name in reversed(names) if self.links[name].moves)

    def palms(self, first: str) -> list[str]:
        """Return the bodies below one, or itself, from which chains branch that can close by themselves."""
        branches = self.branches(first)
        below = {branch: self.palms(branch) for branch in branches}
        deeper = [palm for palms in below.values() for palm in palms]
        # Fingers may share a joint, as on a bone of the palm; what hangs on more joints is an arm.
        plain = [branch for branch, palms in below.items() if not palms]
        own = len(list(self.above(first)))
        far = [palm for palm in deeper if len(list(self.above(palm))) - own >= _WRIST]
        if far or (deeper and not plain) or len(branches) < 2:
            return far or deeper
        return [first] if self.independent([name for branch in branches for name in self.under(branch)]) else []


def _attribute(joint: ElementTree.Element, tag: str, key: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get(key, "")


def _axis(joint: ElementTree.Element) -> tuple[float, ...]:
    axis = tuple(map(float, (_attribute(joint, "axis", "xyz") or "1 0 0").split()))
    if len(axis) != 3 or not np.isfinite(axis).all():
        raise ValueError("an axis has three finite numbers")
    return axis


def cut_above_palm(path: Path, text: str, base: str | None = None) -> Cut | None:
    """Cut off what is above the palm of a URDF, such as an arm or a wrist; None where the hand begins with its root.

    Parameters
    ----------
    path : Path
        Name of the file, for errors.
    text : str
        Its content. What is no tree of links is left to the core, whose errors name lines.
    base : str, optional
        A link of the palm. By default the palm is the rigid body from which at least two chains branch; without one, a
        chain of many joints is an arm that ends in a jaw.

    Raises
    ------
    HandError
        If there is no link `base`, or the URDF has several hands and no `base`.
    """
    try:
        robot = ElementTree.fromstring(text)
        if "<!ENTITY" in text:  # expanded, they have no lines of the file
            text = ElementTree.tostring(robot, encoding="unicode")
        tree = _Tree(robot)
    except (ElementTree.ParseError, ValueError):
        return None
    if base is not None and base not in tree.links:
        known = ", ".join(list(tree.links)[:_NAMED])
        raise HandError(f"{path}: there is no link {base!r}, the base of the hand; its links are {known}, ...")
    palm = tree.first(base) if base is not None else _palm(path, tree, tree.root)
    above = tuple(link.joint for link in tree.above(palm))
    kept = set(tree.under(palm))
    if not above:
        return None
    return Cut(_kept(path, text, robot, tree, kept), palm, above, len(tree.links) - len(kept))


def without_blank_lines(text: str) -> str:
    """Return a text without lines that are blank, such as those of a cut."""
    return "".join(f"{line.rstrip()}\n" for line in text.split("\n") if line.strip())


def _palm(path: Path, tree: _Tree, root: str) -> str:
    """Find the first link of the palm."""
    palms = tree.palms(root)
    if len(palms) > 1:
        named = ", ".join(palms[:_NAMED])
        raise HandError(f"{path} has several hands, which begin with {named}; name the palm of one with --base LINK")
    if palms:
        return palms[0]
    return _jaw_of_an_arm(tree, root) or root


def _jaw_of_an_arm(tree: _Tree, root: str) -> str | None:
    """Return the palm of an arm that ends in one jaw against a fixed one: the body before its last joint."""
    at, chain = root, [root]
    while branches := tree.branches(at):
        if len(branches) > 1:
            return None
        at = branches[0]
        chain.append(at)
    moving = tree.independent(chain)
    axes = np.array([link.axis for link in moving])
    bent = len(axes) > 2 and float(np.linalg.matrix_rank(axes, tol=1e-3)) > 1
    if len(moving) < _ARM and not bent:
        return None
    palm = tree.first(tree.links[moving[-1].name].parent)
    return palm if any(tree.links[name].shapes for name in tree.body(palm)) else None


def _kept(path: Path, text: str, robot: ElementTree.Element, tree: _Tree, kept: set[str]) -> str:
    """Write the URDF with some links only; every line keeps its number."""
    joints = {tree.links[name].joint for name in kept}
    palm = next(name for name in kept if tree.links[name].parent not in kept)
    joints.discard(tree.links[palm].joint)
    for name in kept - {palm}:
        if (leader := tree.links[name].follows) and leader not in joints:
            raise HandError(
                f"{path}: joint {tree.links[name].joint!r} follows {leader!r}, which is above the palm {palm!r}; make "
                "it fixed, or name another palm with --base LINK"
            )
    spans = _Spans(text)
    cut = bytearray(text.encode())
    for element, span, visuals in zip(robot, spans.elements, spans.visuals, strict=True):
        name = element.get("name", "")
        if not ((element.tag == "link" and name in kept) or (element.tag == "joint" and name in joints)):
            _blank(cut, span)
        elif element.find("collision") is not None:
            for visual in visuals:
                _blank(cut, visual)
    for comment in spans.comments:
        _blank(cut, comment)
    return cut.decode()


def _blank(content: bytearray, span: tuple[int, int]) -> None:
    """Overwrite a part of a text with spaces; its lines stay."""
    part = slice(*span)
    content[part] = re.sub(rb"[^\n]", b" ", content[part])


class _Spans:
    """First and last byte of the elements of a document's root, of visual shapes within them, and of the comments."""

    def __init__(self, text: str) -> None:
        self.elements: list[tuple[int, int]] = []
        #: By element.
        self.visuals: list[list[tuple[int, int]]] = []
        self.comments: list[tuple[int, int]] = []
        self._content, self._opened = text.encode(), list[int]()
        parser = self._parser = expat.ParserCreate("utf-8")
        parser.StartElementHandler, parser.EndElementHandler = self._begin, self._end
        parser.CommentHandler = self._comment
        parser.Parse(self._content, True)

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        del tag, attributes
        if len(self._opened) == 1:
            self.visuals.append([])
        self._opened.append(self._parser.CurrentByteIndex)

    def _end(self, tag: str) -> None:
        depth, start = len(self._opened), self._opened.pop()
        first = self._tag_at(start)
        span = start, first.end() if first[0].endswith(b"/>") else self._tag_at(self._parser.CurrentByteIndex).end()
        if depth == 2:
            self.elements.append(span)
        elif depth == 3 and tag == "visual":
            self.visuals[-1].append(span)

    def _tag_at(self, place: int) -> re.Match[bytes]:
        """Return the tag that begins at a place."""
        found = _TAG.match(self._content, place)
        assert found is not None
        return found

    def _comment(self, text: str) -> None:
        del text
        start = self._parser.CurrentByteIndex
        self.comments.append((start, self._content.index(b"-->", start) + 3))
