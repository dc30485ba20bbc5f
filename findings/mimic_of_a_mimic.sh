#!/usr/bin/env bash
# yourdfpy 0.0.60, Pinocchio (pin) 4.1.0 and MuJoCo 4.0.0 read a URDF whose joint follows a follower (Python 3.11): three answers, one is right.
#
# Fingers with one motor are often written so: the middle joint follows the knuckle, the tip follows the middle. URDF names no limit to such chains.
# With the knuckle at 0.5 rad, the middle joint following it (0.8, offset 0.1) and the tip following that (2.0), the tip has turned by
# 0.5 + 0.5 + 1.0 = 2.0 rad against the palm.
#
# Seen on 2026-12-01:
#   yourdfpy   1.0 rad: the tip stays straight; a line in the log says that it assumes 0 for a joint which is not actuated
#   pinocchio  with mimic=True ValueError, "wrong argument size: expected 0, got 1", without a joint's name; by default three free joints
#   mujoco     two equality constraints, [0.1, 0.8] and [0, 2]: 2.0 rad
#
# Remedy: write the last joint as a follower of the first, with multiplier 2.0 * 0.8 and offset 2.0 * 0.1, before yourdfpy or Pinocchio reads the file.
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index; about 600 MB in a temporary folder.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'yourdfpy==0.0.60' 'pin==4.1.0' 'mujoco==4.0.0'
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import yourdfpy

LINK = """<link name="{}"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="0 0 0.04"/><axis xyz="0 1 0"/>
<limit lower="0" upper="2" effort="5" velocity="2"/>{}</joint>"""


def finger(*follows: str) -> str:
    """Return a finger of three joints of which the last two follow as stated."""
    joints = zip(("knuckle", "middle", "tip"), ("palm", "a", "b"), ("a", "b", "c"), ("", *follows), strict=True)
    parts = [*map(LINK.format, ("palm", "a", "b", "c")), *(JOINT.format(*joint) for joint in joints)]
    return f'<robot name="finger">{"".join(parts)}</robot>'


chain = Path(sys.argv[1], "chain.urdf")
chain.write_text(finger('<mimic joint="knuckle" multiplier="0.8" offset="0.1"/>', '<mimic joint="middle" multiplier="2"/>'))
flat = Path(sys.argv[1], "flat.urdf")
flat.write_text(
    finger('<mimic joint="knuckle" multiplier="0.8" offset="0.1"/>', '<mimic joint="knuckle" multiplier="1.6" offset="0.2"/>')
)


def turned(rotation: np.ndarray) -> float:
    """Return the angle about y, radians."""
    return float(np.arctan2(rotation[0, 2], rotation[0, 0]))


def by_yourdfpy(path: Path) -> float:
    robot = yourdfpy.URDF.load(str(path))
    robot.update_cfg({"knuckle": 0.5})
    return turned(robot.get_transform("c", "palm"))


def by_pinocchio(path: Path) -> float:
    model = pinocchio.buildModelFromUrdf(str(path), mimic=True)
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array([0.5]))
    return turned(data.oMf[model.getFrameId("c")].rotation)


def by_mujoco(path: Path) -> float:
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    joints = {model.joint(index).name: index for index in range(model.njnt)}
    data.qpos[joints["knuckle"]] = 0.5
    for constant, factor, follower, leader in (
        (*model.eq_data[i, :2], model.eq_obj1id[i], model.eq_obj2id[i]) for i in range(model.neq)
    ):
        data.qpos[follower] = constant + factor * data.qpos[leader]
    mujoco.mj_kinematics(model, data)
    return turned(data.body("c").xmat.reshape(3, 3))


seen = {}
for path in (chain, flat):
    for name, read in (("yourdfpy", by_yourdfpy), ("pinocchio", by_pinocchio), ("mujoco", by_mujoco)):
        try:
            seen[path.stem, name] = round(read(path), 6)
        except ValueError as error:
            seen[path.stem, name] = "refused" if "expected 0, got 1" in str(error) else str(error)
        print(path.stem, name, seen[path.stem, name])
free = pinocchio.buildModelFromUrdf(str(chain)).nq
print("pinocchio, by default, has", free, "free joints")
expected = {("flat", name): 2.0 for name in ("yourdfpy", "pinocchio", "mujoco")}
expected |= {("chain", "yourdfpy"): 1.0, ("chain", "pinocchio"): "refused", ("chain", "mujoco"): 2.0}
sys.exit(seen != expected or free != 3)
PYTHON
