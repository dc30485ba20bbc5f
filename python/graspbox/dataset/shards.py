"""Shards, the unit of work: a shard is a Parquet file of complete scenes of one split, written atomically."""

import hashlib
import json
import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspbox._common import schemas
from graspbox._common.refusals import is_refusal, reason
from graspbox._core import Hand
from graspbox.dataset.candidates import HandGeometry
from graspbox.dataset.extras import parquet, pyarrow
from graspbox.dataset.images import scene_images
from graspbox.dataset.manifest import KINDS
from graspbox.dataset.scenes import SceneTask, Subject, label, tasks_of
from graspbox.dataset.schema import TRIALS, arrow_schema, image_schema
from graspbox.dataset.settings import DatasetConfig
from graspbox.errors import ConfigError, GraspboxError, InternalError
from graspbox.object_sets import ObjectSpec
from graspbox.planning.plan_files import mesh_hash

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Shard", "ShardFiles", "divide", "make", "stored_facts"]

#: Metadata key of the facts about a shard in its file.
_KEY = b"graspbox"
#: Trials per row group.
_ROW_GROUP = 4096
_COMPRESSION_LEVEL = 3
#: Meshes that a shard of scenes of several objects keeps.
_MESHES = 64


@dataclass(frozen=True)
class Shard:
    """A shard to make.

    Attributes
    ----------
    name : str
        Name of its files in ``trials`` and ``images``.
    tasks : tuple of SceneTask
        Its scenes, in the order of their rows.
    fingerprint : str
        Hash of the settings of the data set.
    """

    name: str
    tasks: tuple[SceneTask, ...]
    fingerprint: str


@dataclass(frozen=True)
class ShardFiles:
    """A complete shard: the contents of its files, and its entry in the manifest (`facts`)."""

    name: str
    trials: bytes
    images: bytes | None
    facts: dict[str, Any]


