"""Settings of servers: types, ranges and exposure are checked before anything listens."""

import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, fields
from ipaddress import ip_address
from pathlib import Path
from typing import Any, get_type_hints

from graspbox import _core
from graspbox._common.arguments import check_range, natural, plain, shown
from graspbox.envs.remote_config import check_token
from graspbox.errors import ConfigError, FileError
from graspbox.hands import Hand

__all__ = ["ListenerSettings", "PolicyServerSettings", "ServerSettings"]

Texts = Sequence[str]
FilePath = str | Path
#: Fields that the core does not have.
_PYTHON = ("insecure", "objects", "hands", "env_id")
#: Fewest characters of a token.
_MIN_TOKEN = 16
#: Least and greatest value of numbers.
_RANGES: dict[str, tuple[float, float]] = {
    "port": (0, 65_535),
    "max_sessions": (1, 10_000),
    "max_message": (65_536, 1_000_000_000),
    "threads": (1, 1024),
    "max_envs": (1, 65_536),
    "idle_timeout": (1.0, 1e6),
    "max_grace": (0.0, 86_400.0),
}
#: An origin as browsers send it, and the ports that they leave out.
_ORIGIN = re.compile(r"([a-z][a-z0-9+.-]*)://([a-z0-9._-]+|\[[0-9a-f:.]+\])(?::([1-9][0-9]*))?")
_LEFT_OUT = {("http", "80"), ("https", "443")}


@dataclass(frozen=True)
class ListenerSettings:
    """Settings of any server.

    Attributes
    ----------
    host, port : str and int
        Address to listen on; port 0 is any free port.
    token : str, optional
        Secret that clients must send: at least 16 characters of printable ASCII.
    tls_cert, tls_key : path, optional
        Certificate chain and private key, PEM files.
    origins : sequence of str
        Origins of browser pages that may connect, such as ``http://localhost:8080``.
    insecure : bool
        Allows an address reachable from other machines without TLS and token.
    max_sessions, max_message : int
        Most sessions, largest message in bytes.
    idle_timeout : float
        Seconds without a command or request after which a session ends.
    threads : int, optional
        Threads that serve clients; by default ``GRASPBOX_THREADS``, else all.
    """

    host: str = "127.0.0.1"
    port: int = 5055
    token: str | None = None
    tls_cert: FilePath | None = None
    tls_key: FilePath | None = None
    origins: Texts = ()
    insecure: bool = False
    max_sessions: int = 256
    max_message: int = 64 << 20
    idle_timeout: float = 3600.0
    threads: int | None = None

    @property
    def num_threads(self) -> int:
        """Number of threads, chosen or by default."""
        return _core.num_threads(self.threads)

    def check(self) -> None:
        """Refuse wrong types and values, unreadable files, and settings that would admit unauthorized clients.

        Raises
        ------
        ConfigError
            The message begins with the name of the field, if it concerns one.
        FileError
            For a file that cannot be read.
        """
        hints = get_type_hints(type(self))
        for field in fields(self):
            _check_type(field.name, getattr(self, field.name), hints[field.name])
            if field.name in _RANGES and getattr(self, field.name) is not None:
                check_range(self, field.name, *_RANGES[field.name])
        for origin in self.origins:
            _check_origin(origin)
        for file in (self.tls_cert, self.tls_key):
            if file is not None:
                _check_file(file)
        if self.token is not None:
            check_token(self.token, "token")
            if len(self.token) < _MIN_TOKEN:
                wanted = f"give at least {_MIN_TOKEN}, such as {secrets.token_urlsafe(24)}"
                raise ConfigError(f"the token has {len(self.token)} characters; {wanted}")
        try:
            local = self.host == "localhost" or ip_address(self.host).is_loopback
        except ValueError:
            local = False
        if not local and not self.insecure and (self.token is None or self.tls_cert is None):
            raise ConfigError(
                f"host is {self.host!r}, which other machines reach; give tls_cert, tls_key and token (--tls-cert, "
                "--tls-key, --token-file), or insecure=True (--insecure) where everybody on that network may use this "
                "server"
            )

    def core_fields(self) -> dict[str, Any]:
        """Return the settings that the core reads."""
        own = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in _PYTHON}
        own |= {"threads": self.num_threads, "origins": list(self.origins)}
        own = {name: str(value) if isinstance(value, Path) else value for name, value in own.items()}
        return {name: plain(value, name) for name, value in own.items()}


