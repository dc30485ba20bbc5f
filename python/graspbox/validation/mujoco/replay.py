"""One trial in MuJoCo: close, lift, hold, with the core's definition of success.

Only MuJoCo steps the world. Between steps the spools turn (position command at full speed, stalled while the tension
is at its maximum), the soft joint stops push, and the carriage follows the minimum-jerk lift.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import mujoco
import numpy as np

from graspbox._core import CLEAR_OF_TABLE
from graspbox.configs import PhysicsConfig, SuccessCriterion, TrialConfig
from graspbox.envs.motion import minimum_jerk
from graspbox.outcomes import FailureKind
from graspbox.validation.mujoco.description import Array, Finger
from graspbox.validation.mujoco.scene import CARRIAGE_INERTIA, Scene, quaternion

#: Criterion of success: rise of the centre of mass (m), speed in the hand's frame (m/s), and hold time (s).
LIFT_HEIGHT, REST_SPEED, HOLD_TIME = (
    SuccessCriterion.lift_height,
    SuccessCriterion.rest_speed,
    SuccessCriterion.hold_time,
)
#: Interval at which the criterion is checked, s: the core's time step.
_LOOK_EVERY = PhysicsConfig.dt
#: Bodies that overlap by more than this at the start make a trial infeasible, m: contacts are left at rest less deep
#: than this.
_START_DEPTH = 0.001


@dataclass(frozen=True)
class TrialTimes:
    """The script of a trial, by default the core's; seconds and metres."""

    close_time: float = TrialConfig.close_time
    lift_height: float = TrialConfig.lift_height
    lift_time: float = TrialConfig.lift_time
    hold_time: float = TrialConfig.hold_time

    @property
    def end(self) -> float:
        """Length of the whole trial, s."""
        return self.close_time + self.lift_time + self.hold_time

    def rise(self, time: float) -> float:
        """Height of the palm above its start, m."""
        return self.lift_height * minimum_jerk((time - self.close_time) / self.lift_time)


@dataclass
class Outcome:
    """Result of a trial."""

    success: bool
    failure: FailureKind | None
    #: Rise of the centre of mass at the end, m.
    lift: float
    #: Greatest speed in the hand's frame during the last half second, m/s; infinite for a trial that ended before.
    speed: float
    #: Links of the hand that touched the object when lifting began, and at the end.
    touching: tuple[int, int]
    #: Largest overlap of object and hand during the last half second, m.
    depth: float
    #: Simulated seconds.
    time: float
    trace: list[Sample] = field(default_factory=list)


@dataclass
class Sample:
    """A row of the trace, every 10 ms."""

    time: float
    #: (fingers, 2) angles, rad.
    fingers: Array
    #: (fingers,) N.
    tensions: Array
    #: (fingers,) rad.
    spools: Array
    #: (4, 4).
    world_from_object: Array


