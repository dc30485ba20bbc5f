"""The object sets from which a policy learned, as its folder names them; `graspbox.evaluation` leaves them out."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from graspbox.dataset import manifest
from graspbox.errors import ConfigError
from graspbox.object_sets import Split

__all__ = ["LEARNED_SPLITS", "evaluated_split", "of_datasets", "of_splits"]

#: Splits whose objects a training sees: to learn from, and to decide when to stop or which network to keep.
LEARNED_SPLITS = ("train", "validation")
#: Seeds of a family that are further apart than this are of two sets.
_LARGEST_GAP = 50


def evaluated_split(objects: str) -> Split | None:
    """Give the split of a set on which a policy is evaluated: of sets other than procedural ones only the test."""
    return None if objects.startswith("procedural") else "test"


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
    made = [f"procedural:{family}:{low}-{high}" for family, each in seeds.items() for low, high in _runs(each)]
    return made + list(others)


def _runs(seeds: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Give the first and last of each run of seeds, across small gaps: what is missing there is of another split."""
    first, *others = sorted(seeds)
    last = first
    for seed in others:
        if seed - last > _LARGEST_GAP:
            yield first, last
            first = seed
        last = seed
    yield first, last
