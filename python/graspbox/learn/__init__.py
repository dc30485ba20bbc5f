"""Train policies (extra ``train``). Learning uses the core of graspbox, which knows nothing of it.

| package | purpose |
|---|---|
| `training` | run directories, the training loop, options of every training |
| `models` | learned components: network, inputs, losses and training side by side |
| `recipes` | ``graspbox train``: from data to a published policy with its card |
| `sb3` | trainings with Stable-Baselines3 |
| `export` | trained networks as published policies: ONNX files |
| `random_hands` | random hands for training |
"""

from importlib.util import find_spec

from graspbox.errors import MissingExtraError

__all__ = ["require"]


def require(*packages: str, need: str = "training") -> None:
    """Check that torch and other packages that train are installed; raises MissingExtraError if one is missing."""
    missing = [name for name in ("torch", *packages) if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"{need} needs {' and '.join(missing)}: pip install 'graspbox[train]'")
