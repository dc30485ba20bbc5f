"""Three pairings of input images and target poses from the same trials: one-to-many, one-to-one, many-to-one.

Each pairs views of a scene with rows of the table; nothing is copied. A scene without a success has no pair.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspbox.data.trials.tables import column

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Example", "many_to_one", "one_to_many", "one_to_one"]


@dataclass(frozen=True, eq=False)
class Example:
    """Images of a scene, and their target poses.

    `views` (v,) are indices of its cameras, and `rows` (k,) are rows of the table with the target poses, best first.
    """

    scene: str
    views: NDArray[np.int64]
    rows: NDArray[np.int64]


def _scenes(table: "pa.Table") -> Iterator[tuple[str, int, NDArray[np.int64]]]:
    """Yield each scene in the table's order: its name, its number of views, and its successes from best to worst.

    The order is by successful replays, then security, then less motion in the hand, then the row.
    """
    names, success, secure = (column(table, name) for name in ("scene", "success", "secure"))
    replays, wins = column(table, "replays"), column(table, "replay_successes")
    share = np.where(replays > 0, wins / np.maximum(replays, 1), 1.0)
    motion = np.nan_to_num(column(table, "kindness_rate"), nan=np.inf)
    views = np.asarray(table["world_from_camera"].combine_chunks().value_lengths().to_numpy())
    order = np.lexsort((np.arange(len(names)), motion, ~secure, -share))
    order = order[success[order]]
    good: dict[str, list[int]] = {}
    for row in order.tolist():
        good.setdefault(str(names[row]), []).append(row)
    for name in dict.fromkeys(names.tolist()):
        if name in good:
            # All rows of a scene have the same cameras.
            yield name, int(views[good[name][0]]), np.array(good[name], np.int64)


def one_to_many(table: "pa.Table") -> list[Example]:
    """Pair each image with every pose that succeeded in its scene: ambiguous targets, for multimodal networks.

    `table` has trials from `graspbox.data.trials.load`, with the columns ``scene``, ``success``, ``secure``,
    ``replays``, ``replay_successes``, ``kindness_rate`` and ``world_from_camera``.
    """
    return [Example(name, np.array([v]), rows) for name, views, rows in _scenes(table) for v in range(views)]


def one_to_one(table: "pa.Table") -> list[Example]:
    """Pair each image with the best pose of its scene; argument as `one_to_many`."""
    return [Example(name, np.array([v]), rows[:1]) for name, views, rows in _scenes(table) for v in range(views)]


def many_to_one(table: "pa.Table") -> list[Example]:
    """Pair all images of a scene with each pose that succeeded there, one per example; argument as `one_to_many`."""
    return [
        Example(name, np.arange(views), rows[i : i + 1])
        for name, views, rows in _scenes(table)
        for i in range(len(rows))
        if views
    ]
