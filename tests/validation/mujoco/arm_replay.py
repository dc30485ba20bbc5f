"""A trial of a whole arm in MuJoCo: along a path to the grasp, close, lift, hold.

The arm is MuJoCo's reading of its URDF. The hand of `scene` is attached to its flange instead of a carriage. Torques
within the arm's limits pull its joints along the course: inverse dynamics of arm and hand, and feedback; that the hand
holds an object they learn from the feedback alone. Contacts of hand, arm, object and table are MuJoCo's.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from graspbox.arms import Arm, Trajectory
from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.hands.description import BASE, Array
from graspbox.tools.scene_export.contents import ObjectData, quaternion
from graspbox.tools.scene_export.mjcf import scene_model
from validation.mujoco.compare import describe
from validation.mujoco.replay import Outcome, Replay, TrialTimes, run_trial
from validation.mujoco.scene import Numerics, Scene, add_patch, indexed

__all__ = ["ArmOutcome", "ArmReplay", "ArmScene", "build_arm", "course_of", "replay_arm", "urdf_of"]

#: Before the names of the parts of the arm and the hand, which may have the same names.
_ARM, _HAND = "arm/", "hand/"
#: Inertia of the motors behind their gears, kg m2: MuJoCo Menagerie has this for UR5e and xArm7, 0.07 to 0.2 for FR3.
_ARMATURE = 0.1
#: Natural frequency of the critically damped feedback, rad/s: with `_ARMATURE` at least 9 kN m/rad, so that an arm
#: yields where a torque is at its limit. With 100 rad/s it yields by millimetres where fingers press on the table.
_FREQUENCY = 300.0
#: Collision bit of the arm's links and the table; links meet objects as the hand does.
_ARM_BIT = 2
#: Degree of the polynomials of a joint along the lift, whose error is some micrometres at the hand.
_DEGREE = 12
#: Time steps between two measurements of the flange.
_LOOK_EVERY = 4
#: Greatest difference of the heights of two lifts, metres.
_LIFT_ERROR = 1e-4


def urdf_of(arm: Arm) -> str:
    """Return the URDF of an arm for MuJoCo, which keeps its fixed links."""
    told = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    return arm.files[0].replace("</robot>", f"{told}</robot>")


@dataclass(frozen=True)
class ArmScene:
    """The model of an arm with a hand, and an object.

    Attributes
    ----------
    scene : Scene
        The model, and the indices of hand, object and table; `Scene.is_hand` is without the arm.
    arm : Arm
        The arm.
    flange_from_hand : (4, 4) float64
        Pose of the hand's grasp frame.
    base_body, flange_body : int
        Bodies of the arm.
    is_arm : (g,) bool
        Mask over geoms.
    addresses, dofs : (k,) int
        Of the arm's joints, in ``qpos`` and ``qvel``.
    torques : (k,) float64
        Greatest torques, N m.
    """

    scene: Scene
    arm: Arm
    flange_from_hand: Array
    base_body: int
    flange_body: int
    is_arm: NDArray[np.bool_]
    addresses: NDArray[np.intp]
    dofs: NDArray[np.intp]
    torques: Array


def build_arm(
    arm: Arm, hand: Hand, item: ObjectData, numerics: Numerics | None = None, *, patch: float = 0.0
) -> ArmScene:
    """Compile the model of an arm that carries a hand, one object, and the table; `patch` as for `scene.build`."""
    numerics, described = numerics or Numerics(), describe(hand)
    physics, names = PhysicsConfig(), tomllib.loads(arm.files[1])
    spec = mujoco.MjSpec.from_string(scene_model([item], [], None, physics, numerics))
    carried = mujoco.MjSpec.from_string(scene_model([], [], described, physics, numerics))
    spec.attach(_arm_spec(arm, described.bare_friction, numerics), prefix=_ARM, frame=spec.worldbody.add_frame())
    mount = arm.flange_from_base_of(hand)
    flange = spec.body(_ARM + names["flange"])
    frame = flange.add_frame(pos=mount[:3, 3], quat=quaternion(mount[:3, :3]))
    # With its actuators, and the pairs of its shapes, also those with the table.
    frame.attach_body(carried.body(described.links[BASE].name), _HAND, "")
    spec.geom("table").conaffinity |= _ARM_BIT
    model = spec.compile()
    add_patch(model, patch)
    scene = indexed(model, described, [item], numerics, _HAND)
    is_arm = np.array([model.geom(i).name.startswith(_ARM) for i in range(model.ngeom)])
    scene.is_hand &= ~is_arm
    joints = [model.joint(_ARM + name) for name in arm.joints]
    return ArmScene(
        scene=scene,
        arm=arm,
        flange_from_hand=mount @ described.base_from_hand,
        base_body=model.body(_ARM + names["base"]).id,
        flange_body=model.body(_ARM + names["flange"]).id,
        is_arm=is_arm,
        addresses=np.array([joint.qposadr[0] for joint in joints], dtype=np.intp),
        dofs=np.array([joint.dofadr[0] for joint in joints], dtype=np.intp),
        torques=np.array([model.jnt_actfrcrange[joint.id, 1] for joint in joints]),
    )


def _arm_spec(arm: Arm, friction: float, numerics: Numerics) -> mujoco.MjSpec:
    """Read an arm's URDF; its links meet objects and the table, as the hand's bare shapes do."""
    spec = mujoco.MjSpec.from_string(urdf_of(arm))
    for joint in spec.joints:
        joint.armature = _ARMATURE
    for geom in spec.geoms:
        geom.contype, geom.conaffinity, geom.condim = _ARM_BIT, 1, 3
        geom.friction = [friction, 0.0, 0.0]
        geom.solref[:], geom.solimp[:3] = numerics.solref, numerics.solimp
    return spec


def course_of(path: Trajectory, arm: Arm, times: TrialTimes, step: float) -> tuple[Array, Array]:
    """Return positions of the joints, one row per `step` seconds: (n, k) on the way to the grasp, (m, k) in the trial.

    The arm follows the path to the grasp at the path's speed. It lifts along the path at the speed of `times`, as the
    core does: its own would be another trial.

    The base stands upright.

    Raises
    ------
    ConfigError
        If the path does not lift as high as the trial.
    """
    dense = path.resampled(1.0 / step)
    way = dense.positions[np.isin(dense.phases, ("reach", "approach"))]
    lift = dense.positions[dense.phases == "lift"]
    heights = arm.flange_poses(lift)[:, 2, 3]
    rises = heights - heights[0]
    if abs(rises[-1] - times.lift_height) > _LIFT_ERROR:
        raise ConfigError(
            f"the path lifts by {rises[-1]:.4f} m, the trial by {times.lift_height} m; "
            f"plan it with PathConfig(lift={times.lift_height})"
        )
    fits = [Chebyshev.fit(rises, column, _DEGREE) for column in lift.T]
    now = np.array([times.rise(step * row) for row in range(round(times.end / step))])
    return way, np.stack([fit(now) for fit in fits], axis=1)


@dataclass
class ArmOutcome:
    """Result of a trial of a whole arm.

    Attributes
    ----------
    trial : Outcome
        Its verdict.
    distance, angle : float
        Greatest distance, metres, and angle, rad, of the flange from that of the course.
    torque : float
        Greatest torque as a share of a joint's limit; 1 where it was cut.
    touched : bool
        A link of the arm touched the object or the table.
    """

    trial: Outcome
    distance: float
    angle: float
    torque: float
    touched: bool


class ArmReplay(Replay):
    """A trial of an arm in progress: `approach`, then `validation.mujoco.replay.run_trial`."""

    def __init__(
        self,
        arm_scene: ArmScene,
        world_from_base: Array,
        preshape: float,
        course: tuple[Array, Array],
        times: TrialTimes | None = None,
    ) -> None:
        self.arm_scene, self._world_from_base = arm_scene, world_from_base
        step = arm_scene.scene.numerics.timestep
        self.positions = np.concatenate(course)
        self._speeds = np.gradient(self.positions, step, axis=0)
        self._accelerations = np.gradient(self._speeds, step, axis=0)
        self._before = len(course[0])
        self._row = 0
        self.distance = self.angle = self.torque = 0.0
        self.touched = False
        # The hand's place is fixed on the flange.
        super().__init__(arm_scene.scene, arm_scene.flange_from_hand, preshape, times)

    def _place(self, world_from_hand: Array) -> None:
        model, base = self.model, self.arm_scene.base_body
        model.body_pos[base] = self._world_from_base[:3, 3]
        model.body_quat[base] = quaternion(self._world_from_base[:3, :3])
        super()._place(world_from_hand)
        self.data.qpos[self.arm_scene.addresses] = self.positions[0]

    def approach(self) -> None:
        """Move the open hand to the grasp."""
        while self._row < self._before:
            self._advance(closes=False)
        # The contacts there.
        mujoco.mj_forward(self.model, self.data)

    def step(self) -> None:
        """Advance the trial by one time step."""
        self._advance(closes=True)
        self.steps += 1

    def _advance(self, *, closes: bool) -> None:
        model, data = self.model, self.data
        self.drive.apply(model, data, closes=closes)
        mujoco.mj_step1(model, data)
        self._pull()
        mujoco.mj_step2(model, data)
        self._row += 1
        if self._row % _LOOK_EVERY == 0:
            self._look()

    def _pull(self) -> None:
        """Set the torques of the arm's joints."""
        model, data, row = self.model, self.data, self._row
        places, dofs, limit = self.arm_scene.addresses, self.arm_scene.dofs, self.arm_scene.torques
        behind = self.positions[row] - data.qpos[places]
        slower = self._speeds[row] - data.qvel[dofs]
        wanted, torque = np.zeros(model.nv), np.zeros(model.nv)
        wanted[dofs] = self._accelerations[row] + _FREQUENCY**2 * behind + 2.0 * _FREQUENCY * slower
        mujoco.mj_mulM(model, data, torque, wanted)
        pull = torque[dofs] + data.qfrc_bias[dofs] - data.qfrc_passive[dofs]
        self.torque = max(self.torque, min(float(np.abs(pull / limit).max()), 1.0))
        data.qfrc_applied[dofs] = np.clip(pull, -limit, limit)

    def _look(self) -> None:
        """Measure the flange, and whether the arm touches something."""
        data, own = self.data, self.arm_scene
        wanted = self._world_from_base @ own.arm.flange_poses(self.positions[None, self._row - 1])[0]
        turn = data.xmat[own.flange_body].reshape(3, 3).T @ wanted[:3, :3]
        sine = 0.5 * float(np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]))
        self.distance = max(self.distance, float(np.linalg.norm(data.xpos[own.flange_body] - wanted[:3, 3])))
        self.angle = max(self.angle, float(np.arcsin(min(sine, 1.0))))
        contact = data.contact
        self.touched = self.touched or bool((own.is_arm[contact.geom].any(axis=1) & (contact.dist < 0.0)).any())

    def object_place(self, body: int | None = None) -> Array:
        """Return the centre of mass of an object, by default the first, in the frame of the hand's base, m."""
        data, base = self.data, self.scene.base_body
        place = data.xipos[self.scene.object_body if body is None else body] - data.xpos[base]
        return np.asarray(data.xmat[base].reshape(3, 3).T @ place)


def replay_arm(
    arm_scene: ArmScene, world_from_base: Array, path: Trajectory, times: TrialTimes | None = None
) -> ArmOutcome:
    """Run one trial to its end: the arm follows a path to the grasp, the hand closes, the arm lifts and holds.

    Parameters
    ----------
    arm_scene : ArmScene
        The result of `build_arm`.
    world_from_base : (4, 4) float64
        Pose of the arm's base.
    path : Trajectory
        See `course_of`.
    times : TrialTimes, optional
        By default the core's.
    """
    times = times or TrialTimes()
    course = course_of(path, arm_scene.arm, times, arm_scene.scene.numerics.timestep)
    run = ArmReplay(arm_scene, world_from_base, path.preshape, course, times)
    run.approach()
    outcome = run_trial(run)
    return ArmOutcome(outcome, run.distance, run.angle, run.torque, run.touched)
