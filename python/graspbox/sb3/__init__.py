"""Adapters for Stable-Baselines3 (extra ``[train]``).

| name | what it is |
|---|---|
| `graspbox.sb3.VecEnv` | the native vector environments as a ``VecEnv`` of Stable-Baselines3 |
| `graspbox.sb3.Extractor` | a features extractor with a suitable network for each kind of observation |
| `graspbox.sb3.TrunkExtractor` | a features extractor with a network that was trained before |
| `graspbox.sb3.goal_env` | ``Grasp-v0`` in which an agent is told where another policy would grasp |
| `graspbox.sb3.residual_env` | ``GraspPose-v0`` in which an agent corrects the grasps of another policy |
| `graspbox.sb3.residual_training` | runs that learn to correct |
| `graspbox.sb3.policy` | a trained model as a `graspbox.policies.Policy`; baselines to compare it with |
| `graspbox.sb3.training` | makes the model of a run: parameters, policy class, demonstrations |
| `graspbox.sb3.running` | evaluation on held-out objects, checkpoints |
| `graspbox.sb3.demonstrations` | demonstrations of the scripted expert: behaviour cloning, replay |
| `graspbox.sb3.parameters` | entries of ``scripts/sb3.yaml`` |
| `graspbox.sb3.cloning` | behaviour cloning of recorded demonstrations: steps, statistics, loss |
| `graspbox.sb3.fine_tuning` | a model begins as a clone and stays near its demonstrations at first |
| `graspbox.sb3.export` | a policy as a folder that acts without torch; `graspbox.sb3.action_graphs`: what it computes |
| `graspbox.sb3.histories` | how the policy of a run came about, with commands that repeat it |
| `graspbox.sb3.ppo` | PPO with a learning rate of its own for the value function |

Nothing of Stable-Baselines3 is imported before one of these is asked for; `require` tells whether it is there.
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
        If one of them is not.
    """
    missing = [name for name in ("torch", "stable_baselines3") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training needs {' and '.join(missing)}: pip install 'graspbox[train]'")


def __getattr__(name: str) -> Any:
    if name == "VecEnv":
        from graspbox.sb3.vec_env import VecEnv

        return VecEnv
    if name in _EXTRACTORS:
        # Importing this first says which extra is missing.
        import_module("graspbox.sb3.vec_env")
        return getattr(import_module(_EXTRACTORS[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
