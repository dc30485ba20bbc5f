"""Clients that attack a server: it continues, frees their resources, and answers an honest client as before.

A few runs of each attack; ``scripts/attack_server.py`` makes millions, and measures the honest client's round trips.
"""

import contextlib
import ctypes
import json
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hostile_policy
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings
from graspbox.tools.remote.serving import available
from hostile_attacks import ACTION, ATTACKS, CAN, Attack, kill, made
from hostile_policy import POLICY_ATTACKS, grasps, post
from hostile_wire import Peer, frame, http, msgpack

TOKEN = "a-token-of-many-characters"
ROOT = Path(__file__).parents[2]
#: Requests of each attack on a policy.
COUNT = 200


def gauge(metrics: str, name: str) -> int:
    return int(next(line.split()[1] for line in metrics.splitlines() if line.startswith(f"graspbox_{name} ")))


def until(done: Callable[[], bool]) -> None:
    """Wait for a condition in the background; half a minute counts as never."""
    for _ in range(3000):
        if done():
            return
        time.sleep(0.01)
    pytest.fail("it does not happen")


@dataclass
class Honest:
    """A server, and a client that begins before the attacks."""

    server: EnvironmentServer
    peer: Peer
    #: The answer to its steps, without the number: an episode that is set back gives it again.
    state: bytes

    def steps(self) -> Any:
        """Make the same three steps from the same state."""
        assert "error" not in self.peer.call("set_state", env_id=0, state=self.state)
        answers = [self.peer.call("step", actions=np.full((1, ACTION), 0.3, np.float32)) for _ in range(3)]
        return [answer["now"] for answer in answers]


@pytest.fixture(scope="module")
def honest() -> Iterator[Honest]:
    with EnvironmentServer(ServerSettings(port=0, objects=available())) as server, made(server.url) as peer:
        yield Honest(server, peer, peer.call("get_state", env_id=0)["state"])


@pytest.mark.parametrize("name", [*ATTACKS, "clients killed"])
def test_an_attack_leaves_nothing_and_nobody_notices(honest: Honest, name: str) -> None:
    """The honest client gets the same bits, and sessions, environments and connections of the others are gone."""
    before = honest.steps()
    attack: Attack = kill if name == "clients killed" else ATTACKS[name][0]
    count = 6 if name == "clients killed" else 40 if not ATTACKS[name][1] else 1000
    attack(honest.server.url, random.Random(1), count)
    assert honest.steps() == before
    for what in ("sessions", "environments", "connections"):
        until(lambda what=what: gauge(honest.server.metrics(), what) <= 1)  # type: ignore[misc]


def test_a_frame_beyond_the_limit_is_answered_with_the_reason() -> None:
    most = 1 << 16
    policy = PolicyServer("random", PolicyServerSettings(port=0, max_message=most))
    with EnvironmentServer(ServerSettings(port=0, objects=("procedural",), max_message=most)) as server, policy:
        for url in (server.url, policy.url):
            with Peer(url) as peer:
                peer.send(bytes(1 << 17))
                with pytest.raises(ConnectionError, match="more than 65536 bytes; send less, or raise --max-message"):
                    peer.receive()


