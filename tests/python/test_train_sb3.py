"""Stable-Baselines3 takes the environments as they are. Needs the extra ``train``; `make test-train` runs these."""

import warnings

import gymnasium
import pytest

from graspbox.envs import IDS

pytestmark = pytest.mark.train

sb3 = pytest.importorskip("stable_baselines3")


@pytest.mark.parametrize("env_id", IDS)
def test_check_env_has_no_warning(env_id: str) -> None:
    from stable_baselines3.common.env_checker import check_env

    env = gymnasium.make(env_id, objects="procedural:ball:0-1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.parametrize("env_id", IDS)
def test_ppo_learns_for_a_few_steps(env_id: str) -> None:
    env = gymnasium.make(env_id, objects="procedural:ball:0-1")
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    before = [p.clone() for p in model.policy.parameters()]
    model.learn(32)
    assert model.num_timesteps == 32
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))
