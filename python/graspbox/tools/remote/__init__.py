"""Environments and policies for other machines: ``graspbox serve``, ``graspbox serve-policy``, Ray (extra ``ray``).

The protocol is specified in ``docs/reference/protocol.md``. Environments on a server are made by the keyword
``remote``: ``gymnasium.make_vec("graspbox/Grasp-v0", num_envs=64, remote="ws://host:5055")``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspbox.tools.remote.serving import EnvironmentServer
from graspbox.tools.remote.settings import ServerSettings

if TYPE_CHECKING:
    from graspbox.tools.remote.ray_cluster import RayServers, RayVectorEnv, ray_servers

__all__ = ["EnvironmentServer", "RayServers", "RayVectorEnv", "ServerSettings", "ray_servers"]


def __getattr__(name: str) -> Any:
    if name in ("RayServers", "RayVectorEnv", "ray_servers"):
        return getattr(import_module("graspbox.tools.remote.ray_cluster"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
