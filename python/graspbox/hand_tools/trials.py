"""A few planned grasps in simulation: whether the planner and a trial work with a hand."""

from collections.abc import Iterator

import numpy as np

from graspbox import object_sets
from graspbox.errors import GraspboxError, InternalError
from graspbox.evaluation.planner_trials import ObjectResult, try_object
from graspbox.hand_tools.findings import CheckedHand, Finding
from graspbox.hand_tools.motion import open_width

__all__ = ["trials"]

#: Objects that are tried, and the first poses of each.
_OBJECTS, _POSES = ("procedural:box:0", "procedural:can:0", "procedural:ball:0"), 5
#: Greatest middle side of an object as a share of the opening; larger objects are scaled down.
_FILLED = 0.7
#: An opening of a hand that states none and whose fingers do not face each other, metres.
_USUAL = 0.08


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
    """Try the object, scaled to the opening of the hand."""
    opening = checked.hand.widest
    if np.isinf(opening):
        opening = open_width(checked)
        opening = opening if opening > 0.01 else _USUAL
    mesh = object_sets.load(name)[0].load()
    middle = float(np.sort(mesh.bounds[1] - mesh.bounds[0])[1])
    scale = min(1.0, _FILLED * opening / middle)
    spec = object_sets.load(name, scale=round(scale, 3))[0]
    return try_object(spec, poses=_POSES, seed=seed, hand=checked.hand)


def _row(name: str, result: ObjectResult) -> Finding:
    if result.error:
        return Finding("warning", "trials", name, "", f"it could not be tried: {result.error}", "read the error")
    row, outcomes = result.row(), result.outcomes
    kinds = {} if outcomes is None else dict(zip(*np.unique(outcomes.failure, return_counts=True), strict=True))
    failed = ", ".join(f"{count} {kind}" for kind, count in kinds.items() if kind)
    value = f"{row['succeeded']} of {row['tried']}"
    message = "first poses of the plan that hold the object in simulation"
    return Finding("note", "trials", name, value, f"{message}{f' (others: {failed})' if failed else ''}")
