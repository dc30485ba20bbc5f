"""The keyword ``depth_limits``: depth as uint8, in single, vector and remote environments."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from acting import OBJECTS
from graspbox import errors, policies
from graspbox.envs.spaces import depth_as_uint8, depth_in_metres
from graspbox.policies.base import Task

ID = "graspbox/Grasp-v0"
LIMITS = (0.3, 0.6)


def test_the_inverse_is_off_by_half_a_step() -> None:
    depth = np.array([0.0, 0.1, 0.3, 0.4321, 0.6, 1.9], dtype=np.float32)
    codes = depth_as_uint8(depth, LIMITS)
    assert codes.tolist() == [0, 1, 1, 113, 255, 255]
    again = depth_in_metres(codes, LIMITS)
    assert again.dtype == np.float32
    np.testing.assert_allclose(again, [0.0, 0.3, 0.3, 0.4321, 0.6, 0.6], atol=0.3 / 508 + 1e-6)


@pytest.mark.parametrize("obs", ["depth", ("proprio", "depth_palm", "rgbd")])
def test_depth_is_that_in_metres_between_the_limits(remote: str | None, obs: Any) -> None:
    name = "depth" if obs == "depth" else "depth_palm"
    settings: dict[str, Any] = {"objects": OBJECTS, "obs": obs, "image_size": 36}
    coarse = {**settings, "depth_limits": LIMITS, "remote": remote}
    seen, random = [], np.random.default_rng(0)
    actions = None
    for keywords in (settings, coarse, {**coarse, "copy": False}):
        envs: Any = gymnasium.make_vec(ID, num_envs=2, autoreset_mode="SameStep", max_episode_steps=3, **keywords)
        if actions is None:
            actions = random.uniform(-1, 1, (4, *envs.action_space.shape)).astype(np.float32)
        found = [envs.reset(seed=3)[0]]
        for action in actions:
            observation, *_, infos = envs.step(action)
            found.append(observation)
            found += [] if "final_obs" not in infos else infos["final_obs"].tolist()
        assert envs.observation_space.contains(found[-1])
        found = [one if obs == "depth" else one[name] for one in found]
        seen.append([np.array(one) for one in found])
        envs.close()
    for metres, codes in zip(*seen[:2], strict=True):
        assert codes.dtype == np.uint8
        np.testing.assert_array_equal(codes, depth_as_uint8(metres, LIMITS))
    np.testing.assert_array_equal(seen[1][-1], seen[2][-1])
    single: Any = gymnasium.make(ID, **coarse)
    observation, _ = single.reset(seed=3)
    np.testing.assert_array_equal(observation if obs == "depth" else observation[name], seen[1][0][0])
    assert single.observation_space.contains(observation)
    single.close()


@pytest.mark.parametrize("limits", [(0.6, 0.3), (-1.0, 1.0), (0.1, float("inf")), (0.1,), "near"])
def test_wrong_limits_are_refused(limits: Any) -> None:
    with pytest.raises(errors.ConfigError, match="depth_limits is") as caught:
        gymnasium.make_vec(ID, obs="depth", depth_limits=limits)
    assert caught.value.field == "depth_limits"


def test_a_policy_that_takes_metres_is_not_given_bytes() -> None:
    keywords: dict[str, Any] = {"objects": OBJECTS, "obs": ("depth", "proprio"), "depth_limits": LIMITS}
    env = gymnasium.make(ID, **keywords)
    with pytest.raises(errors.ConfigError, match="needs depth in metres"):
        policies.load("partial_view_planner").bind(Task.of(env))


@pytest.mark.train
def test_cnn_policy_takes_depth() -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    from graspbox.sb3 import VecEnv

    keywords: dict[str, Any] = {"objects": OBJECTS, "obs": "depth", "max_episode_steps": 4}
    env = VecEnv.make(ID, 2, depth_limits=LIMITS, **keywords)
    model = sb3.PPO("CnnPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu").learn(16)
    assert type(model.policy.features_extractor).__name__ == "NatureCNN"
