"""The catalog of a server: object sets and hands that clients may name.

A client names an offered set, a part of one, or the name that the server gave to one. Paths are refused.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from graspbox import object_sets
from graspbox._common.arguments import shown
from graspbox._core import Arm
from graspbox.errors import ConfigError, ObjectSetError
from graspbox.object_sets import ObjectSet
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES

__all__ = ["MAX_OBJECTS", "Catalog"]

#: Sets that need no path.
_SETS = ("procedural", "ycb")
#: Most objects of the environments of a session.
MAX_OBJECTS = 100_000


@dataclass(frozen=True)
class _Procedural:
    """An offered procedural set: its families, and the seeds of each; None allows any seed."""

    families: frozenset[str]
    seeds: range | None

    def covers(self, family: str, seeds: range) -> bool:
        own = self.seeds
        return family in self.families and (own is None or (seeds[0] in own and seeds[-1] in own))


class Catalog:
    """Object sets and hands that clients may name, as in `graspbox.tools.remote.ServerSettings`; checks the names."""

    def __init__(self, objects: Sequence[str], hands: Sequence[str]) -> None:
        self.hands = tuple(hands)
        #: Names of the object sets, as clients see them.
        self.names: list[str] = []
        self._aliases: dict[str, str] = {}
        self._procedural: list[_Procedural] = []
        self._ycb: set[str] = set()
        for text in objects:
            try:
                self._add(text)
            except ObjectSetError as error:
                raise ObjectSetError(f"objects has {text!r}: {error}") from None
            self.names.append(text.partition("=")[0])

    def _add(self, text: str) -> None:
        name, equals, target = text.partition("=")
        kind, _, rest = text.partition(":")
        if equals:
            if not name or name in self._aliases or name.partition(":")[0] in _SETS:
                raise ConfigError(f"objects has {text!r}; write NAME=SET, with a unique name")
            object_sets.load(target)
            self._aliases[name] = target
        elif kind == "procedural":
            families, seeds = object_sets.families_and_seeds(rest, text)
            # No family begins with a digit; without a range of seeds every seed is allowed.
            ranged = rest.rpartition(":")[2][:1].isdigit()
            self._procedural.append(_Procedural(frozenset(families), seeds if ranged else None))
        elif kind == "ycb":
            self._ycb |= set(object_sets.load(text).names)
        elif kind == "dir" or "/" in text or Path(text).suffix.lower() in MESH_SUFFIXES or Path(text).exists():
            raise ConfigError(f"objects has {text!r}; clients name no path, so give it a name: tools={text}")
        else:
            near = get_close_matches(kind.lower(), _SETS, n=1)
            hint = f"did you mean {near[0] + text[len(kind) :]!r}?" if near else "choose procedural, ycb or NAME=SET"
            raise ConfigError(f"objects has {text!r}, which names no object set; {hint}")

    def hand(self, name: Any) -> str:
        """Return the name of an offered hand; a `ConfigError` refuses others."""
        if name not in self.hands:
            known = ", ".join(self.hands)
            raise ConfigError(f"this server does not offer the hand {shown(name)}; choose from {known}")
        return str(name)

    def arm(self, name: Any) -> None:
        """Refuse an arm other than those of the package, by a `ConfigError`."""
        if name is not None and name not in Arm.names():
            known = ", ".join(Arm.names())
            raise ConfigError(f"a server does not offer the arm {shown(name)}; choose from {known}")

    def find(self, objects: Any, scale: float = 1.0, mass: float | None = None) -> ObjectSet:
        """Load the objects that a client names; an `ObjectSetError` refuses sets that are not offered, and too many."""
        names: list[str] = [objects] if isinstance(objects, str) else objects
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ObjectSetError(f"objects is {shown(objects)}; give names of object sets")
        # The work below grows with the number of names, and other clients wait for it.
        if len(names) > MAX_OBJECTS:
            raise ObjectSetError(f"objects has {len(names)} names; this server allows at most {MAX_OBJECTS} objects")
        self._check_count(names)
        selected = object_sets.load([self._aliases.get(name, name) for name in names], scale=scale, mass=mass)
        # Errors show the client's own names instead of local folders.
        return replace(selected, name=",".join(names))

    def _check_count(self, names: Iterable[str]) -> None:
        """Count objects name by name, without making procedural ones, and stop at the bound."""
        count, seen = 0, set()
        for name in names:
            if name in seen:
                raise ObjectSetError(f"objects has {shown(name)} twice; name each set once")
            seen.add(name)
            count += self._count(name)
            if count > MAX_OBJECTS:
                raise ObjectSetError(
                    f"objects names at least {count} objects; this server allows at most {MAX_OBJECTS}"
                )

    def _count(self, name: str) -> int:
        """Count the objects of a set that is offered."""
        kind, _, rest = name.partition(":")
        if name in self._aliases:
            return len(object_sets.load(self._aliases[name]))
        if kind == "procedural" and self._procedural:
            families, seeds = object_sets.families_and_seeds(rest, name)
            if all(any(offered.covers(family, seeds) for offered in self._procedural) for family in families):
                return len(families) * len(seeds)
        if kind == "ycb" and self._ycb and self._ycb.issuperset((selected := object_sets.load(name)).names):
            return len(selected)
        known = ", ".join(self.names)
        raise ObjectSetError(f"this server does not offer the objects {name[:100]!r}; choose from {known}")
