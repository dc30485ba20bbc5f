"""One trial in MuJoCo: close, lift, hold, with the core's definition of success.

Only MuJoCo steps the world. Between steps `drive` moves the actuators, and the carriage follows a minimum-jerk lift.
"""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from graspbox._core import CLEAR_OF_TABLE, REST_TIME
from graspbox.configs import PhysicsConfig, SuccessCriterion, TrialConfig
from graspbox.envs.motion import minimum_jerk
from graspbox.hands.description import Array, joint_motion
from graspbox.simulation.outcomes import FailureKind
from graspbox.tools.scene_export.contents import object_names, quaternion
from graspbox.tools.scene_export.mjcf import CARRIAGE_INERTIA
from validation.mujoco.drive import Drive
from validation.mujoco.scene import Scene

#: Criterion of success: rise of the centre of mass (m), speed in the hand's frame (m/s), and hold time (s).
LIFT_HEIGHT, REST_SPEED, HOLD_TIME = (
    SuccessCriterion.lift_height,
    SuccessCriterion.rest_speed,
    SuccessCriterion.hold_time,
)
#: Interval at which the criterion is checked, s: the core's time step.
_LOOK_EVERY = PhysicsConfig.dt
#: Trials are infeasible if bodies overlap by more than this at the start, m; contacts at rest are less deep.
_START_DEPTH = 0.001
#: Rise of an object relative to the hand that settling fingers can cause, m; the core's early stops allow the same.
_CURL_RISE = 0.03


@dataclass(frozen=True)
class TrialTimes:
    """Phases of a trial, by default the core's; seconds and metres."""

    close_time: float = TrialConfig.close_time
    lift_height: float = TrialConfig.lift_height
    lift_time: float = TrialConfig.lift_time
    hold_time: float = TrialConfig.hold_time

    @property
    def end(self) -> float:
        """Duration of the trial, s."""
        return self.close_time + self.lift_time + self.hold_time

    def rise(self, time: float) -> float:
        """Return the height of the palm above its start, m."""
        return self.lift_height * minimum_jerk((time - self.close_time) / self.lift_time)


@dataclass
class Outcome:
    """Result of a trial."""

    success: bool
    failure: FailureKind | None
    #: Rise of the centre of mass at the end, m.
    lift: float
    #: Greatest speed in the hand's frame, averaged as in the core, during the last half second, m/s; infinite if
    #: infeasible.
    speed: float
    #: Number of the hand's links that touched the object when lifting began, and at the end.
    touching: tuple[int, int]
    #: Largest overlap of object and hand during the last half second, m.
    depth: float
    #: Simulated seconds.
    time: float
    trace: list[Sample] = field(default_factory=list)


@dataclass
class Sample:
    """A row of the trace, one per 10 ms."""

    time: float
    #: Positions of the dynamic joints, in the order of their links, rad or m.
    joints: Array
    #: Loads of the actuators, N or N m, and their positions, rad or m.
    loads: Array
    actuators: Array
    #: Pose of the object, (4, 4), metres.
    world_from_object: Array


