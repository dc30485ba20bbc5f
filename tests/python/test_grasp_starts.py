"""Starts at a grasp: a share of episodes begins with the open hand around the object."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.hands import load_hand

SETTINGS: dict[str, Any] = {"objects": ["procedural:box:0-3", "procedural:can:0-3"]}


def seen(share: float, seeds: range, **settings: Any) -> NDArray[np.float32]:
    env = gymnasium.make("graspbox/Grasp-v0", grasp_starts=share, **SETTINGS, **settings)
    return np.array([env.reset(seed=seed)[0] for seed in seeds])


def test_a_share_of_the_starts_is_at_a_grasp_and_changes_no_other() -> None:
    far, some, all_near = (seen(share, range(40)) for share in (0.0, 0.5, 1.0))
    near = (some != far).any(axis=1)
    assert 10 < near.sum() < 30
    np.testing.assert_array_equal(some[~near], far[~near])
    np.testing.assert_array_equal(some[near], all_near[near])


@pytest.mark.parametrize("hand", ["reflex", "panda_gripper"])
def test_the_hand_closes_on_the_object(hand: str) -> None:
    """At the start the grasp centre is near the object; closing and lifting then often grasps it."""
    env = gymnasium.make("graspbox/Grasp-v0", grasp_starts=1.0, hand=hand, control="top_down", **SETTINGS)
    action: NDArray[np.float32] = np.zeros_like(env.action_space.sample())
    preshapes = bool(np.ptp(load_hand(hand).preshape_limits))
    closing = -2 if preshapes else -1
    held = 0
    for seed in range(10):
        env.reset(seed=seed)
        for step in range(25):
            action[:] = 0.0
            action[closing] = 1.0
            action[2] = 0.4 if step > 8 else 0.0
            _, _, ended, _, info = env.step(action)
            if ended:
                break
        held += info["is_success"] or info["lift"] > 0.03
    assert held >= 4


def test_vector_environments_start_alike() -> None:
    envs: Any = gymnasium.make_vec("graspbox/Grasp-v0", 6, grasp_starts=0.5, **SETTINGS)
    np.testing.assert_array_equal(envs.reset(seed=list(range(6)))[0], seen(0.5, range(6)))


def test_a_given_pose_of_the_hand_comes_first() -> None:
    env = gymnasium.make("graspbox/Grasp-v0", grasp_starts=1.0, **SETTINGS)
    plain = gymnasium.make("graspbox/Grasp-v0", **SETTINGS)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.4
    options = {"world_from_hand": pose.tolist()}
    np.testing.assert_array_equal(env.reset(seed=0, options=options)[0], plain.reset(seed=0, options=options)[0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"grasp_starts": 1.5}, "`grasp_starts` is 1.5, but it must be between 0 and 1"),
        ({"grasp_starts": 0.5, "layout": "pile"}, "grasp_starts needs closed-loop control of a single object"),
    ],
)
def test_impossible_shares_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        gymnasium.make("graspbox/Grasp-v0", **SETTINGS, **settings)
