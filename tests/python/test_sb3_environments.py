"""Stable-Baselines3 accepts the environments unchanged. Needs the extra ``train``; `make test-train` runs these."""

import itertools
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox.envs import IDS, SINGLE_OBJECT_IDS
from test_conformance import CASES, factory, label

pytestmark = pytest.mark.train

sb3 = pytest.importorskip("stable_baselines3")
yaml = pytest.importorskip("yaml")


ZOO = Path(__file__).parents[2] / "scripts/rl_zoo3"
#: Warnings of Stable-Baselines3 about images that are not RGB: depth in metres, points, voxels, labels. Its own
#: extractors cannot process them; `graspbox.sb3.Extractor` can.
NO_PICTURE = (
    r".* is an image but its `dtype` is \(float32\)",
    r".* is an image but the upper and lower bounds are not in \[0, 255\]",
    r"The minimal resolution for an image is 36x36",
)


@pytest.mark.parametrize("case", CASES, ids=label)
def test_check_env_has_no_warning(case: Any, remote: str | None) -> None:
    from stable_baselines3.common.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for message in NO_PICTURE if case[1]["obs"] not in ("rgb", "state", "proprio", "tactile") else ():
            warnings.filterwarnings("ignore", message)
        check_env(factory(case, remote)().unwrapped)


@pytest.mark.parametrize("env_id", IDS)
def test_ppo_learns_for_a_few_steps(env_id: str, remote: str | None) -> None:
    env = gymnasium.make(env_id, objects="procedural:ball:0-1", remote=remote)
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=0, device="cpu")
    before = [p.clone() for p in model.policy.parameters()]
    model.learn(32)
    assert model.num_timesteps == 32
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))


@pytest.mark.parametrize(
    ("algorithm", "env_id"),
    [*itertools.product(["ppo", "sac", "td3"], SINGLE_OBJECT_IDS), ("sac", "graspbox/Reach-v0")],
)
def test_the_files_for_rl_zoo_make_models(algorithm: str, env_id: str) -> None:
    """Every entry is read as RL Zoo reads it, and takes a few steps; RL Zoo itself is in no extra."""
    import torch
    from stable_baselines3.common.noise import NormalActionNoise

    found = yaml.safe_load((ZOO / f"{algorithm}.yml").read_text())[env_id]
    policy, normalize = found.pop("policy"), found.pop("normalize")
    assert normalize is True or set(eval(normalize)) == {"norm_obs", "norm_reward"}
    assert found.pop("n_envs") >= 1
    assert found.pop("n_timesteps") >= 2500
    found["policy_kwargs"] = eval(found["policy_kwargs"], {"nn": torch.nn})
    if isinstance(found["learning_rate"], str):
        kind, rate = found["learning_rate"].split("_")
        assert kind == "lin"
        found["learning_rate"] = float(rate)
    limit: dict[str, Any] = {}
    if "replay_buffer_class" in found:
        assert found["replay_buffer_class"] == "HerReplayBuffer"
        # It samples from complete episodes.
        found["replay_buffer_class"], limit = sb3.HerReplayBuffer, {"max_episode_steps": 2}
    env = gymnasium.make(env_id, objects="procedural:ball:0", **limit)
    if "noise_type" in found:
        assert found.pop("noise_type") == "normal"
        size = env.action_space.shape or ()
        found["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, found.pop("noise_std")))
    # Small enough for a test.
    small = {"n_steps": 8, "batch_size": 8} if algorithm == "ppo" else {"buffer_size": 100, "learning_starts": 4}
    model = getattr(sb3, algorithm.upper())(policy, env, device="cpu", seed=0, **{**found, **small})
    model.learn(8)
    assert model.num_timesteps == 8
