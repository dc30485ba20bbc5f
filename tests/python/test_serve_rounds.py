"""``graspbox benchmark clutter`` with a policy on a server: the counts of the policy on this machine."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from command_line import invoke
from foreign_server import foreign, packed
from graspbox.errors import ConfigError
from graspbox.evaluation.rounds import clear_rounds
from graspbox.policies import Task, clutter
from graspbox.policies.remote_policy import RemotePolicy
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings

CLEAR = "graspbox/Clear-v0"
TOKEN = "a-token-of-some-length"
GUARDED = PolicyServerSettings(port=0, env_id=CLEAR, token=TOKEN)
ROUNDS = ("--layout", "packed", "--objects-per-scene", "2", "--rounds", "2", "--seed", "0")
CANS = ("--objects", "procedural:can:0-9")


@pytest.fixture(scope="module")
def top_down() -> Iterator[str]:
    with PolicyServer("top_down", GUARDED) as server:
        yield server.url


@pytest.fixture
def token(tmp_path: Path) -> tuple[str, str]:
    (tmp_path / "token").write_text(f"{TOKEN}\n")
    return "--token-file", str(tmp_path / "token")


def run(*words: str, status: int = 0) -> Any:
    """Return what ``graspbox benchmark clutter`` prints, JSON if it succeeds."""
    done = invoke(["benchmark", "clutter", *words, "--json"])
    if status:
        assert isinstance(done.exception, ConfigError), done.output
        return str(done.exception)
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_a_served_policy_has_the_rounds_of_the_policy(top_down: str, token: tuple[str, str]) -> None:
    served = run(top_down, *token, *ROUNDS, *CANS)
    assert served == run("top_down", *ROUNDS, *CANS)
    assert served[0]["attempts"] > 2


def test_a_look_that_finds_nothing_is_told(top_down: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The policy overlooks what is lower than 5 cm."""
    above_table = clutter._above_table
    monkeypatch.setattr(clutter, "_above_table", lambda view: _high(above_table(view)))
    settings: dict[str, Any] = {"objects": "procedural:can:0-9", "layout": "packed", "objects_per_scene": 2}
    served = clear_rounds(RemotePolicy(top_down, token=TOKEN), rounds=4, **settings)
    local = clear_rounds("top_down", rounds=4, **settings)
    assert served.to_json() == local.to_json()
    assert served.no_grasp.tolist() == local.no_grasp.tolist()
    assert 0 < local.no_grasp.sum() < 4
    assert local.attempts.sum() > 0


def _high(points: Any) -> Any:
    return points if points[:, 2].max(initial=0.0) > 0.05 else points[:0]


@pytest.mark.parametrize(
    ("answer", "found"), [({}, False), ({"found_nothing": False}, False), ({"found_nothing": True}, True)]
)
@pytest.mark.parametrize("ours", [True, False], ids=["ours", "foreign"])
def test_what_a_server_tells_of_a_look(answer: dict[str, Any], found: bool, ours: bool) -> None:
    envs = gymnasium.make_vec(CLEAR, 1, objects="procedural:can:0", obs="proprio")
    observation, _ = envs.reset(seed=0)
    hello = {"observations": ["proprio"], **({"server": "graspbox"} if ours else {})}
    with foreign(packed(hello), packed({"actions": np.zeros(10, np.float32), **answer})) as url:
        policy = RemotePolicy(url)
        policy.bind(Task.of(envs))
        policy.reset([1])
        policy.act(observation)
        assert policy.found_nothing(0) == (found and ours)
        policy.reset([2])
        assert not policy.found_nothing(0)


def test_a_wrong_word_about_a_look_is_refused() -> None:
    envs = gymnasium.make_vec(CLEAR, 1, objects="procedural:can:0", obs="proprio")
    observation, _ = envs.reset(seed=0)
    hello = {"observations": ["proprio"], "server": "graspbox"}
    with foreign(packed(hello), packed({"actions": np.zeros(10, np.float32), "found_nothing": "yes"})) as url:
        policy = RemotePolicy(url)
        policy.bind(Task.of(envs))
        policy.reset([1])
        with pytest.raises(ConfigError, match=r"has found_nothing 'yes' \(str\); this is true or false"):
            policy.act(observation)


def test_another_environment_or_camera_than_that_of_the_server(top_down: str, token: tuple[str, str]) -> None:
    """A policy that is served for single objects looked once in a round, and then gave zeros."""
    with PolicyServer("top_down", PolicyServerSettings(port=0)) as server:
        message = run(server.url, *ROUNDS, *CANS, status=1)
    assert "takes observations of 'graspbox/GraspPose-v0', not of 'graspbox/Clear-v0'; start it with" in message
    message = run(top_down, *token, *ROUNDS, *CANS, "--camera", "overhead", status=1)
    assert "cameras is not that of the policy 'top_down'" in message
    assert "leave out cameras (--camera" in message


def test_options_of_servers_need_one(tmp_path: Path) -> None:
    assert "--obs, --key and --chunk are for a policy on a server" in run("top_down", "--chunk", "2", status=1)
    assert "--token-file and --ca-file are for servers" in run("top_down", "--ca-file", str(tmp_path), status=1)
    assert "--key is ['depth']; write it as" in run("ws://127.0.0.1:9", "--key", "depth", status=1)
