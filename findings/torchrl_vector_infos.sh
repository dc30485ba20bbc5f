#!/usr/bin/env bash
# TorchRL 0.14.1, GymWrapper on a vector environment of Gymnasium 1.4.0 (Python 3.11): a dictionary in the infos stops it.
#
# With autoreset SAME_STEP, environments whose info has a nested dictionary, such as reward terms, cannot be wrapped: the
# constructor raises a RuntimeError that speaks of the "expand_specs" of a "TensorDictPrimer", and names neither the info nor its
# entry. The same environments without the dictionary can, and with it too when autoreset is DISABLED.
#
# Seen on 2026-11-29:
#   SAME_STEP, flat infos: wrapped
#   SAME_STEP, nested infos: RuntimeError: expand_specs wasn't specified in the TensorDictPrimer constructor
#   DISABLED, nested infos: wrapped
#
# So make vector environments for TorchRL with autoreset_mode="Disabled" (scripts/examples/torchrl_ppo.py).
# Exit status: 0 while this is so, 1 if it has changed. Needs Python 3.11 and a package index; about 6 GB in a temporary folder.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'torchrl==0.14.1' 'gymnasium==1.4.0'
"$folder/venv/bin/python" -W ignore - 2>"$folder/log" <<'PYTHON'
import sys

import gymnasium
from gymnasium.vector import AutoresetMode
from torchrl.envs import GymWrapper


class WithTerms(gymnasium.Wrapper):
    def reset(self, **options):
        seen, info = self.env.reset(**options)
        return seen, {**info, "terms": {"alive": 1.0}}

    def step(self, action):
        *rest, info = self.env.step(action)
        return (*rest, {**info, "terms": {"alive": 1.0}})


def wrapped(mode, wrappers):
    envs = gymnasium.make_vec(
        "CartPole-v1", num_envs=2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, wrappers=wrappers
    )
    try:
        GymWrapper(envs).rollout(4)
    except RuntimeError as error:
        return f"RuntimeError: {str(error).split(',')[0]}"
    return "wrapped"


found = []
for mode, infos, wrappers in (
    (AutoresetMode.SAME_STEP, "flat", None),
    (AutoresetMode.SAME_STEP, "nested", [WithTerms]),
    (AutoresetMode.DISABLED, "nested", [WithTerms]),
):
    found.append(wrapped(mode, wrappers))
    print(f"{mode.name}, {infos} infos: {found[-1]}")
same = found[0] == found[2] == "wrapped" and found[1].startswith("RuntimeError: expand_specs")
sys.exit(0 if same else 1)
PYTHON
