"""Grasps by whole arms in both engines, and whether MuJoCo's arm holds what the core's holds.

The core's verdict is that of ``GraspPose-v0`` with the arm. The same path is followed in MuJoCo by `arm_replay`, and
the same grasp is tried there by a hand without an arm (`replay`): a difference that the hand alone also has is one of
the engines, another one is the arm's.

Nearly all grasps of a planner hold, and two engines that always say so agree. So half of the trials fail in the core,
if enough are found, unless the first grasps are asked for, as they come.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox import _core, arms, object_sets
from graspbox.arms import Trajectory
from graspbox.configs import PathConfig, TrialConfig
from graspbox.envs.coding import codec
from graspbox.errors import ConfigError, PathError
from graspbox.evaluation.results import wilson
from graspbox.hands.description import Array
from graspbox.tools.scene_export.contents import object_data
from validation.agreement import kappa
from validation.mujoco.arm_replay import ArmOutcome, build_arm, replay_arm
from validation.mujoco.compare import check_patch, check_settings, describe
from validation.mujoco.replay import Outcome, replay
from validation.mujoco.report import Agreement
from validation.mujoco.scene import Numerics, build

__all__ = ["SAME", "ArmTrial", "VerdictReport", "VerdictRow", "compare_arm", "sample_arm_trials"]

#: Least share of trials with the same verdict.
SAME = 0.97
#: Grasps among which a trial's is drawn: the planner's best feasible ones.
_BEST = 30
#: Grasps that are tried per reset; at most one success and one failure of them are kept.
_TRIED = 6
#: Resets per wanted trial after which fewer trials are made.
_RESETS = 20
_ENV = "graspbox/GraspPose-v0"


@dataclass(frozen=True, eq=False)
class ArmTrial:
    """A grasp that an arm executed in the core.

    Attributes
    ----------
    scene : Scene
        The object at rest, and the hand.
    world_from_hand : (4, 4) float64
        The grasp, metres.
    path : Trajectory
        The arm's path to it, and up.
    success : bool
        The core's verdict.
    failure : str
        Kind of its failure; empty for a success.
    """

    scene: graspbox.Scene
    world_from_hand: Array
    path: Trajectory
    success: bool
    failure: str


@dataclass(frozen=True)
class VerdictRow:
    """Verdicts of one trial: those of the core, of MuJoCo's arm, and of MuJoCo's hand without an arm."""

    object: str
    success: bool
    failure: str
    arm: ArmOutcome
    free: Outcome

    @property
    def equal(self) -> bool:
        """Whether core and MuJoCo's arm have the same verdict."""
        return self.success == self.arm.trial.success

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON types."""
        outcomes = {"arm": self.arm.trial, "free": self.free}
        return {
            "object": self.object,
            "core": self.failure or "success",
            **{name: outcome.failure or "success" for name, outcome in outcomes.items()},
            **{f"{name}_lift": outcome.lift for name, outcome in outcomes.items()},
            **{f"{name}_speed": outcome.speed for name, outcome in outcomes.items()},
            "distance": self.arm.distance,
        }


@dataclass
class VerdictReport(Agreement):
    """Verdicts of the trials of one arm with its hand.

    Attributes
    ----------
    arm, hand : str
        Their names.
    executed : Counter of bool
        Grasps that the core executed until it had these trials, by success.
    rows : list of VerdictRow
        The trials.
    """

    arm: str
    hand: str
    executed: Counter[bool] = field(default_factory=Counter)
    rows: list[VerdictRow] = field(default_factory=list)

    def labels(self) -> dict[str, NDArray[np.bool_]]:
        """Return the verdicts by what gave them."""
        rows = self.rows
        labels = {
            "core": [row.success for row in rows],
            "arm": [row.arm.trial.success for row in rows],
            "free": [row.free.success for row in rows],
        }
        return {name: np.array(values, dtype=bool) for name, values in labels.items()}

    def confusion(self, other: str) -> dict[str, int]:
        """Count trials by the verdicts of the core and of MuJoCo's ``arm`` or ``free`` hand, ``core, MuJoCo``."""
        labels, words = self.labels(), {True: "success", False: "failure"}
        pairs = Counter(zip(labels["core"].tolist(), labels[other].tolist(), strict=True))
        return {f"{words[a]}, {words[b]}": pairs[a, b] for a in (True, False) for b in (True, False)}

    @property
    def unselected(self) -> float:
        """Share of equal verdicts to expect of grasps that are not selected by their success; NaN if unknown."""
        executed, total = self.executed, self.executed.total()
        share = 0.0
        for success in (True, False):
            rows = [row.equal for row in self.rows if row.success is success]
            if executed[success] and not rows:
                return float("nan")
            share += executed[success] / total * float(np.mean(rows)) if rows else 0.0
        return share if total else float("nan")

    def by_cause(self) -> dict[str, int]:
        """Count different verdicts: ``engines`` if the hand without an arm differs from the core too, else ``arm``."""
        rows = [row for row in self.rows if not row.equal]
        engines = sum(row.free.success != row.success for row in rows)
        return {"engines": engines, "arm": len(rows) - engines}

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON types."""
        labels, rows = self.labels(), self.rows
        pairs = (("core", "arm"), ("core", "free"), ("free", "arm"))
        return {
            "arm": self.arm,
            "hand": self.hand,
            "trials": len(rows),
            "executed": {"success": self.executed[True], "failure": self.executed[False]},
            "equal": self.equal,
            "share": self.share,
            "ci95": list(wilson(self.equal, len(rows))),
            "unselected": self.unselected,
            "agreements": {
                f"{a} / {b}": {"share": float(np.mean(labels[a] == labels[b])), "kappa": kappa(labels[a], labels[b])}
                for a, b in pairs
                if rows
            },
            "confusion": {name: self.confusion(name) for name in ("arm", "free")},
            "by_cause": self.by_cause(),
            "distance": max((row.arm.distance for row in rows), default=0.0),
            "angle": max((float(np.degrees(row.arm.angle)) for row in rows), default=0.0),
            "torque": max((row.arm.torque for row in rows), default=0.0),
            "touched": sum(row.arm.touched for row in rows),
            "different": [row.to_json() for row in rows if not (row.equal and row.free.success == row.success)],
        }


def sample_arm_trials(
    arm: arms.Arm,
    hand: graspbox.Hand,
    objects: Sequence[str],
    trials: int,
    seed: int,
    executed: Counter[bool],
    *,
    first: bool = False,
) -> Iterator[tuple[Array, ArmTrial]]:
    """Yield the pose of an arm's base and a trial, half of them successes in the core, while enough are found.

    Every reset of ``GraspPose-v0`` has the next object at another place, and another seed; `executed` counts all
    grasps that the core executed, by success. With `first` every reset gives one trial: the planner's best grasp that
    the arm executes.
    """
    specs, wanted = object_sets.load(list(objects)), {True: trials - trials // 2, False: trials // 2}
    order = np.random.default_rng(seed).permutation(len(specs))
    for number in range(_RESETS * trials):
        if executed.total() == trials if first else not any(wanted.values()):
            return
        spec = specs[int(order[number % len(specs)])]
        env: Any = gymnasium.make(
            _ENV, objects=spec.source, scale=spec.scale, mass=spec.mass, arm=arm, hand=hand, obs="state"
        ).unwrapped
        kept: set[bool] = set()
        for trial in _executed(env, arm, hand, seed + number, ranked=first):
            executed[trial.success] += 1
            if first or (wanted[trial.success] and trial.success not in kept):
                kept.add(trial.success)
                wanted[trial.success] -= 1
                yield env.world_from_arm, trial
            if first:
                break
        env.close()


def _executed(env: Any, arm: arms.Arm, hand: graspbox.Hand, seed: int, *, ranked: bool) -> Iterator[ArmTrial]:
    """Execute some of the planner's grasps of the object of a reset; all in their order if `ranked`."""
    coder = codec("grasp_pose", hand)
    state, _ = env.reset(seed=seed)
    saved, pose = env.get_state(), coder.pose(state, "object")
    mesh = env.objects[0].load()
    plan = graspbox.plan(mesh, hand=hand, world_from_object=pose, seed=seed)
    plan = plan[plan.feasible][:_BEST]
    config = PathConfig(standoff=TrialConfig.standoff, lift=TrialConfig.lift_height)
    order = np.arange(len(plan)) if ranked else np.random.default_rng(seed).permutation(len(plan))[:_TRIED]
    for index in order:
        action = coder.encode_action(pose @ plan.poses[index], float(plan.preshape[index]))
        env.set_state(saved)
        *_, info = env.step(action)
        if info["infeasible"]:
            continue
        world_from_hand, preshape = coder.decode_grasp(action)
        try:
            path = arms.plan_path(
                arm, hand, world_from_hand, preshape, env.world_from_arm, target=(mesh, pose), config=config
            )
        except PathError:
            # At the edge of what is reached the pose of forward kinematics has a path, and this one has none.
            continue
        scene = graspbox.Scene(mesh, hand=hand, world_from_object=pose)
        yield ArmTrial(scene, world_from_hand, path, bool(info["is_success"]), str(info["failure"]))


