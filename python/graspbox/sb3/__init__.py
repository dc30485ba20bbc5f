"""Adapters for Stable-Baselines3 (extra ``[train]``).

`graspbox.learn.sb3` has the trainings. Importing this package imports nothing of Stable-Baselines3.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspbox.sb3.extractors import Extractor
    from graspbox.sb3.vec_env import VecEnv

__all__ = ["Extractor", "VecEnv"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        # Importing this first raises the error that names the missing extra.
        from graspbox.sb3.vec_env import VecEnv

        if name == "VecEnv":
            return VecEnv
        from graspbox.sb3.extractors import Extractor

        return Extractor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
