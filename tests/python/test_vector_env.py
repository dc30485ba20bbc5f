"""The native vector environment equals many single ones: the same bits, including infos."""

import itertools
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import graspbox
from acting import ACTING, CAMERAS, DECISIONS, OBJECTS, TASKS, Experts, lower, over_the_highest, pressing
from graspbox import errors
from graspbox.envs import spaces

ID = "graspbox/Grasp-v0"
VECTORS = tuple(spaces.tables(graspbox.load_hand())["observations"]["twist"]["each"])
#: An array, and all that there are in a dictionary.
OBSERVATIONS = {"array": "state", "all": (*spaces.IMAGES, *VECTORS, "rgb_palm")}


COUNTS_SAME_STEP = tuple(map(int, gymnasium.__version__.split(".")[:2])) >= (1, 4)
MISCOUNTED = "RecordEpisodeStatistics of gymnasium below 1.4 counts the episodes of SAME_STEP one step short"


def make(num_envs: int = 3, task: str = "Grasp", **settings: Any) -> Any:
    env_id, keywords = TASKS[task]
    defaults = {"objects": OBJECTS, "reward": "dense", "cameras": CAMERAS}
    return gymnasium.make_vec(env_id, num_envs=num_envs, **{**defaults, **keywords, **settings})


def make_sync(mode: AutoresetMode, num_envs: int = 3, **settings: Any) -> Any:
    return make(num_envs, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **settings)


#: Tasks whose environments have to do the same in all ways to step them: a motion, a target, and rounds.
ALL_WAYS = pytest.mark.parametrize("task", ["Grasp", "Grasp, target", "Clear"])


@pytest.mark.parametrize(("mode", "which"), list(itertools.product(AutoresetMode, OBSERVATIONS)), ids=str)
def test_equals_sync_of_single_environments(mode: AutoresetMode, which: str) -> None:
    """Bits, infos and masks, over contact and at least two autoresets in each environment."""
    obs = OBSERVATIONS[which]
    native = make(autoreset_mode=mode, obs=obs, max_episode_steps=20)
    single = make_sync(mode, obs=obs, max_episode_steps=20)
    assert native.observation_space == single.observation_space
    assert native.action_space == single.action_space
    assert native.metadata == single.metadata
    assert data_equivalence(native.reset(seed=3), single.reset(seed=3), exact=True)
    touches, ends = np.zeros(3), np.zeros(3)
    for action in pressing(64, 3):
        ours, theirs = native.step(action), single.step(action)
        assert data_equivalence(ours, theirs, exact=True)
        done = ours[2] | ours[3]
        touches += ours[4]["touches"]
        ends += done
        if mode == AutoresetMode.DISABLED and done.any():
            # Gymnasium's takes the mask out of the options.
            ours = native.reset(options={"reset_mask": done})
            theirs = single.reset(options={"reset_mask": done.copy()})
            assert data_equivalence(ours, theirs, exact=True)
    assert (ends >= 2).all()
    assert (touches > 0).all()


@pytest.mark.parametrize("hand", ["reflex", "panda_gripper"])
@pytest.mark.parametrize(("control", "fingers"), ACTING)
def test_every_meaning_of_an_action_equals_sync(control: str, fingers: str, hand: str) -> None:
    """Vector and single environments, states saved in the middle, and actions sent again: the same bits."""
    settings: dict[str, Any] = {"control": control, "fingers": fingers, "control_freq": 10, "hand": hand}
    native, single = make(2, **settings), make_sync(AutoresetMode.NEXT_STEP, 2, **settings)
    assert native.action_space == single.action_space
    assert data_equivalence(native.reset(seed=3), single.reset(seed=3), exact=True)
    rng, shape = np.random.default_rng(0), native.action_space.shape
    touches, middle = False, []
    actions = [lower(rng.uniform(-0.3, 0.6, shape).astype(np.float32), control) for _ in range(24)]
    for step, action in enumerate(actions):
        if step == 12:
            middle = [native.get_state(env) for env in range(2)]
        last = native.step(action)
        assert data_equivalence(last, single.step(action), exact=True)
        touches |= bool(last[4]["touches"].any())
    assert touches
    for env, state in enumerate(middle):
        native.set_state(env, state)
    for action in actions[12:]:
        again = native.step(action)
    assert data_equivalence(again, last, exact=True)


