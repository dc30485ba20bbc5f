"""Many trials in both engines: equal and different labels, reasons of the differences, and speed.

Poses are sampled at random around the objects (from above and from the sides, the palm near the surface), independently
of the planner. Both engines get the same arrays; a pose that is in collision at the start in either of them is counted
separately and not compared.

Trials with different labels are repeated in both engines at half their time step. If an engine then changes its label,
that label was numerically undecided and the difference says nothing about the model; otherwise the engines disagree.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

import graspbox
from graspbox import _core
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.validation.mujoco.description import Array, HandDescription, read_hand
from graspbox.validation.mujoco.replay import Outcome, replay
from graspbox.validation.mujoco.scene import Numerics, ObjectData, build

#: Easy and hard, light and heavy, round and square: the objects of the hold suite, and one of each procedural family.
DEFAULT_OBJECTS = (
    "ycb:006_mustard_bottle",
    "ycb:005_tomato_soup_can",
    "ycb:011_banana",
    "ycb:025_mug",
    "ycb:013_apple",
    "ycb:043_phillips_screwdriver",
    "ycb:035_power_drill",
    "ycb:048_hammer",
    "ycb:061_foam_brick",
    "ycb:065-d_cups",
    "procedural:0",
)
#: Poses are sampled in rounds until enough are feasible; after this many rounds the object is left out.
_MAX_ROUNDS = 20

Why = Literal["core undecided", "mujoco undecided", "both undecided", "engines disagree"]


@dataclass(frozen=True)
class Row:
    """One trial in both engines."""

    object: str
    success: bool
    failure: str
    lift: float
    mujoco: Outcome
    world_from_hand: Array
    object_from_hand: Array
    preshape: float
    #: Why the labels differ; None where they are equal.
    why: Why | None = None

    @property
    def equal(self) -> bool:
        """Whether both engines say success, or both do not."""
        return self.success == self.mujoco.success

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return {
            "object": self.object,
            "core": {"success": self.success, "failure": self.failure or None, "lift": self.lift},
            "mujoco": {
                "success": self.mujoco.success,
                "failure": self.mujoco.failure,
                "lift": self.mujoco.lift,
                "speed": self.mujoco.speed,
                "links_at_lift": self.mujoco.touching[0],
                "links_at_end": self.mujoco.touching[1],
                "depth": self.mujoco.depth,
            },
            "world_from_hand": self.world_from_hand.tolist(),
            "preshape": self.preshape,
            "why": self.why,
        }


@dataclass
class Report:
    """Result of a comparison."""

    rows: list[Row] = field(default_factory=list)
    #: Trials that MuJoCo finds in collision at the start.
    infeasible: int = 0
    #: Objects without enough feasible poses.
    left_out: list[str] = field(default_factory=list)
    #: Labels that the core's early stops changed; there should be none.
    early_stop_changed: int = 0
    threads: int = 1
    core_seconds: float = 0.0
    core_full_seconds: float = 0.0
    mujoco_seconds: float = 0.0

    @property
    def equal(self) -> int:
        """Trials with equal labels."""
        return sum(row.equal for row in self.rows)

    @property
    def share(self) -> float:
        """Share of equal labels."""
        return self.equal / len(self.rows) if self.rows else 0.0

    def _rate(self, seconds: float) -> float:
        return len(self.rows) / seconds if seconds > 0.0 else 0.0

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        different = [row for row in self.rows if not row.equal]
        kinds = Counter(f"{row.failure or 'success'} / {row.mujoco.failure or 'success'}" for row in different)
        return {
            "trials": len(self.rows),
            "equal": self.equal,
            "share": self.share,
            "core_success": sum(row.success for row in self.rows),
            "mujoco_success": sum(row.mujoco.success for row in self.rows),
            "infeasible_in_mujoco": self.infeasible,
            "left_out": self.left_out,
            "early_stop_changed": self.early_stop_changed,
            "threads": self.threads,
            "trials_per_s": {
                "core": self._rate(self.core_seconds),
                "core_without_early_stops": self._rate(self.core_full_seconds),
                "mujoco": self._rate(self.mujoco_seconds),
            },
            "by_kind": dict(kinds.most_common()),
            "by_why": dict(Counter(str(row.why) for row in different).most_common()),
            "by_object": dict(Counter(row.object for row in different).most_common()),
            "different": [row.to_json() for row in different],
        }


def object_data(scene: graspbox.Scene) -> ObjectData:
    """Take the object of a core scene at its resting pose."""
    body = scene.body
    return ObjectData(
        scene.name, body.parts, body.mass, body.center_of_mass, body.inertia, np.array(scene.world_from_object)
    )


def describe(hand: HandLike = "reflex") -> HandDescription:
    """Read a hand from the two files that the core read."""
    return read_hand(*load_hand(hand).files)


def random_preshape(random: np.random.Generator, hand: graspbox.Hand) -> float:
    """Sample a preshape: the greatest with probability 0.3, else one of the lower 38 % of the range.

    The greatest is a pinch of the ReFlex. Of named preshapes all are as likely.
    """
    low, high = hand.preshape_limits
    if hand.preshape_unit == "1":
        return float(random.integers(round(high) + 1))
    return high if random.random() < 0.3 else random.uniform(low, low + 0.6 / (0.5 * np.pi) * (high - low))


def random_pose(random: np.random.Generator, points: Array, center: Array, hand: graspbox.Hand) -> tuple[Array, float]:
    """Sample a hand pose from above or from a side, and a preshape.

    Parameters
    ----------
    points : (n, 3)
        Corners of the object's parts, world frame.
    center : (3,)
        Centre of mass, world frame.
    hand : Hand
        For its preshapes.

    Returns
    -------
    world_from_hand : (4, 4)
    preshape : float
        See `random_preshape`.
    """
    yaw = random.uniform(0.0, 2.0 * np.pi)
    side = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    gap = random.uniform(0.003, 0.02)
    pose = np.eye(4)
    if random.random() < 0.5:
        pose[:3, :3] = np.column_stack([side, np.cross([0.0, 0.0, -1.0], side), [0.0, 0.0, -1.0]])
        # Straight fingers of the ReFlex end 0.105 below the palm: nearer to the table they must fold on the way.
        height = max(points[:, 2].max() + gap, random.uniform(0.08, 0.115))
        pose[:3, 3] = [*(center[:2] + random.uniform(-0.015, 0.015, 2)), height]
    else:
        x = np.cross([0.0, 0.0, 1.0], side) if random.random() < 0.5 else np.array([0.0, 0.0, 1.0])
        x = x * random.choice([-1.0, 1.0])
        pose[:3, :3] = np.column_stack([x, np.cross(side, x), side])
        reach = float(((center - points) @ side).max())
        pose[:3, 3] = center - side * (reach + gap)
        # Half of the hand's base, and a little, above the table.
        pose[2, 3] = max(center[2], 0.075) + random.uniform(-0.01, 0.03)
    return pose, random_preshape(random, hand)


def sample_trials(scene: graspbox.Scene, count: int, random: np.random.Generator) -> tuple[Array, Array] | None:
    """Sample poses that are feasible in the core: (count, 4, 4) ``object_from_hand`` and (count,) preshapes."""
    rest = np.array(scene.world_from_object)
    body = scene.body
    points = np.concatenate(body.parts) @ rest[:3, :3].T + rest[:3, 3]
    center = rest[:3, :3] @ body.center_of_mass + rest[:3, 3]
    world_to_object = np.linalg.inv(rest)
    poses: list[Array] = []
    preshapes: list[float] = []
    # A short trial suffices to find out whether a pose is feasible.
    check = TrialConfig(close_time=0.1, lift_time=0.1, hold_time=0.5)
    for _ in range(_MAX_ROUNDS):
        sampled = [random_pose(random, points, center, scene.hand) for _ in range(count)]
        candidates = np.stack([world_to_object @ pose for pose, _ in sampled])
        found = scene.simulate(candidates, np.array([p for _, p in sampled]), config=check)
        for pose, (_, preshape), failure in zip(candidates, sampled, found.failure, strict=True):
            if failure != "infeasible" and len(poses) < count:
                poses.append(pose)
                preshapes.append(preshape)
        if len(poses) == count:
            return np.stack(poses), np.array(preshapes)
    return None


def _replay_all(
    hand: HandDescription, item: ObjectData, poses: Array, preshapes: Array, numerics: Numerics, threads: int
) -> Iterator[Outcome]:
    scene = build(hand, item, numerics=numerics)
    with ThreadPoolExecutor(threads) as pool:
        # MuJoCo releases the interpreter's lock while it steps.
        yield from pool.map(lambda pair: replay(scene, pair[0], float(pair[1])), zip(poses, preshapes, strict=True))


def _why(scene: graspbox.Scene, hand: HandDescription, row: Row, numerics: Numerics) -> Why:
    """Run both engines at half their time step."""
    physics = PhysicsConfig()
    half = graspbox.Scene(scene.mesh, hand=scene.hand, physics=replace(physics, dt=0.5 * physics.dt))
    again = half.simulate(row.object_from_hand[None], np.array([row.preshape]))
    # The same object at rest: only the time step differs.
    item = object_data(half)
    fine = build(hand, item, numerics=replace(numerics, timestep=0.5 * numerics.timestep))
    theirs = replay(fine, item.world_from_object @ row.object_from_hand, row.preshape)
    core, mujoco = bool(again.success[0]) != row.success, theirs.success != row.mujoco.success
    if core and mujoco:
        return "both undecided"
    if core:
        return "core undecided"
    return "mujoco undecided" if mujoco else "engines disagree"


def compare(
    objects: Sequence[str] = DEFAULT_OBJECTS,
    trials: int = 200,
    seed: int = 0,
    *,
    hand: HandLike = "reflex",
    threads: int | None = None,
    numerics: Numerics | None = None,
    explain: bool = True,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Judge `trials` feasible random grasps, spread evenly over the objects, in both engines.

    Parameters
    ----------
    objects : sequence of str
        Object sets.
    trials : int
        Number of trials, at least one.
    seed : int
        Seed of the poses.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    threads : int, optional
        For both engines; by default as many as the core would use.
    numerics : Numerics, optional
        MuJoCo's settings.
    explain : bool
        Repeat trials with different labels at half the time step.
    progress : callable, optional
        Called after each object with the number of finished trials.

    Raises
    ------
    ConfigError
        If there are no trials, or MuJoCo's time step is not positive.
    """
    numerics = numerics or Numerics()
    if trials < 1:
        raise ConfigError(f"trials is {trials}; give 1 or more")
    if not 0.0 < numerics.timestep <= 0.01:
        raise ConfigError(f"timestep is {numerics.timestep}; give at most 0.01 s")
    specs = graspbox.object_sets.load(list(objects))
    loaded = load_hand(hand)
    described = describe(loaded)
    report = Report(threads=threads or _core.num_threads())
    share, rest = divmod(trials, len(specs))
    done = 0
    for number, spec in enumerate(specs):
        count = share + (number < rest)
        if count == 0:
            continue
        scene = graspbox.Scene(spec.load(), hand=loaded)
        sampled = sample_trials(scene, count, np.random.default_rng([seed, number]))
        done += count
        if sampled is None:
            report.left_out.append(spec.name)
        else:
            rows = _judge(report, scene, described, sampled, numerics)
            if explain:
                rows = [row if row.equal else replace(row, why=_why(scene, described, row, numerics)) for row in rows]
            report.rows += rows
        if progress is not None:
            progress(done)
    return report


