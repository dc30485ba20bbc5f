"""Environments and policies for other machines: ``graspbox serve``, ``graspbox serve-policy``.

| module | purpose |
|---|---|
| `graspbox.remote.serving` | an environment server: Python makes the environments, Rust does everything else |
| `graspbox.remote.offer` | object sets and hands that clients may name |
| `graspbox.remote.policy_serving` | a policy server |
| `graspbox.remote.grasp_requests` | requests for grasps in images: their entries, as arrays and as JSON |
| `graspbox.remote.settings`, `graspbox.remote.running` | settings, threads and shutdown of both servers |
| `graspbox.remote.remote_policy` | a policy on a server, for `graspbox.evaluation` |
| `graspbox.remote.ray_cluster` | servers on a Ray cluster (extra ``ray``), and a vector environment over them |

The protocol is specified in ``docs/reference/protocol.md``. Environments on a server are made by the keyword
``remote``: ``gymnasium.make_vec("graspbox/Grasp-v0", num_envs=64, remote="ws://host:5055")``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspbox.remote.serving import EnvironmentServer
from graspbox.remote.settings import ServerSettings

if TYPE_CHECKING:
    from graspbox.remote.ray_cluster import RayServers, RayVectorEnv, ray_servers

__all__ = ["EnvironmentServer", "RayServers", "RayVectorEnv", "ServerSettings", "ray_servers"]


def __getattr__(name: str) -> Any:
    if name in ("RayServers", "RayVectorEnv", "ray_servers"):
        return getattr(import_module("graspbox.remote.ray_cluster"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
