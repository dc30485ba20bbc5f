"""The dense reward: whoever approaches the object earns more than whoever stands still, with every hand."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import graspbox
from graspbox.envs.coding import codec
from graspbox.envs.reward import DENSE

#: Steps of the approach at 5 Hz, standard deviation of its noise, environments.
_STEPS, _NOISE, _ENVS = 15, 0.5, 16


def earned(hand: graspbox.Hand, speed: float, noise: float) -> float:
    """Mean return of moving the grasp centre towards the middle of the object with noise in all entries."""
    mode = AutoresetMode.SAME_STEP
    envs = gymnasium.make_vec(
        "graspbox/Grasp-v0",
        _ENVS,
        objects="procedural:box:0-9",
        hand=hand,
        autoreset_mode=mode,
        max_episode_steps=_STEPS,
    )
    reads, center = codec("twist", hand), np.array(hand.closing_center(hand.preshape_limits[0]))
    rng, total = np.random.default_rng(0), 0.0
    seen, _ = envs.reset(seed=0)
    for _ in range(_STEPS):
        ways = np.array([reads.column(state, "bounds_center") for state in seen]) - center
        actions = rng.normal(0.0, noise, envs.action_space.shape)
        actions[:, :3] += speed * ways / np.linalg.norm(ways, axis=1, keepdims=True)
        seen, rewards, _, _, _ = envs.step(np.clip(actions, -1.0, 1.0).astype(np.float32))
        total += float(rewards.sum())
    envs.close()
    return total / _ENVS


@pytest.mark.parametrize("name", graspbox.Hand.names())
def test_standing_still_is_not_the_best_that_chance_finds(name: str) -> None:
    hand = graspbox.load_hand(name)
    still = earned(hand, speed=0.0, noise=0.0)
    assert still == pytest.approx(0.0, abs=1e-3)
    assert earned(hand, speed=1.0, noise=_NOISE) > still + 0.05


def test_nothing_costs() -> None:
    """A cost of what chance does before it grasps anything makes learners settle on not moving."""
    assert min(DENSE.values()) > 0
    assert set(DENSE) == {"reach", "contact", "closure", "lift", "hold", "success"}
