"""`graspbox.sb3`: vector environments equal single ones for Stable-Baselines3. Needs the extra ``train``."""

import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from acting import EACH, OBJECTS, Experts, pressing
from graspbox import errors
from graspbox.configs import PictureConfig

pytestmark = pytest.mark.train

sb3 = pytest.importorskip("stable_baselines3")

ID = "graspbox/Grasp-v0"


def make(num_envs: int = 3, **settings: Any) -> Any:
    from graspbox.sb3 import VecEnv

    defaults = {"objects": OBJECTS, "reward": "dense", "max_episode_steps": 9, **EACH}
    return VecEnv.make(ID, num_envs, **{**defaults, **settings})


@pytest.mark.parametrize("obs", ["state", ("proprio", "tactile")])
def test_equals_dummy_vec_env(stopped_clock: None, obs: Any) -> None:
    """Observations, rewards, dones and infos with ends and statistics of episodes, over several episodes."""
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    def single() -> Any:
        return Monitor(gymnasium.make(ID, objects=OBJECTS, reward="dense", obs=obs, max_episode_steps=9, **EACH))

    native, dummy = make(obs=obs), DummyVecEnv([single] * 3)
    for env in (native, dummy):
        env.seed(4)
        env.set_options({"place": [0.0, 0.01, 0.2]})
    assert data_equivalence(native.reset(), dict_of(dummy.reset()), exact=True)
    assert data_equivalence(native.reset_infos, dummy.reset_infos, exact=True)
    ends = 0
    for actions in pressing(30, 3):
        ours, theirs = native.step(actions), dummy.step(actions)
        assert data_equivalence(ours[0], dict_of(theirs[0]), exact=True)
        for a, b in zip(ours[1:3], theirs[1:3], strict=True):
            assert data_equivalence(a, b, exact=True)
        assert data_equivalence(ours[3], theirs[3], exact=True)
        assert data_equivalence(native.reset_infos, dummy.reset_infos, exact=True)
        ends += int(ours[2].sum())
    assert ends >= 6
    # A reset in the middle of an episode begins its statistics, too.
    native.reset()
    dones, infos = native.step(actions)[2:]
    while not dones.any():
        dones, infos = native.step(actions)[2:]
    assert infos[0]["episode"]["l"] == 9


def test_a_success_ends_an_episode_as_in_dummy_vec_env(stopped_clock: None) -> None:
    """An end that is none of time: the terminal observation is there, and nothing says that it was cut off."""
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    settings: dict[str, Any] = {"objects": "procedural:can:0-1", "fingers": "synergy", "control_freq": 10}
    native = make(2, max_episode_steps=200, reward="sparse", **settings)
    made = {"max_episode_steps": 200, "reward": "sparse", **settings}
    dummy: Any = DummyVecEnv([lambda: Monitor(gymnasium.make(ID, **made))] * 2)
    experts = Experts(native.get_attr("objects", 0)[0], 2, control_freq=10)
    for env in (native, dummy):
        env.seed(5)
    states, ends = native.reset(), np.ones(2, dtype=bool)
    assert data_equivalence(states, dummy.reset(), exact=True)
    for _ in range(150):
        actions = experts.act(states, np.array([info["object"] for info in native.reset_infos]), ends)
        ours, theirs = native.step(actions), dummy.step(actions)
        assert data_equivalence(tuple(ours), tuple(theirs), exact=True)
        states, _, ends, infos = ours
        for info in (infos[i] for i in np.flatnonzero(ends)):
            assert info["is_success"]
            assert not info["TimeLimit.truncated"]
            assert info["terminal_observation"].shape == states[0].shape
        if ends.any():
            return
    pytest.fail("no success")


def dict_of(observation: Any) -> Any:
    return dict(observation) if isinstance(observation, dict) else observation


def test_attributes_methods_and_their_errors(stopped_clock: None) -> None:
    env = make()
    env.reset()
    assert env.get_attr("num_envs", indices=[0, 2]) == [3, 3]
    assert env.has_attr("render_mode")
    assert not env.has_attr("moon")
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    states = env.env_method("get_state")
    actions = pressing(2, 3)
    first = env.step(actions[0])
    for i, state in enumerate(states):
        env.env_method("set_state", state, indices=i)
    assert data_equivalence(env.step(actions[0]), first, exact=True)
    with pytest.raises(errors.ConfigError, match="no method"):
        env.env_method("step", actions[0])
    with pytest.raises(errors.ConfigError, match="'render_mode' is shared"):
        env.set_attr("render_mode", None, indices=[0])
    env.set_attr("level", 3, indices=[0, 2])
    assert env.get_attr("level", indices=[0, 2]) == [3, 3]
    assert not env.has_attr("level")
    env.set_options([{"object": 0}, {"object": 5}, {"object": 2}])
    env.reset()
    names = env.get_attr("objects", 0)[0].names
    assert [info["object"] for info in env.reset_infos] == [names[0], names[5], names[2]]
    from stable_baselines3.common.env_util import make_vec_env

    from graspbox.sb3 import VecEnv

    with pytest.raises(errors.ConfigError, match=r"VecEnv\.make"):
        make_vec_env(ID, n_envs=2, vec_env_cls=VecEnv)

    with pytest.raises(errors.ConfigError, match="SameStep"):
        VecEnv(gymnasium.make_vec(ID, num_envs=2, objects=OBJECTS))
    # A rollout buffer would take each observation as that of the step before.
    with pytest.raises(errors.ConfigError, match="copy=True"):
        make(copy=False)


