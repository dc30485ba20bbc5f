"""Folders of published networks that act: from observations of an environment to actions; read without torch.

| file | contents |
|---|---|
| ``config.json``        | `NetworkPolicyConfig` |
| ``policy.onnx``        | from observations, by their names, (n, ...) as the environment gives them, to ``action`` (n, k) float32 |
| ``policy.safetensors`` | the weights, and what scales observations; the ONNX file follows from them |
| ``README.md``          | the card: data, commands, time, seed, scores, limits |
| ``LICENSE``            | the licence of the weights |
"""  # noqa: E501 (a table)

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from graspbox.envs import IDS
from graspbox.errors import ConfigError
from graspbox.perception.policy_folders import check_counts, check_hashes, check_texts, read_config, write_config

__all__ = [
    "GOAL_NAME",
    "NETWORK_KIND",
    "NetworkInput",
    "NetworkPolicyConfig",
    "read_network_policy",
    "write_network_policy",
]

#: Kind of the policy that `NetworkPolicyConfig` describes.
NETWORK_KIND = "network"
#: Name of the observation that another policy makes, `graspbox.policies.goals`.
GOAL_NAME = "goal"
#: Settings of an environment that decide what an action does; a folder names all that its environment has.
ACTING = ("control", "frame_skip", "hand")


@dataclass(frozen=True)
class NetworkInput:
    """An observation that a network takes: its name, and shape and type of a row."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", tuple(self.shape))
        if not all(isinstance(size, int) and size > 0 for size in self.shape):
            raise ConfigError(f"shape is {self.shape!r}; give positive integers")
        try:
            np.dtype(self.dtype)
        except TypeError:
            raise ConfigError(f"dtype is {self.dtype!r}; give the name of a type of numpy") from None


@dataclass(frozen=True)
class NetworkPolicyConfig:
    """What a network that acts needs, and where it comes from.

    Attributes
    ----------
    name : str
        Name in results.
    graspbox : str
        Version that exported it.
    env_id : str
        The environment that it acts in, one of `graspbox.envs.IDS`.
    obs : str or tuple of str
        Keyword ``obs`` of the environments that it learned in.
    settings : mapping
        Other keywords of these environments that decide what it sees and what its actions do.
    inputs : tuple of NetworkInput
        What it observes, one entry for each name in `obs`.
    actions : int
        Length of an action.
    algorithm : str
        Algorithm of Stable-Baselines3 whose policy it is.
    policy_kwargs : mapping
        What that policy is made of, as ``scripts/sb3.yaml`` has it.
    files : mapping of str to str
        SHA-256 of every file of the network.
    goal_from : str
        Folder, from this one, of the policy whose grasps are the observation ``goal`` (`graspbox.policies.goals`);
        empty where there is no such observation.
    goal_hash : str
        SHA-256 of its ``config.json``, which names its files.
    """

    name: str
    graspbox: str
    env_id: str
    obs: str | tuple[str, ...]
    settings: Mapping[str, Any]
    inputs: tuple[NetworkInput, ...]
    actions: int
    algorithm: str
    files: Mapping[str, str]
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    goal_from: str = ""
    goal_hash: str = ""

    def __post_init__(self) -> None:
        check_texts(self, "name", "graspbox", "algorithm")
        if not (isinstance(self.goal_from, str) and isinstance(self.goal_hash, str)):
            raise ConfigError(f"goal_from is {self.goal_from!r} and goal_hash {self.goal_hash!r}; give texts")
        check_counts(self, "actions")
        check_hashes(self.files)
        if self.env_id not in IDS:
            raise ConfigError(f"env_id is {self.env_id!r}; choose from {', '.join(IDS)}")
        if not isinstance(self.obs, str):
            object.__setattr__(self, "obs", tuple(self.obs))
        named = (self.obs,) if isinstance(self.obs, str) else self.obs
        given = [one.name if isinstance(one, NetworkInput) else one for one in self.inputs]
        if sorted(named) != sorted(given):
            raise ConfigError(f"inputs are {given!r}; give one for each name in obs, {self.obs!r}")
        if bool(self.goal_from) != (GOAL_NAME in named):
            raise ConfigError(f"obs is {self.obs!r} and goal_from {self.goal_from!r}; the one needs the other")
        for name in ("settings", "policy_kwargs"):
            if not isinstance(getattr(self, name), Mapping):
                raise ConfigError(f"{name} is {getattr(self, name)!r}; give values by their names")
        if not isinstance(self.settings.get("hand"), str):
            raise ConfigError(f"settings.hand is {self.settings.get('hand')!r}; give the name of a hand")


def write_network_policy(folder: Path, config: NetworkPolicyConfig) -> None:
    """Write ``config.json``."""
    write_config(folder, NETWORK_KIND, config)


def read_network_policy(folder: Path) -> NetworkPolicyConfig:
    """Read ``config.json`` of a network that acts, and check the files that it names.

    Raises
    ------
    FileError
        If a file is missing.
    ConfigError
        If the policy is of another kind, an entry is missing, unknown or wrong, or a file is not the one that was
        exported.
    """
    return read_config(Path(folder), NETWORK_KIND, NetworkPolicyConfig)
