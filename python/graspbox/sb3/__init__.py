"""Adapters for Stable-Baselines3 (extra ``[train]``).

| name | purpose |
|---|---|
| `graspbox.sb3.VecEnv` | the native vector environments as a ``VecEnv`` of Stable-Baselines3 |
| `graspbox.sb3.Extractor` | a features extractor with a suitable network for each kind of observation |
| `graspbox.sb3.TrunkExtractor` | a features extractor with a pretrained network |
| `graspbox.sb3.goal_env` | ``Grasp-v0`` with the grasp of another policy as an observation |
| `graspbox.sb3.residual_env` | ``GraspPose-v0`` in which an agent corrects the grasps of another policy |
| `graspbox.sb3.residual_training` | training runs for such corrections |
| `graspbox.sb3.policy` | a trained model as a `graspbox.policies.Policy`; baselines to compare it with |
| `graspbox.sb3.running` | environments, models, evaluation on held-out objects, checkpoints |
| `graspbox.sb3.training` | training runs on rewards, with demonstrations of the scripted expert |
| `graspbox.sb3.cloning` | behaviour cloning of recorded demonstrations, and fine-tuning of a clone |
| `graspbox.sb3.settings` | options of these trainings, and their file of parameters |
| `graspbox.sb3.export` | a policy as a folder that runs without torch; `graspbox.sb3.action_graphs`: its computation |
| `graspbox.sb3.histories` | the history of a run's policy, with commands that reproduce it |
| `graspbox.sb3.ppo` | PPO with its own learning rate for the value function |

Importing this package imports nothing of Stable-Baselines3; `require` checks that it is installed.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from graspbox.errors import MissingExtraError

if TYPE_CHECKING:
    from graspbox.sb3.extractors import Extractor
    from graspbox.sb3.trunks import TrunkExtractor
    from graspbox.sb3.vec_env import VecEnv

__all__ = ["Extractor", "TrunkExtractor", "VecEnv", "require"]

#: Modules of the features extractors, by name.
_EXTRACTORS = {"Extractor": "graspbox.sb3.extractors", "TrunkExtractor": "graspbox.sb3.trunks"}


def require() -> None:
    """Check that torch and Stable-Baselines3 are installed.

    Raises
    ------
    MissingExtraError
        If one of them is missing.
    """
    missing = [name for name in ("torch", "stable_baselines3") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training needs {' and '.join(missing)}: pip install 'graspbox[train]'")


def __getattr__(name: str) -> Any:
    if name == "VecEnv":
        from graspbox.sb3.vec_env import VecEnv

        return VecEnv
    if name in _EXTRACTORS:
        # Importing this first raises the error that names the missing extra.
        import_module("graspbox.sb3.vec_env")
        return getattr(import_module(_EXTRACTORS[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