class Replay:
    """A trial in progress."""

    def __init__(self, scene: Scene, world_from_hand: Array, preshape: float, times: TrialTimes | None = None):
        self.scene = scene
        self.times = times or TrialTimes()
        # The model contains the poses of bodies without joints, so each trial has its own copy.
        self.model = copy.copy(scene.model)
        self.data = mujoco.MjData(self.model)
        self.dt = scene.numerics.timestep
        self.steps = 0
        self.drive = Drive(scene, scene.hand.open_positions(preshape))
        self._place(world_from_hand)
        mujoco.mj_forward(self.model, self.data)
        self.resting_heights = self.data.xipos[list(scene.object_bodies), 2].copy()

    def _place(self, world_from_hand: Array) -> None:
        scene, model, data = self.scene, self.model, self.data
        world_from_base = world_from_hand @ np.linalg.inv(scene.hand.base_from_hand)
        model.body_pos[scene.base_body] = world_from_base[:3, 3]
        model.body_quat[scene.base_body] = quaternion(world_from_base[:3, :3])
        hand, positions = scene.hand, list(self.drive.positions)
        for link in hand.moving:
            if link.index not in scene.joints:
                motion = joint_motion(link, hand.start_position(link.index, positions))
                body, frame = model.body(scene.prefix + link.name).id, link.parent_from_link @ motion
                model.body_pos[body], model.body_quat[body] = frame[:3, 3], quaternion(frame[:3, :3])
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        for name, item in zip(object_names(len(scene.objects)), scene.objects, strict=True):
            rest, start = item.start, model.joint(name).qposadr[0]
            data.qpos[start : start + 3] = rest[:3, 3]
            data.qpos[start + 3 : start + 7] = quaternion(rest[:3, :3])
        # Servo-driven joints and mimic joints of the open hand.
        for index, (address, _) in scene.joints.items():
            data.qpos[address] = hand.start_position(index, positions)

    @cached_property
    def _carriage(self) -> tuple[int, int]:
        """Address in ``qpos`` and index in ``qvel`` of the carriage."""
        joint = self.model.joint("carriage")
        return int(joint.qposadr[0]), int(joint.dofadr[0])

    def contacts(self, body: int | None = None) -> tuple[bool, int, float]:
        """Return whether an object touches table or walls, how many hand links touch it, and their greatest depth, m.

        The object is that of a body, by default the first.
        """
        body = self.scene.object_body if body is None else body
        contact = self.data.contact
        geoms, distance = contact.geom, contact.dist
        scene = self.scene
        if len(distance) == 0:
            return False, 0, 0.0
        object_first, object_second = (self.model.geom_bodyid[geoms] == body).T
        other = np.where(object_first, geoms[:, 1], geoms[:, 0])
        pressing = (object_first | object_second) & (distance < 0.0)
        hand = pressing & scene.is_hand[other]
        links = np.unique(self.model.geom_bodyid[other[hand]])
        depth = float(-distance[hand].min()) if hand.any() else 0.0
        return bool((pressing & scene.is_scenery[other]).any()), len(links), depth

    def is_feasible(self) -> bool:
        """Return whether the open hand is free of collisions with object and table at the start."""
        contact = self.data.contact
        hand = self.scene.is_hand[contact.geom]
        mixed = hand[:, 0] != hand[:, 1]
        return not bool((contact.dist[mixed] < -_START_DEPTH).any())

    def joint(self, link: int) -> tuple[float, float]:
        """Return position (rad or m) and speed of the joint of a link."""
        address, dof = self.scene.joints[link]
        return float(self.data.qpos[address]), float(self.data.qvel[dof])

    def load(self, index: int) -> float:
        """Return the load of an actuator: tension of its tendon, or the greatest closing force on its joints."""
        return float(self.drive.loads(self.data)[index])

    def step(self) -> None:
        """Advance by one time step."""
        data, dt = self.data, self.dt
        self.drive.apply(self.model, data)
        now, dof = self._carriage
        rise, after = self.times.rise(self.steps * dt), self.times.rise((self.steps + 1) * dt)
        speed = (after - rise) / dt
        data.qfrc_applied[dof] = CARRIAGE_INERTIA * (speed - data.qvel[dof]) / dt
        mujoco.mj_step(self.model, data)
        data.qpos[now], data.qvel[dof] = after, speed
        self.steps += 1

    def object_place(self, body: int | None = None) -> Array:
        """Return a centre of mass relative to the hand up to a constant, m; the hand only translates vertically.

        The object is that of a body, by default the first.
        """
        place: Array = self.data.xipos[self.scene.object_body if body is None else body].copy()
        place[2] -= self.data.qpos[self._carriage[0]]
        return place

    def sample(self) -> Sample:
        """Record a row of the trace."""
        pose = np.eye(4)
        pose[:3, :3] = self.data.xmat[self.scene.object_body].reshape(3, 3)
        pose[:3, 3] = self.data.xpos[self.scene.object_body]
        return Sample(
            time=self.steps * self.dt,
            joints=self.data.qpos[self.drive.addresses],
            loads=self.drive.loads(self.data),
            actuators=self.drive.positions.copy(),
            world_from_object=pose,
        )


