"""Settings of servers and clients: values of wrong types, and unusable files, are refused by name."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from command_line import invoke
from graspbox import _core
from graspbox.envs.remote_config import RemoteConfig, remote_config
from graspbox.errors import ConfigError, FileError, GraspboxError, ObjectSetError
from graspbox.tools.remote import EnvironmentServer, ServerSettings
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings

TLS = Path(__file__).parents[1] / "fixtures" / "tls"

WRONG: list[tuple[dict[str, Any], str]] = [
    ({"host": 5}, "host is 5"),
    ({"port": "5055"}, "port is '5055'"),
    ({"port": None}, "port is None"),
    ({"port": 99_999}, "^port is 99999 .*from 0 to 65535"),
    ({"port": -1}, "^port is -1"),
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
    ({"origins": ("foo",)}, "^origins has 'foo', which no browser sends; .* such as 'http://foo'"),
    ({"origins": ("localhost:8080",)}, "^origins has 'localhost:8080', .* such as 'http://localhost:8080'"),
    ({"origins": ("http://localhost:8080/",)}, "^origins has .*8080/', .* such as 'http://localhost:8080'"),
    ({"origins": ("https://page.example:443",)}, "^origins has .* such as 'https://page.example'"),
    ({"origins": ("http://Page.example",)}, "^origins has .* such as 'http://page.example'"),
    ({"origins": ("*",)}, "^origins has .* such as 'http://localhost:8080'"),
    ({"tls_cert": "nope.pem", "tls_key": "nope.key"}, r"^No such file or directory: nope\.pem$"),
    ({"insecure": "yes"}, "insecure is 'yes' .*; give True or False"),
    ({"tls_cert": 5}, "tls_cert is 5"),
    ({"threads": 0}, "^threads is 0 .*from 1 to 1024"),
    ({"threads": "all"}, "threads is 'all'"),
    ({"threads": 1.5}, "threads is 1.5"),
    ({"max_envs": -1}, "max_envs is -1"),
    ({"max_sessions": 0}, "^max_sessions is 0"),
    ({"max_message": 100}, "^max_message is 100 .*from 65536 to"),
    ({"max_message": None}, "max_message is None"),
    ({"idle_timeout": float("nan")}, "^idle_timeout is nan"),
    ({"idle_timeout": "long"}, "idle_timeout is 'long'"),
    ({"max_grace": True}, "max_grace is True"),
    ({"max_grace": -1.0}, "^max_grace is -1.0 .*from 0 to 86400"),
]


@pytest.mark.parametrize(("settings", "sentence"), WRONG, ids=lambda value: str(value)[:50])
def test_settings_are_refused_by_name(settings: dict[str, Any], sentence: str) -> None:
    kinds = ConfigError, FileError, ObjectSetError
    with pytest.raises(kinds, match=sentence) as found:
        EnvironmentServer(ServerSettings(**{"port": 0, **settings}))
    assert "secret" not in str(found.value)
    if "NAME=SET" not in sentence:
        with pytest.raises(kinds, match=sentence):
            ServerSettings(**{"port": 0, **settings}).check()
    if next(iter(settings)) in PolicyServerSettings.__dataclass_fields__:
        with pytest.raises(kinds, match=sentence):
            PolicyServer("random", PolicyServerSettings(**{"port": 0, **settings}))


def test_origins_that_browsers_send() -> None:
    origins = (
        "http://localhost:8080",
        "https://page.example",
        "http://127.0.0.1",
        "http://[::1]:5000",
        "app://obsidian.md",
    )
    ServerSettings(origins=origins).check()


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
    (("--tls-cert", "NONE", "--tls-key", "KEY"), ConfigError, r"^--tls-cert is '\S*NONE', .* \(No such .* in PEM$"),
    (("--tls-cert", "CERT", "--tls-key", "NONE"), ConfigError, r"^--tls-key is '\S*NONE', .* \(No such .* in PEM$"),
    (("--tls-cert", ".", "--tls-key", "KEY"), ConfigError, r"^--tls-cert is '.', .* \(Is a directory\); give a cert"),
    (("--origin", "localhost:8080"), ConfigError, "^--origin has 'localhost:8080', which no browser sends"),
    (("--objects", "bogus"), ConfigError, "^--objects has 'bogus', which names no object set; choose procedural, ycb"),
    (("--objects", "procedual:can"), ConfigError, "^--objects has .*; did you mean 'procedural:can'"),
    (("--objects", "dir:/tmp"), ConfigError, "^--objects has 'dir:/tmp'; clients name no path.*tools=dir:/tmp$"),
    (("--objects", "tools=dir:/nope"), ObjectSetError, "^--objects has 'tools=dir:/nope': .*/nope"),
    (("--objects", "procedural:moon"), ObjectSetError, "^--objects has 'procedural:moon': there is no family 'moon'"),
    (("--tls-cert", "EMPTY", "--tls-key", "KEY"), ConfigError, "EMPTY: it holds no certificate in PEM$"),
    (("--tls-cert", "CERT", "--tls-key", "EMPTY"), ConfigError, "EMPTY: it holds no private key in PEM"),
    (("--tls-cert", "KEY", "--tls-key", "CERT"), ConfigError, "key: it holds no certificate in PEM"),
    (("--tls-cert", "OTHER", "--tls-key", "KEY"), ConfigError, "it cannot be used with .*server.key"),
    (("--token-file", "NONE"), ConfigError, r"^--token-file is '\S*NONE', .* \(No such .*'openssl rand"),
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
    if command[0] == "serve-policy" and words[0] in ("--max-envs", "--idle-timeout", "--objects"):
        pytest.skip("an option of environments alone")
    files = {"CERT": str(TLS / "server.pem"), "KEY": str(TLS / "server.key"), "OTHER": str(TLS / "ca.pem")}
    for name, content in {"EMPTY": b"", "BINARY": bytes(range(256)), "SHORT": b"short\n"}.items():
        (tmp_path / name).write_bytes(content)
    files |= {name: str(tmp_path / name) for name in ("NONE", "EMPTY", "BINARY", "SHORT")}
    given = [*command, *(files.get(word, word) for word in words), "--port", "0"]
    with pytest.raises(kind, match=sentence):
        invoke(given, catch_exceptions=False)