def test_memory_of_ended_sessions_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was kept for reuse: after a flood of sessions a server held on to three times its memory."""
    monkeypatch.setattr("graspbox.tools.remote.running._TRIM", 0.5)

    def memory() -> float:
        lines = Path("/proc/self/status").read_text().splitlines()
        return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024

    with EnvironmentServer(ServerSettings(port=0, objects=("procedural",))) as server:
        made(server.url).socket.close()
        until(lambda: gauge(server.metrics(), "sessions") == 0)
        # Earlier tests of this process left free memory, which the sessions would use.
        ctypes.CDLL(None).malloc_trim(0)
        before = memory()
        with contextlib.ExitStack() as stack:
            for _ in range(60):
                stack.enter_context(made(server.url, num_envs=16))
            during = memory()
        until(lambda: gauge(server.metrics(), "sessions") == 0)
        assert during > before + 15.0
        until(lambda: memory() < before + 0.25 * (during - before))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"num_envs": 1 << 63}, "num_envs"),
        ({"num_envs": 0}, "num_envs"),
        ({"num_envs": -1}, "num_envs"),
        ({"objects": "/etc/passwd"}, "does not offer the objects"),
        ({"objects": "dir:/"}, "does not offer the objects"),
        ({"objects": ["procedural:can:0", "dir:/"]}, "does not offer the objects"),
        ({"objects": "procedural:mug:0-99999999999"}, "at most"),
        ({"objects": "procedural:mug:0-999999"}, "at most 100000"),
        ({"objects": []}, "is empty"),
        ({"objects": ["procedural:can:0"] * 99_999}, "twice; name each set once"),
        ({"objects": [f"procedural:can:{seed}" for seed in range(100_001)]}, "100001 names"),
        ({"keywords": {"image_size": 10**9}}, "between 16 and 1024 pixels"),
        ({"keywords": {"control_freq": 1 << 63}}, "control_freq"),
        ({"keywords": {"control_freq": 4 * 10**9}}, "control_freq"),
        ({"keywords": {"hand": "/etc/passwd"}}, "does not offer the hand"),
        ({"keywords": {"remote": "ws://127.0.0.1:1"}}, "leave remote"),
        ({"keywords": {"obs": ["rgb"], "image_size": 1024}, "num_envs": 1000}, "make fewer, or with smaller images"),
        ({"keywords": {"x": [[[]]] * 1000}}, "no keyword"),
        ({"keywords": {"y" * 5000: 1}}, "keys of at most 4096 bytes"),
        ({"grace": float("nan")}, "grace is NaN"),
        ({"environment": {}}, "there is no environment"),
    ],
)
def test_what_nobody_may_make(honest: Honest, fields: dict[str, Any], words: str) -> None:
    with Peer(honest.server.url) as peer:
        error = peer.call("make", **{"objects": CAN, **fields})["error"]
    assert words in error["message"]
    assert error["type"] != "InternalError"


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"environment": "graspbox/Moon-v0"}, "environment"),
        ({"environment": []}, "environment"),
        ({"vector": 5}, "vector"),
        ({"num_envs": -3}, "num_envs"),
        ({"num_envs": "x"}, "num_envs"),
        ({"objects": "ycb:moon"}, "objects"),
        ({"objects": []}, "objects"),
        ({"objects": 5}, "objects"),
        ({"keywords": "ab"}, "keywords"),
        ({"keywords": {"moon": 1}}, "moon"),
        ({"keywords": {"m" * 4000: 1}}, "m" * 100),
        ({"keywords": {"remote": "ws://127.0.0.1:1"}}, "remote"),
        ({"keywords": {"render_mode": "human"}}, "render_mode"),
        ({"keywords": {"render_mode": "film"}}, "render_mode"),
        ({"keywords": {"obs": "moon"}}, "obs"),
        ({"keywords": {"obs": ["state", "state"]}}, "obs"),
        ({"keywords": {"obs": "tactile", "hand": "panda_gripper"}}, "obs"),
        ({"keywords": {"control": "think"}}, "control"),
        ({"keywords": {"autoreset_mode": "never"}}, "autoreset_mode"),
        ({"keywords": {"reward": "praise"}}, "reward"),
        ({"keywords": {"reward_weights": {"moon": 1.0}}}, "reward_weights"),
        ({"keywords": {"reward_weights": {"reach": "much"}}}, "reward_weights"),
        ({"keywords": {"randomization": "wild"}}, "randomization"),
        ({"keywords": {"info": "less"}}, "info"),
        ({"keywords": {"cameras": {"moon": 1}}}, "cameras"),
        ({"keywords": {"hand": "nose"}}, "hand"),
        ({"keywords": {"hand": []}}, "hand"),
        ({"keywords": {"split": "half"}}, "split"),
        ({"keywords": {"split": []}}, "split"),
        ({"keywords": {"reward": []}}, "reward"),
        ({"keywords": {"control": []}}, "control"),
        ({"keywords": {"image_size": [1, 2, 3]}}, "image_size"),
        ({"keywords": {"image_size": 8}}, "image_size"),
        ({"keywords": {"physics": {"gravity": -1.0}}}, "physics"),
        ({"keywords": {"max_episode_steps": "x"}}, "max_episode_steps"),
        ({"keywords": {"control_freq": 0}}, "control_freq"),
    ],
)
def test_a_refused_make_names_the_field(honest: Honest, fields: dict[str, Any], field: str) -> None:
    """The entry of the command, or the keyword, for any beginning of the sentence."""
    with Peer(honest.server.url) as peer:
        error = peer.call("make", **{"objects": CAN, **fields})["error"]
    assert error["field"] == field, error
    assert error["type"] in ("ConfigError", "ObjectSetError", "UnknownKeywordError"), error


def test_a_client_is_offered_no_keyword_that_it_may_not_use(honest: Honest) -> None:
    """The choices named `remote`."""
    with Peer(honest.server.url) as peer:
        message = peer.call("make", objects=CAN, keywords={"xyz": 1})["error"]["message"]
    assert "reward_weights" in message
    assert not {"remote", "num_threads", "copy", "prepare_files"} & set(message.replace(",", "").split())


def test_absurd_commands_are_refused_by_name(honest: Honest) -> None:
    many = np.zeros(1 << 20, np.uint8)
    wrong: list[tuple[str, dict[str, Any], str]] = [
        ("render", {"env_ids": many}, "env_ids"),
        ("send", {"env_ids": many, "actions": np.zeros((1, ACTION), np.float32)}, "env_ids"),
        ("reset", {"seed": many}, "seed"),
        ("reset", {"mask": many.astype(np.bool_)}, "mask"),
        ("reset", {"seed": -1}, "seed"),
        ("reset", {"seed": 1.5}, "seed"),
        ("reset", {"seed": [1, 2, 3]}, "seed"),
        ("reset", {"mask": np.ones(3, np.bool_)}, "mask"),
        ("reset", {"options": {"x": float("nan")}}, "options"),
        ("step", {"actions": np.full((1, ACTION), np.nan, np.float32)}, "actions"),
        ("step", {"actions": np.zeros((0, 1 << 40), np.float32)}, "actions"),
        ("get_state", {"env_id": 1 << 63}, "env_id"),
        ("get_state", {"env_id": 5}, "env_id"),
        ("set_state", {"env_id": 5, "state": b""}, "env_id"),
        ("observe", {"z" * 100_000: 1}, "z" * 40),
    ]
    for command, fields, field in wrong:
        error = honest.peer.call(command, **fields)["error"]
        assert (error["field"], error["type"]) == (field, "ConfigError"), error
        assert len(error["message"]) < 1000


def test_a_client_that_takes_up_another_session_leaves_its_own() -> None:
    """Sessions whose client had taken up another one were left for an hour: a resume must end the session of before."""
    with EnvironmentServer(ServerSettings(port=0, objects=("procedural",))) as server, Peer(server.url) as first:
        ticket = first.call("make", objects=CAN, grace=5.0)
        with made(server.url, reset=False, num_envs=7) as peer:
            answer = peer.call("resume", session=ticket["session"], secret=ticket["secret"], received=2)
            assert answer["received"] == 2
            until(lambda: gauge(server.metrics(), "environments") == 1)
            assert gauge(server.metrics(), "sessions") == 1


def test_who_is_not_let_in() -> None:
    settings = ServerSettings(port=0, objects=("procedural",), token=TOKEN, origins=("http://page.example",))
    with EnvironmentServer(settings) as server:
        right = f"Authorization: Bearer {TOKEN}"
        cases: list[tuple[tuple[str, ...], int]] = [
            ((right,), 101),
            ((right, "Origin: http://page.example"), 101),
            ((f"Sec-WebSocket-Protocol: graspbox, graspbox.token.{TOKEN}",), 101),
            ((), 401),
            ((f"Authorization: Bearer {TOKEN}x",), 401),
            ((f"Authorization: Bearer {TOKEN[:-1]}",), 401),
            ((f"Authorization: Basic {TOKEN}",), 401),
            (("Authorization: Bearer ",), 401),
            (("Authorization: Bearer \xe9\xff",), 401),
            ((right, "Origin: http://elsewhere.example"), 403),
            ((right, "Origin: null"), 403),
            ((right, "Origin: http://page.example.elsewhere.example"), 403),
            ((right, "Origin: \xff"), 403),
        ]
        for headers, status in cases:
            with Peer(server.url, headers, hello=False) as peer:
                assert peer.status == status, headers
        assert b" 401 " in http(server.url, "GET /metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")


@pytest.fixture(scope="module")
def policy() -> Iterator[PolicyServer]:
    pytest.importorskip("onnxruntime", reason="the policy is a network, from the extra 'onnx'")
    with PolicyServer(ROOT / "policies/depth", PolicyServerSettings(port=0)) as server:
        yield server


@pytest.mark.parametrize("name", POLICY_ATTACKS)
def test_an_attack_on_a_policy_leaves_it_deciding(policy: PolicyServer, name: str) -> None:
    url = policy.url
    before = post(url, json.dumps(grasps(random.Random(0))).encode())
    assert b"rises above the table" in before
    POLICY_ATTACKS[name][0](url, random.Random(1), 20 if name == "gone before the answer" else COUNT)

    def answers() -> bool:
        found = post(url, json.dumps(grasps(random.Random(0))).encode())
        return found.rpartition(b"\r\n\r\n")[2] == before.rpartition(b"\r\n\r\n")[2]

    until(answers)
    until(lambda: gauge(policy.metrics(), "sessions") == 0)


def test_requests_for_grasps_hold_every_absurd_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most of them were never sent: their number in the list grew with the number of requests, too slowly."""
    sent: list[dict[str, Any]] = []

    def collect(url: str, body: bytes) -> bytes:
        sent.append(json.loads(body))
        return b""

    monkeypatch.setattr(hostile_policy, "post", collect)
    POLICY_ATTACKS["hostile requests for grasps"][0]("ws://127.0.0.1:1", random.Random(1), COUNT)
    plain = grasps(random.Random(0))
    changed = [{name: one[name] for name in one if one[name] != plain.get(name)} for one in sent]
    texts = {json.dumps(value) for one in changed for value in one.values()} | {
        json.dumps(one["count"]) for one in sent
    }
    for values in (hostile_policy._DEPTHS, hostile_policy._VALUES, hostile_policy._EARLIERS):
        assert [value for value in values if json.dumps(value) not in texts] == []
    assert set(hostile_policy._NAMES) <= {name for one in changed for name in one}


def test_a_shape_beyond_memory_ends_no_decider(policy: PolicyServer) -> None:
    """Such an array is one that numpy cannot make; each frame with one ended a thread that decides."""
    huge = {"__ndarray__": True, "dtype": "<f4", "shape": [0, 1 << 62], "data": b""}
    with Peer(policy.url) as peer:
        for _ in range(4):
            peer.socket.sendall(frame(msgpack({"depth": huge})))
            assert b"bytes of data" in peer.receive()
