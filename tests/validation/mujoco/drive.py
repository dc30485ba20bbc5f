"""Motion of the hand's actuators, and tendons at their force limit, which MuJoCo does not compute.

All quantities are arrays over the dynamic joints (in the order of `Scene.joints`), over the actuators of the hand, or
over MuJoCo's actuators ("drives": one per tendon or driven joint).
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from graspbox.hands.description import Array
from validation.mujoco.scene import Scene

#: Share of its damping that still acts on the joints while a tendon or servo is at its force limit: the friction of
#: tendon and sheath, without that of the motor. Both engines of the core do the same.
SATURATED_DAMPING = 0.2
#: Command of a slack tendon, metres: far below any tendon length, so that it does not pull at any winding speed.
_SLACK = -1.0


class Drive:
    """The actuators of one replay, which close the hand."""

    def __init__(self, scene: Scene, positions: list[float]):
        hand, joints = scene.hand, scene.joints
        self.dt = scene.numerics.timestep
        #: Positions of the hand's actuators, rad or m.
        self.positions: Array = np.array(positions)
        #: Addresses of the joints in ``qpos`` and ``qvel``.
        self.addresses = np.array([address for address, _ in joints.values()], dtype=np.intp)
        self.dofs = np.array([dof for _, dof in joints.values()], dtype=np.intp)
        springs = [hand.links[link].spring for link in joints]
        self._damping = np.array([spring.damping for spring in springs])
        self._speed = np.array([a.speed if a.closes else 0.0 for a in hand.actuators])
        self._travel = np.array([a.travel[1] for a in hand.actuators])
        self._limit = np.array([a.load_limit for a in hand.actuators])
        self._read_drives(scene)

    def _read_drives(self, scene: Scene) -> None:
        """Collect a row per drive: its index in MuJoCo, its actuator, its gains, and its moment arms at the joints."""
        hand, column = scene.hand, {link: i for i, link in enumerate(scene.joints)}
        index, owner, wound, spools = [], [], [], []
        offsets, laws, limits, arms = [], [], [], []
        for number, actuator in enumerate(hand.actuators):
            for i, drive in enumerate(scene.actuators[number]):
                row = np.zeros(len(column))
                if actuator.spool is not None:
                    tendon = hand.tendons[actuator.spool[0]]
                    for link, arm in tendon.arms:
                        row[column[link]] = arm
                    wound.append(actuator.spool[1])
                    offsets.append(0.0)
                    laws.append((tendon.stiffness, tendon.damping))
                    limits.append(tendon.max_tension)
                else:
                    assert actuator.servo is not None
                    link, ratio, offset = actuator.joints[i]
                    row[column[link]] = 1.0
                    wound.append(ratio)
                    offsets.append(offset)
                    laws.append(actuator.servo)
                    limits.append(actuator.load_limit)
                spools.append(actuator.spool is not None)
                index.append(drive)
                owner.append(number)
                arms.append(row)
        self._index, self._owner = np.array(index, dtype=np.intp), np.array(owner, dtype=np.intp)
        self._wound, self._offset = np.array(wound), np.array(offsets)
        self._is_spool: NDArray[np.bool_] = np.array(spools, dtype=bool)
        self._stiffness, self._rate_gain = np.array(laws).reshape(-1, 2).T
        self._greatest = np.array(limits)
        self._arms = np.array(arms).reshape(-1, len(column))
        #: Damping of each joint by each drive at its force limit.
        self._extra = SATURATED_DAMPING * self._rate_gain[:, None] * self._arms**2

    def loads(self, data: mujoco.MjData) -> Array:
        """Return each actuator's load, N or N m: tension of its tendon, or the greatest closing force on its joints."""
        loads = np.zeros(len(self.positions))
        np.maximum.at(loads, self._owner, data.actuator_force[self._index] * np.sign(self._wound))
        return loads

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData, *, closes: bool = True) -> None:
        """Move the actuators by a time step unless the hand stays open; set MuJoCo's commands and dampings."""
        before = self.positions
        pulls = closes & (self.loads(data) < self._limit)
        after = np.where(pulls, np.minimum(before + self._speed * self.dt, np.maximum(self._travel, before)), before)
        self.positions = after
        q = data.qpos[self.addresses]
        taken, start = self._wound * after[self._owner], self._wound * before[self._owner]
        length = self._arms @ q
        # The damper acts between drive and joints; MuJoCo's acts on the joints only, so add the drive's speed.
        wound = taken + self._offset + self._rate_gain / self._stiffness * (taken - start) / self.dt
        data.ctrl[self._index] = np.where(self._is_spool & (taken <= length), _SLACK, wound)
        stretch = start + self._offset - length
        full = self._stiffness * np.where(self._is_spool, stretch, np.abs(stretch)) >= self._greatest
        model.dof_damping[self.dofs] = self._damping + full @ self._extra
