"""``graspbox evaluate`` with environments or a policy on a server: the same trials as locally, no ignored option."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from command_line import invoke
from graspbox import evaluation, object_sets, policies
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError, FileError, GraspboxError
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings

TLS = Path(__file__).parents[1] / "fixtures" / "tls"
TOKEN = "a-token-of-some-length"
GUARDED: dict[str, Any] = {
    "port": 0,
    "token": TOKEN,
    "tls_cert": TLS / "server.pem",
    "tls_key": TLS / "server.key",
}
TRIALS = ("--trials", "6", "--num-envs", "3", "--seed", "4")


@pytest.fixture(scope="module")
def environments() -> Iterator[str]:
    offer = ServerSettings(objects=("procedural", "tools=procedural:can:0-3"), **GUARDED)
    with EnvironmentServer(offer) as server:
        yield server.url


@pytest.fixture(scope="module")
def policy() -> Iterator[str]:
    with PolicyServer("random", PolicyServerSettings(**GUARDED)) as server:
        yield server.url


@pytest.fixture
def token(tmp_path: Path) -> Path:
    (tmp_path / "token").write_text(f"{TOKEN}\n")
    return tmp_path / "token"


@pytest.fixture
def belongs(token: Path) -> tuple[str, ...]:
    """Options of a client that the servers let in."""
    return ("--token-file", str(token), "--ca-file", str(TLS / "ca.pem"))


def run(*words: str) -> Any:
    """Return the output of ``graspbox evaluate``, without its times."""
    done = invoke(["evaluate", *words, *TRIALS, "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    return {name: value for name, value in found.items() if name != "ms_per_decision"}


def test_environments_on_a_guarded_server(
    environments: str, belongs: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The options for token and certificate were those of a policy alone, and were ignored in silence."""
    words = ("random", "--objects", "procedural:can:0-3")
    local = run(*words)
    assert run(*words, "--remote", environments, *belongs) == local
    monkeypatch.setenv("GRASPBOX_TOKEN", TOKEN)
    assert run(*words, "--remote", environments, *belongs[2:]) == local


