"""Sessions on servers: sending and receiving, broken connections, lost servers, and refusals."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import pytest

from foreign_server import Proxy
from graspbox import errors, load_hand
from graspbox.envs.remote_config import RemoteConfig
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from test_remote import (
    POSE,
    Urls,
    acting,
    begun,
    breaking,
    make,
    make_single,
    pools_of,
    rollout,
    rollout_single,
    rows,
    same,
)

TOKEN = "a-token-of-many-characters"


def served(**settings: Any) -> EnvironmentServer:
    return EnvironmentServer(ServerSettings(port=0, **settings))


@pytest.fixture(scope="module")
def urls() -> Iterator[Urls]:
    with served() as one, served() as two:
        yield one.url, two.url


def error_of(call: Callable[[], Any]) -> tuple[str, str]:
    """Find class and sentence of the error of a call."""
    try:
        call()
    except Exception as error:
        return type(error).__name__, str(error)
    pytest.fail("no error")


@pytest.mark.parametrize("before", [True, False], ids=["before", "between"])
@pytest.mark.parametrize("count", [1, 2])
def test_bits_continue_after_a_lost_connection(urls: Urls, count: int, before: bool) -> None:
    """In every command: each is carried out once, and its answer arrives."""
    settings: dict[str, Any] = {"max_episode_steps": 4, "render_mode": "rgb_array", "obs": ("state", "depth")}
    local = make(5, **settings)
    env = breaking(make(5, remote=urls[:count], **settings), before)
    assert same(rollout(env, 6), rollout(local, 6))
    assert same(env.call("get_state"), local.call("get_state"))
    assert same(env.cameras(), local.cameras())
    assert same(env.render(), local.render())
    state = local.get_state(1)
    assert same(env.set_state(4, state), local.set_state(4, state))
    for one in (env, local):
        one.send(acting(one, 1)[0])
    assert same(rows(env.recv())[4], rows(local.recv())[4])
    assert error_of(lambda: env.recv(1)) == error_of(lambda: local.recv(1))
    assert same(env.step(acting(env, 1)[0]), local.step(acting(env, 1)[0]))
    single, alone = breaking(make_single(POSE, remote=urls[0]), before), make_single(POSE)
    assert same(rollout_single(single, 2), rollout_single(alone, 2))


def until(done: Callable[[], bool]) -> None:
    """Wait for a condition in the background; ten seconds count as never."""
    for _ in range(1000):
        if done():
            return
        time.sleep(0.01)
    pytest.fail("it does not happen")


def sessions(server: EnvironmentServer) -> int:
    return int(next(line.split()[1] for line in server.metrics().splitlines() if line.startswith("graspbox_sessions ")))


@pytest.mark.parametrize(("code", "reason"), [(1001, ""), (1001, "proxy restarting"), (1012, "service restart")])
def test_a_proxy_that_goes_away_ends_no_session(urls: Urls, code: int, reason: str) -> None:
    """Any frame that closed the connection was taken for the end of the session, in spite of its grace."""
    local = begun(2)
    with Proxy(urls[0]) as proxy:
        env = begun(2, remote=proxy.url)
        for action in acting(local, 3):
            assert same(env.step(action), local.step(action))
            proxy.close_all(code, reason)
        env.close()


def test_a_server_that_stops_ends_its_sessions_at_once() -> None:
    """It says so, and the client does not try again for the grace of its session."""
    with served() as server:
        env = begun(2, remote=RemoteConfig((server.url,), grace=600.0))
        server.stop()
        with pytest.raises(errors.ConnectionLostError, match="is over: the server is stopping"):
            env.step(acting(env, 1)[0])


def test_a_session_that_nobody_takes_up_ends() -> None:
    """After that it is lost, and with it its environments."""
    with served() as server:
        env = begun(2, remote=RemoteConfig((server.url,), grace=0.1))
        pools_of(env)[0]._client._break_off()
        until(lambda: sessions(server) == 0)
        with pytest.raises(errors.ConnectionLostError, match=f"session on {server.url} is (lost|over)"):
            env.step(acting(env, 1)[0])


def test_without_grace_a_lost_connection_is_an_error(urls: Urls) -> None:
    env = begun(5, remote=RemoteConfig(urls, grace=0.0))
    pools_of(env)[1]._client._break_off()
    with pytest.raises(errors.ConnectionLostError, match=rf"{urls[1]} .*environments 2 to 4 "):
        env.step(acting(env, 1)[0])


def interrupted(env: Any, which: int, call: Callable[[], Any]) -> None:
    """Ctrl-C while the answer of a server is waited for; later ones have their command already."""
    pool = pools_of(env)[which]

    def end(_number: int) -> Any:
        raise KeyboardInterrupt

    pool.end = end
    with pytest.raises(KeyboardInterrupt):
        call()
    del pool.end


@pytest.mark.parametrize("command", ["step", "reset", "send"])
@pytest.mark.parametrize("which", [0, 1])
def test_a_call_that_was_interrupted_is_not_forgotten(urls: Urls, which: int, command: str) -> None:
    """Servers after the awaited one had stepped, unknown to the client: later bits were wrong."""
    with served() as server:
        urls = (urls[0], server.url)
        env, local = begun(remote=urls, max_episode_steps=4), begun(max_episode_steps=4)
        actions = acting(local, 6)
        for action in actions[:2]:
            assert same(env.step(action), local.step(action))
        calls: dict[str, Callable[[], Any]] = {
            "step": lambda: env.step(actions[2]),
            "send": lambda: env.send(actions[2]),
            "reset": lambda: env.reset(seed=8, options={"reset_mask": np.array([True, False, True, True, True])}),
        }
        interrupted(env, which, calls[command])
        # Each environment continues from its current state.
        for index, state in enumerate(env.call("get_state")):
            local.set_state(index, state)
        for action in actions[3:]:
            assert same(env.step(action), local.step(action))
    env.close()


def test_an_interruption_leaves_no_episode_that_is_over_unnoticed(urls: Urls) -> None:
    """Without autoreset a step of an episode that is over is refused before any server moves."""
    env = begun(remote=urls, autoreset_mode="Disabled", max_episode_steps=1)
    action = acting(env, 1)[0]
    interrupted(env, 0, lambda: env.step(action))
    until(lambda: error_of(lambda: env.step(action))[1].startswith("the episode of environment"))
    states = env.call("get_state")
    assert "is over" in error_of(lambda: env.step(action))[1]
    assert env.call("get_state") == states
    env.reset(seed=3)
    env.step(action)
    env.close()


def test_environments_that_have_not_begun_are_known_after_an_interruption(urls: Urls) -> None:
    env = make(5, remote=urls)
    interrupted(env, 1, lambda: env.reset(seed=3))
    found = env.reset(seed=4)
    assert same(found, make(5).reset(seed=4))
    env.close()


def test_a_signal_ends_a_call_over_several_servers(urls: Urls) -> None:
    """As a user sends it: the call ends at once, and the environments continue from their current states."""
    env = make(128, POSE, remote=urls)
    env.reset(seed=3)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    action[:, [2, 3, 7]] = [-0.3, 1.0, -1.0]
    before = env.call("get_state")
    Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        env.step(action)
    states = env.call("get_state")
    assert any(state == old for state, old in zip(states, before, strict=True)), "the call did not run to its end"
    local = make(128, POSE)
    for index, state in enumerate(states):
        local.set_state(index, state)
    assert same(env.reset(seed=5), local.reset(seed=5))
    env.close()


CALLS: dict[str, Callable[[Any], Any]] = {
    "step": lambda env: env.step(acting(env, 1)[0]),
    "reset": lambda env: env.reset(seed=1),
    "get_state": lambda env: env.get_state(1),
    "recv": lambda env: env.recv(5),
}


def test_the_error_of_a_lost_server_names_it_and_its_environments() -> None:
    with served() as one, served() as two:
        config = RemoteConfig((one.url, two.url), grace=0.0)
        envs = {name: begun(remote=config) for name in CALLS}
        envs["recv"].send(acting(envs["recv"], 1)[0])
        for server in (one, two):
            server.stop(patient=False)
        for name, call in CALLS.items():
            kind, sentence = error_of(partial(call, envs[name]))
            assert (name, kind) == (name, "ConnectionLostError")
            assert one.url in sentence, name
            assert "environments 0 to 1 " in sentence, name


def test_the_error_of_the_only_server_names_it_and_its_environments() -> None:
    with served() as server:
        env, alone = begun(3, remote=RemoteConfig((server.url,), grace=0.0)), make_single(remote=server.url)
        alone.reset(seed=0)
        server.stop(patient=False)
        for name in ("step", "get_state", "reset"):
            with pytest.raises(errors.ConnectionLostError, match=f"{server.url}.*; environments 0 to 2 are on it$"):
                CALLS[name](env)
        with pytest.raises(errors.ConnectionLostError, match=f"{server.url}.*; environment 0 is on it$"):
            alone.reset()
        with pytest.raises(errors.ConnectionLostError, match=r"reached.*; environments 0 to 2 are to be on it$"):
            make(3, remote=server.url)


def test_a_mass_that_is_none_is_refused_as_in_this_process() -> None:
    """It was an error of another class, about another rule."""
    with served() as server:
        for name, value in (("mass", np.nan), ("mass", -1.0), ("scale", np.inf), ("scale", 0.0)):
            made: list[dict[str, Any]] = [{name: value}, {name: value, "remote": server.url}]
            here, there = (error_of(partial(make, 1, **choice)) for choice in made)
            assert here == there
            assert here[0] == "ObjectSetError"


def send(env: Any, count: int, envs: list[int]) -> Any:
    return env.send(acting(env, 1)[0][:count], envs)


def spoiled(env: Any, *rows: int) -> Any:
    """Actions with NaN in some rows."""
    action = acting(env, 1)[0]
    action[list(rows), 2] = np.nan
    return action


#: Wrong in environments that have begun.
WRONG: dict[str, Callable[[Any], Any]] = {
    "step with NaN": lambda env: env.step(spoiled(env, 3)),
    "step of other shape": lambda env: env.step(acting(env, 1)[0][:, :-1]),
    "reset object": lambda env: env.reset(options={"each": [None, None, None, {"object": "moon"}, None]}),
    "reset friction": lambda env: env.reset(options={"each": [None, None, None, None, {"friction": -1.0}]}),
    "recv of none": lambda env: env.recv(0),
    "recv of too many": lambda env: [send(env, 3, [0, 4, 2]), env.recv(4)],
    "recv of less than none": lambda env: env.recv(-1),
    "send to none": lambda env: send(env, 1, [5]),
    "send twice": lambda env: send(env, 2, [4, 4]),
    "send with NaN": lambda env: env.send(spoiled(env, 4)),
    "state of none": lambda env: env.get_state(5),
    "state of less than none": lambda env: env.get_state(-1),
    "state that is damaged": lambda env: env.set_state(4, env.get_state(4)[:-3]),
    "state that is text": lambda env: env.set_state(4, "damaged"),
    "state of other objects": lambda env: env.set_state(4, begun(1, objects="procedural:mug:0").get_state(0)),
    "away, step": lambda env: [send(env, 1, [4]), env.step(acting(env, 1)[0])],
    "away, send": lambda env: [send(env, 1, [4]), send(env, 3, [0, 3, 4])],
    "away, reset": lambda env: [send(env, 1, [4]), env.reset(options={"reset_mask": np.ones(5, dtype=bool)})],
    "away, get_state": lambda env: [send(env, 1, [4]), env.get_state(4)],
    "closed": lambda env: (env.close(), env.reset()),
}
#: Wrong in environments that have not begun.
TOO_EARLY: dict[str, Callable[[Any], Any]] = {
    "step": lambda env: env.step(acting(env, 1)[0]),
    "send": lambda env: send(env, 1, [4]),
    "get_state": lambda env: env.get_state(4),
    "cameras": lambda env: env.cameras(),
    "render": lambda env: env.render(),
    "partial reset": lambda env: env.reset(seed=0, options={"reset_mask": np.arange(5) != 3}),
}
#: Wrong after the end of the episodes of environments 3 and 4, without autoreset.
TOO_LATE: dict[str, Callable[[Any], Any]] = {
    "step": lambda env: env.step(acting(env, 1)[0]),
    "send": lambda env: env.send(acting(env, 1)[0]),
    "send of one": lambda env: send(env, 1, [4]),
}


def half_ended(remote: Any) -> Any:
    env = begun(remote=remote, autoreset_mode="Disabled", max_episode_steps=2)
    env.step(acting(env, 1)[0])
    env.reset(options={"reset_mask": np.arange(5) < 3})
    env.step(acting(env, 1)[0])
    return env


@pytest.mark.parametrize(
    ("table", "made", "name"),
    [
        *((WRONG, lambda remote: begun(remote=remote), name) for name in WRONG),
        *((TOO_EARLY, lambda remote: make(5, remote=remote, render_mode="rgb_array"), name) for name in TOO_EARLY),
        *((TOO_LATE, half_ended, name) for name in TOO_LATE),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_errors_are_those_of_this_process(urls: Urls, table: Any, made: Callable[[Any], Any], name: str) -> None:
    """Class and sentence, whose environments are numbered as the client numbers them."""
    envs = [made(remote) for remote in (None, urls[0], urls)]
    assert len({error_of(partial(table[name], env)) for env in envs}) == 1


@pytest.fixture(scope="module")
def guarded() -> Iterator[EnvironmentServer]:
    offer = {"objects": ("procedural:can", "cans=procedural:can:0-1"), "hands": ("reflex",)}
    with served(token=TOKEN, max_sessions=1, max_envs=3, max_message=1 << 17, **offer) as server:
        yield server


@pytest.fixture
def door(guarded: EnvironmentServer, tmp_path: Path) -> RemoteConfig:
    """Let in, with a token of a file."""
    (tmp_path / "token").write_text(f"{TOKEN}\n")
    until(lambda: sessions(guarded) == 0)
    return RemoteConfig((guarded.url,), token_file=str(tmp_path / "token"))


@pytest.mark.parametrize(
    ("asked", "kind", "sentence"),
    [
        (
            {"objects": "procedural:box:0"},
            errors.ObjectSetError,
            "offer the objects 'procedural:box:0'.*procedural:can",
        ),
        ({"objects": ["cans", "mug.stl"]}, errors.ObjectSetError, "offer the objects 'mug.stl'"),
        ({"objects": Path("/etc")}, errors.ObjectSetError, "offer the objects '/etc'"),
        ({"objects": "procedural:can:0-200000"}, errors.ObjectSetError, "200001 objects"),
        ({"hand": "soft_hand"}, errors.ConfigError, "offer the hand 'soft_hand'.*reflex"),
        ({"hand": load_hand()}, errors.ConfigError, "a hand by its name"),
        ({"num_envs": 4}, errors.ConfigError, "num_envs is 4; this server has 3 of 3 environments left"),
        ({"obs": "rgb", "image_size": 200}, errors.ConfigError, "bytes"),
    ],
)
def test_what_a_server_does_not_offer(door: RemoteConfig, asked: dict[str, Any], kind: Any, sentence: str) -> None:
    """It reports the free number, and another client can use it."""
    with pytest.raises(kind, match=sentence):
        make(**{"remote": door, "objects": "cans", **asked})
    env = make(3, remote=door, objects="cans")
    assert same(rollout(env, 2), rollout(make(3, objects="procedural:can:0-1"), 2))
    env.close()


def test_sessions_are_counted(guarded: EnvironmentServer, door: RemoteConfig) -> None:
    env = make(1, remote=door, objects="cans")
    with pytest.raises(errors.ConfigError, match="all 1 sessions of this server are in use"):
        make(1, remote=door, objects="cans")
    env.close()
    until(lambda: sessions(guarded) == 0)
    make(1, remote=door, objects="cans").close()


GONE: dict[str, Callable[[str], Any]] = {
    "closed": lambda url: make(2, remote=url).close(),
    "collected": lambda url: make(2, remote=url),
    "single, collected": lambda url: make_single(remote=url),
    "another server is not there": lambda url: error_of(partial(make, 4, remote=(url, "ws://127.0.0.1:1"))),
    "a keyword of the client is wrong": lambda url: error_of(partial(make, remote=url, prepare_files=-1)),
}


@pytest.mark.parametrize("way", GONE)
def test_environments_that_are_gone_hold_no_session(way: str) -> None:
    with served() as server:
        GONE[way](server.url)
        until(lambda: sessions(server) == 0)
        assert "graspbox_environments 0\n" in server.metrics()


def test_only_who_knows_the_token_comes_in(
    guarded: EnvironmentServer, door: RemoteConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wrong").write_text(TOKEN[:-1])
    for remote in (guarded.url, replace(door, token_file=str(tmp_path / "wrong"))):
        with pytest.raises(errors.ConfigError, match=rf"{guarded.url} refuses .*401.*token"):
            make(1, remote=remote, objects="cans")
    with pytest.raises(errors.FileError, match="none"):
        make(1, remote=replace(door, token_file=str(tmp_path / "none")), objects="cans")
    monkeypatch.setenv("GRASPBOX_TOKEN", TOKEN)
    make(1, remote=guarded.url, objects="cans").close()
    with pytest.raises(errors.ConfigError, match="at least 16"):
        served(token="short")
