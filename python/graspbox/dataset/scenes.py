"""One scene of a data set: an object at rest, its candidates, their trials, and the resulting rows."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import to_json
from graspbox._core import Hand, Mesh
from graspbox.dataset import candidates as sources
from graspbox.dataset.candidates import HandGeometry, Poses, Surface
from graspbox.dataset.resting import RestingScene, settle_alone, settle_among
from graspbox.dataset.settings import DatasetConfig
from graspbox.errors import PlanError
from graspbox.object_sets import ObjectSpec
from graspbox.outcomes import Outcomes
from graspbox.planning import plan
from graspbox.planning.plan_files import mesh_hash

__all__ = ["SceneTask", "Subject", "label", "scene_seed", "tasks_of"]

Floats = NDArray[np.float64]

#: Rounds of candidates before a source counts as exhausted, and candidates made per requested one.
_ROUNDS, _SURPLUS = 6, 4
#: Sources that replace one that finds too few poses, in this order.
_STAND_INS = ("planner", "normal", "random")


@dataclass(frozen=True)
class Subject:
    """An object and its identification in the rows.

    Attributes
    ----------
    spec : ObjectSpec
        Source of its mesh.
    group, split : str
        Group of near-duplicates, and the split of the group.
    """

    spec: ObjectSpec
    group: str
    split: str


@dataclass(frozen=True)
class SceneTask:
    """A scene to label: a subject, the number of its scene in 0 .. `DatasetConfig.rests` - 1, and other objects."""

    subject: Subject
    rest: int
    others: tuple[ObjectSpec, ...] = ()

    @property
    def name(self) -> str:
        """Name of the scene in the rows."""
        return f"{self.subject.spec.name}/{self.rest}"


def _entropy(seed: int, *names: str | int) -> int:
    digest = hashlib.sha256("\n".join(map(str, (seed, *names))).encode()).digest()
    return int.from_bytes(digest[:8], "little")


def scene_seed(config: DatasetConfig, task: SceneTask) -> int:
    """Seed of a scene: a function of the data set's seed, the object's name and the number of the resting pose."""
    return _entropy(config.seed, task.subject.spec.name, task.rest)


def tasks_of(subjects: list[Subject], config: DatasetConfig) -> list[SceneTask]:
    """List the scenes of the objects of one split, in their order.

    In a scene of several objects the others are drawn from the same split, none twice if there are enough.
    """
    tasks = [SceneTask(subject, rest) for subject in subjects for rest in range(config.rests)]
    return tasks if config.layout == "single" else [_among(task, subjects, config) for task in tasks]


def _among(task: SceneTask, subjects: list[Subject], config: DatasetConfig) -> SceneTask:
    rng = np.random.default_rng(_entropy(scene_seed(config, task), "others"))
    least, most = config.objects_per_scene
    count = int(rng.integers(least, most + 1)) - 1
    others = [subject.spec for subject in subjects if subject != task.subject] or [task.subject.spec]
    chosen = rng.choice(len(others), size=count, replace=count > len(others))
    return replace(task, others=tuple(others[int(index)] for index in chosen))


@dataclass
class _Found:
    """Candidates of a scene, collected source by source: `world_from_hand`, preshape, source, rank and score."""

    poses: list[Floats] = field(default_factory=list)
    preshape: list[Floats] = field(default_factory=list)
    source: list[str] = field(default_factory=list)
    rank: list[int | None] = field(default_factory=list)
    score: list[float | None] = field(default_factory=list)

    def add(self, source: str, found: Poses, ranks: list[int] | None = None, scores: list[float] | None = None) -> None:
        count = len(found.preshape)
        self.poses.append(found.world_from_hand)
        self.preshape.append(found.preshape)
        self.source += [source] * count
        self.rank += ranks or [None] * count
        self.score += scores or [None] * count

    def all(self) -> Poses:
        return Poses(np.concatenate([np.zeros((0, 4, 4)), *self.poses]), np.concatenate([np.zeros(0), *self.preshape]))


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
        self.mesh = load(task.subject.spec)
        self.resting = self._settle(load)
        self.scene = self.resting.scene
        self.object_from_world = np.linalg.inv(self.scene.world_from_object)
        self.surface = Surface.of(self.scene, int(self.rng.integers(2**63)))
        self._plan: Any = None
        self._unused: NDArray[np.int64] | None = None

    def _settle(self, load: Callable[[ObjectSpec], Mesh]) -> RestingScene:
        spec, config = self.task.subject.spec, self.config
        if config.layout != "single":
            return settle_among([spec, *self.task.others], load, self.hand, config, self.rng)
        # One offset per object spreads its scenes evenly over the probabilities.
        offset = _entropy(config.seed, spec.name, "rests") / 2**64
        share = (self.task.rest + offset) / config.rests
        return settle_alone(spec.name, self.mesh, self.hand, config, share, self.rng)

    def _in_object(self, world_from_hand: Floats) -> Floats:
        return np.ascontiguousarray(self.object_from_world @ world_from_hand)

    def _free(self, found: Poses) -> Poses:
        """Keep the poses that pass the planner's collision filter."""
        planning = self.config.planning
        passed = self.scene.check(
            self._in_object(found.world_from_hand),
            found.preshape,
            clearance=planning.clearance,
            standoff=planning.standoff,
            num_threads=1,
        )
        return Poses(found.world_from_hand[passed], found.preshape[passed])

    def _made(self, make: Any, count: int) -> Poses:
        """Make `count` poses that pass the collision filter, or fewer after a few rounds."""
        kept: list[Poses] = []
        have = 0
        for _ in range(_ROUNDS):
            if have >= count:
                break
            kept.append(self._free(make(min(_SURPLUS * (count - have) + 8, 4096))))
            have += len(kept[-1].preshape)
        poses = np.concatenate([np.zeros((0, 4, 4)), *(k.world_from_hand for k in kept)])[:count]
        return Poses(poses, np.concatenate([np.zeros(0), *(k.preshape for k in kept)])[:count])

    def _planned(self, found: _Found, count: int) -> int:
        """Add poses of the plan: half the best remaining ones, half at random."""
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
        assert self._unused is not None
        best, others = np.split(self._unused, [min((count + 1) // 2, len(self._unused))])
        picked = self.rng.permutation(len(others))[: count - len(best)]
        chosen = np.concatenate([best, np.sort(others[picked])])
        self._unused = np.setdiff1d(self._unused, chosen)
        poses = self.scene.world_from_object @ self._plan.poses[chosen]
        found.add(
            "planner",
            Poses(poses, self._plan.preshape[chosen]),
            ranks=chosen.tolist(),
            scores=self._plan.score[chosen].tolist(),
        )
        return len(chosen)

    def _add(self, found: _Found, source: str, count: int) -> int:
        """Add up to `count` poses of a source; return how many."""
        if source == "planner":
            return self._planned(found, count)
        make = sources.SOURCES[source]
        made = self._made(lambda n: make(self.surface, self.geometry, n, self.rng), count)
        found.add(source, made)
        return len(made.preshape)

    def _fill(self, found: _Found, missing: int) -> None:
        for source in _STAND_INS:
            if missing > 0:
                missing -= self._add(found, source, missing)

    def run(self) -> dict[str, Any]:
        """Collect candidates, try them, and return the columns."""
        counts = _quotas(self.config)
        jitter = counts.pop("jitter")
        first = _Found()
        missing = sum(count - self._add(first, source, count) for source, count in counts.items() if count)
        self._fill(first, missing)
        if not first.source:
            raise PlanError(f"no candidate pose of {self.task.name} is free of collision")
        tried = self._try(first)
        columns = [tried]
        if jitter:
            second, won, nominal = _Found(), tried["success"], first.all()
            good = Poses(nominal.world_from_hand[won], nominal.preshape[won])
            if won.any():
                second.add("jitter", self._made(lambda n: sources.jittered(good, n, self.rng), jitter))
            self._fill(second, jitter - len(second.source))
            columns.append(self._try(second))
        merged = {name: _joined([part[name] for part in columns]) for name in tried}
        return self._complete(merged)

    def _trials(self, nominal: Poses) -> tuple[Floats, Floats, Outcomes]:
        """Try each pose once with its own error, friction and mass: executed poses, factors (n, 2), outcomes."""
        config, count = self.config, len(nominal.preshape)
        executed = sources.deviated(nominal.world_from_hand, config.hand_position, config.hand_rotation, self.rng)
        factors = np.stack(
            [self.rng.uniform(*config.friction, count), self.rng.uniform(*config.mass, count)],
            axis=1,
        )
        outcomes = self.scene.simulate(
            self._in_object(executed),
            nominal.preshape,
            friction=factors[:, 0],
            mass=factors[:, 1],
            config=config.trial,
            num_threads=1,
        )
        return executed, factors, outcomes

    def _try(self, found: _Found) -> dict[str, Any]:
        nominal = found.all()
        executed, factors, outcomes = self._trials(nominal)
        count = len(nominal.preshape)
        replays = self.config.replays if self.task.subject.split != "train" else 0
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
            "candidate": found.source,
            "rank": found.rank,
            "score": found.score,
            "replays": np.full(count, replays),
            "replay_successes": wins[0],
            "replay_secure": wins[1],
        }

    def _complete(self, columns: dict[str, Any]) -> dict[str, Any]:
        """Add the columns that are constant over the scene."""
        subject, count = self.task.subject, len(columns["preshape"])
        rest, view_seed = self.scene.world_from_object, _entropy(self.seed, "views")
        same = {
            "scene": self.task.name,
            "object": subject.spec.name,
            "source": subject.spec.source,
            "group": subject.group,
            "split": subject.split,
            "sha256": mesh_hash(self.mesh),
            "scale": subject.spec.scale,
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
        return _core.camera_poses(to_json(self.config.cameras), middle.tolist(), self.config.views, seed)


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
    task: SceneTask,
    load: Callable[[ObjectSpec], Mesh],
    hand: Hand,
    geometry: HandGeometry,
    config: DatasetConfig,
) -> tuple[dict[str, Any], RestingScene]:
    """Label one scene.

    Returns
    -------
    dict
        The columns of `graspbox.dataset.schema.TRIALS` by name, as arrays or lists of equal length.
    RestingScene
        The scene.

    Raises
    ------
    SimulationError, PlanError, MeshError
        If the object cannot be simulated or planned for.
    """
    labeller = _Labeller(task, load, hand, geometry, config)
    return labeller.run(), labeller.resting
