"""Closed loops of MJCF hands as mimic joints: MuJoCo moves the driven joint, and lines are fitted to those that follow.

A URDF is a tree, so mimic joints replace each ``connect`` of two bodies of a linkage, such as a four-bar finger.
Springs and stops determine what the constraint leaves free. A parallelogram follows a line exactly; for other linkages
`LoopFit` tells how far the two bodies are apart where the line is worst.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import HandError

__all__ = ["Coupling", "LoopFit", "couple_loops"]

Array = NDArray[np.float64]

#: The joint that leads, ratio and offset: a follower is at ratio times the leader's position, plus the offset.
Coupling = tuple[int, float, float]

#: Positions of the driven joint to which lines are fitted.
_SAMPLES = 41
#: Time step of the simulation, seconds; most steps for a sample; speed at which joints are at rest, rad/s or m/s.
_STEP, _MOST_STEPS, _REST = 1e-3, 2000, 1e-5
#: Armature of the joints that are held, which no constraint moves, and added to that of others, which springs then move
#: slowly; kg m2 or kg.
_HELD, _ADDED = 1e3, 1e-3
#: `solref` and `solimp` of equalities and stops: as stiff as the time step permits.
_SOLREF, _SOLIMP = (4.0 * _STEP, 1.0), (0.99, 0.999, 1e-4, 0.5, 2.0)
#: Greatest distance between the two bodies of a loop, metres.
_MOST_GAP = 5e-3
_UNSTABLE = "the joints of its closed loops do not come to rest; see in MuJoCo's viewer whether the loops stay closed"


@dataclass(frozen=True)
class LoopFit:
    """A mimic joint in place of a closed loop.

    Attributes
    ----------
    leader : str
        The joint that it follows.
    ratio, offset : float
        Its position is `ratio` times the leader's, plus `offset`; radians or metres.
    most : float
        Greatest difference from the position in the closed loop, over the leader's range, radians or metres.
    gap : float
        Greatest distance between the two bodies where the loop was closed, over the leader's range, metres.
    """

    leader: str
    ratio: float
    offset: float
    most: float
    gap: float


@dataclass(frozen=True)
class _Loop:
    """A ``connect`` of two bodies.

    Attributes
    ----------
    equality : int
        The equality.
    head : int
        The joint that leads all others.
    passive : frozenset of int
        Joints between the bodies that neither an actuator nor another joint moves.
    """

    equality: int
    head: int
    passive: frozenset[int]


def couple_loops(
    mujoco: Any, model: Any, equalities: list[int], coupled: Mapping[int, Coupling]
) -> tuple[dict[int, Coupling], dict[str, LoopFit]]:
    """Fit lines to the joints of closed loops.

    Parameters
    ----------
    mujoco : module
        MuJoCo.
    model : MjModel
        The hand.
    equalities : list of int
        Its ``connect`` equalities.
    coupled : mapping
        Joints that follow others in any case, with the leader of each, which follows none.

    Returns
    -------
    couplings : dict
        Leader, ratio and offset of each further joint.
    fits : dict
        The same by the names of the joints, with errors.

    Raises
    ------
    HandError
        If not exactly one joint with an actuator drives a loop, if this joint has no range, or if lines leave the loop
        open by more than 5 mm.
    """
    named = _Names(mujoco, model)
    loops = [_loop(mujoco, model, named, equality, coupled) for equality in equalities]
    couplings: dict[int, Coupling] = {}
    fits: dict[str, LoopFit] = {}
    for head in dict.fromkeys(loop.head for loop in loops):
        followers = {joint: (ratio, offset) for joint, (leader, ratio, offset) in coupled.items() if leader == head}
        led = [loop for loop in loops if loop.head == head]
        for joint, fit in _fits(mujoco, model, named, led, {head: (1.0, 0.0), **followers}).items():
            if joint in couplings:
                raise HandError(f"joint {named.joint(joint)!r} is in closed loops that different joints drive")
            couplings[joint], fits[named.joint(joint)] = (head, fit.ratio, fit.offset), fit
    return couplings, fits


def _fits(
    mujoco: Any, model: Any, named: "_Names", loops: list[_Loop], driven: dict[int, tuple[float, float]]
) -> dict[int, LoopFit]:
    """Fit lines to the passive joints of loops that one joint leads; `driven` has ratio and offset of the others."""
    head = loops[0].head
    if not model.jnt_limited[head]:
        raise HandError(f"joint {named.joint(head)!r} drives a closed loop and has no range; give it one")
    low, high = model.jnt_range[head]
    positions: Array = np.linspace(low, high, _SAMPLES)
    passive = sorted(frozenset[int]().union(*(loop.passive for loop in loops)))
    seen = _moved(mujoco, model, positions, driven, passive)
    lines = {joint: np.polyfit(positions, seen[:, n], 1).tolist() for n, joint in enumerate(passive)}
    gaps = _gaps(mujoco, model, positions, {**driven, **lines}, [loop.equality for loop in loops])
    for loop, gap in zip(loops, gaps, strict=True):
        if gap > _MOST_GAP:
            raise HandError(
                f"equality {named.equality(loop.equality)!r} closes a loop that mimic joints leave open by up to "
                f"{1e3 * gap:.1f} mm; a hand is a tree of links, whose joints follow others linearly"
            )
    found: dict[int, LoopFit] = {}
    for n, (joint, (ratio, offset)) in enumerate(lines.items()):
        most = float(np.abs(ratio * positions + offset - seen[:, n]).max())
        gap = max(gap for loop, gap in zip(loops, gaps, strict=True) if joint in loop.passive)
        found[joint] = LoopFit(named.joint(head), ratio, offset, most, gap)
    return found


class _Names:
    """Names of the elements of a model; unnamed ones by their number."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self._mujoco, self._model = mujoco, model

    def joint(self, index: int) -> str:
        """Name a joint."""
        return str(self._mujoco.mj_id2name(self._model, self._mujoco.mjtObj.mjOBJ_JOINT, index) or f"joint_{index}")

    def equality(self, index: int) -> str:
        """Name an equality."""
        found = self._mujoco.mj_id2name(self._model, self._mujoco.mjtObj.mjOBJ_EQUALITY, index)
        return str(found or f"equality_{index}")


