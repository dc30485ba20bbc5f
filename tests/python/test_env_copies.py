"""Environments can be pickled and copied; in a forked process and after `close` their errors explain the cause."""

import copy
import os
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

from acting import CAMERAS, DECISIONS, EACH, LOOPS, OBJECTS, TASKS, over_the_highest, pressing
from graspbox import errors

GRASP, POSE = "graspbox/Grasp-v0", "graspbox/GraspPose-v0"
SETTINGS: dict[str, Any] = {"objects": OBJECTS, "reward": "dense", "randomization": "standard", "cameras": CAMERAS}


def pickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))


def cloudpickled(env: Any) -> Any:
    cloudpickle = pytest.importorskip("cloudpickle")
    return cloudpickle.loads(cloudpickle.dumps(env))


WAYS = pytest.mark.parametrize("way", [pickled, copy.deepcopy, cloudpickled], ids=lambda way: way.__name__)


@WAYS
@pytest.mark.parametrize("task", LOOPS)
def test_a_copy_of_a_single_environment_continues_with_the_same_bits(way: Callable[[Any], Any], task: str) -> None:
    """In contact, through the limit of time that a wrapper counts, and into the next episode's draws."""
    env_id, keywords = TASKS[task]
    env = gymnasium.make(env_id, obs=("state", "depth"), max_episode_steps=30, **SETTINGS, **keywords)
    env.reset(seed=4)
    actions = pressing(45, 1)[:, 0]
    touched = [env.step(action)[4]["touches"] for action in actions[:25]]
    assert any(touched) or keywords
    other = way(env)
    assert other.spec == env.spec
    assert other.unwrapped.np_random_seed == 4
    for action in actions[25:]:
        ours, theirs = env.step(action), other.step(action)
        assert data_equivalence(ours, theirs, exact=True)
        if ours[2] or ours[3]:
            assert data_equivalence(env.reset(), other.reset(), exact=True)
    assert data_equivalence(env.unwrapped.np_random.random(3), other.unwrapped.np_random.random(3), exact=True)


@WAYS
@pytest.mark.parametrize("task", DECISIONS)
def test_a_copy_of_a_decision_continues_with_the_same_bits(way: Callable[[Any], Any], task: str) -> None:
    """Before each attempt of an episode, and after its end, where both wait for a reset."""
    env_id, keywords = TASKS[task]
    env: Any = gymnasium.make(env_id, **SETTINGS, **keywords)
    env.reset(seed=1)
    attempts, ended = 0, False
    while not ended:
        other = way(env)
        action = over_the_highest(env.unwrapped.arrangement())
        result = env.step(action)
        assert data_equivalence(result, other.step(action), exact=True)
        attempts, ended = attempts + 1, result[2]
    assert attempts > 1 or env_id == POSE
    over = way(env)
    for each in (env.unwrapped, over.unwrapped):
        with pytest.raises(errors.ConfigError, match="over"):
            each.step(action)
    assert data_equivalence(env.reset(), over.reset(), exact=True)


@WAYS
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("task", ["Grasp", "Grasp, target", "Clear"])
def test_a_copy_of_a_vector_environment_continues_with_the_same_bits(
    way: Callable[[Any], Any], mode: Any, task: str
) -> None:
    """Copied in every one of ten steps, among them those in which an autoreset is due."""
    env_id, keywords = TASKS[task]
    env: Any = gymnasium.make_vec(env_id, num_envs=2, autoreset_mode=mode, max_episode_steps=4, **SETTINGS, **keywords)
    env.reset(seed=[3, 9])
    for step, action in enumerate(pressing(10, 2)):
        if task == "Clear":
            action = np.stack([over_the_highest(env.arrangement(i)) if step % 2 else action[i] for i in range(2)])
        other = way(env)
        assert other.spec == env.spec
        assert other.np_random_seed == (3, 9)
        ours = env.step(action)
        assert data_equivalence(ours, other.step(action), exact=True)
        if mode == AutoresetMode.DISABLED and (done := ours[2] | ours[3]).any():
            env.reset(options={"reset_mask": done})


@WAYS
def test_a_copy_of_an_environment_that_has_not_begun_needs_a_reset(way: Callable[[Any], Any]) -> None:
    single: Any = way(gymnasium.make(GRASP, **SETTINGS, **EACH).unwrapped)
    vector: Any = way(gymnasium.make_vec(POSE, num_envs=2, copy=False, **SETTINGS))
    for env in (single, vector):
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(env.action_space.sample())
    first = gymnasium.make(GRASP, **SETTINGS, **EACH).unwrapped.reset(seed=2)
    assert data_equivalence(single.reset(seed=2), first, exact=True)
    # Buffers are the copy's own.
    assert vector.reset(seed=2)[0] is vector._out["state"]
    half: Any = gymnasium.make_vec(GRASP, num_envs=2, **SETTINGS, **EACH)
    half.set_state(1, single.get_state())
    again = way(half)
    assert again.np_random_seed == (None, -1)
    assert again.get_state(1) == half.get_state(1)


def test_what_is_on_its_way_is_not_copied() -> None:
    env: Any = gymnasium.make_vec(GRASP, num_envs=2, **SETTINGS, **EACH)
    env.reset(seed=0)
    env.send(pressing(1, 2)[0])
    with pytest.raises(errors.ConfigError, match="receive its result first"):
        pickle.dumps(env)
    env.recv()
    pickle.dumps(env)


@pytest.mark.parametrize("vector", [False, True], ids=["single", "vector"])
def test_nothing_but_closing_works_after_close(vector: bool) -> None:
    env: Any = gymnasium.make_vec(GRASP, num_envs=2) if vector else gymnasium.make(GRASP).unwrapped
    env.reset(seed=0)
    env.close()
    calls = [
        lambda: env.step(env.action_space.sample()),
        lambda: env.reset(seed=0),
        env.render,
        env.cameras,
        lambda: env.get_state(0) if vector else env.get_state(),
        lambda: pickle.dumps(env),
    ]
    for call in calls:
        with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="closed"):
            call()
    env.close()


def in_a_fork(work: Callable[[], Any]) -> str:
    """Run work in a forked child; the name and text of its error, or nothing."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        text = ""
        try:
            work()
        except BaseException as error:
            text = f"{type(error).__name__}: {error}"
        os.write(write, text.encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    return text


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_is_told_to_make_its_own_environment() -> None:
    """Most of such children once waited for ever for threads that they do not have."""
    env: Any = gymnasium.make_vec(GRASP, num_envs=4, objects=OBJECTS, **EACH)
    env.reset(seed=0)
    action = pressing(1, 4)[0]
    env.step(action)
    env.send(action)
    for work in (lambda: env.recv(4), lambda: env.step(action), lambda: env.reset(seed=1), lambda: pickle.dumps(env)):
        text = in_a_fork(work)
        assert text.startswith("ConfigError: this environment was made in process")
        assert str(os.getpid()) in text
    env.recv(4)
    saved = pickle.dumps(env)

    def there() -> None:
        other = pickle.loads(saved)
        np.testing.assert_array_equal(other.step(action)[0], expected)

    expected = env.step(action)[0]
    assert in_a_fork(there) == ""
