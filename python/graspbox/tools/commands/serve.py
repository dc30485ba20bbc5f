"""``graspbox serve``: environments for other machines."""

import json
import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Literal

import typer

from graspbox.envs.remote_config import token_in
from graspbox.errors import ConfigError, ObjectSetError
from graspbox.hands import Hand
from graspbox.tools.remote.running import DRAIN, RunningServer
from graspbox.tools.remote.serving import EnvironmentServer, available
from graspbox.tools.remote.settings import ListenerSettings, ServerSettings

_log = logging.getLogger(__name__)
_DEFAULTS = ServerSettings()
#: Options whose names are not those of fields.
_OPTIONS = {"origins": "origin"}

Host = Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0 for all of this machine.")]
TlsCert = Annotated[str | None, typer.Option(help="Certificate chain, a PEM file.")]
TlsKey = Annotated[str | None, typer.Option(help="Private key of the certificate, a PEM file.")]
TokenFile = Annotated[Path | None, typer.Option(help="File with the token that clients must send.")]
Origins = Annotated[
    list[str] | None,
    typer.Option("--origin", help="Origin of a browser page that may connect: http://localhost:8080; repeatable."),
]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Listen beyond this machine without TLS and token: anyone may connect.")
]
MaxMessage = Annotated[int, typer.Option(help="Largest message in either direction, bytes.")]
IdleTimeout = Annotated[
    float, typer.Option(help="Seconds without a command or request after which a client's session ends.")
]
Log = Annotated[Literal["text", "json"], typer.Option(help="Format of log lines on standard error.")]


class _TextLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return f"{_time_of(record)} {record.levelname} {super().format(record)}"


class _JsonLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return json.dumps({"time": _time_of(record), "level": record.levelname, "message": record.getMessage()})


def _time_of(record: logging.LogRecord) -> str:
    return datetime.fromtimestamp(record.created).astimezone().isoformat(timespec="milliseconds")


def log_to_stderr(kind: str) -> None:
    """Write log events of graspbox to standard error, as text or as one JSON object per line."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_JsonLines() if kind == "json" else _TextLines())
    logger = logging.getLogger("graspbox")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)


@contextmanager
def options_named(kind: type[ListenerSettings]) -> Iterator[None]:
    """Replace the name of a field, with which an error begins, by that of its option."""
    try:
        yield
    except (ConfigError, ObjectSetError) as error:
        word, space, rest = str(error).partition(" ")
        field = word.strip("`:")
        if field not in {one.name for one in fields(kind)}:
            raise
        option = _OPTIONS.get(field, field.replace("_", "-"))
        raise type(error)(f"--{option}{space}{rest}") from None


def token_of(token_file: Path | None, tls_cert: str | None, tls_key: str | None) -> str | None:
    """Read the token, if there is a file of one; refuse files that cannot be read, by their options."""
    files = {
        "--tls-cert": (tls_cert, "a certificate chain in PEM"),
        "--tls-key": (tls_key, "the private key of the certificate in PEM"),
        "--token-file": (token_file, "a file with the token, such as 'openssl rand -base64 24 > token' writes"),
    }
    for option, (file, wanted) in files.items():
        try:
            if file is not None:
                Path(file).open("rb").close()
        except OSError as error:
            raise ConfigError(
                f"{option} is {str(file)!r}, which cannot be read ({error.strerror}); give {wanted}"
            ) from None
    return None if token_file is None else token_in(token_file)


def listener_options(
    host: str,
    port: int,
    tls: tuple[str | None, str | None],
    token_file: Path | None,
    origins: list[str] | None,
    insecure: bool,
) -> dict[str, Any]:
    """Return the fields of `graspbox.tools.remote.settings.ListenerSettings` that every server has as options."""
    return {
        "host": host,
        "port": port,
        "token": token_of(token_file, *tls),
        "tls_cert": tls[0],
        "tls_key": tls[1],
        "origins": tuple(origins or ()),
        "insecure": insecure,
    }


def serve_until_stopped(server: RunningServer, *lines: str) -> None:
    """Serve until SIGTERM or SIGINT, which let running calls end; a second one ends everything at once.

    `lines` are printed once clients can connect and signals are handled.
    """
    signals = 0

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal signals
        signals += 1
        (server.hurry if signals > 1 else server.drain)()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    server.start()
    for line in lines:
        typer.echo(line)
    sys.stdout.flush()
    server.wait()
    _log.info("stopping: running calls have %g s to end", DRAIN)
    if server.stop():
        _log.info("stopped")
        return
    _log.warning("stopped, although calls were running")
    logging.shutdown()
    # Busy threads cannot be joined.
    os._exit(130 if signals > 1 else 1)


def serve(
    host: Host = _DEFAULTS.host,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0: any that is free.")] = _DEFAULTS.port,
    objects: Annotated[
        list[str] | None,
        typer.Option(
            help="Object set that clients may name, with its parts; NAME=SET offers it under another name, which a "
            "path needs. Repeatable; by default procedural and ycb, as far as they are installed."
        ),
    ] = None,
    hands: Annotated[
        list[str] | None, typer.Option(help="Hand that clients may name; repeatable; by default all.")
    ] = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    token_file: TokenFile = None,
    origins: Origins = None,
    insecure: Insecure = False,
    max_envs: Annotated[int, typer.Option(help="Most environments of all sessions.")] = _DEFAULTS.max_envs,
    max_sessions: Annotated[int, typer.Option(help="Most sessions.")] = _DEFAULTS.max_sessions,
    max_message: MaxMessage = _DEFAULTS.max_message,
    idle_timeout: IdleTimeout = _DEFAULTS.idle_timeout,
    threads: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Threads that step environments; all by default.")
    ] = None,
    log: Log = "text",
) -> None:
    """Serve environments over WebSockets: gymnasium.make_vec(..., remote="ws://HOST:PORT").

    SIGTERM and Ctrl-C let running calls end, 10 s at most; a second one ends at once.
    """
    log_to_stderr(log)
    settings = ServerSettings(
        **listener_options(host, port, (tls_cert, tls_key), token_file, origins, insecure),
        objects=tuple(objects or available()),
        hands=tuple(hands or Hand.names()),
        max_envs=max_envs,
        max_sessions=max_sessions,
        max_message=max_message,
        idle_timeout=idle_timeout,
        threads=threads,
    )
    with options_named(ServerSettings):
        server = EnvironmentServer(settings)
    catalog = server.catalog
    offered = f"objects: {', '.join(catalog.names)}; hands: {', '.join(catalog.hands)}; up to {max_envs} environments"
    serve_until_stopped(server, f"serving at {server.url}", offered)
