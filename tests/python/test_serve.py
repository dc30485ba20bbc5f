"""``graspbox serve`` as a process: output, exit status, access control."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import typer

import graspbox
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError
from graspbox.tools.commands.serve import serve_until_stopped
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from hostile_wire import Peer
from test_remote_sessions import until

TLS = Path(__file__).parents[1] / "fixtures" / "tls"
CAN: dict[str, Any] = {"objects": "procedural:can:0", "num_envs": 2}


@contextmanager
def served(
    *options: str, command: str = "serve", printed: list[str] | None = None
) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """Run a server in a process of its own; its address. Its first line is appended to `printed`."""
    call = [sys.executable, "-m", "graspbox", command, *options, "--port", "0"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            line = process.stdout.readline()
            if printed is not None:
                printed.append(line)
            found = re.search(r"wss?://\S+?:\d+", line)
            if found is None:
                raise AssertionError(line + process.stderr.read())
            yield process, found[0]
        finally:
            process.kill()


def get(url: str, path: str, token: str | None = None) -> tuple[int, str]:
    """Status and body of a page of a server."""
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    request = urllib.request.Request(url.replace("ws", "http", 1) + path, headers=headers)
    try:
        with urllib.request.urlopen(request) as response:
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_a_killed_server_is_told_at_once() -> None:
    """The client was silent for the grace of its session, a minute by default."""
    with served("--objects", "procedural", "--threads", "1") as (process, url):
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote={"urls": (url,), "grace": 600.0}, **CAN)
        env.reset(seed=0)
        process.kill()
        process.wait()
    # A warning is an error here, so that the step ends long before its grace.
    with pytest.raises(RuntimeWarning, match=rf"connection to {url} was lost at \S+; trying again for 600 s"):
        env.step(env.action_space.sample())
    env.close()


def test_a_server_prints_where_it_is_and_ends_at_sigterm() -> None:
    with served("--objects", "procedural", "--threads", "1") as (process, url):
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote=url, **CAN)
        env.reset(seed=0)
        assert get(url, "/healthz") == (200, "OK\n")
        status, text = get(url, "/metrics")
        assert status == 200
        assert "graspbox_environments 2\n" in text
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=15) == 0
        with pytest.raises(ConnectionLostError, match=re.escape(url)):
            env.step(np.zeros(env.action_space.shape, dtype=np.float32))


def decisions(url: str, count: int) -> Any:
    """Environments whose next step takes a while: each step of one is a whole grasp."""
    env: Any = gymnasium.make_vec("graspbox/GraspPose-v0", count, objects="procedural:can:0", remote=url)
    env.reset(seed=0)
    return env


def acting(env: Any) -> Any:
    """Grasps in the middle of the table, each of which takes a twentieth of a second."""
    actions = np.zeros(env.action_space.shape, dtype=np.float32)
    actions[:, [2, 3, 7]] = [-0.3, 1.0, -1.0]
    return actions


def test_running_calls_end_before_the_server_does() -> None:
    """A step of many decisions is under way at SIGTERM; its answer still arrives."""
    with served("--objects", "procedural", "--threads", "1") as (process, url):
        env = decisions(url, 16)
        pool = env.unwrapped._core.pool
        number = pool.begin("step", {"actions": acting(env)})
        time.sleep(0.1)
        process.send_signal(signal.SIGTERM)
        assert len(pool.end(number)["now"]["reward"]) == 16
        assert process.wait(timeout=15) == 0


def test_environments_that_step_in_the_background_are_running() -> None:
    """SIGTERM ended a server whose environments had been sent, since no command ran."""
    with served("--objects", "procedural", "--threads", "1") as (process, url):
        env = decisions(url, 16)
        env.send(acting(env))
        process.send_signal(signal.SIGTERM)
        until(lambda: get(url, "/healthz")[0] == 503)
        assert sorted(env.recv()[-1]["env_id"].tolist()) == list(range(16))
        assert process.wait(timeout=15) == 0


def test_environments_that_are_asked_for_are_made() -> None:
    """A `make` that waits for the threads that make environments is answered after SIGTERM; a new one is refused."""
    with served("--objects", "procedural") as (process, url), ExitStack() as stack:
        late, *peers = (stack.enter_context(Peer(url)) for _ in range(5))
        numbers = [peer.submit("make", objects="procedural:can:0-4000") for peer in peers]
        time.sleep(0.1)
        process.send_signal(signal.SIGTERM)
        until(lambda: get(url, "/healthz")[0] == 503)
        assert "this server is stopping" in late.call("make", objects="procedural:can:0")["error"]["message"]
        for peer, number in zip(peers, numbers, strict=True):
            assert peer.answer(number)["description"]["objects"] == 4001
        assert process.wait(timeout=15) == 0


def test_a_second_signal_does_not_wait() -> None:
    """A step is under way that takes longer than the ten seconds that the first signal gives it."""
    with served("--objects", "procedural", "--threads", "1") as (process, url):
        env = decisions(url, 1024)
        pool = env.unwrapped._core.pool
        number = pool.begin("step", {"actions": acting(env)})
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        until(lambda: get(url, "/healthz")[0] == 503)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
        with pytest.raises(ConnectionLostError):
            pool.end(number)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_is_heard_as_soon_as_the_address_is_printed(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A supervisor may stop a server as soon as it reads the address; that would end this process."""
    before = {one: signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT)}
    monkeypatch.setattr(typer, "echo", lambda _: os.kill(os.getpid(), number))
    server = EnvironmentServer(ServerSettings(port=0))
    try:
        serve_until_stopped(server, f"serving at {server.url}")
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    with pytest.raises(ConnectionLostError):
        gymnasium.make_vec("graspbox/Grasp-v0", remote=server.url, **CAN)


