#!/usr/bin/env bash
# Gymnasium 1.4.0, gymnasium.make (Python 3.11): an environment whose first reset raised cannot be stepped any more.
#
# make() wraps every environment in PassiveEnvChecker. If the first call of reset raises, as for an option that the environment
# refuses, a later reset succeeds, and the first step after it raises a TypeError of the checker. With disable_env_checker=True,
# and where the first reset succeeded and a later one raised, the step works.
#
# Seen on 2026-11-29:
#   first reset refused: TypeError: cannot unpack non-iterable NoneType object
#   second reset refused: stepped
#   first reset refused, without the checker: stepped
#
# So in a notebook: after a refused first reset make the environment anew, or pass disable_env_checker=True.
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'gymnasium==1.4.0'
"$folder/venv/bin/python" -W ignore - <<'PYTHON'
import sys

import gymnasium
import numpy as np


class Choosy(gymnasium.Env):
    """Refuses a reset with the option "unknown"."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        if options and "unknown" in options:
            raise ValueError("there is no option 'unknown'")
        return np.zeros(2, np.float32), {}

    def step(self, action):
        return np.zeros(2, np.float32), 0.0, False, False, {}


gymnasium.register("Choosy-v0", entry_point=Choosy)


def stepped(refused_first, **settings):
    env = gymnasium.make("Choosy-v0", **settings)
    if not refused_first:
        env.reset(seed=0)
    try:
        env.reset(seed=0, options={"unknown": 1})
    except ValueError:
        pass
    env.reset(seed=0)
    try:
        env.step(np.zeros(1, np.float32))
    except TypeError as error:
        return f"TypeError: {error}"
    return "stepped"


found = [stepped(True), stepped(False), stepped(True, disable_env_checker=True)]
for name, result in zip(
    ("first reset refused", "second reset refused", "first reset refused, without the checker"), found, strict=True
):
    print(f"{name}: {result}")
sys.exit(0 if found[0].startswith("TypeError: cannot unpack") and found[1:] == ["stepped", "stepped"] else 1)
PYTHON
