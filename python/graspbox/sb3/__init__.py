"""Adapters for Stable-Baselines3 (extra ``[train]``).

| name | what it is |
|---|---|
| `graspbox.sb3.VecEnv` | the native vector environments as Stable-Baselines3 takes them |

Nothing of Stable-Baselines3 is imported before one of these is asked for.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspbox.sb3.vec_env import VecEnv

__all__ = ["VecEnv"]


def __getattr__(name: str) -> Any:
    if name == "VecEnv":
        from graspbox.sb3.vec_env import VecEnv

        return VecEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
