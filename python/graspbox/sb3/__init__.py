"""Adapters for Stable-Baselines3 (extra ``[train]``).

| name | what it is |
|---|---|
| `graspbox.sb3.VecEnv` | the native vector environments as Stable-Baselines3 takes them |
| `graspbox.sb3.Extractor` | features of images, depth, labels, points and voxels, chosen by the space |
| `graspbox.sb3.running` | what a training run needs: evaluation on held-out objects, checkpoints |
| `graspbox.sb3.references` | random actions, zero actions and the planner, to compare with |
| `graspbox.sb3.demonstrations` | the scripted expert shows how: copies to begin with, episodes to learn from |
| `graspbox.sb3.ppo` | PPO whose values learn faster than its policy |

Nothing of Stable-Baselines3 is imported before one of these is asked for.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspbox.sb3.extractors import Extractor
    from graspbox.sb3.vec_env import VecEnv

__all__ = ["Extractor", "VecEnv"]


def __getattr__(name: str) -> Any:
    if name == "VecEnv":
        from graspbox.sb3.vec_env import VecEnv

        return VecEnv
    if name == "Extractor":
        # Importing this first says which extra is missing.
        from graspbox.sb3 import vec_env  # noqa: F401
        from graspbox.sb3.extractors import Extractor

        return Extractor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
