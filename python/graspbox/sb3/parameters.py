"""Parameters of a training run: the entries of ``scripts/sb3.yaml``, and what replaces them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from graspbox.errors import ConfigError

__all__ = ["Parameters", "read_parameters"]


@dataclass(frozen=True)
class Parameters:
    """An entry of ``scripts/sb3.yaml``: an algorithm in an environment."""

    #: Steps of all environments together.
    steps: int
    num_envs: int
    #: Whether vector observations, and rewards, are scaled by running statistics.
    normalize: dict[str, bool]
    #: Keywords of the environment.
    env: dict[str, Any]
    #: Arguments of the algorithm.
    model: dict[str, Any]
    #: Successful episodes of the scripted expert: sac and td3 replay them, ppo clones them.
    demonstrations: int = 0
    #: Passes over the demonstrations when cloning.
    clone_epochs: int = 60
    #: Number of first steps in which the value function of a cloned policy learns alone.
    value_warmup: int = 0
    #: Weight of the cloning loss in the training of a policy that begins as a clone (``--clone``).
    clone_weight: float = 0.0
    #: Steps over which that weight falls to zero.
    clone_steps: int = 0


def read_parameters(
    path: Path, algorithm: str, env_id: str, changes: tuple[str, ...] = (), steps: int | None = None
) -> Parameters:
    """Read the entry of an algorithm and an environment, and replace values.

    Parameters
    ----------
    path : Path
        The file.
    algorithm, env_id : str
        Names of the entry.
    changes : tuple of str
        Such as ``model.gamma=0.98``; values are YAML.
    steps : int, optional
        Replaces the number of steps.

    Raises
    ------
    ConfigError
        If there is no such entry, or a change names no parameter.
    """
    found = yaml.safe_load(path.read_text())
    try:
        values = found[algorithm][env_id]
    except (KeyError, TypeError):
        raise ConfigError(f"{str(path)!r} has no entry {algorithm!r}, {env_id!r}; add one") from None
    for change in changes:
        name, equals, value = change.partition("=")
        *parents, last = name.split(".")
        place = values
        for parent in parents:
            place = place.get(parent) if isinstance(place, dict) else None
        if not equals or not isinstance(place, dict):
            raise ConfigError(f"--set {change!r} names no parameter; write, for example, model.gamma=0.98")
        place[last] = yaml.safe_load(value)
    if steps is not None:
        values["steps"] = steps
    try:
        return Parameters(**values)
    except TypeError as error:
        raise ConfigError(f"parameters are {', '.join(Parameters.__annotations__)} ({error})") from None