def _judge(
    report: Report, scene: graspbox.Scene, hand: HandDescription, sampled: tuple[Array, Array], numerics: Numerics
) -> list[Row]:
    poses, preshapes = sampled
    item = object_data(scene)
    clock = time.perf_counter
    begin = clock()
    ours = scene.simulate(poses, preshapes, num_threads=report.threads)
    early = clock()
    full = scene.simulate(poses, preshapes, config=TrialConfig(early_stop=False), num_threads=report.threads)
    middle = clock()
    world_poses = item.world_from_object @ poses
    theirs = list(_replay_all(hand, item, world_poses, preshapes, numerics, report.threads))
    report.mujoco_seconds += clock() - middle
    report.core_full_seconds += middle - early
    report.core_seconds += early - begin
    report.early_stop_changed += int(np.sum(full.success != ours.success))
    rows = []
    for i, outcome in enumerate(theirs):
        if outcome.failure == "infeasible":
            report.infeasible += 1
            continue
        rows.append(
            Row(
                object=scene.name,
                success=bool(ours.success[i]),
                failure=str(ours.failure[i]),
                lift=float(ours.lift[i]),
                mujoco=outcome,
                world_from_hand=world_poses[i],
                object_from_hand=poses[i],
                preshape=float(preshapes[i]),
            )
        )
    return rows
