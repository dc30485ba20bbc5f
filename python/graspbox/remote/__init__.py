"""Environments and policies for other machines: ``graspbox serve``, ``graspbox serve-policy``.

| module | what it does |
|---|---|
| `graspbox.remote.serving` | makes the environments of clients; which object sets and hands they may name |
| `graspbox.remote.ray_cluster` | servers on a Ray cluster (extra ``ray``), and a vector environment over them |

The protocol is specified in ``docs/server.md``. Environments on a server are made by the keyword ``remote``:
``gymnasium.make_vec("graspbox/Grasp-v0", num_envs=64, remote="ws://host:5055")``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspbox.remote.serving import EnvironmentServer, ServerSettings

if TYPE_CHECKING:
    from graspbox.remote.ray_cluster import RayServers, RayVectorEnv, ray_servers

__all__ = ["EnvironmentServer", "RayServers", "RayVectorEnv", "ServerSettings", "ray_servers"]


def __getattr__(name: str) -> Any:
    if name in ("RayServers", "RayVectorEnv", "ray_servers"):
        return getattr(import_module("graspbox.remote.ray_cluster"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