def test_a_policy_on_a_guarded_server(
    environments: str, policy: str, belongs: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It names its observations itself; environments may be on another server of the same token."""
    local = run("random", "--objects", "procedural:can:0-3")
    assert run(policy, "--objects", "procedural:can:0-3", *belongs) == local
    assert run(policy, "--objects", "procedural:can:0-3", "--remote", environments, *belongs) == local
    monkeypatch.setenv("GRASPBOX_TOKEN", TOKEN)
    assert run(policy, "--objects", "procedural:can:0-3", *belongs[2:]) == local


def test_sets_that_the_server_alone_knows(environments: str, belongs: tuple[str, ...]) -> None:
    """They were looked up on this machine before the server was asked."""
    found = run("random", "--objects", "tools", "--remote", environments, *belongs)
    assert found == run("random", "--objects", "procedural:can:0-3")
    for more in (("--split", "train"), ("--scale", "0.8")):
        part = run("random", "--objects", "tools", *more, "--remote", environments, *belongs)
        assert part == run("random", "--objects", "procedural:can:0-3", *more)


def test_objects_that_cannot_be_used_are_left_out_there_too(tmp_path: Path) -> None:
    """An error of one object names it over the wire; without that the first of them ended the evaluation."""
    ball = object_sets.load("procedural:ball:0")[0].load()
    corners = [f"v {x} {y} {z}\n" for x, y, z in ball.vertices]
    triangles = [f"f {a} {b} {c}\n" for a, b, c in ball.faces + 1]
    (tmp_path / "ball.obj").write_text("".join(corners + triangles))
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    local = evaluation.evaluate("random", objects=f"dir:{tmp_path}", trials=12)
    assert set(local.refused) == {"flat"}
    with EnvironmentServer(ServerSettings(port=0, objects=(f"tools=dir:{tmp_path}",))) as server:
        for remote in (server.url, RemoteConfig((server.url, server.url))):
            found = evaluation.evaluate("random", objects="tools", trials=12, remote=remote)
            assert found == local
            assert set(found.refused) == {"flat"}
            assert found.objects_given == 2


def test_what_a_policy_learned_from_must_be_known_here() -> None:
    learned = policies.load("random")
    learned.learned_from = ("procedural:can:0-1",)
    with EnvironmentServer(ServerSettings(port=0, objects=("procedural", "tools=procedural:can:0-3"))) as server:
        asked: dict[str, Any] = {"trials": 2, "remote": server.url}
        with pytest.raises(ConfigError, match=r"only the server has .*'tools'.*include_learned=True"):
            evaluation.evaluate(learned, objects="tools", **asked)
        result = evaluation.evaluate(learned, objects="tools", include_learned=True, **asked)
        assert (result.objects_given, result.objects_left_out) == (4, 0)
        result = evaluation.evaluate(learned, objects="procedural:can:0-3", **asked)
        assert (result.objects_given, result.objects_left_out) == (4, 2)
        assert result == evaluation.evaluate(learned, objects="procedural:can:0-3", trials=2)


def test_who_does_not_belong(environments: str, policy: str, belongs: tuple[str, ...]) -> None:
    for words in (("random", "--remote", environments), (policy,)):
        with pytest.raises(ConfigError, match=r"refuses the connection \(401\).*token"):
            run(*words, *belongs[2:])
        with pytest.raises(ConfigError, match="its issuer is unknown; give the issuer's certificate as ca_file"):
            run(*words, *belongs[:2])


WRONG: list[tuple[tuple[str, ...], type[GraspboxError], str]] = [
    (("random", "--token-file", "TOKEN"), ConfigError, "--token-file and --ca-file are for servers"),
    (("random", "--ca-file", "TOKEN"), ConfigError, "--token-file and --ca-file are for servers"),
    (("random", "--obs", "depth"), ConfigError, "--obs, --key and --chunk are for a policy on a server"),
    (("random", "--chunk", "2"), ConfigError, "--obs, --key and --chunk are for a policy on a server"),
    (("random", "--remote", "ws://127.0.0.1:1", "--mass", "2"), ConfigError, "--mass is for meshes of this machine"),
    (("random", "--remote", "ws://127.0.0.1:1", "--token-file", "NONE"), FileError, "No such file.*NONE"),
    (("random", "--remote", "ws://127.0.0.1:1", "--token-file", "BINARY"), ConfigError, "BINARY' has characters"),
    (("random", "--remote", "ws://127.0.0.1:1", "--token-file", "EMPTY"), ConfigError, "EMPTY' is empty"),
    (("random", "--remote", "ws://127.0.0.1:1", "--ca-file", "NONE"), FileError, "NONE"),
    (("ws://127.0.0.1:1", "--token-file", "BINARY"), ConfigError, "BINARY' has characters"),
    (("wss://127.0.0.1:1", "--ca-file", "NONE"), ConnectionLostError, "cannot be reached"),
]


@pytest.mark.parametrize(("words", "kind", "sentence"), WRONG, ids=lambda value: str(value)[:60])
def test_options_that_cannot_be_used(
    tmp_path: Path, token: Path, words: tuple[str, ...], kind: Any, sentence: str
) -> None:
    (tmp_path / "BINARY").write_bytes(bytes(range(256)))
    (tmp_path / "EMPTY").write_text(" \n")
    named = {"TOKEN": str(token), **{name: str(tmp_path / name) for name in ("NONE", "BINARY", "EMPTY")}}
    with pytest.raises(kind, match=sentence):
        run(*(named.get(word, word) for word in words))


def test_a_file_of_certificates_that_cannot_be_used(policy: str, token: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.pem").touch()
    for name, kind, sentence in (
        ("none.pem", FileError, "No such file"),
        ("empty.pem", ConfigError, "no certificate in PEM"),
        ("token", ConfigError, "no certificate in PEM"),
    ):
        with pytest.raises(kind, match=sentence):
            run(policy, "--token-file", str(token), "--ca-file", str(tmp_path / name))


def test_the_options_for_servers_are_explained() -> None:
    done = invoke(["evaluate", "--help"], env={"COLUMNS": "200"})
    text = " ".join(done.output.split())
    assert "token of the servers that are named; by default the variable GRASPBOX_TOKEN" in text
    assert "--ca-file" in text