@pytest.mark.parametrize(
    ("control", "mode"), list(zip(("twist", "delta_pose", "target_pose"), AutoresetMode, strict=True)), ids=str
)
def test_episodes_that_succeed_equal_sync_too(control: str, mode: AutoresetMode) -> None:
    """Two environments grasp, lift and hold; two episodes of each end by success, for good."""
    settings: dict[str, Any] = {
        "objects": "procedural:can:0-1",
        "control": control,
        "fingers": "synergy",
        "control_freq": 10,
        "max_episode_steps": 100,
    }
    native = make(2, autoreset_mode=mode, **settings)
    single = make_sync(mode, 2, **settings)
    experts = Experts(native.unwrapped.objects, 2, control=control, control_freq=10)
    (states, info), theirs = native.reset(seed=5), single.reset(seed=5)
    assert data_equivalence((states, info), theirs, exact=True)
    starts, dones, successes = np.ones(2, bool), np.zeros(2, bool), np.zeros(2)
    for _ in range(400):
        action = experts.act(states, info["object"], starts)
        ours, theirs = native.step(action), single.step(action)
        assert data_equivalence(ours, theirs, exact=True)
        ended = ours[2]
        ends = ours[4].get("final_info", ours[4])
        successes += ended & np.asarray(ends["is_success"], dtype=bool)
        states, info = ours[0], ours[4]
        starts = {AutoresetMode.NEXT_STEP: dones, AutoresetMode.SAME_STEP: ended}.get(mode, np.zeros(2, bool))
        dones = ended
        if mode == AutoresetMode.DISABLED and ended.any():
            states, info = native.reset(options={"reset_mask": ended})
            theirs = single.reset(options={"reset_mask": ended.copy()})
            assert data_equivalence((states, info), theirs, exact=True)
            starts = ended
        if (successes >= 2).all():
            return
    pytest.fail(f"successes: {successes}")


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("task", DECISIONS)
def test_decisions_equal_sync_of_single_environments(task: str, mode: AutoresetMode) -> None:
    """Planned poses, far ones, and ones that hit the table; a step ends an episode, or takes something away."""
    obs = (*VECTORS, "depth", "depth_palm", "voxels")
    settings: dict[str, Any] = {"task": task, "obs": obs, "randomization": "standard"}
    single, native = make_sync(mode, **settings), make(autoreset_mode=mode, **settings)
    assert native.observation_space == single.observation_space
    assert native.metadata == single.metadata
    assert data_equivalence(native.reset(seed=3), single.reset(seed=3), exact=True)
    successes = ends = 0
    for step in range(8 if task == "Clear" else 5):
        action = np.stack([over_the_highest(native.arrangement(index)) for index in range(3)])
        # The second pose of each three is far above; the third hits the table.
        action[:, 2] += [0.0, 0.8, -0.9][step % 3]
        ours, theirs = native.step(action), single.step(action)
        assert data_equivalence(ours, theirs, exact=True)
        successes += int((ours[1] > 1.0).sum())
        done = ours[2] | ours[3]
        ends += int(done.sum())
        if mode == AutoresetMode.DISABLED and done.any():
            shown = native.reset(options={"reset_mask": done})
            assert data_equivalence(shown, single.reset(options={"reset_mask": done.copy()}), exact=True)
    assert successes >= 1
    assert ends >= 3


