"""`NetworkPolicy`: a published network from the observations of an environment to actions, such as a clone."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from graspbox._common.made_once import MadeOnce
from graspbox.artifacts.configs import ACTING, NetworkInput, NetworkPolicyConfig
from graspbox.artifacts.folders import hand_of, load, policy_of, used_folder
from graspbox.artifacts.runtimes import Network, onnx_network, output
from graspbox.envs.settings import Settings, keywords
from graspbox.errors import ConfigError
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.goals import GOAL_NAME, Goals, goal_space, plain_settings
from graspbox.simulation import load_hand

__all__ = ["NetworkPolicy"]


class NetworkPolicy(Policy):
    """Maps observations to actions by a network; onnxruntime runs it, without torch.

    `graspbox.sb3.export` writes such folders. The network has no other inputs than `obs`: with ``state`` among them it
    is privileged.

    Parameters
    ----------
    folder : Path
        A policy's folder (`graspbox.artifacts`).
    num_threads : int
        Threads of a decision; the networks are small.

    Raises
    ------
    ConfigError
        If the folder is wrong, or lacks a file.

    Attributes
    ----------
    config : NetworkPolicyConfig
        The folder's ``config.json``.
    """

    def __init__(self, folder: Path, *, num_threads: int = 1) -> None:
        self.config = load(folder, NetworkPolicyConfig)
        environment, roles = self.config.environment, self.config.roles
        self.name, self.obs, self.env_id = self.config.name, environment.obs, environment.id
        self.settings = {**self.config.settings, "hand": hand_of(folder, self.config)}
        base: Policy | None = policy_of(used_folder(folder, self.config, "goal")) if roles else None
        self.learned_from = (*self.config.learned_from, *(base.learned_from if base else ()))
        self._file = Path(folder) / "policy.onnx"
        self._network: MadeOnce[Network] = MadeOnce(partial(onnx_network, self._file, num_threads))
        self._goals = self._make_goals(base)
        self.base = self._goals.base if self._goals else None

    def _make_goals(self, base: Policy | None) -> Goals | None:
        """Make the source of the observation ``goal``."""
        if base is None:
            return None
        plain = plain_settings({**self.settings, "obs": self.config.environment.obs}, base)
        self.obs, self.settings = plain.pop("obs"), plain
        return Goals(base)

    def _bind(self, task: Task) -> None:
        if task.env_id != self.env_id:
            raise ConfigError(f"the policy {self.name!r} acts in {self.env_id!r}, not in {task.env_id!r}")
        hand, known = load_hand(task.hand).name, self.config.hand
        if hand != known:
            raise ConfigError(f"the policy {self.name!r} was trained for the hand {known!r}, not {hand!r}")
        for name in ACTING:
            default = keywords(Settings)[name].default
            wanted, found = self.settings.get(name, default), getattr(task, name)
            if wanted != found:
                raise ConfigError(
                    f"the policy {self.name!r} needs {name}={wanted!r}; the environments have {name}={found!r}"
                )
        for one in self.config.inputs:
            self._check(one, task)
        shape = task.action_space.shape
        if shape != (self.config.actions,):
            raise ConfigError(
                f"the actions of the environments have shape {shape}; those of the policy {self.name!r} have "
                f"({self.config.actions},)"
            )
        if self._goals is not None:
            self._goals.bind(task)
        self._network()

    def _check(self, wanted: NetworkInput, task: Task) -> None:
        """Compare an observation of the environments with an input of the network."""
        space: Any = task.observation_space
        if self._goals is not None and wanted.name == GOAL_NAME:
            box = goal_space()
        else:
            box = space if isinstance(task.obs, str) else space[wanted.name]
        if (box.shape, str(box.dtype)) != (wanted.shape, wanted.dtype):
            raise ConfigError(
                f"the observation {wanted.name!r} has shape {box.shape} and type {box.dtype}; the policy "
                f"{self.name!r} needs {wanted.shape} and {wanted.dtype}: make the environments with the keywords "
                f"in its `settings`, {self.settings!r}"
            )

    def act(self, observation: Any) -> Actions:
        """Run the network for each environment separately: its bits must not depend on the others."""
        actions = self._zeros()
        network = self._network()
        names = [one.name for one in self.config.inputs]
        rows: Mapping[str, Any] = observation if isinstance(observation, Mapping) else {names[0]: observation}
        if self._goals is not None:
            self._goals.look(observation)
            rows = {**rows, GOAL_NAME: self._goals.show(rows["proprio"])}
        for i in range(len(actions)):
            inputs = {name: np.ascontiguousarray(rows[name][i : i + 1]) for name in names}
            actions[i] = output(network(inputs), "action", (1, actions.shape[1]), str(self._file))[0]
        return actions
