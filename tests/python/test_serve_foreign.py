"""Clients connected to an unexpected server: an error of one sentence, and no traceback."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from foreign_server import close_frame, foreign, packed, text
from graspbox import _core
from graspbox.errors import ConfigError, ConnectionLostError, GraspboxError
from graspbox.policies import Task
from graspbox.policies.remote_policy import RemotePolicy
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings
from hostile_wire import frame
from test_remote import make

HELLO: dict[str, Any] = {
    "protocol": "graspbox",
    "protocol_version": 1,
    "version": "0.1.0",
    "limits": {"max_grace": 300.0},
}


def test_a_server_of_environments_is_no_server_of_a_policy() -> None:
    with EnvironmentServer(ServerSettings(port=0)) as server:
        with pytest.raises(ConfigError, match=r"is a server of environments; .*'graspbox serve-policy'"):
            RemotePolicy(server.url)
        with pytest.raises(ConfigError, match="is a server of environments"):
            RemotePolicy(server.url, obs="depth")


def test_a_server_of_a_policy_is_no_server_of_environments() -> None:
    with (
        PolicyServer("random", PolicyServerSettings(port=0)) as server,
        pytest.raises(ConfigError, match="is not an environment server; start one with 'graspbox serve'"),
    ):
        make(1, remote=server.url)


METADATA: list[tuple[bytes, str]] = [
    (packed(["a", "list"]), "begins with .*list.*; a server of a policy sends a map"),
    (packed(5), "begins with 5"),
    (packed(None), "begins with None"),
    (packed({"server": "graspbox"}), "does not name its observations"),
    (packed({"server": "graspbox", "observations": 5}), "names observations 5 "),
    (packed({"observations": [5]}), "names observations "),
    (packed({"observations": ["depth"], "environment": 5}), "environment 5 "),
    (packed({"observations": ["depth"], "settings": 5}), "settings 5 "),
    (packed({}), "does not name its observations"),
    (packed({"server": "graspbox", "learned_from": "procedural"}), "learned_from 'procedural'.*at most 1000 names"),
    (packed({"server": "graspbox", "learned_from": [5]}), r"learned_from \[5\]"),
    (packed({"server": "graspbox", "learned_from": ["x"] * 1001}), "learned_from .*at most 1000 names"),
    (packed({"server": "graspbox", "learned_from": ["x" * 1001]}), "learned_from .*of 1000 characters"),
    (packed({"server": "graspbox", "hand": 5}), "the hand 5 "),
    (packed({"server": "graspbox", "hand": "x" * 1001}), "the hand 'xxx"),
    (packed({"server": "graspbox", "confidence": 0.5}), "has confidence 0.5 "),
    (text("no metadata today"), "no metadata today"),
    (frame(b"\xc1", mask=False), "msgpack"),
]


@pytest.mark.parametrize(("first", "sentence"), METADATA, ids=lambda value: str(value)[:40])
def test_first_frames_that_are_no_metadata(first: bytes, sentence: str) -> None:
    with foreign(first) as url, pytest.raises(ConfigError, match=sentence):
        RemotePolicy(url)


ANSWERS: list[tuple[bytes, str]] = [
    (packed({"actions": "x"}), "returns actions as 'x'"),
    (packed({"actions": [[1.0, 2.0], [3.0]]}), "returns actions as "),
    (packed({"actions": {"left": [0.0]}}), "returns actions as {'left'"),
    (packed({"actions": None}), "returns actions of shape|returns actions as"),
    (packed({"actions": np.zeros((1, 3), np.float32)}), r"returns actions of shape \(1, 3\)"),
    (packed({"action": 1}), "it must contain 'actions'"),
    (packed([1]), "it must contain 'actions'"),
    (text(""), "reports an error: it does not name one"),
    (text(" \n "), "reports an error: it does not name one"),
    (text("Traceback\nValueError: two cameras\n"), "reports an error: ValueError: two cameras$"),
    (close_frame(1011, "out of memory"), r"the connection was closed \(1011 out of memory\)"),
    (frame(b"\xc1", mask=False), "msgpack"),
]


@pytest.mark.parametrize(("answer", "sentence"), ANSWERS, ids=lambda value: str(value)[:40])
def test_answers_that_hold_no_actions(answer: bytes, sentence: str) -> None:
    envs = gymnasium.make_vec("graspbox/Grasp-v0", 1, objects="procedural:can:0", obs="proprio")
    observation, _ = envs.reset(seed=0)
    with foreign(packed({"robot": "arm"}), answer) as url:
        policy = RemotePolicy(url, obs="proprio")
        policy.bind(Task.of(envs))
        policy.reset([1])
        with pytest.raises((ConfigError, ConnectionLostError), match=sentence):
            policy.act(observation)


CONFIDENCES: list[tuple[dict[str, Any], str]] = [
    ({}, "states the confidence None"),
    ({"confidence": "much"}, "states the confidence 'much'"),
    ({"confidence": 1.5}, "states the confidence 1.5 .*from 0 to 1"),
    ({"confidence": float("nan")}, "states the confidence nan"),
    ({"confidence": True}, "states the confidence True"),
]


@pytest.mark.parametrize("ours", [True, False], ids=["ours", "foreign"])
@pytest.mark.parametrize(("more", "sentence"), CONFIDENCES, ids=lambda value: str(value)[:40])
def test_confidences_that_are_none(more: dict[str, Any], sentence: str, ours: bool) -> None:
    """A server that is not ours may mean something else by its entries."""
    envs = gymnasium.make_vec("graspbox/Grasp-v0", 1, objects="procedural:can:0", obs="proprio")
    observation, _ = envs.reset(seed=0)
    hello = {"observations": ["proprio"], "confidence": True, **({"server": "graspbox"} if ours else {"hand": 5})}
    with foreign(packed(hello), packed({"actions": np.zeros(8, np.float32), **more})) as url:
        policy = RemotePolicy(url)
        policy.bind(Task.of(envs))
        policy.reset([1])
        if ours:
            with pytest.raises(ConfigError, match=sentence):
                policy.act(observation)
        else:
            policy.act(observation)
            assert policy.confidence(0) is None
            assert policy.learned_from == ()


FIRST: list[tuple[tuple[bytes, ...], str]] = [
    ((packed([1, 2]),), "is not an environment server"),
    ((packed("hello"),), "is not an environment server"),
    ((packed({}),), "is not an environment server"),
    ((packed({"protocol": "graspbox"}),), "speaks version None of the protocol"),
    ((packed({**HELLO, "protocol_version": 2}),), r"version 2 of the protocol \(graspbox 0.1.0\)"),
    ((packed({**HELLO, "limits": None}),), "has no limits"),
    ((packed({**HELLO, "limits": {}}),), "has no limits"),
    ((frame(b"\xc1", mask=False),), "does not speak this protocol"),
    ((text("go away"),), "does not speak this protocol: go away"),
    ((packed(HELLO), packed({"id": 1})), "describes its environments without autoreset"),
    ((packed(HELLO), packed({"id": 1, "description": {"autoreset": "disabled"}})), "without has_files"),
    ((packed(HELLO), packed({"id": 1, "error": 5})), "reports an invalid error"),
    ((packed(HELLO), packed({"id": 1, "error": {"type": "Strange", "message": "x"}})), "of the kind 'Strange': x"),
    ((packed(HELLO), frame(b"\xc1", mask=False)), "does not speak this protocol"),
    ((packed(HELLO), close_frame(4000, "too old")), "is over: too old"),
]


@pytest.mark.parametrize(("frames", "sentence"), FIRST, ids=lambda value: str(value)[-40:])
def test_servers_that_are_not_of_graspbox(frames: tuple[bytes, ...], sentence: str) -> None:
    with foreign(*frames) as url, pytest.raises(GraspboxError, match=sentence):
        make(1, remote=url)


def test_a_first_frame_that_never_comes() -> None:
    with foreign(b"") as url, pytest.raises(ConnectionLostError, match="it sends nothing"):
        _core.PolicyClient(url, token=None, ca=None)