def test_decisions_by_other_ways_are_the_same() -> None:
    """Views into buffers, sent and received, and in processes: the results of a plain call."""
    settings: dict[str, Any] = {"objects": OBJECTS, "reward": "dense", "obs": ("depth_palm", "proprio", "state")}
    env_id, same = "graspbox/GraspPose-v0", AutoresetMode.SAME_STEP
    made: list[Any] = [
        gymnasium.make_vec(env_id, num_envs=3, autoreset_mode=same, copy=copy, **settings)
        for copy in (True, False, True)
    ]
    plain, views, sent = made
    single: Any = [partial(gymnasium.make, env_id, **settings)] * 3
    processes = AsyncVectorEnv(single, autoreset_mode=same)
    others: list[Any] = [views, sent, processes]
    try:
        first, _ = plain.reset(seed=3)
        for env in others:
            assert data_equivalence(env.reset(seed=3)[0], first, exact=True)
        plain.action_space.seed(0)
        for action in [plain.action_space.sample() for _ in range(3)]:
            expected = plain.step(action)
            sent.send(action)
            arrived = sent.recv(3)
            order = np.argsort(arrived[4]["env_id"])
            np.testing.assert_array_equal(arrived[0]["proprio"][order], expected[0]["proprio"])
            assert data_equivalence(views.step(action), expected, exact=True)
            assert data_equivalence(processes.step(action)[:4], expected[:4], exact=True)
    finally:
        processes.close()


def test_a_held_action_is_that_action_again() -> None:
    """At 5 Hz a step is four of 20 Hz, their terms added up, but for the last episode's rest."""
    slow, fast = make(2, control_freq=5, max_episode_steps=8), make(2, max_episode_steps=32)
    for env in (slow, fast):
        env.reset(seed=2)
    touches = False
    for action in pressing(8, 2):
        ours = slow.step(action)
        theirs = [fast.step(action) for _ in range(4)]
        np.testing.assert_array_equal(ours[0], theirs[-1][0])
        np.testing.assert_allclose(ours[1], sum(step[1] for step in theirs), atol=1e-5)
        np.testing.assert_array_equal(ours[3], theirs[-1][3])
        touches |= bool(ours[4]["touches"].any())
    assert ours[3].all()
    assert touches


@ALL_WAYS
@pytest.mark.parametrize("mode", AutoresetMode)
def test_partial_resets_equal_those_of_sync(mode: AutoresetMode, task: str) -> None:
    """In the middle of episodes, with seeds and options, and where an autoreset is due."""
    native = make(task=task, autoreset_mode=mode, max_episode_steps=9)
    single = make_sync(mode, task=task, max_episode_steps=9)
    native.reset(seed=0)
    single.reset(seed=0)
    option = {"place": [0.0, 0.0, 0.5]} if task == "Grasp" else {"friction": 0.5}
    kinds: list[dict[str, Any]] = [{}, {"seed": 8}, {"seed": [7, None, 9]}, {"options": option}]
    asked = itertools.cycle(kinds)
    rng = np.random.default_rng(0)
    for step, action in enumerate(pressing(40, 3)):
        ours = native.step(action)
        assert data_equivalence(ours, single.step(action), exact=True)
        done = ours[2] | ours[3]
        if step % 3 == 2 or (mode == AutoresetMode.DISABLED and done.any()):
            settings = next(asked)
            mask = done | (rng.random(3) < 0.5)
            if not mask.any():
                continue
            options = settings.get("options", {})
            ours = native.reset(seed=settings.get("seed"), options={**options, "reset_mask": mask})
            theirs = single.reset(seed=settings.get("seed"), options={**options, "reset_mask": mask})
            assert data_equivalence(ours, theirs, exact=True)


def rollout(native: Any, steps: int = 40) -> list[Any]:
    return [native.reset(seed=1), *(native.step(action) for action in pressing(steps, native.num_envs, seed=4))]


@ALL_WAYS
def test_results_depend_neither_on_neighbours_nor_on_threads(task: str) -> None:
    many = rollout(make(5, task, num_threads=2, max_episode_steps=15))
    assert data_equivalence(rollout(make(5, task, num_threads=1, max_episode_steps=15)), many, exact=True)
    actions = pressing(40, 5, seed=4)
    alone = make(1, task, max_episode_steps=15)
    observation, _ = alone.reset(seed=1 + 3)
    np.testing.assert_array_equal(observation[0], many[0][0][3])
    for action, step in zip(actions, many[1:], strict=True):
        observation, *_ = alone.step(action[3:4])
        np.testing.assert_array_equal(observation[0], step[0][3])


