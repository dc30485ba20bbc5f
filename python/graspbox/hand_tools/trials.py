"""A few planned grasps in simulation: whether the planner and a trial work with a hand, and how well it grasps."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox.configs import DecomposeConfig, PlanConfig
from graspbox.errors import GraspboxError, HandError, InternalError
from graspbox.evaluation.planner_trials import ObjectResult, try_object
from graspbox.hand_tools.bodies import Floats
from graspbox.hand_tools.findings import CheckedHand, Finding
from graspbox.hand_tools.motion import open_width
from graspbox.hands import Hand
from graspbox.meshes import Mesh
from graspbox.planning import plan
from graspbox.simulation import Scene

__all__ = ["LEAST_OPENING", "Judged", "Task", "judge", "resting", "trials"]

#: Least opening for which objects are scaled down, metres: none of less than 5 mm or 10 mg are simulated.
LEAST_OPENING = 10e-3

#: Objects that are tried, and the first poses of each.
_OBJECTS, _POSES = ("procedural:box:0", "procedural:can:0", "procedural:ball:0"), 5
#: Greatest middle side of an object as a share of the opening; larger objects are scaled down.
_FILLED = 0.7
#: An opening of a hand that states none and whose fingers do not face each other, metres.
_USUAL = 0.08
#: Families of the objects.
_FAMILIES = ("can", "box", "ball")
#: Few boxes: the objects are simple, and the same random numbers serve every hand.
SIMPLE = PlanConfig(decompose=DecomposeConfig(max_boxes=2, samples=500))
#: What a grasp that does not hold shows by its failure about the way to one that does, and the weight of that.
_PARTIAL, _HINT = {"no_contact": 0.1, "slipped": 0.5, "unstable": 0.8, "dropped": 0.8}, 0.1
#: Worth of a grasp that holds, and more of one that holds firmly.
_HOLDS, _FIRMLY = 0.7, 0.3


def trials(checked: CheckedHand, seed: int = 0) -> Iterator[Finding]:
    """Plan for objects that fit the hand, with a seed of the planner, and simulate the first poses."""
    results = []
    for name in _OBJECTS:
        try:
            result = _result(checked, name, seed)
        except InternalError:
            raise
        except GraspboxError as error:
            result = ObjectResult(name, error=str(error))
        results.append(result)
        yield _row(name, result)
    rows = [result.row() for result in results]
    subject, value = "planner", ""
    if all(result.error for result in results):
        message = "no object could be planned for or simulated"
        remedy = "read the errors above; most concern `[grasp]`"
    elif not any(row["tried"] for row in rows):
        value = "0 poses"
        message = (
            "no pose is free of collisions for any object: the hand faces away, or is closed when it should be open"
        )
        remedy = (
            "look at the picture (--picture): z of the grasp frame points out of the palm, x along the closing fingers"
        )
    elif not any(row["succeeded"] for row in rows):
        subject, value, message = "simulation", "0 grasps", "no planned grasp holds any object"
        remedy = "see `failure` of `graspbox grasp --out`; check pads, `center`, `load_limit` and friction"
    else:
        return
    yield Finding("error", "trials", subject, value, message, remedy)


def _result(checked: CheckedHand, name: str, seed: int) -> ObjectResult:
    opening = checked.hand.widest
    if np.isinf(opening):
        opening = open_width(checked)
        opening = opening if opening > 0.01 else _USUAL
    return try_object(_fitting(opening, name), poses=_POSES, seed=seed, hand=checked.hand)


def _fitting(opening: float, name: str) -> object_sets.ObjectSpec:
    """Return the object of a name, scaled down to the opening of a hand, metres, if it is larger.

    Raises
    ------
    HandError
        If nothing fits between the fingers.
    """
    if opening < LEAST_OPENING:
        raise HandError(
            f"the hand opens by {1e3 * opening:.1f} mm, too little for an object ({1e3 * LEAST_OPENING:g} mm); check "
            "`travel` of the closing actuators and `width` in [[grasp.preshapes]]"
        )
    mesh = object_sets.load(name)[0].load()
    middle = float(np.sort(mesh.bounds[1] - mesh.bounds[0])[1])
    scale = min(1.0, _FILLED * opening / middle)
    return object_sets.load(name, scale=round(scale, 3))[0]


def _row(name: str, result: ObjectResult) -> Finding:
    if result.error:
        return Finding("warning", "trials", name, "", f"it could not be tried: {result.error}", "read the error")
    row, outcomes = result.row(), result.outcomes
    kinds = {} if outcomes is None else dict(zip(*np.unique(outcomes.failure, return_counts=True), strict=True))
    failed = ", ".join(f"{count} {kind}" for kind, count in kinds.items() if kind)
    value = f"{row['succeeded']} of {row['tried']}"
    message = "first poses of the plan that hold the object in simulation"
    return Finding("note", "trials", name, value, f"{message}{f' (others: {failed})' if failed else ''}")


@dataclass(frozen=True, eq=False)
class Task:
    """An object and its pose at rest (4, 4), world frame; its family."""

    family: str
    mesh: Mesh
    world_from_object: Floats


@dataclass(frozen=True)
class Judged:
    """What grasps of one object with one hand came to.

    Attributes
    ----------
    asked, tried, held, firm : int
        Grasps that were asked for, that the planner found, that hold the object, and that hold it firmly.
    value : float
        What they are worth, in [0, 1]: mostly the root of the share that holds, since another object is worth more than
        more grasps of one. A grasp that the planner did not find is worth nothing.
    """

    asked: int
    tried: int = 0
    held: int = 0
    firm: int = 0
    value: float = 0.0


def resting(hand: Hand, opening: float, seeds: Sequence[int]) -> list[Task]:
    """Let objects of each family come to rest, scaled down to the opening of a hand, metres."""
    tasks = []
    for family in _FAMILIES:
        for seed in seeds:
            mesh = _fitting(opening, f"procedural:{family}:{seed}").load()
            tasks.append(Task(family, mesh, Scene(mesh, hand=hand).world_from_object))
    return tasks


def judge(
    hands: Sequence[Hand | None],
    tasks: Sequence[Task],
    poses: int,
    *,
    planning: PlanConfig = SIMPLE,
    seed: int = 0,
) -> list[list[Judged]]:
    """Try hands on all tasks, with the first `poses` planned grasps each; None stands for one that cannot be made.

    Results do not depend on the number of threads.
    """
    jobs = [(hand, task) for hand in hands for task in tasks]

    def work(job: tuple[Hand | None, Task]) -> Judged:
        hand, task = job
        return Judged(poses) if hand is None else _tried(hand, task, poses, planning, seed)

    with ThreadPoolExecutor(_core.num_threads()) as pool:
        try:
            results = list(pool.map(work, jobs))
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise
    return [results[i * len(tasks) : (i + 1) * len(tasks)] for i in range(len(hands))]


def _tried(hand: Hand, task: Task, poses: int, planning: PlanConfig, seed: int) -> Judged:
    try:
        scene = Scene(task.mesh, hand=hand, world_from_object=task.world_from_object)
        rest = scene.world_from_object
        found = plan(task.mesh, hand=hand, world_from_object=rest, seed=seed, config=planning, num_threads=1).best(
            poses
        )
        if not len(found):
            return Judged(poses)
        out = scene.simulate(found, num_threads=1)
    except InternalError:
        raise
    except GraspboxError:
        # An object that this hand cannot be planned for counts as one that it does not hold.
        return Judged(poses)
    hints: NDArray[np.float64] = np.array([_PARTIAL.get(kind, 0.0) for kind in out.failure])
    hint = float(np.where(out.success, 1.0, hints).sum()) / poses
    holds = float((out.success * (_HOLDS + _FIRMLY * out.secure)).sum()) / poses
    value = (1.0 - _HINT) * float(np.sqrt(holds)) + _HINT * hint
    return Judged(poses, len(found), int(out.success.sum()), int(out.secure.sum()), value)
