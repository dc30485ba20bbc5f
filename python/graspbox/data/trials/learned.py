"""The object sets a policy was trained on, as recorded in its folder; `graspbox.evaluation` leaves them out."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from graspbox.data.trials import manifest
from graspbox.errors import ConfigError
from graspbox.object_sets import Split

__all__ = ["LEARNED_SPLITS", "evaluated_split", "of_datasets", "of_splits"]

#: Splits that a training uses: to learn from, and for early stopping or model selection.
LEARNED_SPLITS = ("train", "validation")
#: Seeds of a family separated by more than this belong to two sets.
_LARGEST_GAP = 50


def evaluated_split(objects: str) -> Split | None:
    """Return the split of a set on which a policy is evaluated: the test split, except for procedural sets."""
    return None if objects.startswith("procedural") else "test"


def of_splits(names: Iterable[str], splits: Sequence[str] = LEARNED_SPLITS) -> list[str]:
    """Name the splits of object sets: ``NAME/SPLIT`` for each."""
    return [f"{name}/{split}" for name in names for split in splits]


def of_datasets(folders: Iterable[Path]) -> list[str]:
    """Name the object sets of data sets of trials: families with their range of seeds, ``ycb``, and files."""
    names: dict[str, None] = {}
    for folder in folders:
        made = manifest.read(Path(folder))
        if made is None:
            raise ConfigError(f"there is no data set in {str(folder)!r}")
        names |= dict.fromkeys(_sets(made["objects"]))
    return of_splits(names)


def _sets(objects: Iterable[Mapping[str, Any]]) -> list[str]:
    """Merge the objects of a manifest."""
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
    """Return the first and last seed of each run of seeds; small gaps belong to other splits."""
    first, *others = sorted(seeds)
    last = first
    for seed in others:
        if seed - last > _LARGEST_GAP:
            yield first, last
            first = seed
        last = seed
    yield first, last
