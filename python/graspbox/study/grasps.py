"""Successful grasps of objects, as the reference study collected them: planner poses that hold in simulation.

Poses are in the **base frame** of an object at rest: its origin is where the vertical through the centre of the
object's bounds meets the table, and its axes are the world's (z up). It is the study's object frame, in which the
networks of `graspbox.study.networks` predict.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox._common.by_value import ByValue
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.object_sets import ObjectSet
from graspbox.planning import plan
from graspbox.simulation import Scene

__all__ = ["PRESHAPE", "Grasps", "base_pose", "collect", "executed"]

#: The networks predict no preshape, so all grasps share one. At pi/3 every object of the study's table 3.1 has
#: successful poses; at 0 the wooden block has none, at pi/2 the drill.
PRESHAPE = float(np.pi / 3)
#: Poses tried per call.
_BATCH = 32
#: Greatest number of plans per object, with consecutive seeds.
_MOST_PLANS = 12


@dataclass(frozen=True, eq=False)
class Grasps(ByValue):
    """Successful grasps: n rows grouped by object; each object's in the order of the planner's ranking.

    `object` indexes `names`; `base_from_hand` (n, 4, 4) are poses in the base frame, metres; `secure` tells whether the
    object was held without shifting (`graspbox.simulation`).
    """

    names: tuple[str, ...]
    object: NDArray[np.int64]
    base_from_hand: NDArray[np.float64]
    preshape: NDArray[np.float64]
    secure: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.object)

    def best(self) -> NDArray[np.int64]:
        """Row of each object's best grasp, (objects,): the first secure one, else its first; -1 without a grasp."""
        chosen = np.full(len(self.names), -1, dtype=np.int64)
        for i in range(len(self.names)):
            rows = np.flatnonzero(self.object == i)
            held = rows[self.secure[rows]]
            if len(rows):
                chosen[i] = held[0] if len(held) else rows[0]
        return chosen


def base_pose(scene: Scene) -> NDArray[np.float64]:
    """``world_from_base`` (4, 4) of the object of a scene."""
    rest = scene.world_from_object
    return base_under(scene.mesh.vertices @ rest[:3, :3].T + rest[:3, 3])


def base_under(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """``world_from_base`` (4, 4) under points of an object (n, 3), world, metres."""
    pose = np.eye(4)
    pose[:2, 3] = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2
    return pose


def executed(scene: Scene, base_from_hand: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert poses in the base frame to ``object_from_hand`` (n, 4, 4), as `Scene.simulate` takes it."""
    object_from_base = np.linalg.inv(scene.world_from_object) @ base_pose(scene)
    return np.asarray(object_from_base @ base_from_hand)


def _successes(scene: Scene, preshape: float, seed: int, num_threads: int | None) -> Iterator[Grasps]:
    """Try the poses of one plan after another, and yield the successful ones in batches."""
    base_from_object = np.linalg.inv(base_pose(scene)) @ scene.world_from_object
    seen: set[bytes] = set()
    for more in range(_MOST_PLANS):
        rest = scene.world_from_object
        planned = plan(scene.mesh, hand=scene.hand, world_from_object=rest, seed=seed + more, num_threads=num_threads)
        best = planned.best()
        fits = np.isclose(best.preshape, preshape, atol=1e-6)
        fresh = [i for i in np.flatnonzero(fits) if best.poses[i].tobytes() not in seen]
        seen.update(best.poses[i].tobytes() for i in fresh)
        for start in range(0, len(fresh), _BATCH):
            part = best[np.array(fresh[start : start + _BATCH])]
            out = scene.simulate(part, config=TrialConfig(), num_threads=num_threads)
            kept = out.success
            yield Grasps(
                (scene.name,),
                np.zeros(int(kept.sum()), dtype=np.int64),
                base_from_object @ part.poses[kept],
                part.preshape[kept],
                out.secure[kept],
            )


def collect(
    objects: ObjectSet,
    count: int,
    *,
    preshape: float = PRESHAPE,
    seed: int = 0,
    hand: str = "reflex",
    num_threads: int | None = None,
    done: Callable[[int], None] = lambda _: None,
) -> Grasps:
    """Collect `count` successful grasps, distributed as evenly over the objects as their poses allow.

    Each object starts with an equal share; the others make up a shortfall. Only planner poses with this preshape are
    tried; `seed` is that of the first plan of each object. The grasps do not depend on `num_threads`. `done` is called
    with the number of grasps so far. Too few successful poses are a `ConfigError`.
    """
    if count < 1:
        raise ConfigError(f"count is {count}; it must be 1 or more")
    batches: list[list[Grasps]] = [[] for _ in objects]
    searches: dict[int, Iterator[Grasps]] = {}
    for i, spec in enumerate(objects):
        scene = Scene(spec.load(), hand=hand)
        searches[i] = _successes(scene, preshape, seed, num_threads)

    def have(i: int) -> int:
        return sum(map(len, batches[i]))

    level = 0
    while searches and sum(min(have(i), level) if i in searches else have(i) for i in range(len(objects))) < count:
        # Exhausted objects contribute all they have; the others share the rest equally.
        exhausted = sum(have(i) for i in range(len(objects)) if i not in searches)
        level = -(-(count - exhausted) // len(searches))
        for i, search in list(searches.items()):
            while have(i) < level:
                batch = next(search, None)
                if batch is None:
                    del searches[i]
                    break
                batches[i].append(batch)
                done(min(count, sum(map(have, range(len(objects))))))
    return _joined(objects, batches, count)


def _joined(objects: ObjectSet, batches: list[list[Grasps]], count: int) -> Grasps:
    """Concatenate the batches of all objects, and remove the surplus from the objects with the most grasps."""
    sizes = np.array([sum(map(len, parts)) for parts in batches])
    if sizes.sum() < count:
        raise ConfigError(
            f"count is {count}, but the planner's poses of {len(objects)} objects with this preshape give "
            f"{sizes.sum()} successful grasps; ask for fewer, or name more objects"
        )
    while sizes.sum() > count:
        sizes[np.argmax(sizes)] -= 1
    rows = [(i, part) for i, parts in enumerate(batches) for part in parts]
    kept = np.concatenate([np.arange(sum(map(len, parts))) < size for parts, size in zip(batches, sizes, strict=True)])
    return Grasps(
        objects.names,
        np.concatenate([np.full(len(part), i, dtype=np.int64) for i, part in rows])[kept],
        np.concatenate([part.base_from_hand for _, part in rows])[kept],
        np.concatenate([part.preshape for _, part in rows])[kept],
        np.concatenate([part.secure for _, part in rows])[kept],
    )