def _loop(mujoco: Any, model: Any, named: _Names, equality: int, coupled: Mapping[int, Coupling]) -> _Loop:
    """Find the joints of a loop."""
    first, second = (_ancestors(model, body) for body in _bodies(mujoco, model, equality))
    between = {joint for body in first ^ second for joint in _joints_of(model, body)}
    driven = between & (_actuated(mujoco, model) | set(coupled))
    heads = sorted({coupled[joint][0] if joint in coupled else joint for joint in driven})
    if len(heads) != 1:
        several = f"that {', '.join(map(named.joint, heads))} drive" if heads else "without an actuator"
        raise HandError(
            f"equality {named.equality(equality)!r} closes a loop {several}; let an actuator drive one of its joints: "
            f"{', '.join(map(named.joint, sorted(between)))}"
        )
    return _Loop(equality, heads[0], frozenset(between - driven))


def _bodies(mujoco: Any, model: Any, equality: int) -> tuple[int, int]:
    """Return the two bodies that an equality connects."""
    ends = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    if model.eq_objtype[equality] == int(mujoco.mjtObj.mjOBJ_SITE):
        return int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
    return ends


def _ancestors(model: Any, body: int) -> set[int]:
    """Return a body and those that carry it, without the world."""
    found = set[int]()
    while body:
        found.add(body)
        body = int(model.body_parentid[body])
    return found


def _joints_of(model: Any, body: int) -> range:
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body]))


def _actuated(mujoco: Any, model: Any) -> set[int]:
    """Return the joints that actuators drive, by themselves or by a tendon along joints."""
    found = set[int]()
    for kind, (index, _) in zip(model.actuator_trntype, model.actuator_trnid.tolist(), strict=True):
        if kind == int(mujoco.mjtTrn.mjTRN_JOINT):
            found.add(index)
        if kind == int(mujoco.mjtTrn.mjTRN_TENDON):
            first, count = int(model.tendon_adr[index]), int(model.tendon_num[index])
            wraps = range(first, first + count)
            found |= {int(model.wrap_objid[w]) for w in wraps if model.wrap_type[w] == int(mujoco.mjtWrap.mjWRAP_JOINT)}
    return found