@pytest.mark.parametrize("obs", ["state", ("tactile", "proprio"), ("depth", "rgb_palm", "voxels")])
def test_views_hold_what_copies_hold(obs: Any) -> None:
    copies, views = make(obs=obs), make(obs=obs, copy=False)

    def arrays(observation: Any) -> list[Any]:
        return list(observation.values()) if isinstance(observation, dict) else [observation]

    kept, buffers = arrays(copies.reset(seed=1)[0]), arrays(views.reset(seed=1)[0])
    for action in pressing(30, 3):
        before = [array.copy() for array in kept]
        new, now = arrays(copies.step(action)[0]), arrays(views.step(action)[0])
        assert all(a is b for a, b in zip(now, buffers, strict=True))
        assert all((a == b).all() for a, b in zip(now, new, strict=True))
        assert all((a == b).all() for a, b in zip(kept, before, strict=True))
        assert not any(np.shares_memory(a, b) for a in new for b in kept)
        kept = new


def test_environments_beside_each_other_prepare_objects_once() -> None:
    first, second = make(2), make_sync(AutoresetMode.NEXT_STEP, 2)
    cores = [first._core, *(env.unwrapped._core for env in second.envs)]
    assert all(core.source.handle is cores[0].source.handle for core in cores)
    assert make(2, objects="procedural:can:0")._core.source.handle is not cores[0].source.handle
    assert make(2, physics=graspbox.PhysicsConfig(gravity=1.6))._core.source.handle is not cores[0].source.handle


def test_environments_have_different_objects() -> None:
    _, info = make(16, objects="procedural:can:0-3").reset(seed=0)
    assert len(set(info["object"])) == 4


@pytest.mark.skipif(not COUNTS_SAME_STEP, reason=MISCOUNTED)
def test_statistics_of_decisions() -> None:
    settings: dict[str, Any] = {"objects": OBJECTS, "reward": "dense", "autoreset_mode": AutoresetMode.SAME_STEP}
    plain: Any = gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=3, **settings)
    counted: Any = RecordEpisodeStatistics(gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=3, **settings))
    plain.reset(seed=3)
    counted.reset(seed=3)
    plain.action_space.seed(0)
    for action in [plain.action_space.sample() for _ in range(3)]:
        expected, (*_, info) = plain.step(action), counted.step(action)
        np.testing.assert_allclose(info["episode"]["r"], expected[1], rtol=1e-6)
        np.testing.assert_array_equal(info["episode"]["l"], [1, 1, 1])


@pytest.mark.parametrize("mode", AutoresetMode)
def test_statistics_of_episodes(mode: AutoresetMode) -> None:
    """Gymnasium's wrapper counts returns and lengths as they are, also under partial resets."""
    if mode == AutoresetMode.SAME_STEP and not COUNTS_SAME_STEP:
        pytest.skip(MISCOUNTED)
    env = RecordEpisodeStatistics(make(autoreset_mode=mode, max_episode_steps=7))
    env.reset(seed=0)
    returns, lengths, fresh = np.zeros(3), np.zeros(3, dtype=int), np.zeros(3, dtype=bool)
    episodes = 0
    for step, action in enumerate(pressing(60, 3)):
        _, rewards, terminated, truncated, info = env.step(action)
        done = terminated | truncated
        acted = ~fresh
        returns[acted] += rewards[acted]
        lengths[acted] += 1
        for i in np.flatnonzero(done):
            assert info["episode"]["l"][i] == lengths[i]
            assert info["episode"]["r"][i] == pytest.approx(returns[i], abs=1e-9)
            episodes += 1
        assert ("episode" in info) == done.any()
        mask = done if mode == AutoresetMode.DISABLED else np.zeros(3, dtype=bool)
        if step % 10 == 4:
            mask = mask | np.array([True, False, False])
        returns[done] = lengths[done] = 0
        fresh = done & (mode == AutoresetMode.NEXT_STEP)
        if mask.any():
            env.reset(options={"reset_mask": mask.copy()})
            returns[mask] = lengths[mask] = 0
            fresh[mask] = False
    assert episodes > 15
    assert env.episode_count == episodes


