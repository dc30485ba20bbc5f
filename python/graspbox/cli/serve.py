"""``graspbox serve``: environments for other machines."""

import json
import logging
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated, Literal, Protocol

import typer

from graspbox.cli.common import console
from graspbox.errors import FileError
from graspbox.hands import Hand
from graspbox.remote.serving import EnvironmentServer, ServerSettings, available

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


def token_in(path: Path | None) -> str | None:
    """Read a token.

    Raises
    ------
    FileError
        If the file cannot be read.
    """
    if path is None:
        return None
    try:
        return path.read_text().strip()
    except OSError as error:
        raise FileError(error.errno, error.strerror, str(path)) from None


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
    max_envs: Annotated[int, typer.Option("--max-envs", help="Most environments of all sessions.")] = 1024,
    max_sessions: Annotated[int, typer.Option("--max-sessions", help="Most sessions.")] = 256,
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
        token=token_in(token_file),
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
    server = EnvironmentServer(settings)
    offer = server.offer
    typer.echo(f"serving at {server.url}")
    typer.echo(f"objects: {', '.join(offer.names)}; hands: {', '.join(offer.hands)}; up to {max_envs} environments")
    sys.stdout.flush()
    stop_at_signals(server)
    server.serve()
    console.print("stopping; running calls have 10 s to end")
    server.stop()


class Stoppable(Protocol):
    """A server that runs."""

    def drain(self) -> None: ...  # noqa: D102
    def stop(self, patient: bool = True) -> None: ...  # noqa: D102


def stop_at_signals(server: Stoppable) -> None:
    """Drain a server at SIGTERM or SIGINT; a second one does not wait for running calls."""
    signals = 0

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal signals
        signals += 1
        if signals > 1:
            server.stop(patient=False)
            raise SystemExit(130)
        server.drain()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
