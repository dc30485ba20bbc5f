"""Servers that step the environments."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import environ
from pathlib import Path
from typing import Any, Literal, get_args

from graspbox._common.arguments import shown
from graspbox.errors import ConfigError, FileError

__all__ = ["RemoteConfig", "check_token", "client_token", "remote_config", "token_in"]

#: Environment variable with the token, if nothing else names one.
_VARIABLE = "GRASPBOX_TOKEN"

Depth = Literal["float32", "uint16"]


@dataclass(frozen=True)
class RemoteConfig:
    """Environment servers, for the keyword ``remote``: see ``graspbox serve``.

    Attributes
    ----------
    urls : tuple of str
        Addresses, ``ws://HOST:PORT`` or ``wss://HOST:PORT``. Environments are spread over them and step in parallel.
    token_file : str, optional
        File with the token of the servers; by default the environment variable ``GRASPBOX_TOKEN``, else none.
    ca_file : str, optional
        Certificates to trust besides those of the public authorities, in PEM.
    grace : float
        Seconds for which a server keeps a session whose connection was lost, and the client tries to resume it.
    depth : {"float32", "uint16"}
        Encoding of depth images on the wire. ``uint16`` halves their size and rounds to millimetres.
    shm : bool
        Whether large arrays are sent through shared memory. The servers must run on this machine.
    token_text : str, optional
        The token itself, instead of `token_file`, for tokens made by a program. ``repr`` leaves it out; pickles and
        ``spec.to_json()`` of the environments hold it.
    """

    urls: tuple[str, ...] = ()
    token_file: str | None = None
    ca_file: str | None = None
    grace: float = 60.0
    depth: Depth = "float32"
    shm: bool = False
    token_text: str | None = field(default=None, repr=False)

    def token(self) -> str | None:
        """Read the token: FileError or ConfigError if the file cannot be read, or has no valid token."""
        if self.token_text is not None:
            check_token(self.token_text, "remote.token_text")
            return self.token_text
        return client_token(self.token_file)


def client_token(file: str | Path | None) -> str | None:
    """Find the token of a server: in a file, else in the environment variable ``GRASPBOX_TOKEN``, else None."""
    if file is not None:
        return token_in(file)
    found = environ.get(_VARIABLE) or None
    if found is not None:
        check_token(found, f"the environment variable {_VARIABLE}")
    return found


def token_in(file: str | Path) -> str:
    """Read a token from a file, without the white space around it: FileError or ConfigError if there is none."""
    try:
        found = Path(file).read_bytes().strip().decode("latin-1")
    except OSError as error:
        raise FileError(error.errno, error.strerror, str(file)) from None
    check_token(found, f"the token in {str(file)!r}")
    return found


def check_token(token: str, name: str) -> None:
    """Refuse a token that is not printable ASCII; the ConfigError calls it `name`, and does not repeat it."""
    if not token:
        raise ConfigError(f"{name} is empty; give a token, such as 'openssl rand -base64 24' prints")
    if not (token.isascii() and token.isprintable() and token == token.strip()):
        raise ConfigError(f"{name} has characters that no header can hold; give printable ASCII, on one line")


def _check_types(config: RemoteConfig) -> None:
    """Refuse values of the wrong type early."""
    if isinstance(config.grace, bool) or not isinstance(config.grace, int | float) or not 0 <= config.grace < 1e6:
        raise ConfigError(f"remote.grace is {shown(config.grace)}; give a number of seconds from 0 to 1,000,000")
    if not isinstance(config.shm, bool):
        raise ConfigError(f"remote.shm is {shown(config.shm)}; give True or False")
    for name in ("token_file", "ca_file"):
        value = getattr(config, name)
        if value is not None and not isinstance(value, str | Path):
            raise ConfigError(f"remote.{name} is {shown(value)}; give a path")
    if config.token_text is not None and not isinstance(config.token_text, str):
        raise ConfigError(f"remote.token_text is of the type {type(config.token_text).__name__}; give a text")
    if config.ca_file is not None and not Path(config.ca_file).is_file():
        raise FileError(2, "there is no file of certificates", str(config.ca_file))


def remote_config(remote: Any) -> RemoteConfig | None:
    """Convert the argument of the keyword ``remote``; ConfigError for invalid addresses or fields."""
    if remote is None:
        return None
    if isinstance(remote, str):
        remote = RemoteConfig((remote,))
    elif isinstance(remote, Sequence):
        remote = RemoteConfig(tuple(remote))
    if not isinstance(remote, RemoteConfig):
        raise ConfigError(f"remote is {shown(remote)}; give an address such as 'ws://127.0.0.1:5055', or several")
    if isinstance(remote.urls, str) or not remote.urls or not all(isinstance(url, str) for url in remote.urls):
        raise ConfigError(f"remote.urls is {shown(remote.urls)}; give addresses such as 'ws://127.0.0.1:5055'")
    _check_types(remote)
    if remote.depth not in get_args(Depth):
        choices = ", ".join(map(repr, get_args(Depth)))
        raise ConfigError(f"remote.depth is {shown(remote.depth)}; choose from {choices}")
    return remote
