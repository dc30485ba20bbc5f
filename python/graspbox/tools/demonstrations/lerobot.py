"""Demonstrations as a LeRobotDataset, version 3.0 of the format (extra ``[lerobot]``).

``lerobot.datasets.LeRobotDataset(repo_id, root=folder)`` loads the folder, which can be uploaded unchanged. The
layout is that of https://huggingface.co/docs/lerobot/lerobot-dataset-v3.

| feature | contents |
|---|---|
| ``observation.state`` | ``proprio``: measurements of the arm and the hand |
| ``observation.environment_state`` | ``state``: the privileged vector |
| ``observation.images.NAME`` | colour images as PNG, and depth images as lossless TIFF: float32 metres |
| ``observation.NAME`` | every other observation, such as ``tactile`` or ``points`` |
| ``action`` | in [-1, 1] |
| ``next.reward``, ``next.done``, ``next.success`` | result of the action |

As in LeRobot, the last observation of an episode, which no action follows, is left out.

Depth images carry the marks of LeRobot 0.6 (``info.is_depth_map``, ``info.depth_unit``). It converts them and
their statistics to millimetres on reading, unless called with ``depth_output_unit="m"``; 0 means no measurement.
LeRobot before 0.6 ignores the marks and reads metres.
"""

import io
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox.data.episodes.store import Demonstrations, EpisodeSteps
from graspbox.data.files import parquet, pyarrow
from graspbox.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["TASK", "to_lerobot"]

#: The instruction of all episodes.
TASK = "Grasp the object and lift it."
_VERSION = "v3.0"
_CHUNK = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
#: Files per chunk, and megabytes per file (LeRobot's defaults).
_FILES, _MEGABYTES = 1000, 100
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
_NAMES = {"proprio": "observation.state", "state": "observation.environment_state"}
#: Columns of every data set, with one number per frame.
_DEFAULT = {"timestamp": "float32"}
_DEFAULT |= dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")


