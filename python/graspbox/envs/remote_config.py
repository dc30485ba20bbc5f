"""Which servers step the environments, and what happens when one of them cannot be reached."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import environ
from pathlib import Path
from typing import Any, Literal, get_args

from graspbox.arguments import natural, shown
from graspbox.errors import ConfigError, FileError

__all__ = ["RemoteConfig", "remote_config"]

Depth = Literal["float32", "uint16"]
Reconnect = Literal["resume", "restore"]


@dataclass(frozen=True)
class RemoteConfig:
    """Servers of environments, for the keyword ``remote``: see ``graspbox serve``.

    Attributes
    ----------
    urls : tuple of str
        Addresses, ``ws://HOST:PORT`` or ``wss://HOST:PORT``. Environments are spread over them, and stepped at once.
    token_file : str, optional
        File with the token of the servers; by default the environment variable ``GRASPBOX_TOKEN``, else none.
    ca_file : str, optional
        Certificates to trust beside those of the public authorities, in PEM.
    grace : float
        Seconds for which a server keeps a session whose connection was lost, and the client tries to take it up again.
    reconnect : {"resume", "restore"}
        What follows where that fails. ``resume``: an error. ``restore``: the environments go on on another of the
        servers, from states that are saved every `checkpoint` steps; the steps since then are repeated. Results are the
        same.
    checkpoint : int
        Steps between two saved states, with ``reconnect="restore"``.
    depth : {"float32", "uint16"}
        How depth images travel. ``uint16`` halves them and rounds to millimetres.
    shm : bool
        Whether large arrays travel through shared memory. The servers must run on this machine.
    token_text : str, optional
        The token itself, instead of `token_file`, where a program made it. ``repr`` leaves it out; pickles and
        ``spec.to_json()`` of the environments hold it.
    """

    urls: tuple[str, ...] = ()
    token_file: str | None = None
    ca_file: str | None = None
    grace: float = 60.0
    reconnect: Reconnect = "resume"
    checkpoint: int = 50
    depth: Depth = "float32"
    shm: bool = False
    token_text: str | None = field(default=None, repr=False)

    def token(self) -> str | None:
        """Read the token.

        Raises
        ------
        FileError
            If the file cannot be read.
        """
        if self.token_text is not None:
            return self.token_text
        if self.token_file is None:
            return environ.get("GRASPBOX_TOKEN")
        try:
            return Path(self.token_file).read_text().strip()
        except OSError as error:
            raise FileError(error.errno, error.strerror, str(self.token_file)) from None


def _check_types(config: RemoteConfig) -> None:
    """Refuse values of other types, which would be found out late."""
    if isinstance(config.grace, bool) or not isinstance(config.grace, int | float) or not 0 <= config.grace < 1e6:
        raise ConfigError(f"remote.grace is {shown(config.grace)}; give a number of seconds from 0 to 1,000,000")
    if natural(config.checkpoint, "remote.checkpoint") < 1:
        raise ConfigError("remote.checkpoint is 0; give 1 or more")
    if not isinstance(config.shm, bool):
        raise ConfigError(f"remote.shm is {shown(config.shm)}; give True or False")
    for name in ("token_file", "ca_file"):
        value = getattr(config, name)
        if value is not None and not isinstance(value, str | Path):
            raise ConfigError(f"remote.{name} is {shown(value)}; give a path")
    if config.ca_file is not None and not Path(config.ca_file).is_file():
        raise FileError(2, "there is no file of certificates", str(config.ca_file))


def remote_config(given: Any) -> RemoteConfig | None:
    """Take what the keyword ``remote`` was given.

    Raises
    ------
    ConfigError
        For anything but None, an address, a sequence of addresses, or a `RemoteConfig` with valid fields.
    """
    if given is None:
        return None
    if isinstance(given, str):
        given = RemoteConfig((given,))
    elif isinstance(given, Sequence):
        given = RemoteConfig(tuple(given))
    if not isinstance(given, RemoteConfig):
        raise ConfigError(f"remote is {shown(given)}; give an address such as 'ws://127.0.0.1:5055', or several")
    if isinstance(given.urls, str) or not given.urls or not all(isinstance(url, str) for url in given.urls):
        raise ConfigError(f"remote.urls is {shown(given.urls)}; give addresses such as 'ws://127.0.0.1:5055'")
    _check_types(given)
    for name, kind in (("depth", Depth), ("reconnect", Reconnect)):
        if getattr(given, name) not in get_args(kind):
            choices = ", ".join(map(repr, get_args(kind)))
            raise ConfigError(f"remote.{name} is {shown(getattr(given, name))}; choose from {choices}")
    return given
