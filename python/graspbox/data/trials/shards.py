"""Shards, the unit of work: a shard is a Parquet file of complete scenes of one split, written atomically."""

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspbox._common.refusals import is_refusal, reason
from graspbox._core import Hand
from graspbox.data.files import parquet, parquet_bytes, pyarrow, sha256
from graspbox.data.trials.candidates import HandGeometry
from graspbox.data.trials.images import scene_images
from graspbox.data.trials.manifest import KINDS
from graspbox.data.trials.scenes import GroupedObject, SceneTask, label, tasks_of
from graspbox.data.trials.schema import SPLITS, TRIALS, arrow_schema, image_schema
from graspbox.data.trials.settings import DatasetConfig
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
#: Meshes that a shard of scenes of several objects keeps.
_MESHES = 64


@dataclass(frozen=True)
class Shard:
    """A shard to make: the name of its files, its scenes in the order of their rows, and the hash of the settings."""

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


def divide(objects: list[GroupedObject], config: DatasetConfig, fingerprint: str) -> list[Shard]:
    """Divide the scenes of a data set into shards, split by split, in the order of the objects."""
    scenes_each = max(1, config.shard_trials // config.poses)
    shards = []
    for split in SPLITS:
        tasks = tasks_of([one for one in objects if one.split == split], config)
        parts = [tasks[i : i + scenes_each] for i in range(0, len(tasks), scenes_each)]
        names = [f"{split}-{i:05d}-of-{len(parts):05d}.parquet" for i in range(len(parts))]
        shards += [Shard(name, tuple(part), fingerprint) for name, part in zip(names, parts, strict=True)]
    return shards


@lru_cache(maxsize=4)
def _geometry(hand: Hand) -> HandGeometry:
    return HandGeometry.of(hand)


def make(shard: Shard, hand: Hand, config: DatasetConfig) -> ShardFiles:
    """Label the scenes of a shard one after the other, on one thread.

    An object that cannot be used has no rows; the facts name it, and the reason. Errors of settings are raised.
    """
    tables, images, objects, refused = [], [], {}, {}
    load = lru_cache(1 if config.layout == "single" else _MESHES)(ObjectSpec.load)
    for task in shard.tasks:
        spec = task.target.spec
        try:
            columns, resting = label(task, load, hand, _geometry(hand), config)
        except GraspboxError as error:
            if not is_refusal(error):
                raise
            refused[task.name] = reason(error, spec.path)
            continue
        mesh = load(spec)
        objects[spec.name] = {"sha256": mesh_hash(mesh), "mass": mesh.mass}
        if set(columns) != {column.name for column in TRIALS}:
            raise InternalError(f"columns {set(columns) ^ {column.name for column in TRIALS}} differ from the schema")
        tables.append(_table(columns, arrow_schema()))
        if config.images:
            images.append(_table(scene_images(columns, resting, config), image_schema(config.image_size)))
    table = pyarrow().concat_tables([arrow_schema().empty_table(), *tables])
    facts = {
        "fingerprint": shard.fingerprint,
        "scenes": [task.name for task in shard.tasks],
        "refused": refused,
        "objects": objects,
        "counts": _counts(table),
    }

    def content(table: "pa.Table") -> bytes:
        return parquet_bytes(table.replace_schema_metadata({_KEY: json.dumps(facts)}), _ROW_GROUP)

    trials, stored = content(table), None
    hashes = {KINDS["trials"]: sha256(trials)}
    if config.images:
        stored = content(pyarrow().concat_tables([image_schema(config.image_size).empty_table(), *images]))
        hashes[KINDS["images"]] = sha256(stored)
    return ShardFiles(shard.name, trials, stored, {**facts, **hashes})


def _table(columns: dict[str, Any], schema: "pa.Schema") -> "pa.Table":
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
    columns = ("candidate", "success", "secure", "failure")
    source, success, secure, failure = (np.array(table[name].to_pylist()) for name in columns)
    flags = {"success": success, "secure": secure, "infeasible": failure == "infeasible"}
    return {
        str(name): {
            "trials": int((source == name).sum()),
            **{key: int(flag[source == name].sum()) for key, flag in flags.items()},
        }
        for name in sorted(set(source.tolist()))
    }


def stored_facts(content: bytes, path: Path) -> dict[str, Any]:
    """Read the facts that `make` wrote about a shard into its file `path`, whose hash is known to be right."""
    pa = pyarrow()
    try:
        return dict(json.loads((parquet().read_schema(pa.BufferReader(content)).metadata or {})[_KEY]))
    except (KeyError, OSError, ValueError, pa.ArrowException):
        raise ConfigError(
            f"{str(path)!r} is not a valid shard of a data set; remove it, and the same command makes it again"
        ) from None
