"""Stable-Baselines3 takes the environments as they are. Needs the extra ``train``; `make test-train` runs these."""

import warnings
from typing import Any

import gymnasium
import pytest

from graspbox.envs import IDS
from test_conformance import CASES, factory, label

pytestmark = pytest.mark.train

sb3 = pytest.importorskip("stable_baselines3")


#: What Stable-Baselines3 says of images that are no pictures: depth in metres, points, voxels, labels. Its own networks
#: do not take them as they are; nothing is wrong with them.
NO_PICTURE = (
    r".* is an image but its `dtype` is \(float32\)",
    r".* is an image but the upper and lower bounds are not in \[0, 255\]",
    r"The minimal resolution for an image is 36x36",
)


@pytest.mark.parametrize("case", CASES, ids=label)
def test_check_env_has_no_warning(case: Any) -> None:
    from stable_baselines3.common.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for message in NO_PICTURE if case[1]["obs"] not in ("rgb", "state", "proprio", "tactile") else ():
            warnings.filterwarnings("ignore", message)
        check_env(factory(case)().unwrapped)


@pytest.mark.parametrize("env_id", IDS)
def test_ppo_learns_for_a_few_steps(env_id: str) -> None:
    env = gymnasium.make(env_id, objects="procedural:ball:0-1")
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    before = [p.clone() for p in model.policy.parameters()]
    model.learn(32)
    assert model.num_timesteps == 32
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))
