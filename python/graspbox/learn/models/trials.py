"""Grasp trials for training: scenes, and the hand poses tried in them with their outcomes."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.data.trials import tables
from graspbox.data.trials.schema import TRIALS
from graspbox.errors import ConfigError
from graspbox.learn.models.cluttered import text_of
from graspbox.learn.training.array_files import ArrayTable
from graspbox.simulation.outcomes import Outcomes

__all__ = ["GraspTrials"]

#: Failures in which the hand held the object for a while.
_SLIPPED = ("slipped", "dropped")
#: Columns of a data set that are read.
_COLUMNS = (
    "source",
    "scale",
    "size_factor",
    "world_from_object",
    "neighbours",
    "walls",
    "executed_world_from_hand",
    "preshape",
    "success",
    "secure",
    "failure",
)


@dataclass(frozen=True, eq=False)
class GraspTrials(ArrayTable):
    """m trials in s scenes; a scene is an object in a resting pose.

    Attributes
    ----------
    source : (s,) str
        The scene, as `graspbox.learn.models.cluttered` writes it: a scaled object as one of several.
    world_from_object : (s, 4, 4) float64
        Resting pose; the table is the plane z = 0, metres.
    scene_of : (m,) int64
        The scene of each trial.
    world_from_hand : (m, 4, 4) float64
        Hand pose that was tried, metres.
    preshape : (m,) float64
        See `graspbox.Hand.preshape_limits`.
    success, secure, slip : (m,) bool
        Whether it succeeded, whether it held without shifting, and whether the object was lost after being held.
    """

    source: NDArray[np.str_]
    world_from_object: NDArray[np.float64]
    scene_of: NDArray[np.int64]
    world_from_hand: NDArray[np.float64]
    preshape: NDArray[np.float64]
    success: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    slip: NDArray[np.bool_]

    def __post_init__(self) -> None:
        scenes, trials = len(self.source), len(self.scene_of)
        shapes = {
            "world_from_object": (scenes, 4, 4),
            "world_from_hand": (trials, 4, 4),
            **dict.fromkeys(("preshape", "success", "secure", "slip"), (trials,)),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ConfigError(f"{name} has shape {getattr(self, name).shape}; it must have {shape}")
        if trials and not (self.scene_of.min() >= 0 and self.scene_of.max() < scenes):
            raise ConfigError(f"scene_of holds {self.scene_of.max()}; there are {scenes} scenes")

    def __len__(self) -> int:
        """Return the number of trials."""
        return len(self.scene_of)

    def rows_of_scenes(self) -> list[NDArray[np.int64]]:
        """Return the rows of the trials of each scene."""
        order = np.argsort(self.scene_of, kind="stable")
        starts = np.searchsorted(self.scene_of[order], np.arange(len(self.source) + 1))
        return [order[first:last] for first, last in pairwise(starts)]

    @classmethod
    def of_scene(
        cls,
        source: str,
        world_from_object: NDArray[np.float64],
        world_from_hand: NDArray[np.float64],
        preshape: NDArray[np.float64],
        outcomes: Outcomes,
    ) -> Self:
        """Build a table from the outcomes of one scene."""
        slip = np.isin(outcomes.failure, _SLIPPED)
        scene_of = np.zeros(len(outcomes), dtype=np.int64)
        source_of, pose = np.array([source]), world_from_object[None]
        return cls(source_of, pose, scene_of, world_from_hand, preshape, outcomes.success, outcomes.secure, slip)

    @classmethod
    def empty(cls, source: str, world_from_object: NDArray[np.float64]) -> Self:
        """Build a table of one scene without trials."""
        flags, scene_of = np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.int64)
        numbers = np.zeros((0, 4, 4)), np.zeros(0)
        return cls(np.array([source]), world_from_object[None], scene_of, *numbers, flags, flags, flags)

    @classmethod
    def from_columns(cls, columns: Mapping[str, Sequence[Any] | ArrayLike]) -> Self:
        """Convert columns of a data set (`graspbox.data.trials.TRIALS`), or of part of one, in any order.

        Columns without use are ignored; without those of neighbours and walls, scenes have a single object.

        Raises ConfigError if a column is missing.
        """
        columns = {**_alone(columns), **columns}
        if missing := [name for name in _COLUMNS if name not in columns]:
            raise ConfigError(f"the columns lack {', '.join(missing)}; read them from a data set of trials")
        source = np.array(_sources(columns), dtype=np.str_)
        objects = np.asarray(columns["world_from_object"], dtype=np.float64).reshape(-1, 4, 4)
        keys = [(name, pose.tobytes()) for name, pose in zip(source.tolist(), objects, strict=True)]
        numbers: dict[tuple[str, bytes], int] = {}
        scene_of = np.array([numbers.setdefault(key, len(numbers)) for key in keys], dtype=np.int64)
        first = np.unique(scene_of, return_index=True)[1]
        return cls(
            source[first],
            objects[first],
            scene_of,
            np.asarray(columns["executed_world_from_hand"], dtype=np.float64).reshape(-1, 4, 4),
            np.asarray(columns["preshape"], dtype=np.float64),
            np.asarray(columns["success"], dtype=np.bool_),
            np.asarray(columns["secure"], dtype=np.bool_),
            np.isin(np.asarray(columns["failure"], dtype=np.str_), _SLIPPED),
        )

    @classmethod
    def from_dataset(cls, folder: str | os.PathLike[str], split: str) -> Self:
        """Read one split of a data set (``graspbox dataset``), even while it is still being made.

        Only the columns that are needed are read, shard by shard: a trial takes about 200 bytes. Raises ConfigError if
        the folder has no shard of the split, MissingExtraError without pyarrow.
        """
        parts = []
        for table in tables.shards(folder, split, list(_COLUMNS)):
            columns: dict[str, Any] = {name: tables.matrices(table, name) for name in _COLUMNS if "world_from" in name}
            columns |= {name: tables.lists(table, name) for name in ("neighbours", "walls")}
            columns |= {name: tables.column(table, name) for name in _COLUMNS if name not in columns}
            parts.append(cls.from_columns(columns))
        return cls.joined(parts)

    @classmethod
    def from_datasets(cls, folders: Iterable[str | os.PathLike[str]], split: str) -> Self:
        """Read one split of several data sets, as `from_dataset` does of one; raises ConfigError without a folder."""
        return cls.joined(cls.from_dataset(folder, split) for folder in folders)

    @classmethod
    def joined(cls, parts: Iterable["GraspTrials"]) -> Self:
        """Concatenate trials, whose scenes stay apart; raises ConfigError if there is no table."""
        pieces = list(parts)
        if not pieces:
            raise ConfigError("there are no trials to join; pass some")
        starts = np.cumsum([0, *(len(part.source) for part in pieces)])
        columns = {f.name: np.concatenate([getattr(part, f.name) for part in pieces]) for f in fields(cls)}
        columns["scene_of"] = np.concatenate(
            [part.scene_of + start for part, start in zip(pieces, starts, strict=False)]
        )
        return cls(**columns)


def _alone(columns: Mapping[str, Sequence[Any] | ArrayLike]) -> dict[str, list[Any]]:
    """Return the columns of scenes of several objects for rows of a single one."""
    added = {column.name: column.alone for column in TRIALS if column.alone is not None}
    count = len(np.asarray(columns.get("preshape", ())))
    return {name: [value] * count for name, value in {"scale": 1.0, **added}.items()}


def _sources(columns: Mapping[str, Sequence[Any] | ArrayLike]) -> list[str]:
    """Name what lies on the table in each row: an object set, or the text of a scene."""
    names = ("source", "scale", "size_factor", "world_from_object", "neighbours", "walls")
    sources: list[str] = []
    before: list[Any] = []
    for source, scale, size_factor, pose, *around in zip(*(columns[name] for name in names), strict=True):
        row = [str(source), float(scale) * float(size_factor), np.asarray(pose, np.float64).tobytes(), *around]
        if row == before:
            sources.append(sources[-1])
            continue
        plain = not len(around[0]) and not len(around[1]) and row[1] == 1.0
        sources.append(row[0] if plain else _text(*row))
        before = row
    return sources


def _text(source: str, scale: float, pose: bytes, neighbours: Sequence[Any], walls: Sequence[Any]) -> str:
    """Write an object, its neighbours and walls as the text of a scene."""
    poses = [np.frombuffer(pose, np.float64), *(each["world_from_object"] for each in neighbours)]
    return text_of(
        [source, *(each["source"] for each in neighbours)],
        [scale, *(each["scale"] * each["size_factor"] for each in neighbours)],
        np.array(poses).reshape(-1, 4, 4),
        np.array([wall["world_from_wall"] for wall in walls]).reshape(-1, 4, 4),
        np.array([wall["half_extents"] for wall in walls]).reshape(-1, 3),
    )
