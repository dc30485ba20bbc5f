#!/usr/bin/env bash
# robosuite 1.5.2, UR5e (MuJoCo 3.3.7, Python 3.11): its arm is not the maker's by up to 2.6 mm at the mount of the hand.
#
# The model's lengths are rounded to millimetres (0.392 m of forearm, 0.1 and 0.134 m of wrist), and the mount `right_hand` is 98 mm from the last axis.
# Universal Robots' DH parameters say 392.2, 99.7, 133.3 and 99.6 mm. Joint angles from a controller or another library's inverse kinematics, which use
# those, put the simulated hand elsewhere; other models in the same package (Panda, xArm7) have the makers' lengths.
#
# Seen on 2026-12-01, 2,000 random postures:
#   mount: mean 1.8 mm, worst 2.6 mm from the maker's kinematics
#
# Remedy: correct the five `pos` of the bodies, or solve inverse kinematics on the model itself.
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index; about 300 MB in a temporary folder.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'mujoco==3.3.7' 'numpy<3'
"$folder/venv/bin/pip" install --quiet --no-deps 'robosuite==1.5.2'
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.util
import sys
from pathlib import Path

import mujoco
import numpy as np

#: Universal Robots' DH parameters of the UR5e: a (m), d (m), alpha (rad).
DH = [
    (0.0, 0.1625, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2),
    (0.0, 0.0997, -np.pi / 2),
    (0.0, 0.0996, 0.0),
]


def flange(posture):
    """Position of the flange in the frame of the DH parameters."""
    pose = np.eye(4)
    for angle, (a, d, alpha) in zip(posture, DH):
        (ct, st), (ca, sa) = (np.cos(angle), np.sin(angle)), (np.cos(alpha), np.sin(alpha))
        pose = pose @ np.array(
            [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return pose[:3, 3]


robots = Path(importlib.util.find_spec("robosuite").origin).parent / "models" / "assets" / "robots"
model = mujoco.MjModel.from_xml_path(str(robots / "ur5e" / "robot.xml"))
data = mujoco.MjData(model)
hand = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "right_hand")
postures = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 6))
theirs, makers = [], []
for posture in postures:
    data.qpos[:6] = posture
    mujoco.mj_kinematics(model, data)
    theirs.append(data.xpos[hand].copy())
    makers.append(flange(posture))
theirs, makers = np.array(theirs), np.array(makers)
# The two base frames differ by a turn about z.
errors = []
for turn in np.arange(4) * np.pi / 2:
    about = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    errors.append(np.linalg.norm(theirs - makers @ about.T, axis=1))
error = 1e3 * min(errors, key=np.max)
print(f"mount: mean {error.mean():.1f} mm, worst {error.max():.1f} mm from the maker's kinematics")
sys.exit(0 if 1.0 < error.max() < 5.0 else 1)
PYTHON