def to_lerobot(demonstrations: Demonstrations, out: str | Path) -> Path:
    """Write demonstrations, at least one episode, as a LeRobotDataset.

    Parameters
    ----------
    demonstrations : Demonstrations
        The demonstrations.
    out : str or Path
        The folder, which must not exist; it is written atomically, and returned.

    Raises
    ------
    ConfigError
        If there is no episode, or the folder exists.
    MissingExtraError
        Without pyarrow, or, for images, without pillow.
    """
    folder = Path(out)
    if folder.exists():
        raise ConfigError(f"{str(folder)!r} exists; remove it, or name another folder")
    if not demonstrations.episodes:
        raise ConfigError(f"{str(demonstrations.folder)!r} has no episode; record some")
    unfinished = folder.with_name(f".{folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        _Writer(unfinished, demonstrations).write()
        unfinished.rename(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return folder


def _is_image(name: str, shape: tuple[int, ...], dtype: str) -> bool:
    """Return whether LeRobot stores an observation as an image file: colours in three channels, or depth in one."""
    kinds = {"rgb": ("uint8", 3), "depth": ("float32", 1)}
    return len(shape) == 3 and kinds.get(name.partition("_")[0]) == (dtype, shape[2])


def _features(settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Describe the features for ``info.json``; also returns the feature name of each observation."""
    features: dict[str, Any] = {}
    names: dict[str, str] = {}
    for name, space in settings["observations"].items():
        shape, dtype = tuple(space["shape"]), space["dtype"]
        if _is_image(name, shape, dtype):
            names[name] = f"observation.images.{name}"
            features[names[name]] = {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}
            if shape[2] == 1:
                features[names[name]]["info"] = {"is_depth_map": True, "depth_unit": "m"}
        else:
            names[name] = _NAMES.get(name, f"observation.{name}")
            features[names[name]] = {"dtype": dtype, "shape": shape, "names": None}
    features["action"] = {"dtype": "float32", "shape": (settings["action_size"],), "names": None}
    for name, dtype in (("reward", "float32"), ("done", "bool"), ("success", "bool")):
        features[f"next.{name}"] = {"dtype": dtype, "shape": (1,), "names": None}
    features |= {name: {"dtype": dtype, "shape": (1,), "names": None} for name, dtype in _DEFAULT.items()}
    return features, names


class _Writer:
    """Writer of a data set, episode by episode."""

    def __init__(self, folder: Path, demonstrations: Demonstrations) -> None:
        self._folder, self._demonstrations = folder, demonstrations
        self._features, self._names = _features(demonstrations.settings)
        self._file, self._bytes, self._frames = 0, 0, 0
        self._writer: Any = None
        self._rows: list[dict[str, Any]] = []
        self._stats = {name: _Stats(len(entry["shape"]) == 1) for name, entry in self._features.items()}

    def write(self) -> None:
        """Write the data set."""
        try:
            for index, one in enumerate(self._demonstrations.read()):
                self._episode(index, one)
        finally:
            if self._writer is not None:
                self._writer.close()
        path = self._path("meta/episodes/", 0)
        parquet().write_table(pyarrow().Table.from_pylist(self._rows), path)
        _write_tasks(self._folder / "meta/tasks.parquet")
        stats = {name: statistics.result() for name, statistics in self._stats.items()}
        _write_json(self._folder / "meta/stats.json", stats)
        _write_json(self._folder / "meta/info.json", self._info())

    def _info(self) -> dict[str, Any]:
        fps = self._demonstrations.settings["fps"]
        return {
            "codebase_version": _VERSION,
            "robot_type": "graspbox",
            "total_episodes": len(self._rows),
            "total_frames": self._frames,
            "total_tasks": 1,
            "chunks_size": _FILES,
            "data_files_size_in_mb": _MEGABYTES,
            "video_files_size_in_mb": 200,
            "fps": round(fps),
            "splits": {"train": f"0:{len(self._rows)}"},
            "data_path": f"data/{_CHUNK}",
            "video_path": None,
            "features": self._features,
        }

    def _path(self, start: str, file: int) -> Path:
        path = self._folder / (start + _CHUNK.format(chunk_index=file // _FILES, file_index=file % _FILES))
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def _episode(self, index: int, one: EpisodeSteps) -> None:
        values = self._values(index, one)
        table = pyarrow().table({name: self._column(name, value) for name, value in values.items()})
        if self._writer is not None and self._bytes + table.nbytes > _MEGABYTES << 20:
            self._writer.close()
            self._writer, self._file, self._bytes = None, self._file + 1, 0
        if self._writer is None:
            self._writer = parquet().ParquetWriter(self._path("data/", self._file), table.schema)
        self._writer.write_table(table)
        self._bytes += table.nbytes
        first, self._frames = self._frames, self._frames + table.num_rows
        row: dict[str, Any] = {
            "episode_index": index,
            "tasks": [TASK],
            "length": table.num_rows,
            "data/chunk_index": self._file // _FILES,
            "data/file_index": self._file % _FILES,
            "dataset_from_index": first,
            "dataset_to_index": self._frames,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for name, value in values.items():
            own = _Stats(self._stats[name].keeps)
            for stats in (own, self._stats[name]):
                stats.add(_as_numbers(value, self._features[name]["dtype"] == "image"), len(value))
            row |= {f"stats/{name}/{statistic}": number for statistic, number in own.result().items()}
        self._rows.append(row)

    def _values(self, index: int, one: EpisodeSteps) -> dict[str, NDArray[Any]]:
        """Frames of every feature, (frames, *shape)."""
        count, fps = len(one.actions), self._demonstrations.settings["fps"]
        columns: dict[str, Any] = {self._names[name]: rows[:-1] for name, rows in one.observations.items()}
        frames = np.arange(count)
        ended = one.terminated | one.truncated
        columns |= {
            "action": one.actions,
            "next.reward": one.rewards,
            "next.done": ended,
            "next.success": ended & one.episode.success,
            "timestamp": frames / fps,
            "frame_index": frames,
            "episode_index": np.full(count, index),
            "index": self._frames + frames,
            "task_index": np.zeros(count),
        }
        values = {name: np.asarray(columns[name]) for name in self._features}
        images = {name for name, row in self._features.items() if row["dtype"] == "image"}
        return {n: v if n in images else v.astype(self._features[n]["dtype"]) for n, v in values.items()}

    def _column(self, name: str, values: NDArray[Any]) -> "pa.Array":
        pa = pyarrow()
        if self._features[name]["dtype"] == "image":
            kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
            return pa.array([{"bytes": _image_file(image), "path": None} for image in values], type=kind)
        column = pa.array(np.ascontiguousarray(values).reshape(-1))
        shape = values.shape[1:]
        if len(shape) == 1:
            return pa.FixedSizeListArray.from_arrays(column, shape[0])
        for size in reversed(shape):
            column = pa.ListArray.from_arrays(pa.array(np.arange(0, len(column) + 1, size, dtype=np.int32)), column)
        return column


def _image_file(image: NDArray[Any]) -> bytes:
    """Encode colours as PNG, depth as TIFF, which supports float32."""
    images = imported("PIL.Image", "images need pillow", "lerobot")
    raw = io.BytesIO()
    if image.shape[2] == 1:
        images.fromarray(np.ascontiguousarray(image[..., 0])).save(raw, format="TIFF", compression="raw")
    else:
        images.fromarray(image).save(raw, format="PNG")
    return raw.getvalue()


def _as_numbers(values: NDArray[Any], image: bool) -> NDArray[np.float64]:
    """Rows for the statistics; those of an image are its channels: colours in [0, 1], depth in metres."""
    if image:
        scale = 255.0 if values.dtype == np.uint8 else 1.0
        return values.reshape(-1, values.shape[-1], 1, 1) / scale
    return values.reshape(len(values), *(values.shape[1:] or (1,))).astype(np.float64)


class _Stats:
    """Statistics over rows added in parts; with quantiles if all rows can be kept."""

    def __init__(self, keeps: bool) -> None:
        self.keeps = keeps
        self._rows: list[NDArray[np.float32]] = []
        self._count, self._frames = 0, 0
        zero: NDArray[np.float64] = np.zeros(())
        self._low, self._high, self._total, self._square = zero + np.inf, zero - np.inf, zero, zero

    def add(self, rows: NDArray[np.float64], frames: int) -> None:
        self._low, self._high = np.minimum(self._low, rows.min(0)), np.maximum(self._high, rows.max(0))
        self._total, self._square = self._total + rows.sum(0), self._square + (rows**2).sum(0)
        self._count += len(rows)
        self._frames += frames
        if self.keeps:
            self._rows.append(rows.astype(np.float32))

    def result(self) -> dict[str, Any]:
        mean = self._total / self._count
        std = np.sqrt(np.maximum(self._square / self._count - mean**2, 0.0))
        statistics = {"min": self._low, "max": self._high, "mean": mean, "std": std, "count": np.array([self._frames])}
        if self.keeps:
            rows = np.concatenate(self._rows)
            statistics |= {f"q{round(100 * q):02d}": np.quantile(rows, q, axis=0) for q in _QUANTILES}
        return {name: value.tolist() for name, value in statistics.items()}


def _write_json(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=4, allow_nan=False))


def _write_tasks(path: Path) -> None:
    """Write the table of tasks as pandas does, with the sentence as its index."""
    columns: list[dict[str, Any]] = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": None, "field_name": "__index_level_0__", "pandas_type": "unicode", "numpy_type": "object"},
    ]
    about = {
        "index_columns": ["__index_level_0__"],
        "column_indexes": [],
        "columns": [{**column, "metadata": None} for column in columns],
        "pandas_version": "2.0.0",
    }
    table = pyarrow().table({"task_index": np.zeros(1, dtype=np.int64), "__index_level_0__": [TASK]})
    parquet().write_table(table.replace_schema_metadata({b"pandas": json.dumps(about)}), path)
