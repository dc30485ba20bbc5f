"""Clients of servers: addresses, and remote environments in Gymnasium and Stable-Baselines3."""

import pickle
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import vector as wrappers

from acting import EACH, OBJECTS, pressing
from graspbox import errors
from graspbox.envs.remote_config import RemoteConfig
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from test_remote import GRASP, PICTURE, POSE, Urls, acting, begun, make, make_single, rollout, same
from test_remote_sessions import error_of, spoiled


@pytest.fixture(scope="module")
def urls() -> Iterator[Urls]:
    settings = ServerSettings(port=0)
    with EnvironmentServer(settings) as one, EnvironmentServer(settings) as two:
        yield one.url, two.url


@pytest.mark.parametrize("url", ["http://127.0.0.1:5055", "127.0.0.1:5055", "ws://", "", "ws://127.0.0.1:99999"])
def test_what_is_no_address(url: str) -> None:
    with pytest.raises(errors.ConfigError, match=f'"{url}" is not a server address'):
        make(1, remote=url)


def test_an_unreachable_server_is_named(urls: Urls) -> None:
    with pytest.raises(errors.ConnectionLostError, match=r"ws://127\.0\.0\.1:1 cannot be reached"):
        make(1, remote="ws://127.0.0.1:1")
    with pytest.raises(errors.ConnectionLostError, match=r"ws://127\.0\.0\.1:1 .*environments 2 to 4 "):
        make(5, remote=(urls[0], "ws://127.0.0.1:1"))


WRONG_CONFIGS: list[Any] = [
    {"urls": "ws://a"}, {"urls": ()}, {"urls": (3,)}, {"grace": -1.0}, {"grace": float("nan")}, {"grace": float("inf")},
    {"grace": "long"}, {"depth": "float64"}, {"token_file": 3},
]  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG_CONFIGS, ids=str)
def test_wrong_configs_are_refused_by_name(urls: Urls, wrong: dict[str, Any]) -> None:
    with pytest.raises(errors.ConfigError, match=next(iter(wrong))):
        make(1, remote=RemoteConfig(**{"urls": urls, **wrong}))


KEYWORDS: list[Any] = [
    {"moon": 1}, {"obs": "deep"}, {"reward": "fair"}, {"reward_weights": {"moon": 1.0}}, {"control": "fly"},
    {"control_freq": 0}, {"max_episode_steps": 0}, {"autoreset_mode": "sometimes"}, {"info": "brief"},
    {"image_size": 8},
    {"randomization": "strong"}, {"render_mode": "ansi"}, {"split": "half"}, {"physics": {"gravty": 1}},
    {"physics": {"gravity": -1.0}}, {"success": {"hold_time": -1.0}}, {"prepare_files": -1}, {"num_threads": 0},
    {"objects": "procedural:moon"}, {"objects": 3}, {"num_envs": 0}, {"num_envs": 1.5}, {"num_envs": -3},
    {"num_envs": "x"}, {"objects": []}, {"reward": []}, {"control": {}}, {"obs": 5}, {"obs": [5]}, {"info": []},
    {"split": []}, {"image_size": [1, 2, 3]}, {"image_size": "x"}, {"randomization": 5}, {"render_mode": []},
    {"autoreset_mode": []}, {"reward_weights": []}, {"physics": []}, {"cameras": 5}, {"control_freq": "x"},
]  # fmt: skip


@pytest.mark.parametrize("wrong", KEYWORDS, ids=str)
def test_wrong_keywords_are_refused_as_in_this_process(urls: Urls, wrong: dict[str, Any]) -> None:
    found = {error_of(partial(make, **{"remote": remote, **wrong})) for remote in (None, urls[0], urls)}
    assert len(found) == 1
    assert {kind for kind, _ in found} <= {"ConfigError", "ObjectSetError", "UnknownKeywordError"}


