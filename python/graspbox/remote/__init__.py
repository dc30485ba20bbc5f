"""Environments and policies for other machines: ``graspbox serve``, ``graspbox serve-policy``.

| module | what it does |
|---|---|
| `graspbox.remote.serving` | makes the environments of clients; which object sets and hands they may name |

The protocol is specified in ``docs/server.md``. Environments on a server are made by the keyword ``remote``:
``gymnasium.make_vec("graspbox/Grasp-v0", num_envs=64, remote="ws://host:5055")``.
"""

from graspbox.remote.serving import EnvironmentServer, ServerSettings

__all__ = ["EnvironmentServer", "ServerSettings"]