def test_the_log_tells_who_came_and_went() -> None:
    """From the start to the end, one JSON object per line; of a flood of refusals a few lines."""
    with served("--objects", "procedural", "--log", "json", "--max-envs", "2") as (process, url):
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote=url, **CAN)
        with pytest.raises(ConfigError, match="0 of 2 environments left"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=url, **CAN)
        for _ in range(50):
            request = urllib.request.Request(f"{url.replace('ws', 'http', 1)}/metrics", headers={"Origin": "http://x"})
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(request)
        env.close()
        until(lambda: "graspbox_sessions 0\n" in get(url, "/metrics")[1])
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=15) == 0
        assert process.stderr is not None
        lines = [json.loads(line) for line in process.stderr]
    assert all(datetime.fromisoformat(line["time"]).tzinfo is not None for line in lines)
    for level, words in (
        ("INFO", r"session \d+ begins, of 127.0.0.1:\d+: 2 environments"),
        ("WARNING", r"127.0.0.1:\d+ is refused: it asks for more environments than are left"),
        ("WARNING", r"127.0.0.1:\d+ is refused: a browser page of its origin"),
        ("INFO", r"session \d+ ends: its client has closed it"),
        ("INFO", "stopping: running calls have 10 s to end"),
        ("INFO", "stopped"),
    ):
        assert any(line["level"] == level and re.match(words, line["message"]) for line in lines), words
    assert len(lines) < 25