def compare_arm(
    arm: str,
    hand: str,
    objects: Sequence[str],
    trials: int,
    seed: int = 0,
    *,
    first: bool = False,
    threads: int | None = None,
    numerics: Numerics | None = None,
    patch: float = 0.0,
    progress: Callable[[int], None] = lambda _: None,
) -> VerdictReport:
    """Execute grasps with a whole arm in the core and in MuJoCo.

    Parameters
    ----------
    arm, hand : str
        Their names.
    objects : sequence of str
        Object sets.
    trials : int
        Number of trials, at least two; half of them are failures in the core, if so many are found.
    seed : int
        Seed of the objects' poses and of the grasps.
    first : bool
        Whether to execute the planner's best grasps as they come, whether they hold or not.
    threads : int, optional
        Number of threads; by default that of the core.
    numerics : Numerics, optional
        MuJoCo's settings.
    patch : float
        Mean distance of a contact area from its middle, metres; 0 for points.
    progress : callable
        Called with the number of finished trials.

    Raises
    ------
    ConfigError
        If an argument is wrong.
    """
    numerics = numerics or Numerics()
    check_settings(trials, numerics)
    check_patch(patch)
    loaded, carried = arms.load_arm(arm), graspbox.load_hand(hand)
    described, report = describe(carried), VerdictReport(loaded.name, carried.name)

    def judge(base: Array, trial: ArmTrial) -> VerdictRow:
        item = object_data(trial.scene)
        outcome = replay_arm(build_arm(loaded, carried, item, numerics, patch=patch), base, trial.path)
        free = replay(
            build(described, item, numerics=numerics, patch=patch), trial.world_from_hand, trial.path.preshape
        )
        return VerdictRow(trial.scene.name, trial.success, trial.failure, outcome, free)

    cases = sample_arm_trials(loaded, carried, objects, trials, seed, report.executed, first=first)
    with ThreadPoolExecutor(threads or _core.num_threads()) as pool:
        for row in pool.map(lambda case: judge(*case), cases):
            report.rows.append(row)
            progress(len(report.rows))
    if not report.rows:
        raise ConfigError(f"the arm {arm!r} with the hand {hand!r} reaches no grasp of {list(objects)}; name others")
    return report
