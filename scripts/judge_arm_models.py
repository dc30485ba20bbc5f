"""Compare the kinematics of the included arms with robosuite's models of them, which other people wrote.

    pip download robosuite==1.5.2 --no-deps -d /tmp/robosuite && unzip -q -d /tmp/robosuite /tmp/robosuite/*.whl
    python scripts/judge_arm_models.py /tmp/robosuite

MuJoCo reads robosuite's MJCF. Its base and its last link have frames of their own: two constant transforms, fitted to
half of the postures, take them to ours, and the other half tells how far the flanges are apart. robosuite has a Panda,
which has the joints of the FR3. Ranges are compared too; those of the FR3 are narrower. Needs the extra ``dev``.
"""

import argparse
import json
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from graspbox import arms
from graspbox._common.programs import run_program

#: By our arm: robosuite's robot.
MODELS = {"fr3": "panda", "ur5e": "ur5e", "xarm7": "xarm7"}

Array = NDArray[np.float64]


def their_poses(model: mujoco.MjModel, postures: Array) -> Array:
    """Return the poses (n, 4, 4) of the last link in the frame of the first one."""
    data = mujoco.MjData(model)
    first, last = model.body_parentid[model.jnt_bodyid[0]], model.jnt_bodyid[-1]
    poses = np.tile(np.eye(4), (2, len(postures), 1, 1))
    for index, posture in enumerate(postures):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        for pose, body in zip(poses[:, index], (first, last), strict=True):
            pose[:3, :3], pose[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return np.asarray(np.linalg.inv(poses[0]) @ poses[1])


def rotation_between(ours: Array, theirs: Array) -> Array:
    """Return the rotation `r` for which `r @ theirs` is nearest to `ours`, both (n, 3)."""
    u, _, vt = np.linalg.svd(ours.T @ theirs)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def fit(ours: Array, theirs: Array) -> tuple[Array, Array]:
    """Return `base` and `tool` for which `base @ theirs @ tool` is nearest to `ours`, all (..., 4, 4)."""
    base, tool = np.eye(4), np.eye(4)

    def angles(poses: Array) -> Array:
        """Return the rotation vectors of the motions from the first pose, in the base's frame."""
        turns = poses[1:, :3, :3] @ poses[0, :3, :3].T
        quats = np.zeros((len(turns), 4))
        for quat, turn in zip(quats, turns, strict=True):
            mujoco.mju_mat2Quat(quat, np.ascontiguousarray(turn).ravel())
        return np.asarray(quats[:, 1:] * np.sign(quats[:, :1]))

    base[:3, :3] = rotation_between(angles(ours), angles(theirs))
    turned = base[:3, :3] @ theirs[:, :3, :3]
    tool[:3, :3] = rotation_between((turned.transpose(0, 2, 1) @ ours[:, :3, :3]).sum(axis=0).T, np.eye(3))
    # Places: ours = base.place + R theirs.place + R theirs.turn tool.place.
    left = ours[:, :3, 3] - theirs[:, :3, 3] @ base[:3, :3].T
    matrix = np.concatenate([np.tile(np.eye(3), (len(ours), 1, 1)), turned], axis=2).reshape(-1, 6)
    base[:3, 3], tool[:3, 3] = np.linalg.lstsq(matrix, left.ravel(), rcond=None)[0].reshape(2, 3)
    return base, tool


def compare(name: str, folder: Path, count: int, seed: int) -> dict[str, object]:
    """Compare one arm; returns the greatest differences of the flange and of the ranges."""
    arm = arms.load_arm(name)
    path = folder / "robosuite" / "models" / "assets" / "robots" / MODELS[name] / "robot.xml"
    if not path.is_file():
        raise SystemExit(f"{path} is no file; give the folder of robosuite's unpacked wheel")
    model = mujoco.MjModel.from_xml_path(str(path))
    low, high = arm.joint_limits.T
    postures = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    ours, theirs = arm.flange_poses(postures), their_poses(model, postures)
    base, tool = fit(ours[::2], theirs[::2])
    found = base @ theirs[1::2] @ tool
    apart = np.linalg.norm(found[:, :3, 3] - ours[1::2, :3, 3], axis=1).max()
    between = np.linalg.norm(found[:, :3, :3] - ours[1::2, :3, :3], axis=(1, 2)).max() / np.sqrt(2.0)
    ranges = np.abs(model.jnt_range - arm.joint_limits)
    return {
        "arm": name,
        "robosuite": MODELS[name],
        "postures": len(found),
        "flange, m": float(apart),
        "flange, rad": float(between),
        "ranges, rad": ranges.max(axis=1).round(3).tolist(),
    }


def main() -> None:
    """Compare all arms."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="robosuite's wheel, unpacked")
    parser.add_argument("--postures", type=int, default=1000, help="random postures (%(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    if args.postures < 20:
        parser.error(f"--postures is {args.postures}; give 20 or more")
    for name in MODELS:
        print(json.dumps(compare(name, args.folder, args.postures, args.seed)))


if __name__ == "__main__":
    run_program(main)
