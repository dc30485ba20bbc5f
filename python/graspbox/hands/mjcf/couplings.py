"""Joints that follow another one by equalities of joints and of tendons along joints.

Every such equality is a linear equation of joint positions. Elimination writes each joint that the equations determine
in those that stay independent: a hand takes it if it follows exactly one.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import HandError
from graspbox.hands.mjcf.loops import Coupling, name_of

__all__ = ["Couplings", "couple"]

Array = NDArray[np.float64]

#: Coefficients below this share of the largest are rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Couplings:
    """Joints that follow others; ``closed`` are the ``connect`` equalities that close loops of the hand."""

    of: dict[int, Coupling]
    closed: list[int]
    #: Equalities between parts that are not of the hand, or do not move in it.
    ignored: list[int]


def couple(mujoco: Any, model: Any, joints: Iterable[int], link_of: Mapping[int, int], actuated: set[int]) -> Couplings:
    """Return the couplings of `joints`, those of the hand; `link_of` has the link of each of its bodies.

    Joints in `actuated` lead others where the equations leave a choice.

    Raises
    ------
    HandError
        For an equality that no mimic joint represents.
    """
    return _Equations(mujoco, model, list(joints), link_of).solved(actuated)


class _Equations:
    def __init__(self, mujoco: Any, model: Any, joints: list[int], link_of: Mapping[int, int]) -> None:
        self._mujoco, self._model, self._joints, self._link_of = mujoco, model, joints, link_of
        self._column = {joint: column for column, joint in enumerate(joints)}
        #: Coefficients of joints, and the constant that their sum has; the joints that the file itself lets follow.
        self._rows: list[Array] = []
        self._constants: list[float] = []
        self._declared: set[int] = set()

    def solved(self, actuated: set[int]) -> Couplings:
        kinds, closed, ignored = self._mujoco.mjtEq, list[int](), list[int]()
        for number in np.flatnonzero(self._model.eq_active0).tolist():
            kind = self._model.eq_type[number]
            if kind == kinds.mjEQ_JOINT:
                used = self._add_joints(number)
            elif kind == kinds.mjEQ_TENDON:
                used = self._add_tendons(number)
            else:
                links = [self._link_of.get(body, -1) for body in _bodies(self._mujoco, self._model, number)]
                used = -1 not in links and len(set(links)) == 2
                if used and kind == kinds.mjEQ_CONNECT:
                    closed.append(number)
                elif used:
                    raise HandError(
                        f"equality {self._name(number)} fixes two bodies to each other; a hand is a tree of links"
                    )
            if not used:
                ignored.append(number)
        return Couplings(self._followers(actuated), closed, ignored)

    def _name(self, number: int) -> str:
        return repr(name_of(self._model, "equality", number))

    def _at_rest(self, joint: int) -> float:
        return float(self._model.qpos0[self._model.jnt_qposadr[joint]])

    def _polynomial(self, number: int) -> tuple[float, float]:
        data = self._model.eq_data[number]
        if np.any(data[2:5]):
            raise HandError(f"equality {self._name(number)} is not linear; leave two coefficients of polycoef")
        return float(data[0]), float(data[1])

    def _add(self, number: int, sides: tuple[dict[int, float], dict[int, float]], constant: float) -> bool:
        """Add the equation: the sum of the first side less that of the second is `constant`, from rest.

        Returns False where a joint is not of the hand.
        """
        row = np.zeros(len(self._joints))
        for sign, side in zip((1.0, -1.0), sides, strict=True):
            for joint, factor in side.items():
                if joint not in self._column:
                    return False
                row[self._column[joint]] += sign * factor
                constant += sign * factor * self._at_rest(joint)
        if not row.any():
            return False
        if np.count_nonzero(row) == 1:
            joint = self._joints[int(np.flatnonzero(row)[0])]
            raise HandError(
                f"equality {self._name(number)} holds one joint, {name_of(self._model, 'joint', joint)!r}; leave out "
                "the joint instead"
            )
        self._rows.append(row)
        self._constants.append(constant)
        return True

    def _add_joints(self, number: int) -> bool:
        offset, ratio = self._polynomial(number)
        first, second = int(self._model.eq_obj1id[number]), int(self._model.eq_obj2id[number])
        used = self._add(number, ({first: 1.0}, {second: ratio} if second >= 0 else {}), offset)
        if used:
            self._declared.add(first)
        return used

    def _add_tendons(self, number: int) -> bool:
        offset, ratio = self._polynomial(number)
        first, second = int(self._model.eq_obj1id[number]), int(self._model.eq_obj2id[number])
        one = self._along(first, number)
        other = {joint: ratio * factor for joint, factor in self._along(second, number).items()} if second >= 0 else {}
        return self._add(number, (one, other), offset)

    def _along(self, tendon: int, number: int) -> dict[int, float]:
        """Return the joints of a tendon with their coefficients."""
        model, first = self._model, int(self._model.tendon_adr[tendon])
        wraps = slice(first, first + int(model.tendon_num[tendon]))
        if any(model.wrap_type[wraps] != self._mujoco.mjtWrap.mjWRAP_JOINT):
            raise HandError(
                f"equality {self._name(number)} holds the tendon {name_of(model, 'tendon', tendon)!r}, which is not "
                "along joints; couple joints, or a fixed tendon"
            )
        return dict(zip(model.wrap_objid[wraps].tolist(), model.wrap_prm[wraps].tolist(), strict=True))

    def _followers(self, actuated: set[int]) -> dict[int, Coupling]:
        """Eliminate joints: those that the file lets follow first, then those without an actuator, the last first."""
        if not self._rows:
            return {}
        matrix = np.column_stack([np.array(self._rows), self._constants])
        scale = float(np.abs(matrix[:, :-1]).max())

        def order(joint: int) -> tuple[int, int]:
            return (0 if joint in self._declared else 2 if joint in actuated else 1), -joint

        pivots: dict[int, int] = {}
        for joint in sorted(self._joints, key=order):
            column = self._column[joint]
            free = [row for row in range(len(matrix)) if row not in pivots]
            row = max(free, key=lambda row: abs(matrix[row, column]), default=-1)
            if row < 0 or abs(matrix[row, column]) < _ROUNDING * scale:
                continue
            pivots[row] = joint
            matrix[row] /= matrix[row, column]
            for other in range(len(matrix)):
                if other != row:
                    matrix[other] -= matrix[other, column] * matrix[row]
        matrix[np.abs(matrix) < _ROUNDING * max(scale, 1.0)] = 0.0
        if any(matrix[row, -1] for row in range(len(matrix)) if row not in pivots):
            raise HandError("equalities of joints contradict each other; leave one of them out")
        return {joint: self._coupling(joint, matrix[row]) for row, joint in pivots.items()}

    def _coupling(self, joint: int, row: Array) -> Coupling:
        """Return the leader, ratio and offset of a joint from its row: its position and those of leaders."""
        leaders = [self._joints[column] for column in np.flatnonzero(row[:-1]) if self._joints[column] != joint]
        name = name_of(self._model, "joint", joint)
        if len(leaders) != 1:
            names = ", ".join(repr(name_of(self._model, "joint", leader)) for leader in leaders)
            raise HandError(
                f"equalities let joint {name!r} follow {names or 'no other joint, so it is held'}; a joint follows one "
                "other"
            )
        return leaders[0], float(-row[self._column[leaders[0]]]), float(row[-1])


def _bodies(mujoco: Any, model: Any, number: int) -> list[int]:
    """Return the two bodies that an equality holds together."""
    ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        return [int(model.site_bodyid[end]) for end in ends]
    return ends if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_BODY else []
