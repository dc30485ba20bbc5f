"""``graspbox serve-policy``: grasps and actions for robots and clients on other machines."""

from typing import Annotated

import typer

from graspbox.cli.common import HandOfPolicy
from graspbox.envs import IDS
from graspbox.hands.loading import hand_like
from graspbox.tools.commands.serve import (
    Host,
    IdleTimeout,
    Insecure,
    Log,
    MaxMessage,
    Origins,
    TlsCert,
    TlsKey,
    TokenFile,
    listener_options,
    log_to_stderr,
    options_named,
    serve_until_stopped,
)
from graspbox.tools.remote.policy_serving import PolicyServer
from graspbox.tools.remote.settings import PolicyServerSettings

_DEFAULTS = PolicyServerSettings()


def serve_policy(
    policy: Annotated[
        str,
        typer.Argument(help="An installed policy such as depth, a folder of one, or a baseline that reads no state."),
    ],
    host: Host = _DEFAULTS.host,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0: any that is free.")] = _DEFAULTS.port,
    env: Annotated[
        str | None, typer.Option(help=f"Environment whose observations clients send: {' or '.join(IDS)}.")
    ] = None,
    hand: HandOfPolicy = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    token_file: TokenFile = None,
    origins: Origins = None,
    insecure: Insecure = False,
    max_sessions: Annotated[int, typer.Option(help="Most clients.")] = _DEFAULTS.max_sessions,
    max_message: MaxMessage = _DEFAULTS.max_message,
    idle_timeout: IdleTimeout = _DEFAULTS.idle_timeout,
    threads: Annotated[
        int, typer.Option(min=1, max=64, help="Decisions that are made at once.")
    ] = _DEFAULTS.num_threads,
    log: Log = "text",
) -> None:
    """Serve a policy: depth images in, grasps out, over openpi's WebSocket protocol and POST /grasps.

    SIGTERM and Ctrl-C let requests end, 10 s at most; a second one ends at once.
    """
    log_to_stderr(log)
    settings = PolicyServerSettings(
        **listener_options(host, port, (tls_cert, tls_key), token_file, origins, insecure),
        max_sessions=max_sessions,
        max_message=max_message,
        idle_timeout=idle_timeout,
        env_id=env,
        threads=threads,
    )
    with options_named(PolicyServerSettings):
        server = PolicyServer(policy, settings, hand=None if hand is None else hand_like(hand))
    grasps = f"; POST {server.url.replace('ws', 'http', 1)}/grasps for JSON" if server.finds_grasps else ""
    serve_until_stopped(server, f"serving {policy} at {server.url}{grasps}")
