"""Object sets that a policy was trained on, as listed in its folder: ``NAME`` or ``NAME/SPLIT``.

`graspbox.evaluation` leaves their objects out; `graspbox.learn.recipes` writes them.
"""

import logging
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import get_args

from graspbox import object_sets
from graspbox.errors import FileError, MissingExtraError, ObjectSetError
from graspbox.object_sets import ObjectSet, Split
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES

__all__ = ["by_family", "without"]

_log = logging.getLogger(__name__)


def by_family(source: str) -> list[str]:
    """Expand a procedural set to one name per family, and return any other name unchanged.

    ``procedural:seen`` grows whenever a family is added; the record of a policy's training objects must not.

    Raises
    ------
    ObjectSetError
        If there is no such procedural set.
    """
    name, split = object_sets.name_and_split(source)
    kind, _, rest = name.partition(":")
    if kind != "procedural":
        return [source]
    families, seeds = object_sets.families_and_seeds(rest, name)
    end = f"/{split}" if split else ""
    return [f"procedural:{family}:{seeds[0]}-{seeds[-1]}{end}" for family in families]


def without(found: ObjectSet, learned_from: Iterable[str]) -> ObjectSet:
    """Leave out the objects of other sets, which are identified by the source of their meshes.

    A set that is not on this machine is ignored, as is a split without objects; the result may be empty.

    Raises
    ------
    ObjectSetError
        If an entry names no object set.
    """
    learned: set[str] = set()
    for source in learned_from:
        name, split = object_sets.name_and_split(source)
        try:
            if split is not None and split not in get_args(Split):
                raise ObjectSetError(f"there is no split {split!r}; choose from {', '.join(get_args(Split))}")
            learned |= {spec.source for spec in object_sets.load(name) if split in (None, spec.split)}
        except (FileError, MissingExtraError, ObjectSetError) as error:
            names_files = name.startswith("dir:") or Path(name).suffix.lower() in MESH_SUFFIXES
            if isinstance(error, ObjectSetError) and not names_files:
                raise ObjectSetError(f"learned_from has {source!r}: {error}") from None
            _log.info("no objects of %s are left out: %s", source, error)
    return replace(found, objects=tuple(spec for spec in found if spec.source not in learned))