def test_the_certificates_of_the_guide(tmp_path: Path) -> None:
    """Its commands make files with which a server and a client understand each other."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl")
    guide = (Path(__file__).parents[2] / "docs/guides/servers.md").read_text()
    (commands,) = re.findall(r"```\n(openssl req -x509.*?)```", guide, flags=re.DOTALL)
    subprocess.run(["sh", "-ec", commands], cwd=tmp_path, check=True, capture_output=True)
    (tmp_path / "token").write_text("a-token-of-some-length\n")
    files = [f"--{name}={tmp_path / file}" for name, file in (("tls-cert", "server.pem"), ("tls-key", "server.key"))]
    with served("--objects", "procedural", f"--token-file={tmp_path / 'token'}", *files) as (_, url):
        trusted = RemoteConfig((url,), token_file=str(tmp_path / "token"), ca_file=str(tmp_path / "ca.pem"))
        gymnasium.make_vec("graspbox/Grasp-v0", remote=trusted, **CAN).close()
        with pytest.raises(ConfigError, match="its issuer is unknown"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=replace(trusted, ca_file=None), **CAN)


def test_the_counters_are_open_metrics() -> None:
    """Prometheus reads the format that the header names; they require the token."""
    with EnvironmentServer(ServerSettings(port=0, token="a-token-of-some-length")) as server:
        url = f"{server.url.replace('ws', 'http', 1)}/metrics"
        request = urllib.request.Request(url, headers={"Authorization": "Bearer a-token-of-some-length"})
        with urllib.request.urlopen(request) as response:
            kind, text = response.headers["Content-Type"], response.read().decode()
        assert kind == "application/openmetrics-text; version=1.0.0; charset=utf-8"
        assert text.endswith("# EOF\n")
        assert get(server.url, "/metrics")[0] == 401


def test_tls_and_token_let_in_who_belongs(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("a-token-of-some-length\n")
    options = ("--tls-cert", str(TLS / "server.pem"), "--tls-key", str(TLS / "server.key"), "--token-file", str(token))
    with served("--objects", "procedural", *options) as (_, url):
        assert url.startswith("wss://")
        good = RemoteConfig((url,), token_file=str(token), ca_file=str(TLS / "ca.pem"))
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote=good, **CAN)
        assert env.reset(seed=0)[0].shape == (2, 86)
        with pytest.raises(ConfigError, match="401"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=RemoteConfig((url,), ca_file=str(TLS / "ca.pem")), **CAN)
        with pytest.raises(ConfigError, match="its issuer is unknown; give the issuer's certificate as ca_file"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=RemoteConfig((url,), token_file=str(token)), **CAN)
        with pytest.raises(ConnectionLostError, match="try wss:// instead of ws://"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=url.replace("wss", "ws"), **CAN)


def test_a_wrong_scheme_or_path_is_named() -> None:
    with EnvironmentServer(ServerSettings(port=0, objects=("procedural",))) as server:
        with pytest.raises(ConnectionLostError, match="try ws:// instead of wss://"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=server.url.replace("ws", "wss"), **CAN)
        with pytest.raises(ConfigError, match=r"404.*give only ws://HOST:PORT"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=f"{server.url}/moon", **CAN)


def test_a_frame_beyond_the_limit_is_refused_and_the_session_goes_on() -> None:
    """The connection was lost and taken up again with the same frame, without end."""
    with EnvironmentServer(ServerSettings(port=0, objects=("procedural",), max_message=1 << 16)) as server:
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote=RemoteConfig((server.url,), grace=2.0), **CAN)
        env.reset(seed=0)
        with pytest.raises(ConfigError, match=r"bytes is larger than the 65536 that .* accepts"):
            env.unwrapped.set_state(0, b"x" * 100_000)  # type: ignore[attr-defined]
        env.step(env.action_space.sample())
        assert "graspbox_sessions 1" in server.metrics()


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"host": "0.0.0.0"}, "insecure=True"),
        ({"host": "0.0.0.0", "token": "a-token-of-some-length"}, "insecure=True"),
        ({"token": "short"}, "at least 16"),
        ({"hands": ("nose",)}, "no hand 'nose'"),
        ({"objects": ("dir:/tmp",)}, "give it a name"),
        ({"tls_cert": str(TLS / "server.pem")}, "give both"),
        ({"tls_cert": str(TLS / "server.key"), "tls_key": str(TLS / "server.key")}, "certificate"),
        ({"max_envs": 0}, "max_envs"),
        ({"host": "no such host", "insecure": True}, "cannot listen"),
    ],
)
def test_settings_that_let_in_strangers_are_refused(settings: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        EnvironmentServer(ServerSettings(**{"port": 0, **settings}))  # type: ignore[arg-type]


def test_pages_of_foreign_origins_are_refused() -> None:
    with EnvironmentServer(ServerSettings(port=0, origins=("http://localhost:8080",))) as server:
        url = server.url.replace("ws", "http", 1)
        for origin, status in (("http://evil.example", 403), ("http://localhost:8080", 200), (url, 200)):
            request = urllib.request.Request(f"{url}/metrics", headers={"Origin": origin})
            try:
                found = urllib.request.urlopen(request).status
            except urllib.error.HTTPError as error:
                found = error.code
            assert found == status, origin


def test_a_folder_of_meshes_is_offered_under_a_name(tmp_path: Path) -> None:
    """Clients use the server's name for it; the path stays on the server."""
    corners = [(0, 0, 0), (0.06, 0, 0), (0, 0.06, 0), (0, 0, 0.06)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    vertices = "".join("v {} {} {}\n".format(*corner) for corner in corners)
    triangles = "".join("f {} {} {}\n".format(*(i + 1 for i in face)) for face in faces)
    (tmp_path / "thing.obj").write_text(vertices + triangles)
    with EnvironmentServer(ServerSettings(port=0, objects=(f"tools=dir:{tmp_path}",))) as server:
        env = gymnasium.make_vec("graspbox/Grasp-v0", 2, objects="tools", remote=server.url)
        assert env.reset(seed=0)[1]["object"].tolist() == ["thing", "thing"]
        with pytest.raises(graspbox.errors.ObjectSetError, match="choose from tools"):
            gymnasium.make_vec("graspbox/Grasp-v0", 2, objects=f"dir:{tmp_path}", remote=server.url)


def test_shared_memory_carries_the_same_bits_and_leaves_nothing() -> None:
    before = set(os.listdir("/dev/shm"))
    with EnvironmentServer(ServerSettings(port=0)) as server:
        keywords: dict[str, Any] = {"objects": "procedural:can:0", "obs": "depth", "image_size": 32}
        remote = RemoteConfig((server.url,), shm=True)
        shared = gymnasium.make_vec("graspbox/Grasp-v0", 3, remote=remote, **keywords)
        local = gymnasium.make_vec("graspbox/Grasp-v0", 3, **keywords)
        np.testing.assert_array_equal(shared.reset(seed=1)[0], local.reset(seed=1)[0])
        assert not {name for name in os.listdir("/dev/shm") if name.startswith("graspbox-")} - before
        for _ in range(3):
            action = local.action_space.sample()
            np.testing.assert_array_equal(shared.step(action)[0], local.step(action)[0])


def test_depth_in_millimetres_is_rounded_and_no_more() -> None:
    with EnvironmentServer(ServerSettings(port=0)) as server:
        keywords: dict[str, Any] = {"objects": "procedural:can:0", "obs": "depth", "image_size": 32}
        remote = RemoteConfig((server.url,), depth="uint16")
        rounded = gymnasium.make_vec("graspbox/Grasp-v0", 2, remote=remote, **keywords).reset(seed=1)[0]
        exact = gymnasium.make_vec("graspbox/Grasp-v0", 2, **keywords).reset(seed=1)[0]
        assert rounded.dtype == exact.dtype
        assert 0 < np.abs(rounded - exact).max() < 0.00051