def test_what_belongs_to_one_environment_is_had_alone() -> None:
    env = make()
    place = np.array([0.01, 0.02, 0.3])
    env.seed(5)
    env.set_options([{"place": place.copy()} for _ in range(3)])
    observations = env.reset()
    seeds, options = [5, 6, 7], {"place": [0.01, 0.02, 0.3]}
    np.testing.assert_array_equal(observations, env.env.reset(seed=seeds, options=options)[0])
    assert (observations != env.env.reset(seed=seeds)[0]).any()
    for name in ("observation_space", "action_space"):
        assert env.get_attr(name) == [getattr(env, name)] * 3
    assert env.get_attr("np_random_seed", indices=[0, 2]) == [5, 7]
    cameras = env.env_method("cameras", indices=[1])
    assert len(cameras) == 1
    assert cameras[0]["front"][1].shape == (4, 4)
    np.testing.assert_array_equal(cameras[0]["palm"][1], env.env.cameras()["palm"][1][1])


def test_a_copy_continues_with_the_same_bits(stopped_clock: None) -> None:
    env = make(2, randomization="standard")
    env.seed(3)
    env.reset()
    actions = pressing(24, 2)
    for action in actions[:12]:
        env.step(action)
    other = pickle.loads(pickle.dumps(env))
    ends = 0
    for action in actions[12:]:
        ours = env.step(action)
        assert data_equivalence(tuple(ours), tuple(other.step(action)), exact=True)
        ends += int(ours[2].sum())
    assert ends >= 2


def test_pictures_of_some_environments() -> None:
    env = make(2, render_mode="rgb_array", picture=PictureConfig(image_size=(32, 48), samples=1))
    env.reset()
    frames = env.get_images()
    np.testing.assert_array_equal(env.env_method("render", indices=[1])[0], frames[1])


def test_ppo_learns_and_is_evaluated() -> None:
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecMonitor

    env = VecMonitor(make(4), info_keywords=("is_success", "lift"))
    model = sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=32, n_epochs=1, seed=0, device="cpu")
    before = [p.clone() for p in model.policy.parameters()]
    model.learn(128)
    assert any((a != b).any() for a, b in zip(before, model.policy.parameters(), strict=True))
    assert len(model.ep_info_buffer) >= 8
    assert all(info["l"] == 9 for info in model.ep_info_buffer)
    returns, lengths = evaluate_policy(model, env, n_eval_episodes=4, return_episode_rewards=True)
    assert np.isfinite(returns).all()
    assert lengths == [9] * 4


def test_plain_training_logs_returns_lengths_and_successes(tmp_path: Path) -> None:
    """The first curves that people look at, without a wrapper."""
    from stable_baselines3.common.logger import configure

    model = sb3.PPO("MlpPolicy", make(4), n_steps=18, batch_size=36, n_epochs=1, seed=0, device="cpu")
    model.set_logger(configure(str(tmp_path), ["json"]))
    model.learn(72)
    model.logger.close()
    logged = json.loads((tmp_path / "progress.json").read_text())
    episodes = model.ep_info_buffer
    assert len(episodes) == 8
    assert logged["rollout/ep_rew_mean"] == pytest.approx(np.mean([episode["r"] for episode in episodes]))
    assert logged["rollout/ep_len_mean"] == 9
    assert logged["rollout/success_rate"] == 0


def test_subproc_vec_env_after_a_rollout_in_the_parent() -> None:
    from stable_baselines3.common.vec_env import SubprocVecEnv

    from test_conformance import factory

    single = factory((ID, {"obs": "state", "fingers": "each"}))
    parent = single()
    parent.reset(seed=0)
    parent.step(parent.action_space.sample())
    env = SubprocVecEnv([single] * 2, start_method="fork")
    try:
        env.seed(0)
        observation: Any = env.reset()
        np.testing.assert_array_equal(observation[0], parent.reset(seed=0)[0])
        for actions in pressing(5, 2):
            seen: Any = env.step(actions)[0]
            np.testing.assert_array_equal(seen[0], parent.step(actions[0])[0])
    finally:
        env.close()


@pytest.mark.parametrize("start_method", ["spawn", "forkserver"])
def test_workers_of_subproc_vec_env_know_the_ids(start_method: str) -> None:
    """Only this process has imported graspbox; "Namespace graspbox not found" was the workers' answer."""
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    settings = {"objects": OBJECTS}
    env = make_vec_env(
        ID,
        2,
        seed=3,
        env_kwargs=settings,
        vec_env_cls=SubprocVecEnv,
        vec_env_kwargs={"start_method": start_method},
    )
    try:
        observations: Any = env.reset()
    finally:
        env.close()
    np.testing.assert_array_equal(observations[1], gymnasium.make(ID, objects=OBJECTS).reset(seed=4)[0])


@pytest.mark.filterwarnings("ignore:This DataLoader will create")  # of torch, on one core
def test_data_loader_workers_step_after_a_rollout_in_the_parent() -> None:
    torch = pytest.importorskip("torch")
    from test_conformance import factory

    single = factory((ID, {"obs": "state", "fingers": "each"}))
    parent = single()
    expected = [parent.reset(seed=seed)[0] for seed in range(4)]

    class Starts(torch.utils.data.Dataset):  # type: ignore[misc, name-defined, unused-ignore]
        def __len__(self) -> int:
            return 4

        def __getitem__(self, seed: int) -> Any:
            return single().reset(seed=seed)[0]

    loader = torch.utils.data.DataLoader(Starts(), num_workers=2, multiprocessing_context="fork")
    found = [batch[0].numpy() for batch in loader]
    np.testing.assert_array_equal(np.stack(found), np.stack(expected))


def test_missing_extra_is_named(tmp_path: Path) -> None:
    (tmp_path / "stable_baselines3.py").write_text("raise ModuleNotFoundError(name='stable_baselines3')\n")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import graspbox.sb3; graspbox.sb3.VecEnv"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "MissingExtraError" in result.stderr
    assert "graspbox[train]" in result.stderr