class Replay:
    """A trial in progress."""

    def __init__(self, scene: Scene, world_from_hand: Array, preshape: float, times: TrialTimes | None = None):
        self.scene = scene
        self.times = times or TrialTimes()
        # Poses of jointless bodies belong to the model, so each trial has its own.
        self.model = copy.copy(scene.model)
        self.data = mujoco.MjData(self.model)
        self.dt = scene.numerics.timestep
        self.steps = 0
        self.spools = [0.0] * len(scene.hand.fingers)
        self._place(world_from_hand, preshape)
        mujoco.mj_forward(self.model, self.data)
        self.resting_height = float(self.data.xipos[scene.object_body, 2])

    def _place(self, world_from_hand: Array, preshape: float) -> None:
        scene, model, data = self.scene, self.model, self.data
        world_from_base = world_from_hand @ np.linalg.inv(scene.hand.base_from_hand)
        model.body_pos[scene.base_body] = world_from_base[:3, 3]
        model.body_quat[scene.base_body] = quaternion(world_from_base[:3, :3])
        for finger, body in zip(scene.hand.fingers, scene.swivels, strict=True):
            if finger.swivel is None:
                continue
            index, sign = finger.swivel
            turn, pose = np.empty(4), np.empty(4)
            mujoco.mju_axisAngle2Quat(turn, scene.hand.links[index].axis, sign * preshape)
            mujoco.mju_mulQuat(pose, quaternion(scene.hand.links[index].parent_from_link[:3, :3]), turn)
            model.body_quat[body] = pose
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        rest = scene.object.world_from_object
        lowest = min(float((points @ rest[2, :3]).min()) for points in scene.object.parts) + rest[2, 3]
        start = model.joint("object").qposadr[0]
        # The core leaves a resting object up to half a millimetre deep in the table; here that would be a push upwards.
        data.qpos[start : start + 3] = rest[:3, 3] - [0.0, 0.0, min(lowest, 0.0)]
        data.qpos[start + 3 : start + 7] = quaternion(rest[:3, :3])
        self._carriage = (int(model.joint("carriage").qposadr[0]), int(model.joint("carriage").dofadr[0]))

    def contacts(self) -> tuple[bool, int, float]:
        """Whether the object touches the scenery, the number of hand links that touch it, and their depth in metres."""
        contact = self.data.contact
        geoms, distance = contact.geom, contact.dist
        scene = self.scene
        if len(distance) == 0:
            return False, 0, 0.0
        object_first, object_second = scene.is_object[geoms[:, 0]], scene.is_object[geoms[:, 1]]
        other = np.where(object_first, geoms[:, 1], geoms[:, 0])
        pressing = (object_first | object_second) & (distance < 0.0)
        hand = pressing & scene.is_hand[other]
        links = np.unique(self.model.geom_bodyid[other[hand]])
        depth = float(-distance[hand].min()) if hand.any() else 0.0
        return bool((pressing & scene.is_scenery[other]).any()), len(links), depth

    def is_feasible(self) -> bool:
        """Tell whether the open hand is free of object and scenery at the start."""
        contact = self.data.contact
        hand = self.scene.is_hand[contact.geom]
        mixed = hand[:, 0] != hand[:, 1]
        return not bool((contact.dist[mixed] < -_START_DEPTH).any())

    def angles(self, finger: int) -> tuple[float, float, float, float]:
        """Give proximal and distal angle (rad) and speed (rad/s)."""
        proximal, distal = self.scene.joints[finger]
        adr = self.model.jnt_qposadr[self.model.dof_jntid[[proximal, distal]]]
        q, v = self.data.qpos, self.data.qvel
        return float(q[adr[0]]), float(q[adr[1]]), float(v[proximal]), float(v[distal])

    def step(self) -> None:
        """Advance by one time step."""
        data, dt = self.data, self.dt
        for i, finger in enumerate(self.scene.hand.fingers):
            self._drive(i, finger)
        now, dof = self._carriage
        rise, after = self.times.rise(self.steps * dt), self.times.rise((self.steps + 1) * dt)
        speed = (after - rise) / dt
        data.qfrc_applied[dof] = CARRIAGE_INERTIA * (speed - data.qvel[dof]) / dt
        mujoco.mj_step(self.model, data)
        data.qpos[now], data.qvel[dof] = after, speed
        self.steps += 1

    def _drive(self, index: int, finger: Finger) -> None:
        """Turn the spool, and let the soft stops push."""
        data = self.data
        q_p, q_d, _, _ = self.angles(index)
        actuator = self.scene.actuators[index]
        spool = self.spools[index]
        stalled = data.actuator_force[actuator] >= finger.max_tension
        after = spool if stalled else min(spool + finger.speed * self.dt, finger.travel[1])
        self.spools[index] = after
        taken = finger.spool_radius * after
        stretch = taken - finger.arms[0] * q_p - finger.arms[1] * q_d
        rate = finger.spool_radius * (after - spool) / self.dt
        # A slack tendon does not pull, however fast it is wound up: 0 is far below any length that could.
        data.ctrl[actuator] = taken + finger.damping / finger.stiffness * rate if stretch > 0.0 else -1.0
        hand = self.scene.hand
        for dof, angle, link in zip(
            self.scene.joints[index], (q_p, q_d), (finger.proximal, finger.distal), strict=True
        ):
            low, high = hand.links[link].limits
            data.qfrc_applied[dof] = finger.stop_stiffness * (min(max(angle, low), high) - angle)

    def object_speed(self) -> float:
        """Speed of the centre of mass in the hand's frame, which only translates, m/s."""
        dof = self.model.joint("object").dofadr[0]
        body, data = self.scene.object_body, self.data
        spin = data.xmat[body].reshape(3, 3) @ data.qvel[dof + 3 : dof + 6]
        velocity = data.qvel[dof : dof + 3] + np.cross(spin, data.xipos[body] - data.xpos[body])
        velocity[2] -= data.qvel[self._carriage[1]]
        return float(np.linalg.norm(velocity))

    def sample(self) -> Sample:
        """Take a row of the trace."""
        fingers = range(len(self.spools))
        pose = np.eye(4)
        pose[:3, :3] = self.data.xmat[self.scene.object_body].reshape(3, 3)
        pose[:3, 3] = self.data.xpos[self.scene.object_body]
        return Sample(
            time=self.steps * self.dt,
            fingers=np.array([self.angles(i)[:2] for i in fingers]),
            tensions=np.array([self.data.actuator_force[a] for a in self.scene.actuators]),
            spools=np.array(self.spools),
            world_from_object=pose,
        )


