"""Grasps to judge: of the planner, of files of other programs, and those that a policy chose in trials."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets, policies
from graspbox.envs.coding import codec
from graspbox.envs.settings import GraspConfig
from graspbox.errors import ConfigError
from graspbox.evaluation import Evaluation, evaluate
from graspbox.evaluation.replays import ActionLog, Replay
from graspbox.hands import HandLike, load_hand
from graspbox.object_sets import ObjectSet, ObjectSpec
from graspbox.planning import plan
from graspbox.simulation import Scene
from graspbox.tools import exchange
from validation.forces.config import Array

__all__ = ["Batch", "Choices", "chosen", "from_files", "planned"]

#: The hand of a closed-loop trial begins to close where its actuators have gone this share of their way to the end.
_CLOSING = 0.1


@dataclass(frozen=True, eq=False)
class Batch:
    """Grasps of one object at rest.

    Attributes
    ----------
    scene : Scene
        The object and the hand.
    poses : (n, 4, 4) float64
        ``object_from_hand``, metres.
    preshape : (n,) float64
        See `graspbox.Hand.preshape_limits`.
    """

    scene: Scene
    poses: Array
    preshape: Array


@dataclass(frozen=True, eq=False)
class Choices:
    """The grasps of a policy.

    Attributes
    ----------
    result : Evaluation
        The trials in which it chose them.
    batches : list of Batch or None
        One grasp per trial; None where the policy chose none, or did not close the hand.
    """

    result: Evaluation
    batches: list[Batch | None]


def planned(objects: Sequence[str], poses: int, seed: int, hand: HandLike = "reflex") -> Iterator[Batch]:
    """Plan the best `poses` grasps of every object of some sets.

    Raises
    ------
    ConfigError, ObjectSetError
        If an argument is wrong; see `graspbox.plan`.
    """
    loaded = load_hand(hand)
    for spec in object_sets.load(list(objects)):
        scene = Scene(spec.load(), hand=loaded)
        best = plan(scene.mesh, hand=loaded, world_from_object=scene.world_from_object, seed=seed).best(poses)
        yield Batch(scene, best.poses, best.preshape)


def from_files(
    files: Sequence[Path], objects: Sequence[str], hand: HandLike = "reflex", preshape: float | None = None
) -> Iterator[Batch]:
    """Read the grasps of files that `graspbox.tools.exchange` reads.

    The object of a file is the one of its name among `objects`, or the only one. It rests where the file's first known
    pose lets it come to rest. `preshape` is as for `graspbox.tools.exchange.load`.

    Raises
    ------
    ConfigError
        If a file is damaged or lacks a preshape, or `objects` lack its object.
    """
    specs = list(object_sets.load(list(objects)))
    for file in files:
        grasps = exchange.load(file, hand=hand, preshape=preshape)
        spec = _object_of(file, grasps.object_name, specs)
        known = grasps.world_from_object[~np.isnan(grasps.world_from_object).any(axis=(1, 2))]
        scene = Scene(spec.load(), hand=grasps.hand, world_from_object=known[0] if len(known) else None)
        yield Batch(scene, grasps.poses, grasps.preshape)


def _object_of(file: Path, name: str, specs: Sequence[ObjectSpec]) -> ObjectSpec:
    """Find the object of a file by its name, or take the only one."""
    if len(specs) == 1:
        return specs[0]
    for spec in specs:
        if spec.name == name:
            return spec
    raise ConfigError(f"{str(file)!r} has grasps of {name!r}, which is none of the objects; name it with --objects")


def chosen(
    policy: str,
    objects: Sequence[str] | ObjectSet,
    trials: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
    *,
    rehearsed: int | None = None,
) -> Choices:
    """Evaluate a policy, and read the grasp of every trial off its actions.

    In ``GraspPose-v0`` the grasp is the action. In ``Grasp-v0`` it is the hand's pose in the object's frame when the
    fingers begin to close for good.

    Parameters
    ----------
    policy, rehearsed
        As for `graspbox.policies.load`.
    objects, trials, seed
        As for `graspbox.evaluation.evaluate`.
    progress : callable
        Called with the number of finished trials.

    Raises
    ------
    ConfigError, ObjectSetError
        As `graspbox.evaluation.evaluate`.
    """
    log = ActionLog(policies.load(policy, rehearsed=rehearsed))
    sets = object_sets.load(objects)
    result = evaluate(log, objects=sets, trials=trials, seed=seed, progress=progress)
    specs = {spec.name: spec for spec in sets}
    batches: list[Batch | None] = []
    for trial in result.trials:
        actions = log.actions(trial.seed, trial.steps)
        if actions is None or result.settings is None:
            raise ConfigError(f"the actions of the trial with seed {trial.seed} were not kept; give fewer --trials")
        batches.append(_grasp(Replay.of(result.env_id, result.settings, specs[trial.object], trial, actions)))
    return Choices(result, batches)


def _grasp(replay: Replay) -> Batch | None:
    """Step an episode again, and read its grasp."""
    env, hand = replay.make(obs="state"), load_hand(replay.settings.get("hand", "reflex"))
    try:
        states = [np.asarray(state, dtype=np.float64) for state, _ in replay.run(env)]
    finally:
        env.close()
    single = replay.env_id.endswith("GraspPose-v0")
    control, fingers = (str(replay.settings.get(name, getattr(GraspConfig, name))) for name in ("control", "fingers"))
    reader = codec("grasp_pose" if single else control, hand, fingers)
    if single:
        world_from_object = reader.pose(states[0], "object")
        try:
            world_from_hand, preshape = reader.decode_grasp(replay.actions[0])
        except ConfigError:
            # Zeros: no grasp.
            return None
    else:
        at = closing_step(np.stack([reader.column(state, "actuator") for state in states]))
        if at is None:
            return None
        world_from_object, world_from_hand = reader.pose(states[at], "object"), reader.pose(states[at], "hand")
        preshape = float(reader.column(states[at], "preshape").sum())
    scene = Scene(replay.spec().load(), hand=hand, world_from_object=world_from_object)
    low, high = hand.preshape_limits
    pose = np.linalg.inv(world_from_object) @ world_from_hand
    return Batch(scene, pose[None], np.array([min(max(preshape, low), high)]))


def closing_step(actuators: NDArray[np.float64]) -> int | None:
    """Return the last step before the hand closes for good; None if it never closes.

    Parameters
    ----------
    actuators : (t, k) float64
        Positions of the actuators that close the hand after every step, rad or m.
    """
    travel = actuators.mean(axis=1)
    way = travel[-1] - travel.min()
    if way <= 1e-6:
        return None
    return int(np.flatnonzero(travel <= travel.min() + _CLOSING * way)[-1])
