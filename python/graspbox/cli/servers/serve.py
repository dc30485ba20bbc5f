"""``graspbox serve``: environments for other machines."""

import json
import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from types import FrameType
from typing import Annotated, Literal

import typer

from graspbox.envs.remote_config import token_in
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.remote.running import DRAIN, RunningServer
from graspbox.remote.serving import EnvironmentServer, available
from graspbox.remote.settings import ListenerSettings, ServerSettings

_log = logging.getLogger(__name__)
_DEFAULTS = ServerSettings()

Host = Annotated[str, typer.Option("--host", help="Address to listen at; 0.0.0.0 for all of this machine.")]
TlsCert = Annotated[str | None, typer.Option("--tls-cert", help="Certificate chain, a PEM file.")]
TlsKey = Annotated[str | None, typer.Option("--tls-key", help="Private key of the certificate, a PEM file.")]
TokenFile = Annotated[Path | None, typer.Option("--token-file", help="File with the token that clients must know.")]
Origins = Annotated[
    list[str] | None,
    typer.Option("--origin", help="Origin of a browser page that may connect: http://localhost:8080; repeatable."),
]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Listen beyond this machine without TLS and token: anybody may connect.")
]
MaxMessage = Annotated[int, typer.Option("--max-message", help="Largest message in either direction, bytes.")]
Log = Annotated[Literal["text", "json"], typer.Option("--log", help="Format of log lines on standard error.")]


class _JsonLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        line = {"time": self.formatTime(record), "level": record.levelname, "message": record.getMessage()}
        return json.dumps(line)


def log_to_stderr(kind: str) -> None:
    """Write log events of graspbox to standard error, as text or as one JSON object per line."""
    handler = logging.StreamHandler(sys.stderr)
    text = logging.Formatter("%(asctime)s %(levelname)s %(message)s")
    handler.setFormatter(_JsonLines() if kind == "json" else text)
    logger = logging.getLogger("graspbox")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)


@contextmanager
def options_named(kind: type[ListenerSettings]) -> Iterator[None]:
    """Name options instead of the fields of settings: an error of a field begins with its name."""
    try:
        yield
    except ConfigError as error:
        word, space, rest = str(error).partition(" ")
        field = word.strip("`:")
        if field not in {one.name for one in fields(kind)}:
            raise
        raise ConfigError(f"--{field.replace('_', '-')}{space}{rest}") from None


def serve_until_stopped(server: RunningServer, *said: str) -> None:
    """Serve until SIGTERM or SIGINT, which let running calls end; a second one ends everything at once.

    The lines of `said` go to standard output once clients can connect and signals are heard.
    """
    signals = 0

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal signals
        signals += 1
        (server.hurry if signals > 1 else server.drain)()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    server.start()
    _log.info("%s", said[0])
    for line in said:
        typer.echo(line)
    sys.stdout.flush()
    server.wait()
    _log.info("stopping: running calls have %g s to end", DRAIN)
    if server.stop():
        _log.info("stopped")
        return
    _log.warning("stopped, although calls were running")
    logging.shutdown()
    # Threads that are still at work cannot be waited for.
    os._exit(130 if signals > 1 else 1)


def serve(
    host: Host = _DEFAULTS.host,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; 0: any that is free.")] = _DEFAULTS.port,
    objects: Annotated[
        list[str] | None,
        typer.Option(
            "--objects",
            help="Object set that clients may name, with its parts; NAME=SET offers it under another name, which a "
            "path needs. Repeatable; by default procedural and ycb, as far as they are installed.",
        ),
    ] = None,
    hands: Annotated[
        list[str] | None, typer.Option("--hands", help="Hand that clients may name; repeatable; by default all.")
    ] = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    token_file: TokenFile = None,
    origins: Origins = None,
    insecure: Insecure = False,
    max_envs: Annotated[int, typer.Option("--max-envs", help="Most environments of all sessions.")] = (
        _DEFAULTS.max_envs
    ),
    max_sessions: Annotated[int, typer.Option("--max-sessions", help="Most sessions.")] = _DEFAULTS.max_sessions,
    max_message: MaxMessage = _DEFAULTS.max_message,
    idle_timeout: Annotated[
        float, typer.Option("--idle-timeout", help="Seconds without a command after which a session ends.")
    ] = _DEFAULTS.idle_timeout,
    threads: Annotated[
        int | None, typer.Option("--threads", min=1, max=1024, help="Threads that step environments; all by default.")
    ] = None,
    log: Log = "text",
) -> None:
    """Serve environments over WebSockets: gymnasium.make_vec(..., remote="ws://HOST:PORT").

    SIGTERM and Ctrl-C let running calls end, 10 s at most; a second one ends at once.
    """
    log_to_stderr(log)
    settings = ServerSettings(
        host=host,
        port=port,
        objects=tuple(objects or available()),
        hands=tuple(hands or Hand.names()),
        token=None if token_file is None else token_in(token_file),
        tls_cert=tls_cert,
        tls_key=tls_key,
        origins=tuple(origins or ()),
        insecure=insecure,
        max_envs=max_envs,
        max_sessions=max_sessions,
        max_message=max_message,
        idle_timeout=idle_timeout,
        threads=threads,
    )
    with options_named(ServerSettings):
        server = EnvironmentServer(settings)
    offer = server.offer
    offered = f"objects: {', '.join(offer.names)}; hands: {', '.join(offer.hands)}; up to {max_envs} environments"
    serve_until_stopped(server, f"serving at {server.url}", offered)