@dataclass(frozen=True)
class ServerSettings(ListenerSettings):
    """Settings of an environment server; those of any server are documented in `ListenerSettings`.

    Attributes
    ----------
    objects : sequence of str
        Object sets that clients may name: ``SET`` allows the set and its parts (``procedural`` allows
        ``procedural:mug:0-9``), ``NAME=SET`` offers it under another name, which a path needs.
    hands : sequence of str
        Hands that clients may name.
    max_envs : int
        Most environments of all sessions.
    max_grace : float
        Longest time for which a session waits for a lost client, seconds.
    """

    objects: Texts = ("procedural", "ycb")
    hands: Texts = tuple(Hand.names())
    max_envs: int = 1024
    max_grace: float = 300.0

    def check(self) -> None:
        """As `ListenerSettings.check`; also refuse unknown hands and an empty catalog."""
        super().check()
        for name in ("objects", "hands"):
            if not getattr(self, name):
                raise ConfigError(f"{name} is empty; name those that clients may use")
        for hand in self.hands:
            if hand not in Hand.names():
                raise ConfigError(f"there is no hand {hand!r} to offer; choose from {', '.join(Hand.names())}")


@dataclass(frozen=True)
class PolicyServerSettings(ListenerSettings):
    """Settings of a policy server; those of any server are documented in `ListenerSettings`.

    Attributes
    ----------
    env_id : str, optional
        The environment whose observations clients send; by default the policy's own, else ``graspbox/GraspPose-v0``.
    threads : int
        Concurrent decisions.
    """

    port: int = 8000
    max_sessions: int = 64
    threads: int | None = 2
    env_id: str | None = None


def _check_origin(origin: str) -> None:
    """Refuse an origin that no browser sends: it would never match."""
    match = _ORIGIN.fullmatch(origin)
    if match is None or (match[1], match[3]) in _LEFT_OUT:
        near = _ORIGIN.match(origin.lower() if "://" in origin else f"http://{origin.lower()}")
        hint = "http://localhost:8080"
        if near is not None:
            hint = f"{near[1]}://{near[2]}" + (f":{near[3]}" if near[3] and (near[1], near[3]) not in _LEFT_OUT else "")
        raise ConfigError(f"origins has {origin!r}, which no browser sends; write SCHEME://HOST:PORT, such as {hint!r}")


def _check_file(file: FilePath) -> None:
    try:
        with Path(file).open("rb"):
            return
    except OSError as error:
        raise FileError(error.errno, error.strerror, str(file)) from None


def _check_type(name: str, value: Any, hint: Any) -> None:
    """Refuse a value of another type than a field's."""
    if hint in (int, int | None):
        if value is not None or hint is int:
            natural(value, name)
        return
    if hint == Texts:
        fits = not isinstance(value, str) and isinstance(value, Sequence) and all(isinstance(x, str) for x in value)
    elif hint is float:
        fits = isinstance(value, int | float) and not isinstance(value, bool)
    else:
        fits = isinstance(value, hint)
    if not fits:
        value_shown = f"of the type {type(value).__name__}" if name == "token" else shown(value)
        raise ConfigError(f"{name} is {value_shown}; give {_WANTED[hint]}")


#: Required value in errors, by the annotation of a field.
_WANTED: dict[Any, str] = {
    str: "a text",
    str | None: "a text or None",
    FilePath | None: "a path or None",
    Texts: "a sequence of texts",
    float: "a number",
    bool: "True or False",
}
