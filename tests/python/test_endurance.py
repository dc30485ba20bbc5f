"""Long runs and other processes: nothing becomes NaN, nothing panics, nothing grows, nothing hangs."""

import os
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AsyncVectorEnv

from acting import CAMERAS, EACH, OBJECTS, pressing

ID = "graspbox/Grasp-v0"


def resident() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


VECTORS, SEEN = ("state", "tactile"), ("depth", "rgb_palm", "points", "state", "voxels")
#: Where an observation of the state has the object's position.
OBJECT = {ID: slice(31, 34), "graspbox/GraspPose-v0": slice(0, 3)}


def diverged(states: np.ndarray, failed: np.ndarray, env_id: str) -> int:
    """Count worlds that have diverged: the object is nowhere, or the episode was given up with the object in its place.

    NaN is shown as the least value; a lost object is off the table, or 0.5 m from its middle.
    """
    place = states[:, OBJECT[env_id]]
    nowhere = (place == -1.0).all(axis=1)
    at_hand = (np.hypot(place[:, 0], place[:, 1]) < 0.3) & (place[:, 2] > 0.0)
    return int((nowhere | (failed & at_hand)).sum())


@pytest.mark.parametrize(
    ("steps", "obs"), [(10_000, VECTORS), (4_000, SEEN), pytest.param(1_000_000, VECTORS, marks=pytest.mark.slow)]
)
def test_random_steps_stay_within_bounds_and_memory(steps: int, obs: tuple[str, ...]) -> None:
    """Uniformly random actions hit object, table and walls; a third of them goes against the object."""
    count = 20
    env: Any = gymnasium.make_vec(
        ID,
        num_envs=count,
        objects=[*OBJECTS, "procedural:mug:0"],
        obs=obs,
        cameras=CAMERAS,
        reward="dense",
        randomization="standard",
        max_episode_steps=50,
        **EACH,
    )
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    biased = pressing(steps // count, count)
    after_warm_up, episodes, touches = None, 0, 0
    for step in range(steps // count):
        action = rng.uniform(-1, 1, (count, 10)).astype(np.float32)
        action[:7] = biased[step, :7]
        observation, rewards, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert np.isfinite(rewards).all()
        assert np.isfinite(info["lift"]).all()
        assert not diverged(observation["state"], info["reward_terms"]["failure"] < 0, ID)
        episodes += int((terminated | truncated).sum())
        touches += int(info["touches"].sum())
        if step == min(2000, steps // count // 2):
            after_warm_up = resident()
    assert episodes >= 0.9 * count * (steps // count // 51)
    assert touches > 0.02 * steps
    assert after_warm_up is not None
    assert resident() < after_warm_up + 50


def test_random_decisions_stay_within_bounds_and_memory() -> None:
    """The same for one decision an episode; every step ends one."""
    count = 20
    env: Any = gymnasium.make_vec(
        "graspbox/GraspPose-v0",
        num_envs=count,
        objects=OBJECTS,
        obs=("state", "depth"),
        image_size=(36, 40),
        reward="dense",
        randomization="standard",
        autoreset_mode="SameStep",
    )
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    after_warm_up = 0.0
    for step in range(100):
        observation, rewards, terminated, _, info = env.step(rng.uniform(-1, 1, (count, 10)).astype(np.float32))
        assert env.observation_space.contains(observation)
        assert np.isfinite(rewards).all()
        assert terminated.all()
        assert np.isfinite(info["final_info"]["lift"]).all()
        # Decisions that cannot be are no failures of the world.
        states = np.stack([last["state"] for last in info["final_obs"]])
        assert not diverged(states, np.zeros(count, dtype=bool), "graspbox/GraspPose-v0")
        if step == 50:
            after_warm_up = resident()
    assert resident() < after_warm_up + 50


def test_async_vector_env_after_a_rollout_in_the_parent() -> None:
    """Forked children start their own threads, and get the observations of the native environment."""
    native: Any = gymnasium.make_vec(ID, num_envs=2, objects=OBJECTS, max_episode_steps=8, **EACH)
    native.reset(seed=0)
    native.step(pressing(1, 2)[0])
    make: Any = partial(gymnasium.make, ID, objects=OBJECTS, max_episode_steps=8, **EACH)
    env = AsyncVectorEnv([make] * 2, context="fork")
    try:
        assert data_equivalence(env.reset(seed=1), native.reset(seed=1), exact=True)
        for action in pressing(12, 2):
            assert data_equivalence(env.step(action), native.step(action), exact=True)
    finally:
        env.close()
