#!/usr/bin/env bash
# robosuite 1.5.2, GymWrapper (MuJoCo 3.3.7, Gymnasium 1.2.1, Python 3.11): two surprises for code written for Gymnasium.
#
# 1. At the horizon, `step` returns terminated=True and truncated=False. Gymnasium's contract is the reverse: a time limit truncates. A learner that
#    bootstraps only after truncation takes the value of the last state as 0, in every episode.
# 2. `reset(seed=0)` twice gives two starts. Gymnasium's contract is the same start; an evaluation by seeds compares different episodes.
#
# Seen on 2026-11-29:
#   same start: False
#   step 4: terminated=False truncated=False
#   step 5: terminated=True truncated=False
#
# An adapter sets truncated = terminated and terminated = False (Lift does not end at success), and seeds another way.
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index; about 1 GB in a temporary folder.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'robosuite==1.5.2' 'mujoco==3.3.7' 'gymnasium==1.2.1' h5py
MUJOCO_GL=egl "$folder/venv/bin/python" - 2>"$folder/log" <<'PYTHON'
import sys

import numpy as np
import robosuite
from robosuite.wrappers import GymWrapper

HORIZON = 5
lift = robosuite.make(
    "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False, horizon=HORIZON
)
env = GymWrapper(lift)
first, _ = env.reset(seed=0)
second, _ = env.reset(seed=0)
same = bool(np.array_equal(first, second))
print(f"same start: {same}")
ends = []
for step in range(1, HORIZON + 1):
    _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape))
    ends.append((bool(terminated), bool(truncated)))
    if step >= HORIZON - 1:
        print(f"step {step}: terminated={terminated} truncated={truncated}")
sys.exit(0 if not same and ends[-2:] == [(False, False), (True, False)] else 1)
PYTHON