@pytest.mark.parametrize("call", ["step", "send"])
def test_a_refused_action_moves_nothing(urls: Urls, call: str) -> None:
    """Not even where another server may ignore NaN, since its environment begins an episode instead."""
    env, local = (begun(remote=remote, max_episode_steps=2) for remote in (urls, None))
    for one in (env, local):
        one.step(acting(one, 1)[0])
        one.reset(options={"reset_mask": np.arange(5) != 0})
        one.step(acting(one, 1)[0])
    states = local.call("get_state")
    for one in (env, local):
        assert "environment 3" in error_of(partial(getattr(one, call), spoiled(one, 0, 3)))[1]
        assert one.call("get_state") == states
    assert same(env.step(acting(env, 1)[0]), local.step(acting(local, 1)[0]))


def test_a_spec_keeps_the_servers(urls: Urls) -> None:
    env = make_single(remote=RemoteConfig(urls[:1]))
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec.kwargs["remote"]["urls"] == [urls[0]]
    again: Any = gymnasium.make(spec)
    assert again.unwrapped._core.pool.url == urls[0]
    assert same(again.reset(seed=1), env.reset(seed=1))
    for one in (env, again):
        one.close()


@pytest.mark.parametrize("obs", ["state", ("rgb", "depth_palm", "proprio")])
def test_views_and_numeric_infos(urls: Urls, obs: Any) -> None:
    """Buffers stay the same arrays, with the contents of copies."""
    settings: dict[str, Any] = {"obs": obs, "info": "numeric", "autoreset_mode": "SameStep", "max_episode_steps": 3}
    local = make(3, **settings)
    expected = rollout(local, 5)
    for remote in (urls[0], urls):
        env = make(3, copy=False, remote=remote, **settings)
        first, _ = env.reset(seed=3)
        buffers = list(first.values()) if isinstance(first, dict) else [first]
        assert same(first, expected[0][0])
        for action, step in zip(acting(env, 5), expected[1:], strict=True):
            found = env.step(action)
            assert same(found, step)
            now = list(found[0].values()) if isinstance(found[0], dict) else [found[0]]
            assert all(a is b for a, b in zip(now, buffers, strict=True))
        env.close()


def test_attributes_and_methods(urls: Urls) -> None:
    local, env = begun(render_mode="rgb_array"), begun(render_mode="rgb_array", remote=urls)
    for name in ("render_mode", "observation_space", "action_space", "np_random_seed", "get_state"):
        assert same(env.get_attr(name) if name != "get_state" else env.call(name), local.call(name))
    assert env.get_attr("objects")[0].names == local.objects.names
    states = local.call("get_state")
    assert same(env.call("set_state", states[4]), local.call("set_state", states[4]))
    assert env.call("get_state") == (states[4],) * 5
    for values in ([3, 4, 5, 6, 7], 5):
        env.set_attr("level", values)
        assert env.get_attr("level") == (tuple(values) if isinstance(values, list) else (values,) * 5)
    env.close()


def test_depth_in_millimetres(urls: Urls) -> None:
    """The nearest millimetre, as a float32 of the same space; other images stay as they are."""
    exact = make(2, obs=("depth", "rgbd", "points", "rgb"))
    rounded = make(2, obs=("depth", "rgbd", "points", "rgb"), remote=RemoteConfig(urls, depth="uint16"))
    assert rounded.observation_space == exact.observation_space
    for (ours, *_), (theirs, *_) in zip(rollout(rounded, 4), rollout(exact, 4), strict=True):
        assert rounded.observation_space.contains(ours)
        assert same({**ours, "depth": 0}, {**theirs, "depth": 0})
        assert ours["depth"].dtype == np.float32
        np.testing.assert_allclose(ours["depth"], theirs["depth"], atol=0.5e-3 + 1e-6, rtol=0)
        assert (ours["depth"] != theirs["depth"]).any()
        np.testing.assert_allclose(1e3 * ours["depth"], np.round(1e3 * ours["depth"]), atol=1e-3, rtol=0)
    rounded.close()