def divide(subjects: list[Subject], config: DatasetConfig, fingerprint: str) -> list[Shard]:
    """Divide the scenes of a data set into shards, split by split, in the order of the objects."""
    scenes_each = max(1, config.shard_trials // config.poses)
    shards = []
    for split in ("train", "validation", "test"):
        tasks = tasks_of([subject for subject in subjects if subject.split == split], config)
        parts = [tasks[i : i + scenes_each] for i in range(0, len(tasks), scenes_each)]
        names = [f"{split}-{i:05d}-of-{len(parts):05d}.parquet" for i in range(len(parts))]
        shards += [Shard(name, tuple(part), fingerprint) for name, part in zip(names, parts, strict=True)]
    return shards


@lru_cache(maxsize=4)
def _geometry(hand: Hand) -> HandGeometry:
    return HandGeometry.of(hand)


def make(shard: Shard, hand: Hand, config: DatasetConfig) -> ShardFiles:
    """Make a shard: label its scenes one after the other, on one thread.

    A refused object has no rows; the facts name it, and the reason.

    Raises
    ------
    ConfigError
        If a setting is wrong, independent of the object.
    """
    started = time.perf_counter()
    tables, images, objects, refused = [], [], {}, {}
    load = lru_cache(1 if config.layout == "single" else _MESHES)(ObjectSpec.load)
    for task in shard.tasks:
        spec = task.subject.spec
        try:
            columns, resting = label(task, load, hand, _geometry(hand), config)
        except GraspboxError as error:
            if not is_refusal(error):
                raise
            refused[task.name] = reason(error, spec.path)
            continue
        mesh = load(spec)
        objects[spec.name] = {"sha256": mesh_hash(mesh), "mass": mesh.mass}
        tables.append(_table(columns))
        if config.images:
            images.append(_image_table(scene_images(columns, resting, config), config))
    table = pyarrow().concat_tables([arrow_schema().empty_table(), *tables])
    facts = {
        "fingerprint": shard.fingerprint,
        "scenes": [task.name for task in shard.tasks],
        "refused": refused,
        "objects": objects,
        "counts": _counts(table),
    }
    stored = _parquet_bytes(image_schema(config.image_size), images, facts) if config.images else None
    trials = _parquet_bytes(arrow_schema(), [table], facts)
    hashes = {KINDS["trials"]: hashlib.sha256(trials).hexdigest()}
    if stored is not None:
        hashes[KINDS["images"]] = hashlib.sha256(stored).hexdigest()
    return ShardFiles(shard.name, trials, stored, {**facts, **hashes, "seconds": time.perf_counter() - started})


def _table(columns: dict[str, Any]) -> "pa.Table":
    pa, schema = pyarrow(), arrow_schema()
    if set(columns) != {column.name for column in TRIALS}:
        raise InternalError(f"columns {set(columns) ^ {column.name for column in TRIALS}} differ from the schema")
    arrays = [_array(columns[name], schema.field(name).type) for name in schema.names]
    return pa.Table.from_arrays(arrays, schema=schema)


def _image_table(columns: dict[str, Any], config: DatasetConfig) -> "pa.Table":
    schema = image_schema(config.image_size)
    arrays = [_array(columns[name], schema.field(name).type) for name in schema.names]
    return pyarrow().Table.from_arrays(arrays, schema=schema)


def _array(values: Any, kind: "pa.DataType") -> "pa.Array":
    """Convert a column; the axes of an array after the first become one list of fixed size."""
    pa = pyarrow()
    if pa.types.is_fixed_size_list(kind):
        flat = np.ascontiguousarray(np.asarray(values).reshape(-1), dtype=kind.value_type.to_pandas_dtype())
        return pa.FixedSizeListArray.from_arrays(pa.array(flat), type=kind)
    if pa.types.is_list(kind) and not pa.types.is_struct(kind.value_type):
        rows = np.asarray(values)
        offsets = np.arange(len(rows) + 1, dtype=np.int32) * rows.shape[1]
        return pa.ListArray.from_arrays(pa.array(offsets), _array(rows, kind.value_type), type=kind)
    return pa.array(values, type=kind)


def _counts(table: "pa.Table") -> dict[str, dict[str, int]]:
    """Count trials, successes, secure grasps and infeasible poses of each source of candidates."""
    source, failure = (np.array(table[name].to_pylist(), dtype=np.str_) for name in ("candidate", "failure"))
    flags = {name: np.array(table[name].to_pylist(), dtype=bool) for name in ("success", "secure")}
    flags["infeasible"] = failure == "infeasible"
    return {
        str(name): {
            "trials": int((source == name).sum()),
            **{key: int(flag[source == name].sum()) for key, flag in flags.items()},
        }
        for name in sorted(set(source))
    }


def _parquet_bytes(schema: "pa.Schema", tables: list["pa.Table"], facts: dict[str, Any]) -> bytes:
    pa = pyarrow()
    table = pa.concat_tables([schema.empty_table(), *tables])
    table = table.replace_schema_metadata({_KEY: json.dumps(facts)})
    sink = pa.BufferOutputStream()
    parquet().write_table(
        table, sink, compression="zstd", compression_level=_COMPRESSION_LEVEL, row_group_size=_ROW_GROUP
    )
    return bytes(sink.getvalue())


@dataclass(frozen=True)
class _ObjectFacts:
    sha256: str
    mass: float


@dataclass(frozen=True)
class _Facts:
    """Facts about a shard that `make` writes into its file."""

    fingerprint: str
    scenes: tuple[str, ...]
    refused: dict[str, str]
    objects: dict[str, _ObjectFacts]
    counts: dict[str, dict[str, int]]


def stored_facts(content: bytes, path: Path) -> dict[str, Any]:
    """Read the facts that `make` wrote about a shard into its file `path`.

    Raises
    ------
    ConfigError
        If the file is not a shard.
    """
    pa = pyarrow()
    complaint = f"{str(path)!r} is not a valid shard of a data set; remove it, and the same command makes it again"
    try:
        facts = (parquet().read_schema(pa.BufferReader(content)).metadata or {})[_KEY]
    except (KeyError, OSError, pa.ArrowException):
        raise ConfigError(complaint) from None
    return asdict(schemas.parse(_Facts, facts, complaint))
