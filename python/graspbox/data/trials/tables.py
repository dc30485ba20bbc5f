"""Rows of a data set as Arrow tables, and their columns as arrays."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspbox.data.files import parquet, pyarrow
from graspbox.data.trials import manifest
from graspbox.data.trials.schema import IMAGES, SPLITS, TRIALS
from graspbox.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["column", "lists", "load", "load_images", "matrices", "shards", "stored_images"]


def load(folder: str | os.PathLike[str], split: str | None = None, columns: list[str] | None = None) -> "pa.Table":
    """Read the trials of a data set from ``graspbox dataset``, even while it is still being made.

    It reads the shards named in ``manifest.json``, and compares each with its hash there.

    Parameters
    ----------
    folder : str or PathLike
        The folder.
    split : {"train", "validation", "test"}, optional
        Read only this split; by default all, in this order.
    columns : list of str, optional
        Read only these columns.

    Raises
    ------
    ConfigError
        If the split or a column does not exist, the folder has no shard of the split, or a shard is damaged.
    MissingExtraError
        Without pyarrow or pydantic (extra ``data``).
    """
    return pyarrow().concat_tables(_shards(folder, "trials", split, columns))


def load_images(
    folder: str | os.PathLike[str], split: str | None = None, columns: list[str] | None = None
) -> "pa.Table":
    """Read the stored images of a data set, one row per view of a scene; arguments and errors as `load`."""
    return pyarrow().concat_tables(_shards(folder, "images", split, columns))


def shards(
    folder: str | os.PathLike[str], split: str | None = None, columns: list[str] | None = None
) -> Iterator["pa.Table"]:
    """Read the trials of a data set one file at a time; arguments and errors as `load`."""
    yield from _shards(folder, "trials", split, columns)


def _shards(
    folder: str | os.PathLike[str], kind: str, split: str | None, columns: list[str] | None
) -> Iterator["pa.Table"]:
    if split is not None and split not in SPLITS:
        raise ConfigError(f"there is no split {split!r}; choose from {', '.join(SPLITS)}")
    known = [column.name for column in (TRIALS if kind == "trials" else IMAGES)]
    if unknown := [name for name in columns or () if name not in known]:
        raise ConfigError(f"there is no column {unknown[0]!r}; choose from {', '.join(known)}")
    made = manifest.read(Path(folder))
    listed = [] if made is None or (kind == "images" and not made["config"].get("images")) else made["shards"]
    wanted = SPLITS if split is None else (split,)
    chosen = [shard for name in wanted for shard in listed if shard["name"].startswith(f"{name}-")]
    if not chosen:
        missing = kind if split is None else f"{kind} of the split {split!r}"
        more = " of more objects" if split else ""
        todo = "run graspbox dataset with images" if kind == "images" else f"run graspbox dataset{more}, or resume it"
        raise ConfigError(f"the data set {os.fspath(folder)!r} has no {missing}; {todo}, or name another folder")
    pa, names = pyarrow(), columns or known
    for shard in chosen:
        content = manifest.content_of(Path(folder), kind, shard)
        try:
            table = parquet().ParquetFile(pa.BufferReader(content)).read(columns=names)
            yield table.select(names).replace_schema_metadata(None)
        except (KeyError, OSError, pa.ArrowException) as error:
            raise ConfigError(f"{kind}/{shard['name']} cannot be read: {error}") from None


def column(table: "pa.Table", name: str) -> NDArray[Any]:
    """Return a column of numbers, flags or text as an array (n,); null becomes NaN, or -1 among integers.

    Raises
    ------
    ConfigError
        If the table has no such column.
    """
    values, pa = _column(table, name), pyarrow()
    if values.null_count:
        values = values.fill_null(float("nan") if pa.types.is_floating(values.type) else -1)
    if pa.types.is_string(values.type) or pa.types.is_large_string(values.type):
        return np.array(values.to_pylist(), dtype=np.str_)
    return np.asarray(values.to_numpy())


def lists(table: "pa.Table", name: str) -> list[Any]:
    """Return a column as a list of Python values; raises as `column`."""
    return list(_column(table, name).to_pylist())


def _column(table: "pa.Table", name: str) -> Any:
    if name not in table.column_names:
        raise ConfigError(f"the table has no column {name!r}; it has {', '.join(table.column_names)}")
    return table[name]


def _flat(array: Any) -> NDArray[Any]:
    """Concatenate the values of nested lists; a slice of a table yields only its own rows."""
    pa = pyarrow()
    while pa.types.is_nested(array.type):
        array = array.flatten()
    return np.asarray(array.to_numpy())


def matrices(table: "pa.Table", name: str) -> NDArray[np.float64]:
    """Return a column of matrices as an array (n, 4, 4), or of lists of matrices as (n, v, 4, 4).

    Raises
    ------
    ConfigError
        If the table has no such column, the column holds no matrices, or its lists differ in length.
    """
    rows, is_nested = _column(table, name).combine_chunks(), pyarrow().types.is_nested
    values, listed = _flat(rows), is_nested(rows.type) and is_nested(rows.type.value_type)
    views = len(values) // (16 * len(rows)) if listed and len(rows) else 1
    lengths = set(rows.value_lengths().to_pylist()) if listed else {16}
    if not is_nested(rows.type) or len(lengths) > 1 or len(values) != 16 * views * len(rows):
        raise ConfigError(f"column {name!r} does not hold matrices, or its rows differ in their number")
    shape = (len(rows), views, 4, 4) if listed else (len(rows), 4, 4)
    return np.ascontiguousarray(values, dtype=np.float64).reshape(shape)


def stored_images(table: "pa.Table", image_size: int | tuple[int, int]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return stored images as arrays: depth (n, H, W) uint16, millimetres, and segmentation (n, H, W) uint8.

    Raises
    ------
    ConfigError
        If the images have another size.
    """
    height, width = (image_size, image_size) if isinstance(image_size, int) else image_size
    images = []
    for name in ("depth", "segmentation"):
        values = _flat(_column(table, name).combine_chunks())
        if len(values) != len(table) * height * width:
            raise ConfigError(f"image_size is {(height, width)}; the images have {len(values) // len(table)} pixels")
        images.append(values.reshape(len(table), height, width))
    return images[0], images[1]
