"""Tables of arrays in ``.npz`` files, made part by part: interrupted work resumes with the next part."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import ClassVar, Self, TypeVar

import numpy as np

from graspbox._common.files import replacing
from graspbox.errors import ConfigError

__all__ = ["CORES", "ArrayTable", "load_or_make", "load_or_make_parts"]

#: Number of parts that keep this machine busy.
CORES = min(os.cpu_count() or 1, 32)


class ArrayTable:
    """Base of dataclasses whose fields are arrays, a row of each for every item."""

    #: Error message if no table has a row.
    nothing: ClassVar[str] = "there are no tables to join; pass some"
    #: Name in the file of each field whose name differs there.
    stored_names: ClassVar[Mapping[str, str]] = {}

    def __len__(self) -> int:
        """Count the rows."""
        return len(vars(self)[fields(self)[0].name])  # type: ignore[arg-type]

    @classmethod
    def joined(cls, parts: Iterable[Self]) -> Self:
        """Join tables; raises ConfigError if they have no rows."""
        filled = [vars(part) for part in parts if len(part)]
        if not filled:
            raise ConfigError(cls.nothing)
        return cls(**{name: np.concatenate([part[name] for part in filled]) for name in filled[0]})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an ``.npz`` file: whole, or not at all."""
        with replacing(Path(path)) as temporary:
            np.savez_compressed(temporary, **{self.stored_names.get(k, k): v for k, v in vars(self).items()})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a table that `save` wrote."""
        with np.load(path, allow_pickle=False) as arrays:
            return cls(**{f.name: arrays[cls.stored_names.get(f.name, f.name)] for f in fields(cls)})  # type: ignore[arg-type]


Table = TypeVar("Table", bound=ArrayTable)


def load_or_make(kind: type[Table], path: Path, make: Callable[[], Table]) -> Table:
    """Read a table; if it has no file yet, make and write it first."""
    if not path.exists():
        make().save(path)
    return kind.load(path)


def load_or_make_parts(
    kind: type[Table],
    folder: Path,
    numbers: Iterable[int],
    make: Callable[[int], Table],
    *,
    workers: int = 1,
    progress: Callable[[int], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> Table:
    """Read the numbered parts of a table from a folder, make those without a file, and join them.

    The result does not depend on the number of workers, except for how far it comes before `stop`.

    Parameters
    ----------
    make : callable
        Makes the part of a number, in any thread and in any order.
    workers : int
        Number of parts that are made at once.
    stop : callable
        Called before each part without a file; once it returns True, no other part is made or read.

    Raises ConfigError if there are no rows.
    """
    folder.mkdir(parents=True, exist_ok=True)
    parts: list[Table] = []
    begun: deque[Future[Table]] = deque()

    def take() -> None:
        parts.append(begun.popleft().result())
        progress(len(parts))

    with ThreadPoolExecutor(workers) as pool:
        for number in numbers:
            path = folder / f"{number:07d}.npz"
            if not path.exists() and stop():
                break
            begun.append(pool.submit(load_or_make, kind, path, partial(make, number)))
            if len(begun) >= workers:
                take()
        while begun:
            take()
    return kind.joined(parts)
