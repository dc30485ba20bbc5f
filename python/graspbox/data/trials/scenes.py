"""One scene of a data set: an object at rest, its candidates, their trials, and the resulting rows."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict
from graspbox._core import Hand, Mesh
from graspbox.data.trials import candidates as sources
from graspbox.data.trials.candidates import HandGeometry, Poses, Surface
from graspbox.data.trials.resting import RestingScene, settle_among, settle_single
from graspbox.data.trials.settings import DatasetConfig
from graspbox.errors import PlanError
from graspbox.object_sets import ObjectSpec
from graspbox.planning import plan
from graspbox.planning.plan_files import mesh_hash
from graspbox.simulation.outcomes import Outcomes

__all__ = ["GroupedObject", "SceneTask", "label", "scene_seed", "tasks_of"]

Floats = NDArray[np.float64]

#: Rounds of candidates before a source counts as exhausted, and candidates made per requested one.
_ROUNDS, _SURPLUS = 6, 4
#: Sources that replace one with too few poses, in this order.
_SUBSTITUTES = ("planner", "normal", "random")


@dataclass(frozen=True)
class GroupedObject:
    """An object, its group of near-duplicates, the split of the group, and the hash of its mesh file, if it has one."""

    spec: ObjectSpec
    group: str
    split: str
    file_sha256: str | None = None


@dataclass(frozen=True)
class SceneTask:
    """A scene to label: its target, the number of the scene in 0 .. `DatasetConfig.rests` - 1, and other objects."""

    target: GroupedObject
    rest: int
    others: tuple[ObjectSpec, ...] = ()

    @property
    def name(self) -> str:
        """Name of the scene in the rows."""
        return f"{self.target.spec.name}/{self.rest}"


def _entropy(seed: int, *names: str | int) -> int:
    digest = hashlib.sha256("\n".join(map(str, (seed, *names))).encode()).digest()
    return int.from_bytes(digest[:8], "little")


def scene_seed(config: DatasetConfig, task: SceneTask) -> int:
    """Seed of a scene: a function of the data set's seed, the object's name and the number of the resting pose."""
    return _entropy(config.seed, task.target.spec.name, task.rest)


def tasks_of(objects: list[GroupedObject], config: DatasetConfig) -> list[SceneTask]:
    """List the scenes of the objects of one split, in their order.

    In a scene of several objects the others are drawn from the same split, none twice if there are enough.
    """
    tasks = [SceneTask(target, rest) for target in objects for rest in range(config.rests)]
    return tasks if config.layout == "single" else [_with_others(task, objects, config) for task in tasks]


def _with_others(task: SceneTask, objects: list[GroupedObject], config: DatasetConfig) -> SceneTask:
    rng = np.random.default_rng(_entropy(scene_seed(config, task), "others"))
    least, most = config.objects_per_scene
    count = int(rng.integers(least, most + 1)) - 1
    others = [other.spec for other in objects if other != task.target] or [task.target.spec]
    chosen = rng.choice(len(others), size=count, replace=count > len(others))
    return replace(task, others=tuple(others[int(index)] for index in chosen))


@dataclass
class _Candidates:
    """Candidates of a scene, collected source by source; ranks and scores are those of the planner's poses."""

    parts: list[Poses] = field(default_factory=list)
    source: list[str] = field(default_factory=list)
    rank: list[int | None] = field(default_factory=list)
    score: list[float | None] = field(default_factory=list)

    def add(self, source: str, poses: Poses, ranks: list[int] | None = None, scores: list[float] | None = None) -> int:
        """Add poses of a source; return their number."""
        count = len(poses.preshape)
        self.parts.append(poses)
        self.source += [source] * count
        self.rank += ranks or [None] * count
        self.score += scores or [None] * count
        return count


