"""Environment servers on a Ray cluster: one actor per server, and a vector environment over all of them.

This module steps no environment: the actors run `graspbox.tools.remote.EnvironmentServer`, and the client talks to
them over WebSockets, past Ray.
"""

import secrets
import socket
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

import gymnasium
from gymnasium.vector import VectorWrapper

from graspbox._common.arguments import natural, shown
from graspbox._common.imports import imported
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError
from graspbox.tools.remote.serving import EnvironmentServer, available
from graspbox.tools.remote.settings import ServerSettings

__all__ = ["RayServers", "RayVectorEnv", "ray_servers"]

#: Seconds within which all servers must run. Ray starts a process for each, which imports graspbox.
_START = 120.0
#: Connections within a cluster rarely break, and a server that is restarted has lost its sessions.
_REMOTE = RemoteConfig(grace=15.0)


def _ray() -> Any:
    return imported("ray", "servers on Ray need the package ray", "ray")


class _Server:
    """The actor: a server at an address that stays the same when Ray restarts it."""

    def __init__(self, host: str, port: int, token: str, threads: int, settings: ServerSettings | None) -> None:
        own = replace(
            settings or ServerSettings(objects=available()),
            host=host,
            port=port,
            token=token,
            threads=threads,
            insecure=True,
        )
        self._server = EnvironmentServer(own).start()

    def url(self) -> str:
        """Return the address for clients."""
        return self._server.url


def _address() -> tuple[str, int]:
    """Return the address of the current node, and a free port there."""
    host = _ray().util.get_node_ip_address()
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with closing(socket.socket(family)) as listener:
        listener.bind((host, 0))
        return host, listener.getsockname()[1]