def replay(
    scene: Scene, world_from_hand: Array, preshape: float, times: TrialTimes | None = None, *, trace: bool = False
) -> Outcome:
    """Run one trial to its end; nothing stops it early.

    Parameters
    ----------
    scene : Scene
        From `build`.
    world_from_hand : (4, 4) float64
        The grasp frame when closing begins.
    preshape : float
        rad.
    trace : bool
        Also return a row every 10 ms.
    """
    run = Replay(scene, world_from_hand, preshape, times)
    if not run.is_feasible():
        return Outcome(False, "infeasible", 0.0, np.inf, (0, 0), 0.0, 0.0)
    times, dt = run.times, run.dt
    close, end, hold = (round(t / dt) for t in (times.close_time, times.end, HOLD_TIME))
    look, rows = max(1, round(_LOOK_EVERY / dt)), max(1, round(0.01 / dt))
    samples = [run.sample()] if trace else []
    touching, highest, left_table, was_on_scenery = 0, 0.0, False, True
    holds, fastest, deepest, rise, links, on_scenery = True, 0.0, 0.0, 0.0, 0, True
    while run.steps < end:
        run.step()
        if trace and run.steps % rows == 0:
            samples.append(run.sample())
        if run.steps % look:
            continue
        on_scenery, links, depth = run.contacts()
        rise = float(run.data.xipos[scene.object_body, 2]) - run.resting_height
        highest = max(highest, rise)
        left_table = left_table or (was_on_scenery and not on_scenery)
        was_on_scenery = on_scenery
        if run.steps <= close:
            touching = links
        if run.steps > end - hold:
            speed = run.object_speed()
            fastest, deepest = max(fastest, speed), max(deepest, depth)
            holds = holds and rise >= LIFT_HEIGHT and not on_scenery and speed < REST_SPEED
    finite = bool(np.isfinite(run.data.qpos).all()) and not run.data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
    success = holds and finite
    failure: FailureKind | None = None
    if not success:
        if touching == 0:
            failure = "no_contact"
        elif not finite or (links > 0 and not on_scenery and rise >= LIFT_HEIGHT):
            failure = "unstable"
        elif highest >= CLEAR_OF_TABLE and left_table:
            failure = "dropped"
        else:
            failure = "slipped"
    return Outcome(success, failure, rise, fastest, (touching, links), deepest, run.steps * dt, samples)