def replay(
    scene: Scene,
    world_from_hand: Array,
    preshape: float,
    times: TrialTimes | None = None,
    *,
    trace: bool = False,
    early_stop: bool = False,
) -> Outcome:
    """Run one trial; to its end unless `early_stop` is set.

    Parameters
    ----------
    scene : Scene
        The result of `build`.
    world_from_hand : (4, 4) float64
        Pose of the grasp frame at which closing begins.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    trace : bool
        Whether to record a row every 10 ms.
    early_stop : bool
        Whether to stop, as failed, when the object is so far below the hand that the lift cannot raise it high enough.
    """
    return run_trial(Replay(scene, world_from_hand, preshape, times), trace=trace, early_stop=early_stop)


@dataclass
class _Judge:
    """Judges the grasp of one object of a trial."""

    body: int
    resting_height: float
    places: deque[Array]
    holds: bool = True
    touching: int = 0
    links: int = 0
    rise: float = 0.0
    highest: float = 0.0
    left_table: bool = False
    on_scenery: bool = True
    fastest: float = 0.0
    deepest: float = 0.0

    def look(self, run: Replay, every: float, *, closing: bool, holding: bool) -> None:
        """Look at the object, once per `every` seconds, while the hand closes, lifts or holds."""
        was_on_scenery = self.on_scenery
        self.on_scenery, self.links, depth = run.contacts(self.body)
        self.rise = float(run.data.xipos[self.body, 2]) - self.resting_height
        self.highest = max(self.highest, self.rise)
        self.left_table = self.left_table or (was_on_scenery and not self.on_scenery)
        if closing:
            self.touching = self.links
        self.places.append(run.object_place(self.body))
        if holding:
            speed = float(np.linalg.norm(self.places[-1] - self.places[0])) / (max(len(self.places) - 1, 1) * every)
            self.fastest, self.deepest = max(self.fastest, speed), max(self.deepest, depth)
            self.holds = self.holds and self.rise >= LIFT_HEIGHT and not self.on_scenery and speed < REST_SPEED

    def failure(self, finite: bool) -> FailureKind:
        """Name the kind of a failure; `finite` is False if the simulation diverged."""
        if self.touching == 0:
            return "no_contact"
        if not finite or (self.links > 0 and not self.on_scenery and self.rise >= LIFT_HEIGHT):
            return "unstable"
        return "dropped" if self.highest >= CLEAR_OF_TABLE and self.left_table else "slipped"


def run_trial(run: Replay, *, trace: bool = False, early_stop: bool = False) -> Outcome:
    """Run a trial from its start; the options are those of `replay`."""
    if not run.is_feasible():
        return Outcome(False, "infeasible", 0.0, np.inf, (0, 0), 0.0, 0.0)
    return run_grasp(run, trace=trace, early_stop=early_stop)


def run_grasp(run: Replay, *, trace: bool = False, early_stop: bool = False) -> Outcome:
    """Close, lift and hold, whether or not the hand has room; among several objects, any may be held."""
    times, dt = run.times, run.dt
    close, end, hold = (round(t / dt) for t in (times.close_time, times.end, HOLD_TIME))
    look, rows = max(1, round(_LOOK_EVERY / dt)), max(1, round(0.01 / dt))
    samples = [run.sample()] if trace else []
    judges = [
        _Judge(body, float(height), deque(maxlen=round(REST_TIME / (look * dt)) + 1))
        for body, height in zip(run.scene.object_bodies, run.resting_heights, strict=True)
    ]
    while run.steps < end:
        run.step()
        if trace and run.steps % rows == 0:
            samples.append(run.sample())
        if run.steps % look:
            continue
        for judge in judges:
            judge.look(run, look * dt, closing=run.steps <= close, holding=run.steps > end - hold)
        most = max(judge.rise for judge in judges) + times.lift_height - times.rise(run.steps * dt)
        if early_stop and run.steps > close and most + _CURL_RISE < LIFT_HEIGHT:
            for judge in judges:
                judge.holds = False
            break
    finite = bool(np.isfinite(run.data.qpos).all()) and not run.data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
    best = max(judges, key=lambda judge: (judge.holds, judge.touching, judge.highest))
    success = best.holds and finite
    failure = None if success else best.failure(finite)
    touching = (best.touching, best.links)
    return Outcome(success, failure, best.rise, best.fastest, touching, best.deepest, run.steps * dt, samples)
