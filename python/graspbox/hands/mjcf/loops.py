"""Closed loops of MJCF hands as mimic joints: MuJoCo moves the driven joint, and lines are fitted to those that follow.

A URDF is a tree, so mimic joints replace each ``connect`` of two bodies of a linkage, such as a four-bar finger.
Springs and stops determine what the constraint leaves free. A parallelogram follows a line exactly; for other linkages
`graspbox.hands.LoopFit` has the distance of the two bodies where the line is worst.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import HandError
from graspbox.hands.loop_fits import LoopFit

__all__ = ["Coupling", "actuated_joints", "couple_loops", "name_of"]

Array = NDArray[np.float64]

#: The joint that leads, ratio and offset: a follower is at ratio times the leader's position, plus the offset.
Coupling = tuple[int, float, float]
#: Ratio and offset of joints that follow the same leader.
Lines = dict[int, tuple[float, float]]

#: Positions of the driven joint to which lines are fitted.
_SAMPLES = 41
#: Time step of the simulation, seconds; most steps for a sample; speed at which joints are at rest, rad/s or m/s.
_STEP, _MOST_STEPS, _REST = 1e-3, 20_000, 1e-5
#: Armature of the joints that are held, which no constraint moves, and added to that of others, which springs then move
#: slowly; kg m2 or kg.
_HELD, _ADDED = 1e3, 1e-3
#: `solref` and `solimp` of equalities and stops: as stiff as the time step permits.
_SOLREF, _SOLIMP = (4.0 * _STEP, 1.0), (0.99, 0.999, 1e-4, 0.5, 2.0)
#: Greatest distance between the two bodies of a loop, metres.
_MOST_GAP = 5e-3
_UNSTABLE = "the joints of its closed loops do not come to rest; see in MuJoCo's viewer whether the loops stay closed"


@dataclass(frozen=True)
class _Loop:
    """A ``connect`` of two bodies."""

    equality: int
    #: The joint that leads all others.
    head: int
    #: Joints between the bodies that neither an actuator nor another joint moves.
    passive: frozenset[int]


def name_of(model: Any, kind: str, index: int) -> str:
    """Return the name of an element of a model, such as a ``joint``; for an unnamed one, kind and number."""
    return str(getattr(model, kind)(index).name or f"{kind}_{index}")


def actuated_joints(mujoco: Any, model: Any) -> set[int]:
    """Return the joints that actuators drive, directly or by a tendon along joints."""
    kinds, joints = mujoco.mjtTrn, set[int]()
    for kind, (index, _) in zip(model.actuator_trntype, model.actuator_trnid.tolist(), strict=True):
        if int(kind) in {int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)}:
            joints.add(index)
        if kind == kinds.mjTRN_TENDON:
            wraps = slice(model.tendon_adr[index], model.tendon_adr[index] + model.tendon_num[index])
            along = model.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_JOINT
            joints |= set(model.wrap_objid[wraps][along].tolist())
    return joints


def couple_loops(
    mujoco: Any, model: Any, equalities: list[int], coupled: Mapping[int, Coupling]
) -> tuple[dict[int, Coupling], dict[str, LoopFit]]:
    """Fit lines to the joints of closed loops.

    `equalities` are the ``connect`` equalities of the model; `coupled` has the joints that follow others in any case,
    with the leader of each, which follows none. Returns the coupling of each further joint, and the fits by the names
    of the joints.

    Raises
    ------
    HandError
        If not exactly one joint with an actuator drives a loop, if this joint has no range, or if lines leave the loop
        open by more than 5 mm.
    """
    linkage = _Linkage(mujoco, model)
    loops = [linkage.loop(equality, coupled) for equality in equalities]
    couplings: dict[int, Coupling] = {}
    fits: dict[str, LoopFit] = {}
    for head in dict.fromkeys(loop.head for loop in loops):
        followers = {joint: (ratio, offset) for joint, (leader, ratio, offset) in coupled.items() if leader == head}
        led = [loop for loop in loops if loop.head == head]
        for joint, fit in linkage.fits(led, {head: (1.0, 0.0), **followers}).items():
            name = name_of(model, "joint", joint)
            if joint in couplings:
                raise HandError(f"joint {name!r} is in closed loops that different joints drive")
            couplings[joint], fits[name] = (head, fit.ratio, fit.offset), fit
    return couplings, fits


class _Linkage:
    """A model with closed loops."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self._mujoco, self._model = mujoco, model

    def loop(self, equality: int, coupled: Mapping[int, Coupling]) -> _Loop:
        """Return the joints of a loop."""
        model = self._model
        first, second = (self._joints_to(body) for body in self._bodies(equality))
        between = first ^ second
        driven = between & (actuated_joints(self._mujoco, self._model) | set(coupled))
        heads = sorted({coupled[joint][0] if joint in coupled else joint for joint in driven})
        if len(heads) != 1:
            joints, leaders = ([name_of(model, "joint", joint) for joint in row] for row in (sorted(between), heads))
            several = f"that {', '.join(leaders)} drive" if heads else "without an actuator"
            raise HandError(
                f"equality {name_of(model, 'equality', equality)!r} closes a loop {several}; let an actuator drive one "
                f"of its joints: {', '.join(joints)}"
            )
        return _Loop(equality, heads[0], frozenset(between - driven))

    def _bodies(self, equality: int) -> tuple[int, int]:
        """Return the two bodies that an equality connects."""
        first, second = int(self._model.eq_obj1id[equality]), int(self._model.eq_obj2id[equality])
        if self._of_sites(equality):
            return int(self._model.site_bodyid[first]), int(self._model.site_bodyid[second])
        return first, second

    def _of_sites(self, equality: int) -> bool:
        return bool(self._model.eq_objtype[equality] == self._mujoco.mjtObj.mjOBJ_SITE)

    def _joints_to(self, body: int) -> set[int]:
        """Return the joints between the world and a body."""
        model, joints = self._model, set[int]()
        while body:
            first = int(model.body_jntadr[body])
            joints |= set(range(first, first + int(model.body_jntnum[body])))
            body = int(model.body_parentid[body])
        return joints

    def fits(self, loops: list[_Loop], driven: Lines) -> dict[int, LoopFit]:
        """Fit lines to the passive joints of loops with the same leader, the first of the `driven` joints."""
        model, head = self._model, loops[0].head
        leader = name_of(model, "joint", head)
        if not model.jnt_limited[head]:
            raise HandError(f"joint {leader!r} drives a closed loop and has no range; set one")
        low, high = model.jnt_range[head]
        positions: Array = np.linspace(low, high, _SAMPLES)
        passive = sorted(frozenset[int]().union(*(loop.passive for loop in loops)))
        moved = self._moved(positions, driven, passive)
        lines = {joint: np.polyfit(positions, moved[:, n], 1).tolist() for n, joint in enumerate(passive)}
        gaps = self._gaps(positions, {**driven, **lines}, [loop.equality for loop in loops])
        for loop, gap in zip(loops, gaps, strict=True):
            if gap > _MOST_GAP:
                raise HandError(
                    f"equality {name_of(model, 'equality', loop.equality)!r} closes a loop that mimic joints leave "
                    f"open by up to {1e3 * gap:.1f} mm; a hand is a tree of links, whose joints follow others linearly"
                )
        fits: dict[int, LoopFit] = {}
        for n, (joint, (ratio, offset)) in enumerate(lines.items()):
            most = float(np.abs(ratio * positions + offset - moved[:, n]).max())
            gap = max(gap for loop, gap in zip(loops, gaps, strict=True) if joint in loop.passive)
            fits[joint] = LoopFit(leader, ratio, offset, most, gap)
        return fits

    def _place(self, data: Any, position: float, lines: Lines) -> None:
        """Put joints where they are when their leader is at a position."""
        for joint, (ratio, offset) in lines.items():
            data.qpos[self._model.jnt_qposadr[joint]] = ratio * position + offset

    def _moved(self, positions: Array, held: Lines, passive: list[int]) -> Array:
        """Simulate the passive joints, (samples, joints), for positions of the driven one, from rest to both ends."""
        model, flags = copy.copy(self._model), self._mujoco.mjtDisableBit
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
        moved = np.zeros((len(positions), len(passive)))
        for samples in (range(middle, len(positions)), range(middle, -1, -1)):
            data = self._mujoco.MjData(model)
            for sample in samples:
                self._place(data, positions[sample], held)
                self._settle(model, data, fixed)
                moved[sample] = data.qpos[model.jnt_qposadr[passive]]
        return moved

    def _settle(self, model: Any, data: Any, fixed: NDArray[np.int64]) -> None:
        """Step until all joints rest. Their speed is set to 0 whenever it falls: dynamic relaxation."""
        kept, last = data.qpos.copy(), 0.0
        for _ in range(_MOST_STEPS):
            from_rest = not data.qvel.any()
            self._mujoco.mj_step(model, data)
            if data.warning[int(self._mujoco.mjtWarning.mjWARN_BADQACC)].number:
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

    def _gaps(self, positions: Array, led: Lines, equalities: list[int]) -> list[float]:
        """Return the greatest distance of the bodies of each loop where all joints follow lines, metres."""
        data, gaps = self._mujoco.MjData(self._model), np.zeros(len(equalities))
        for position in positions:
            self._place(data, position, led)
            self._mujoco.mj_kinematics(self._model, data)
            ends = np.array([self._ends(data, equality) for equality in equalities])
            gaps = np.maximum(gaps, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))
        return gaps.tolist()

    def _ends(self, data: Any, equality: int) -> list[Array]:
        """Return the two points of the world that an equality holds together."""
        model = self._model
        if self._of_sites(equality):
            return [data.site_xpos[site] for site in (model.eq_obj1id[equality], model.eq_obj2id[equality])]
        return [
            data.xpos[body] + data.xmat[body].reshape(3, 3) @ model.eq_data[equality, 3 * n : 3 * n + 3]
            for n, body in enumerate(self._bodies(equality))
        ]
