"""Settings of servers and clients: values of wrong types, and files that cannot be used, are refused by name."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from graspbox import _core
from graspbox.cli import typer_app
from graspbox.envs.remote_config import RemoteConfig, remote_config
from graspbox.errors import ConfigError, FileError, GraspboxError, ObjectSetError
from graspbox.remote import EnvironmentServer, ServerSettings
from graspbox.remote.policy_serving import PolicyServer, PolicyServerSettings

TLS = Path(__file__).parents[1] / "fixtures" / "tls"

WRONG: list[tuple[dict[str, Any], str]] = [
    ({"host": 5}, "host is 5"),
    ({"port": "5055"}, "port is '5055'"),
    ({"port": None}, "port is None"),
    ({"port": 70_000}, "port"),
    ({"token": 5}, "token is of the type int; give a text"),
    ({"token": b"a-secret-of-some-length"}, "token is of the type bytes"),
    ({"token": "a-token-of-some\nlength"}, "token has characters that no header can hold"),
    ({"token": "ein-ungewöhnliches-Token"}, "token has characters that no header can hold"),
    ({"token": " a-token-of-some-length"}, "token has characters that no header can hold"),
    ({"token": ""}, "token is empty"),
    ({"objects": "procedural"}, "objects is 'procedural' .*; give a sequence of texts"),
    ({"objects": (5,)}, "objects is "),
    ({"objects": ()}, "objects is empty"),
    ({"objects": ("=procedural",)}, "NAME=SET"),
    ({"hands": "reflex"}, "hands is 'reflex'"),
    ({"hands": ()}, "hands is empty"),
    ({"origins": "http://x"}, "origins is 'http://x'"),
    ({"insecure": "yes"}, "insecure is 'yes' .*; give True or False"),
    ({"tls_cert": 5}, "tls_cert is 5"),
    ({"threads": 0}, "num_threads is 0"),
    ({"threads": "all"}, "threads is 'all'"),
    ({"threads": 1.5}, "threads is 1.5"),
    ({"max_envs": -1}, "max_envs is -1"),
    ({"max_sessions": 0}, "max_sessions. is 0"),
    ({"max_message": None}, "max_message is None"),
    ({"idle_timeout": float("nan")}, "^idle_timeout is nan"),
    ({"idle_timeout": "long"}, "idle_timeout is 'long'"),
    ({"max_grace": True}, "max_grace is True"),
]


@pytest.mark.parametrize(("settings", "sentence"), WRONG, ids=lambda value: str(value)[:50])
def test_settings_are_refused_by_name(settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises((ConfigError, ObjectSetError), match=sentence) as found:
        EnvironmentServer(ServerSettings(**{"port": 0, **settings}))
    assert "secret" not in str(found.value)
    if next(iter(settings)) in PolicyServerSettings.__dataclass_fields__:
        with pytest.raises(ConfigError, match=sentence):
            PolicyServer("random", PolicyServerSettings(**{"port": 0, **settings}))


@pytest.mark.parametrize("token", ["two\nlines", "ünïcode", "\0", ""])
def test_tokens_that_no_header_can_hold(token: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The client took the address for wrong."""
    with pytest.raises(ConfigError, match=r"remote\.token_text (has characters that no header|is empty)"):
        RemoteConfig(("ws://127.0.0.1:1",), token_text=token).token()
    if token and "\0" not in token:
        monkeypatch.setenv("GRASPBOX_TOKEN", token)
        with pytest.raises(ConfigError, match="GRASPBOX_TOKEN has characters that no header can hold"):
            RemoteConfig(("ws://127.0.0.1:1",)).token()
    if token:
        with pytest.raises(ConfigError, match=r"the token for ws://127\.0\.0\.1:1 has characters"):
            _core.PolicyClient("ws://127.0.0.1:1", token=token, ca=None)


@pytest.mark.parametrize("wrong", [5, b"a-secret-of-some-length"])
def test_a_token_that_is_no_text(wrong: Any) -> None:
    with pytest.raises(ConfigError, match=r"remote\.token_text is of the type (int|bytes); give a text"):
        remote_config(RemoteConfig(("ws://127.0.0.1:1",), token_text=wrong))


CALLS: list[tuple[tuple[str, ...], type[GraspboxError], str]] = [
    (("--max-envs", "0"), ConfigError, "^--max-envs is 0"),
    (("--idle-timeout", "nan"), ConfigError, "^--idle-timeout is nan"),
    (("--max-message", "5"), ConfigError, "^--max-message is 5"),
    (("--host", "0.0.0.0"), ConfigError, "^--host is '0.0.0.0'.*--tls-cert.*--insecure"),
    (("--tls-cert", "CERT"), ConfigError, r"give both .*\(--tls-cert, --tls-key\)"),
    (("--tls-cert", "NONE", "--tls-key", "KEY"), FileError, "No such file or directory: .*NONE"),
    (("--tls-cert", "CERT", "--tls-key", "NONE"), FileError, "No such file or directory: .*NONE"),
    (("--tls-cert", "EMPTY", "--tls-key", "KEY"), ConfigError, "EMPTY: it holds no certificate in PEM$"),
    (("--tls-cert", "CERT", "--tls-key", "EMPTY"), ConfigError, "EMPTY: it holds no private key in PEM"),
    (("--tls-cert", "KEY", "--tls-key", "CERT"), ConfigError, "key: it holds no certificate in PEM"),
    (("--tls-cert", "OTHER", "--tls-key", "KEY"), ConfigError, "it cannot be used with .*server.key"),
    (("--token-file", "NONE"), FileError, "No such file or directory: .*NONE"),
    (("--token-file", "EMPTY"), ConfigError, "EMPTY' is empty"),
    (("--token-file", "BINARY"), ConfigError, "BINARY' has characters that no header can hold"),
    (("--token-file", "SHORT"), ConfigError, "the token has 5 characters; give at least 16"),
]


@pytest.fixture
def log_as_before() -> Iterator[None]:
    """Take back the handler of the command's log, whose stream ends with the test."""
    logger = logging.getLogger("graspbox")
    handlers, level = list(logger.handlers), logger.level
    yield
    logger.handlers, logger.level = handlers, level


@pytest.mark.usefixtures("log_as_before")
@pytest.mark.parametrize("command", [("serve", "--objects", "procedural"), ("serve-policy", "random")], ids=" ".join)
@pytest.mark.parametrize(("words", "kind", "sentence"), CALLS, ids=lambda value: str(value)[:50])
def test_options_are_refused_by_name(
    tmp_path: Path, command: tuple[str, ...], words: tuple[str, ...], kind: type[GraspboxError], sentence: str
) -> None:
    if command[0] == "serve-policy" and words[0] in ("--max-envs", "--idle-timeout"):
        pytest.skip("an option of environments alone")
    files = {"CERT": str(TLS / "server.pem"), "KEY": str(TLS / "server.key"), "OTHER": str(TLS / "ca.pem")}
    for name, content in {"EMPTY": b"", "BINARY": bytes(range(256)), "SHORT": b"short\n"}.items():
        (tmp_path / name).write_bytes(content)
    files |= {name: str(tmp_path / name) for name in ("NONE", "EMPTY", "BINARY", "SHORT")}
    given = [*command, *(files.get(word, word) for word in words), "--port", "0"]
    with pytest.raises(kind, match=sentence):
        CliRunner().invoke(typer_app, given, catch_exceptions=False)