def _moved(
    mujoco: Any, model: Any, positions: Array, held: Mapping[int, tuple[float, float]], passive: list[int]
) -> Array:
    """Simulate the passive joints, (samples, joints), for positions of the driven one, from rest to both ends."""
    model = copy.copy(model)
    flags = mujoco.mjtDisableBit
    for flag in (flags.mjDSBL_CONTACT, flags.mjDSBL_GRAVITY, flags.mjDSBL_ACTUATION, flags.mjDSBL_FRICTIONLOSS):
        model.opt.disableflags |= int(flag)
    model.opt.timestep = _STEP
    model.eq_solref[:], model.eq_solimp[:] = _SOLREF, _SOLIMP
    model.jnt_solref[:], model.jnt_solimp[:] = _SOLREF, _SOLIMP
    free = model.jnt_dofadr[passive]
    fixed = np.setdiff1d(np.arange(model.nv), free)
    model.dof_armature[fixed] = _HELD
    model.dof_armature[free] += _ADDED
    head = next(iter(held))
    middle = int(np.abs(positions - model.qpos0[model.jnt_qposadr[head]]).argmin())
    seen = np.zeros((len(positions), len(passive)))
    for samples in (range(middle, len(positions)), range(middle, -1, -1)):
        data = mujoco.MjData(model)
        for sample in samples:
            for joint, (ratio, offset) in held.items():
                data.qpos[model.jnt_qposadr[joint]] = ratio * positions[sample] + offset
            _settle(mujoco, model, data, fixed)
            seen[sample] = data.qpos[model.jnt_qposadr[passive]]
    return seen


def _settle(mujoco: Any, model: Any, data: Any, fixed: NDArray[np.int64]) -> None:
    """Step until all joints rest. Their speed is set to 0 whenever it falls: dynamic relaxation."""
    kept, last = data.qpos.copy(), 0.0
    for _ in range(_MOST_STEPS):
        from_rest = not data.qvel.any()
        mujoco.mj_step(model, data)
        if data.warning[int(mujoco.mjtWarning.mjWARN_BADQACC)].number:
            raise HandError(_UNSTABLE)
        data.qvel[fixed] = 0.0
        data.qpos[fixed] = kept[fixed]
        speed = float(np.abs(data.qvel).max())
        if from_rest and speed < _REST:
            return
        if speed < last:
            data.qvel[:] = 0.0
        last = speed
    raise HandError(_UNSTABLE)


def _gaps(
    mujoco: Any, model: Any, positions: Array, led: Mapping[int, tuple[float, float]], equalities: list[int]
) -> list[float]:
    """Return how far the bodies of each loop are apart, at most, where all joints follow lines; metres."""
    data, gaps = mujoco.MjData(model), np.zeros(len(equalities))
    for position in positions:
        for joint, (ratio, offset) in led.items():
            data.qpos[model.jnt_qposadr[joint]] = ratio * position + offset
        mujoco.mj_kinematics(model, data)
        ends = np.array([_ends(mujoco, model, data, equality) for equality in equalities])
        gaps = np.maximum(gaps, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))
    return [float(gap) for gap in gaps]


def _ends(mujoco: Any, model: Any, data: Any, equality: int) -> tuple[Array, Array]:
    """Return the two points of the world that an equality holds together."""
    if model.eq_objtype[equality] == int(mujoco.mjtObj.mjOBJ_SITE):
        first, second = (data.site_xpos[site] for site in (model.eq_obj1id[equality], model.eq_obj2id[equality]))
        return first, second
    first, second = (
        data.xpos[body] + data.xmat[body].reshape(3, 3) @ model.eq_data[equality, 3 * n : 3 * n + 3]
        for n, body in enumerate(_bodies(mujoco, model, equality))
    )
    return first, second
