"""Paths of an arm's joints from the environments, followed in MuJoCo by an arm of the same URDF.

An environment moves an arm by random actions, 100 a second. MuJoCo simulates the arm, which torques pull along the
recorded joints: its inverse dynamics, and feedback. The flange is compared, which both find by their own forward
kinematics. A path that jumps, or is faster than its speeds say, cannot be followed.
"""

import tomllib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox import arms
from graspbox.envs import spaces
from graspbox.hands.description import describe
from validation.mujoco.arm_replay import urdf_of

__all__ = ["ANGLE", "DISTANCE", "ArmRow", "follow_paths"]

#: Greatest distance, metres, and angle, degrees, of the flange in both.
DISTANCE, ANGLE = 1e-3, 0.5
#: Actions per second, and MuJoCo's time steps per action.
_RATE, _SUBSTEPS = 100, 10
#: Actions between two that differ.
_HELD = 20
#: Feedback of positions and speeds, 1/s2 and 1/s.
_GAINS = 2500.0, 100.0
#: A hand that every arm but the hobby one carries, and the control modes of the paths.
_HAND, _CONTROLS = "panda_gripper", ("twist", "joint_velocity")


@dataclass(frozen=True)
class ArmRow:
    """Results of an arm.

    Attributes
    ----------
    arm : str
        Its name.
    paths : int
        Number of paths.
    travel : float
        Mean way of the flange on a path, metres.
    distance, angle : float
        Greatest distance, metres, and angle, degrees, between its flange in both.
    """

    arm: str
    paths: int
    travel: float
    distance: float
    angle: float

    @property
    def agrees(self) -> bool:
        """Whether the flange is within `DISTANCE` and `ANGLE` along all paths."""
        return self.distance <= DISTANCE and self.angle <= ANGLE

    def to_json(self) -> dict[str, Any]:
        """Return the fields, and whether both agree."""
        return {**asdict(self), "agrees": self.agrees}


def follow_paths(
    arm: str, paths: int, seconds: float, seed: int, progress: Callable[[int], None] = lambda _: None
) -> ArmRow:
    """Record paths of an arm, half of them by twists and half by speeds of its joints, and follow them in MuJoCo."""
    most, way = np.zeros(2), 0.0
    simulated = _Simulated(arms.load_arm(arm))
    for path in range(paths):
        joints, speeds, flange = _record(arm, _CONTROLS[path % 2], round(seconds * _RATE), seed + path)
        most = np.maximum(most, simulated.follow(joints, speeds, flange))
        way += float(np.linalg.norm(np.diff(flange[:, :3, 3], axis=0), axis=1).sum()) / paths
        progress(path + 1)
    return ArmRow(arm, paths, way, float(most[0]), float(np.degrees(most[1])))


def _record(arm: str, control: str, steps: int, seed: int) -> tuple[NDArray[np.float64], ...]:
    """Joints (n, k), their speeds (n, k), and flange (n, 4, 4) in the base's frame, one row per action."""
    loaded, hand = arms.load_arm(arm), graspbox.load_hand(_HAND)
    env: Any = gymnasium.make(
        "graspbox/Grasp-v0", objects="procedural:ball:0", hand=_HAND, arm=arm, obs="proprio", control=control,
        control_freq=_RATE, max_episode_steps=steps + 1,
    )  # fmt: skip
    columns = spaces.tables(hand, loaded)["observations"][control]["synergy"]["proprio"]
    ends = np.cumsum([row["size"] for row in columns])
    place = {row["name"]: slice(end - row["size"], end) for row, end in zip(columns, ends, strict=True)}
    hand_from_flange = np.linalg.inv(loaded.flange_from_base_of(hand) @ describe(hand).base_from_hand)
    base_from_world = np.linalg.inv(env.unwrapped.world_from_arm)
    rng, rows = np.random.default_rng(seed), []
    seen, _ = env.reset(seed=seed)
    for step in range(steps):
        numbers = seen.astype(np.float64)
        hand_pose = env.unwrapped._core.local_pool.poses()[1][0]
        rows.append((numbers[place["arm_q"]], numbers[place["arm_dq"]], base_from_world @ hand_pose @ hand_from_flange))
        if step % _HELD == 0:
            action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        seen, _, over, *_ = env.step(action)
        if over:
            break
    joints, speeds, flange = zip(*rows, strict=True)
    return np.array(joints), np.array(speeds), np.array(flange)


class _Simulated:
    """An arm in MuJoCo, without contacts."""

    def __init__(self, arm: graspbox.arms.Arm) -> None:
        self.model = mujoco.MjModel.from_xml_string(urdf_of(arm))
        self.model.opt.timestep = 1.0 / (_RATE * _SUBSTEPS)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.data = mujoco.MjData(self.model)
        flange = tomllib.loads(arm.files[1])["flange"]
        self._body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, flange)

    def follow(
        self, joints: NDArray[np.float64], speeds: NDArray[np.float64], flange: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Return the greatest distance, metres, and angle, rad, of the flange from its recorded poses."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = joints[0], speeds[0]
        most = [0.0, 0.0]
        for row in range(len(joints) - 1):
            mujoco.mj_forward(model, data)
            position = data.xpos[self._body] - flange[row, :3, 3]
            turn = data.xmat[self._body].reshape(3, 3).T @ flange[row, :3, :3]
            sine = 0.5 * float(
                np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            )
            most = [max(most[0], float(np.linalg.norm(position))), max(most[1], float(np.arcsin(min(sine, 1.0))))]
            change = (speeds[row + 1] - speeds[row]) * _RATE
            for step in range(_SUBSTEPS):
                time = step / (_RATE * _SUBSTEPS)
                speed = speeds[row] + change * time
                position = joints[row] + speeds[row] * time + 0.5 * change * time**2
                wanted = change + _GAINS[0] * (position - data.qpos) + _GAINS[1] * (speed - data.qvel)
                mujoco.mj_forward(model, data)
                torque = np.zeros(model.nv)
                mujoco.mj_mulM(model, data, torque, wanted)
                data.qfrc_applied[:] = torque + data.qfrc_bias - data.qfrc_passive
                mujoco.mj_step(model, data)
        return most[0], most[1]