@pytest.mark.parametrize(("env_id", "obs"), [(GRASP, ("depth_palm", "proprio")), (GRASP, "points"), (POSE, "rgb")])
def test_gymnasium_finds_nothing_to_complain_about(urls: Urls, env_id: str, obs: Any) -> None:
    """Windows left aside: after one has been open, torch cannot load its compiler (two copies of LLVM)."""
    env = make_single(env_id, remote=urls[0], obs=obs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


def wrapped(env: Any) -> Any:
    env = wrappers.RecordEpisodeStatistics(env)
    env = wrappers.NormalizeObservation(wrappers.ClipAction(env))
    env = wrappers.TransformReward(wrappers.NormalizeReward(env), lambda reward: 2.0 * reward)
    return wrappers.DtypeObservation(env, np.float64)


def test_wrappers_of_gymnasium(urls: Urls) -> None:
    """Statistics of episodes except their times, and values computed from observations and rewards."""
    seen = []
    for remote in (None, urls):
        env = wrapped(make(3, remote=remote, autoreset_mode="NextStep"))
        steps = rollout(env, 20)
        ended = [step[-1].pop("episode") for step in steps if "episode" in step[-1]]
        seen.append((steps, [(one["r"], one["l"]) for one in ended], env.env.env.env.env.env.episode_count))
        env.close()
    assert seen[0][2] >= 6
    assert same(*seen)


def make_sb3(num_envs: int = 3, **settings: Any) -> Any:
    pytest.importorskip("stable_baselines3")
    from graspbox.sb3 import VecEnv

    defaults = {"objects": OBJECTS, "reward": "dense", "max_episode_steps": 7, **EACH}
    return VecEnv.make(GRASP, num_envs, **{**defaults, **settings})


@pytest.mark.train
@pytest.mark.parametrize("obs", ["state", ("proprio", "tactile")])
def test_a_vec_env_is_that_of_this_process(urls: Urls, stopped_clock: None, obs: Any) -> None:
    """Observations, rewards, dones and infos, terminal observations included; methods, pictures and copies."""
    settings: dict[str, Any] = {"obs": obs, "render_mode": "rgb_array", "picture": PICTURE}
    local, env = make_sb3(**settings), make_sb3(remote=urls, **settings)
    for one in (local, env):
        one.seed(4)
        one.set_options({"place": [0.0, 0.01, 0.2]})
    assert env.observation_space == local.observation_space
    assert same(env.reset(), local.reset())
    ends = 0
    for actions in pressing(16, 3):
        ours, theirs = env.step(actions), local.step(actions)
        assert same(tuple(ours), tuple(theirs))
        assert same(env.reset_infos, local.reset_infos)
        ends += int(theirs[2].sum())
    assert ends >= 6
    assert same(env.env_method("get_state", indices=[2]), local.env_method("get_state", indices=[2]))
    assert same(env.get_images(), local.get_images())
    other = pickle.loads(pickle.dumps(env))
    assert same(tuple(other.step(actions)), tuple(local.step(actions)))
    for one in (env, other):
        one.close()


@pytest.mark.train
def test_ppo_learns_the_same(urls: Urls, one_thread: None) -> None:
    """The same rollouts give the same weights; they are others than before."""
    sb3 = pytest.importorskip("stable_baselines3")
    learned = []
    for remote in (None, urls):
        env = make_sb3(4, remote=remote)
        model = sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=32, n_epochs=1, seed=0, device="cpu")
        before = [p.detach().clone().numpy() for p in model.policy.parameters()]
        model.learn(64)
        learned.append([p.detach().numpy() for p in model.policy.parameters()])
        assert not same(learned[-1], before)
        env.close()
    assert same(*learned)


@pytest.mark.train
def test_a_training_on_a_server_equals_one_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_thread: None
) -> None:
    """By ``--set env.remote=URL``; the token is in the environment, not among the settings that the run writes."""
    pytest.importorskip("stable_baselines3")
    from test_sb3_training import PPO, rows_of, run

    monkeypatch.setenv("GRASPBOX_TOKEN", "a-token-of-some-length")
    with EnvironmentServer(ServerSettings(port=0, token="a-token-of-some-length")) as server:
        assert run("ppo", tmp_path / "there", (*PPO, f"env.remote={server.url}")) == 0
    assert run("ppo", tmp_path / "here", PPO) == 0
    there, here = ([{**row, "seconds": 0} for row in rows_of(tmp_path / name)] for name in ("there", "here"))
    assert there == here
    assert not any("a-token" in file.read_text() for file in (tmp_path / "there").glob("*.json"))