class RayServers:
    """Environment servers as actors of a Ray cluster, until `close`; also a context manager.

    Several clients may use them: pass `remote` to each. Each server listens at a free port of its node, and admits
    clients with a token that is made here. There is no TLS (``ServerSettings(insecure=True)``): anyone who can read the
    traffic between the nodes can read the token and all data, and every user of the cluster can ask Ray for the token.
    Use it only within a trusted network, as Ray itself.

    Parameters
    ----------
    servers : int, optional
        Number of servers; they are assigned to the nodes in turn. By default one per node that has CPUs.
    cpus_per_server : int, optional
        CPUs that Ray reserves for a server, which steps with as many threads; by default all CPUs of its node, in equal
        parts where a node has several servers.
    settings : ServerSettings, optional
        Catalog and bounds of the servers; by default the object sets installed on the nodes. Host, port,
        token and threads are set here.
    remote : RemoteConfig, optional
        Client settings, without addresses and token; by default a grace of 15 s. A server whose process
        ends is restarted at the same address for new environments; those that it stepped are lost, and their next call
        raises `ConnectionLostError`.
    address : str, optional
        The cluster, if this process is not connected to one; as of ``ray.init``.

    Raises
    ------
    MissingExtraError
        If Ray is not installed.
    ConfigError
        If there is no cluster at the address, or its nodes do not have the CPUs.
    """

    def __init__(
        self,
        servers: int | None = None,
        *,
        cpus_per_server: int | None = None,
        settings: ServerSettings | None = None,
        remote: RemoteConfig | None = None,
        address: str | None = None,
    ) -> None:
        self._ray = _ray()
        self._actors: list[Any] = []
        self._started = not self._ray.is_initialized()
        if self._started:
            try:
                self._ray.init(address=address, log_to_driver=False)
            except (ConnectionError, ValueError) as error:
                raise ConfigError(f"Ray cannot be reached at {address!r}: {error}") from None
        token = secrets.token_urlsafe(32)
        try:
            urls = self._start(servers, cpus_per_server, token, settings)
        except BaseException:
            self.close()
            raise
        #: For the keyword ``remote`` of environments. It contains the token: do not store it.
        self.remote = replace(remote or _REMOTE, urls=tuple(urls), token_text=token)

    def _start(
        self, servers: int | None, cpus: int | None, token: str, settings: ServerSettings | None
    ) -> Sequence[str]:
        ray = self._ray
        affinity = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
        places = _places(ray.nodes(), servers, cpus)
        on = [affinity(node, soft=False) for node, _ in places]
        try:
            ask = ray.remote(num_cpus=0)(_address)
            addresses = ray.get([ask.options(scheduling_strategy=where).remote() for where in on], timeout=_START)
            actor = ray.remote(max_restarts=-1)(_Server)
            for where, (_, threads), (host, port) in zip(on, places, addresses, strict=True):
                placed = actor.options(num_cpus=threads, scheduling_strategy=where)
                self._actors.append(placed.remote(host, port, token, threads, settings))
            urls: list[str] = ray.get([actor.url.remote() for actor in self._actors], timeout=_START)
        except ray.exceptions.GetTimeoutError:
            wanted = ", ".join(str(threads) for _, threads in places)
            raise ConfigError(
                f"the servers did not start within {_START:.0f} s: they wait for {wanted} CPUs on {len(places)} nodes, "
                "some of which other tasks may use; set cpus_per_server"
            ) from None
        except ray.exceptions.RayActorError as error:
            raise ConfigError(f"a server did not start: {error}") from None
        return urls

    def close(self) -> None:
        """End the servers, and their environments with them."""
        if not self._ray.is_initialized():
            return
        for actor in self._actors:
            self._ray.kill(actor, no_restart=True)
        self._actors.clear()
        if self._started:
            self._ray.shutdown()

    def __enter__(self) -> "RayServers":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _places(nodes: Sequence[dict[str, Any]], servers: int | None, cpus: int | None) -> list[tuple[str, int]]:
    """Return node and CPUs of each server."""
    able = [(node["NodeID"], int(node["Resources"].get("CPU", 0))) for node in nodes if node["Alive"]]
    able = sorted(node for node in able if node[1] >= 1)
    if not able:
        raise ConfigError("no node of the Ray cluster has a CPU; give its nodes CPUs")
    count = len(able) if servers is None else natural(servers, "servers")
    if count < 1 or (cpus is not None and natural(cpus, "cpus_per_server") < 1):
        raise ConfigError(f"servers is {shown(servers)} and cpus_per_server {shown(cpus)}; give at least 1")
    places = []
    for index in range(count):
        node, total = able[index % len(able)]
        sharing = len(range(index % len(able), count, len(able)))
        own = total // sharing if cpus is None else cpus
        if own < 1 or own * sharing > total:
            raise ConfigError(
                f"{sharing} servers of {cpus or 1} CPUs do not fit on a node of {total} CPUs; give fewer servers, or "
                "fewer cpus_per_server"
            )
        places.append((node, own))
    return places


class RayVectorEnv(VectorWrapper):
    """A vector environment whose servers end with it; graspbox's own methods are on ``unwrapped``."""

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any], servers: RayServers) -> None:
        super().__init__(env)
        self.servers = servers

    def close(self, **kwargs: Any) -> None:
        """End the environments and the servers."""
        try:
            super().close(**kwargs)
        finally:
            self.servers.close()


def ray_servers(
    num_envs: int,
    *,
    env_id: str = "graspbox/Grasp-v0",
    servers: int | None = None,
    cpus_per_server: int | None = None,
    settings: ServerSettings | None = None,
    remote: RemoteConfig | None = None,
    address: str | None = None,
    **keywords: Any,
) -> RayVectorEnv:
    """Make environments that the nodes of a Ray cluster step; their ``close`` ends the servers.

    Results are those of a vector environment of this process, to the bit. The environments, with `keywords` such as
    ``objects`` and ``obs``, are divided equally among the servers, whose parameters, access control and errors are
    those of `RayServers`.
    """
    cluster = RayServers(servers, cpus_per_server=cpus_per_server, settings=settings, remote=remote, address=address)
    try:
        env = gymnasium.make_vec(env_id, num_envs=num_envs, remote=cluster.remote, **keywords)
    except BaseException:
        cluster.close()
        raise
    return RayVectorEnv(env, cluster)