@ALL_WAYS
def test_send_and_recv_give_what_step_gives(task: str) -> None:
    """In any order of arrival, each environment gets the observations of a common step."""
    together, apart = make(4, task, max_episode_steps=10), make(4, task, max_episode_steps=10)
    together.reset(seed=2)
    apart.reset(seed=2)
    for action in pressing(25, 4):
        expected = together.step(action)
        apart.send(action)
        parts = [apart.recv(1), apart.recv(3)]
        arrived = np.concatenate([part[4]["env_id"] for part in parts])
        assert sorted(arrived) == [0, 1, 2, 3]
        for array in range(4):
            found = np.concatenate([part[array] for part in parts])
            np.testing.assert_array_equal(found, expected[array][arrived])
        failures = np.concatenate([part[4]["failure"] for part in parts])
        assert (failures == expected[4]["failure"][arrived]).all()
    with pytest.raises(errors.ConfigError, match="steps are pending"):
        apart.recv(1)
    apart.send(pressing(1, 2)[0], [1, 3])
    with pytest.raises(errors.ConfigError):
        apart.step(pressing(1, 4)[0])
    assert set(apart.recv(2)[4]["env_id"]) == {1, 3}
    apart.step(pressing(1, 4)[0])


def test_final_observations_arrive_through_recv() -> None:
    env = make(3, max_episode_steps=4, autoreset_mode="SameStep")
    twin = make(3, max_episode_steps=4, autoreset_mode="SameStep")
    env.reset(seed=0)
    twin.reset(seed=0)
    for action in pressing(4, 3):
        env.send(action, [2, 0, 1])
        found = env.recv()
        expected = twin.step(action[[1, 2, 0]])
    infos, arrived = found[4], found[4]["env_id"]
    assert infos["_final_obs"].all()
    for i, e in enumerate(arrived):
        np.testing.assert_array_equal(infos["final_obs"][i], expected[4]["final_obs"][e])
    np.testing.assert_array_equal(infos["final_info"]["lift"], expected[4]["final_info"]["lift"][arrived])


@ALL_WAYS
def test_states_pass_between_single_and_vector(task: str) -> None:
    """In the middle of an episode: of a round, after an attempt that failed."""
    objects, (env_id, keywords) = "procedural:box:0-1", TASKS[task]
    keywords = {**keywords, **({"max_failures": 40} if task == "Clear" else {})}
    single: Any = gymnasium.make(env_id, objects=objects, reward="dense", **keywords).unwrapped
    env = make(2, task, objects=objects, max_episode_steps=50, **keywords)
    actions = pressing(30, 2)
    env.reset(seed=6)
    for action in actions[:15]:
        env.step(action)
    shown = env.set_state(1, env.get_state(1))
    # Where the others have no episode yet.
    for count in (2, 3):
        fresh: Any = make(count, task, objects=objects, **keywords)
        assert data_equivalence(fresh.set_state(1, env.get_state(1)), shown, exact=True)
    assert data_equivalence(single.set_state(env.get_state(1)), shown, exact=True)
    for action in actions[15:]:
        ours = env.step(action)
        theirs = single.step(action[1])
        np.testing.assert_array_equal(ours[0][1], theirs[0])
        assert ours[1][1] == theirs[1]


def test_wrong_arguments_are_explained() -> None:
    with pytest.raises(errors.ConfigError, match="autoreset"):
        make(autoreset_mode="sometimes")
    with pytest.raises(errors.ConfigError, match=r"num_envs is True \(bool\); give an integer"):
        make(True)
    with pytest.raises(errors.ConfigError, match="num_envs"):
        make(0)
    env = make()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.sample())
    with pytest.raises(errors.ConfigError, match="2 seeds"):
        env.reset(seed=[1, 2])
    env.reset(seed=0)
    for mask in ([True, False, False], np.zeros(3, dtype=bool), np.ones(2, dtype=bool), np.ones(3)):
        with pytest.raises(errors.ConfigError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(errors.ConfigError, match="10 numbers"):
        env.step(np.zeros((2, 10), dtype=np.float32))
    with pytest.raises(errors.ConfigError, match="10 numbers"):
        env.step(np.zeros((10, 3), dtype=np.float32))
