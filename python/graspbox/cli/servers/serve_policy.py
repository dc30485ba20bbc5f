"""``graspbox serve-policy``: grasps and actions for robots and clients on other machines."""

from typing import Annotated

import typer

from graspbox.cli.servers.serve import (
    Host,
    Insecure,
    Log,
    MaxMessage,
    Origins,
    TlsCert,
    TlsKey,
    TokenFile,
    log_to_stderr,
    options_named,
    serve_until_stopped,
)
from graspbox.envs import IDS
from graspbox.envs.remote_config import token_in
from graspbox.remote.policy_serving import PolicyServer
from graspbox.remote.settings import PolicyServerSettings

_DEFAULTS = PolicyServerSettings()


def serve_policy(
    policy: Annotated[str, typer.Argument(help="Folder of a published policy, or a baseline that reads no state.")],
    host: Host = _DEFAULTS.host,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; 0: any that is free.")] = _DEFAULTS.port,
    env: Annotated[
        str | None, typer.Option("--env", help=f"Environment whose observations clients send: {' or '.join(IDS)}.")
    ] = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    token_file: TokenFile = None,
    origins: Origins = None,
    insecure: Insecure = False,
    max_sessions: Annotated[int, typer.Option("--max-sessions", help="Most clients.")] = _DEFAULTS.max_sessions,
    max_message: MaxMessage = _DEFAULTS.max_message,
    threads: Annotated[
        int, typer.Option("--threads", min=1, max=64, help="Decisions that are made at once.")
    ] = _DEFAULTS.num_threads,
    log: Log = "text",
) -> None:
    """Serve a policy: depth images in, grasps out, over openpi's WebSocket protocol and POST /grasps.

    SIGTERM and Ctrl-C let requests end, 10 s at most; a second one ends at once.
    """
    log_to_stderr(log)
    settings = PolicyServerSettings(
        host=host,
        port=port,
        token=None if token_file is None else token_in(token_file),
        tls_cert=tls_cert,
        tls_key=tls_key,
        origins=tuple(origins or ()),
        insecure=insecure,
        max_sessions=max_sessions,
        max_message=max_message,
        env_id=env,
        threads=threads,
    )
    with options_named(PolicyServerSettings):
        server = PolicyServer(policy, settings)
    grasps = f"{server.url.replace('ws', 'http', 1)}/grasps"
    serve_until_stopped(server, f"serving {policy} at {server.url}; POST {grasps} for JSON")