class _Labeller:
    """Makes the rows of one scene."""

    def __init__(
        self,
        task: SceneTask,
        load: Callable[[ObjectSpec], Mesh],
        hand: Hand,
        geometry: HandGeometry,
        config: DatasetConfig,
    ) -> None:
        self.task, self.hand, self.geometry, self.config = task, hand, geometry, config
        self.seed = scene_seed(config, task)
        self.rng = np.random.default_rng(self.seed)
        self.mesh = load(task.target.spec)
        self.resting = self._settle(load)
        self.scene = self.resting.scene
        self.object_from_world = np.linalg.inv(self.scene.world_from_object)
        self.surface = Surface.of(self.scene, int(self.rng.integers(2**63)))
        self._plan: Any = None
        self._unused = np.arange(0)

    def _settle(self, load: Callable[[ObjectSpec], Mesh]) -> RestingScene:
        spec, config = self.task.target.spec, self.config
        if config.layout != "single":
            return settle_among([spec, *self.task.others], load, self.hand, config, self.rng)
        # One offset per object spreads its scenes evenly over the probabilities.
        offset = _entropy(config.seed, spec.name, "rests") / 2**64
        share = (self.task.rest + offset) / config.rests
        return settle_single(spec.name, self.mesh, self.hand, config, share, self.rng)

    def _in_object(self, world_from_hand: Floats) -> Floats:
        return np.ascontiguousarray(self.object_from_world @ world_from_hand)

    def _sample(self, make: Callable[[int], Poses], count: int) -> Poses:
        """Make `count` poses that pass the planner's collision filter, or fewer after a few rounds."""
        planning, free, have = self.config.planning, list[Poses](), 0
        for _ in range(_ROUNDS):
            if have >= count:
                break
            made = make(min(_SURPLUS * (count - have) + 8, 4096))
            margins = {"clearance": planning.clearance, "standoff": planning.standoff}
            object_from_hand = self._in_object(made.world_from_hand)
            passed = self.scene.check(object_from_hand, made.preshape, **margins, num_threads=1)
            free.append(made.chosen(passed))
            have += len(free[-1].preshape)
        return Poses.joined(free).chosen(slice(count))

    def _planned(self, candidates: _Candidates, count: int) -> int:
        """Add poses of the plan: half the best remaining ones, half at random; return their number."""
        if self._plan is None:
            self._plan = plan(
                self.scene.mesh,
                hand=self.hand,
                seed=int(self.rng.integers(2**63)),
                world_from_object=self.scene.world_from_object,
                config=self.config.planning,
                num_threads=1,
                neighbours=self.resting.around,
            ).best()
            self._unused = np.arange(len(self._plan))
        best, others = np.split(self._unused, [min((count + 1) // 2, len(self._unused))])
        picked = self.rng.permutation(len(others))[: count - len(best)]
        rows = np.concatenate([best, np.sort(others[picked])])
        self._unused = np.setdiff1d(self._unused, rows)
        poses = Poses(self.scene.world_from_object @ self._plan.poses[rows], self._plan.preshape[rows])
        return candidates.add("planner", poses, rows.tolist(), self._plan.score[rows].tolist())

    def _add(self, candidates: _Candidates, source: str, count: int) -> int:
        """Add up to `count` poses of a source; return their number."""
        if source == "planner":
            return self._planned(candidates, count)
        make = sources.SOURCES[source]
        poses = self._sample(lambda n: make(self.surface, self.geometry, n, self.rng), count)
        return candidates.add(source, poses)

    def _fill(self, candidates: _Candidates, missing: int) -> None:
        for source in _SUBSTITUTES:
            if missing > 0:
                missing -= self._add(candidates, source, missing)

    def run(self) -> dict[str, Any]:
        """Collect candidates, try them, and return the columns."""
        counts = _quotas(self.config)
        jitter = counts.pop("jitter")
        first = _Candidates()
        missing = sum(count - self._add(first, source, count) for source, count in counts.items() if count)
        self._fill(first, missing)
        if not first.source:
            raise PlanError(f"no candidate pose of {self.task.name} is free of collision")
        tried = self._try(first)
        parts = [tried]
        if jitter:
            second, won = _Candidates(), tried["success"]
            if won.any():
                good = Poses.joined(first.parts).chosen(won)
                second.add("jitter", self._sample(lambda n: sources.jittered(good, n, self.rng), jitter))
            self._fill(second, jitter - len(second.source))
            parts.append(self._try(second))
        return self._complete({name: _joined([part[name] for part in parts]) for name in tried})

    def _trials(self, nominal: Poses) -> tuple[Floats, Floats, Outcomes]:
        """Try each pose once with its own error, friction and mass: executed poses, factors (n, 2), outcomes."""
        config, count = self.config, len(nominal.preshape)
        executed = sources.deviated(nominal.world_from_hand, config.hand_position, config.hand_rotation, self.rng)
        factors = np.stack([self.rng.uniform(*bounds, count) for bounds in (config.friction, config.mass)], axis=1)
        outcomes = self.scene.simulate(
            self._in_object(executed),
            nominal.preshape,
            friction=factors[:, 0],
            mass=factors[:, 1],
            config=config.trial,
            num_threads=1,
        )
        return executed, factors, outcomes

    def _try(self, candidates: _Candidates) -> dict[str, Any]:
        nominal = Poses.joined(candidates.parts)
        executed, factors, outcomes = self._trials(nominal)
        count = len(nominal.preshape)
        replays = self.config.replays if self.task.target.split != "train" else 0
        wins = np.zeros((2, count), np.int64)
        for _ in range(replays):
            again = self._trials(nominal)[2]
            wins += np.stack([again.success, again.secure])
        mass = self.scene.mesh.mass
        return {
            "object_from_hand": self._in_object(nominal.world_from_hand),
            "world_from_hand": nominal.world_from_hand,
            "executed_object_from_hand": self._in_object(executed),
            "executed_world_from_hand": executed,
            "preshape": nominal.preshape,
            "friction_factor": factors[:, 0],
            "friction": factors[:, 0] * self.config.physics.friction.object,
            "mass_factor": factors[:, 1],
            "mass": factors[:, 1] * mass,
            **{f.name: getattr(outcomes, f.name) for f in fields(outcomes)},
            "candidate": candidates.source,
            "rank": candidates.rank,
            "score": candidates.score,
            "replays": np.full(count, replays),
            "replay_successes": wins[0],
            "replay_secure": wins[1],
        }

    def _complete(self, columns: dict[str, Any]) -> dict[str, Any]:
        """Add the columns that are constant over the scene."""
        target, count = self.task.target, len(columns["preshape"])
        rest, view_seed = self.scene.world_from_object, _entropy(self.seed, "views")
        same = {
            "scene": self.task.name,
            "object": target.spec.name,
            "source": target.spec.source,
            "group": target.group,
            "split": target.split,
            "sha256": mesh_hash(self.mesh),
            "scale": target.spec.scale,
            "layout": self.config.layout,
            "size_factor": self.resting.size_factor,
            "world_from_object": rest,
            "neighbours": self.resting.neighbours,
            "walls": self.resting.walls,
            "hand": self.hand.name,
            "seed": self.seed,
            "view_seed": view_seed,
            "fov": self.config.fov,
            "world_from_camera": self._cameras(view_seed),
        }
        return {**columns, "trial": np.arange(count), **{name: [value] * count for name, value in same.items()}}

    def _cameras(self, seed: int) -> Floats:
        """Poses of the cameras around the middle of the object's bounds: (V, 4, 4)."""
        points = self.scene.mesh.vertices @ self.scene.world_from_object[:3, :3].T + self.scene.world_from_object[:3, 3]
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        return _core.camera_poses(config_dict(self.config.cameras), middle.tolist(), self.config.views, seed)


def _quotas(config: DatasetConfig) -> dict[str, int]:
    """Trials of each source: whole numbers that sum to `poses`, by the largest remainders."""
    shares = {f.name: getattr(config.candidates, f.name) * config.poses for f in fields(config.candidates)}
    counts = {name: int(share) for name, share in shares.items()}
    by_remainder = sorted(shares, key=lambda name: counts[name] - shares[name])
    for name in by_remainder[: config.poses - sum(counts.values())]:
        counts[name] += 1
    return counts


def _joined(parts: list[Any]) -> Any:
    if isinstance(parts[0], list):
        return [item for part in parts for item in part]
    return np.concatenate(parts)


def label(
    task: SceneTask, load: Callable[[ObjectSpec], Mesh], hand: Hand, geometry: HandGeometry, config: DatasetConfig
) -> tuple[dict[str, Any], RestingScene]:
    """Label one scene: return the columns of `graspbox.data.trials.schema.TRIALS`, of equal length, and the scene.

    The error of an object that cannot be simulated or planned for is raised.
    """
    labeller = _Labeller(task, load, hand, geometry, config)
    return labeller.run(), labeller.resting
