"""``graspbox serve`` as a process: what it prints, how it ends, who may come in."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError
from graspbox.remote import EnvironmentServer, ServerSettings

TLS = Path(__file__).parents[1] / "fixtures" / "tls"
CAN: dict[str, Any] = {"objects": "procedural:can:0", "num_envs": 2}


@contextmanager
def served(*options: str, command: str = "serve") -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """Run a server in a process of its own; its address."""
    call = [sys.executable, "-m", "graspbox", command, *options, "--port", "0"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            line = process.stdout.readline()
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


def test_running_calls_end_before_the_server_does() -> None:
    """A step of many decisions is under way at SIGTERM; its answer still arrives."""
    with served("--objects", "procedural", "--threads", "1") as (process, url):
        env = gymnasium.make_vec("graspbox/GraspPose-v0", 32, objects="procedural:can:0", remote=url)
        env.reset(seed=0)
        pool = env.unwrapped._core.pool  # type: ignore[attr-defined]
        number = pool.begin("step", {"actions": np.full((32, pool.description["action_space"]["shape"][0]), 0.1, "f4")})
        time.sleep(0.1)
        process.send_signal(signal.SIGTERM)
        assert len(pool.end(number)["now"]["reward"]) == 32
        assert process.wait(timeout=15) == 0


def test_a_second_signal_does_not_wait() -> None:
    with served("--objects", "procedural") as (process, _):
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=15) in (0, 130)


def test_log_lines_are_json_where_asked(tmp_path: Path) -> None:
    with served("--objects", "procedural", "--log", "json", "--idle-timeout", "1") as (process, url):
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote=url, **CAN)
        env.reset(seed=0)
        assert process.stderr is not None
        line = json.loads(process.stderr.readline())
        assert line["level"] == "INFO"
        assert "session" in line["message"]


def test_tls_and_token_let_in_who_belongs(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("a-token-of-some-length\n")
    options = ("--tls-cert", str(TLS / "server.pem"), "--tls-key", str(TLS / "server.key"), "--token-file", str(token))
    with served("--objects", "procedural", *options) as (_, url):
        assert url.startswith("wss://")
        good = RemoteConfig((url,), token_file=str(token), ca_file=str(TLS / "ca.pem"))
        env = gymnasium.make_vec("graspbox/Grasp-v0", remote=good, **CAN)
        assert env.reset(seed=0)[0].shape == (2, 88)
        with pytest.raises(ConfigError, match="401"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=RemoteConfig((url,), ca_file=str(TLS / "ca.pem")), **CAN)
        with pytest.raises(ConnectionLostError, match="certificate"):
            gymnasium.make_vec("graspbox/Grasp-v0", remote=RemoteConfig((url,), token_file=str(token)), **CAN)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"host": "0.0.0.0"}, "write insecure"),
        ({"host": "0.0.0.0", "token": "a-token-of-some-length"}, "write insecure"),
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
    """Clients name what the server calls it; the path stays on the server."""
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
