"""The object sets from which a policy learned, as its folder names them; `graspbox.evaluation` leaves them out."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from graspbox.dataset import manifest
from graspbox.errors import ConfigError

__all__ = ["LEARNED_SPLITS", "of_datasets", "of_splits"]

#: Splits whose objects a training sees: to learn from, and to decide when to stop or which network to keep.
LEARNED_SPLITS = ("train", "validation")


def of_splits(names: Iterable[str], splits: Sequence[str] = LEARNED_SPLITS) -> list[str]:
    """Name the splits of object sets: ``NAME/SPLIT`` for each."""
    return [f"{name}/{split}" for name in names for split in splits]


def of_datasets(folders: Iterable[Path]) -> list[str]:
    """Name the object sets of data sets of trials: families with their range of seeds, ``ycb``, and files.

    Raises
    ------
    ConfigError, FileError
        If a folder holds no data set.
    """
    found: dict[str, None] = {}
    for folder in folders:
        made = manifest.read(Path(folder))
        if made is None:
            raise ConfigError(f"there is no data set in {str(folder)!r}")
        found |= dict.fromkeys(_sets(made["objects"]))
    return of_splits(found)


def _sets(objects: Iterable[Mapping[str, Any]]) -> list[str]:
    """Put the objects of a manifest together."""
    seeds: dict[str, list[int]] = {}
    others: dict[str, None] = {}
    for entry in objects:
        kind, _, rest = str(entry["source"]).partition(":")
        if kind == "procedural":
            family, _, seed = rest.partition(":")
            seeds.setdefault(family, []).append(int(seed))
        else:
            others["ycb" if kind == "ycb" else str(entry["source"])] = None
    return [f"procedural:{family}:{min(each)}-{max(each)}" for family, each in seeds.items()] + list(others)
