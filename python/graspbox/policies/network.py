"""Networks from the observations of an environment to actions, such as a clone; `NetworkPolicy`: a published one."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from graspbox._common.made_once import MadeOnce
from graspbox.envs.settings import GraspConfig
from graspbox.errors import ConfigError
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.published.configs import ACTING, Environment, NetworkInput, NetworkPolicyConfig
from graspbox.policies.published.folders import hand_of, load
from graspbox.policies.published.runtimes import Network, onnx_network, output
from graspbox.simulation import load_hand

__all__ = ["ActingNetwork", "NetworkPolicy"]


class ActingNetwork(Policy):
    """Maps observations to actions by a network, which has no other inputs than `obs`.

    With ``state`` among them it is privileged.

    Parameters
    ----------
    name : str
        Name in results.
    environment : Environment
        The environments in which it acts.
    hand : str or pair of str
        Its hand, as environments take it.
    inputs : sequence of NetworkInput
        Observations that the network needs.
    actions : int
        Length of an action.
    network : MadeOnce
        Makes the network: observations of n environments by their names to ``action`` (n, `actions`).
    learned_from : sequence of str
        As of `graspbox.policies.Policy`.
    """

    #: The inputs state the types of the observations.
    _needs_metres = False

    def __init__(
        self,
        name: str,
        environment: Environment,
        hand: str | tuple[str, str],
        inputs: Sequence[NetworkInput],
        actions: int,
        network: MadeOnce[Network],
        *,
        learned_from: Sequence[str] = (),
    ) -> None:
        self.name, self.obs, self.env_id = name, environment.obs, environment.id
        self.settings = {**environment.settings, "hand": hand}
        self.learned_from = tuple(learned_from)
        self._hand, self._inputs, self._actions, self._network = hand, tuple(inputs), actions, network

    def _bind(self, task: Task) -> None:
        if task.env_id != self.env_id:
            raise ConfigError(f"the policy {self.name!r} acts in {self.env_id!r}, not in {task.env_id!r}")
        hand, known = load_hand(task.hand).name, load_hand(self._hand).name
        if hand != known:
            raise ConfigError(f"the policy {self.name!r} was trained for the hand {known!r}, not {hand!r}")
        for name in ACTING:
            default = getattr(GraspConfig, name)
            wanted, actual = self.settings.get(name, default), getattr(task, name)
            if wanted != actual:
                raise ConfigError(
                    f"the policy {self.name!r} needs {name}={wanted!r}; the environments have {name}={actual!r}"
                )
        for one in self._inputs:
            self._check(one, task)
        shape = task.action_space.shape
        if shape != (self._actions,):
            raise ConfigError(
                f"the actions of the environments have shape {shape}; those of the policy {self.name!r} have "
                f"({self._actions},)"
            )
        self._network()

    def _check(self, wanted: NetworkInput, task: Task) -> None:
        """Compare an observation of the environments with an input of the network."""
        space: Any = task.observation_space
        box = space[wanted.name] if isinstance(space, spaces.Dict) else space
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
        names = [one.name for one in self._inputs]
        rows: Mapping[str, Any] = observation if isinstance(observation, Mapping) else {names[0]: observation}
        for i in range(len(actions)):
            inputs = {name: np.ascontiguousarray(rows[name][i : i + 1]) for name in names}
            actions[i] = output(network(inputs), "action", (1, actions.shape[1]), self.name)[0]
        return actions


class NetworkPolicy(ActingNetwork):
    """A published network; onnxruntime runs it, without torch. `graspbox.learn.sb3.export` writes such folders.

    Parameters
    ----------
    folder : Path
        A policy's folder (`graspbox.policies.published`), whose ``config.json`` is the attribute `config`.
    num_threads : int
        Threads of a decision; the networks are small.

    Raises
    ------
    ConfigError
        If the folder is wrong, or lacks a file.
    """

    #: The class of its ``config.json``, `graspbox.policies.published.registry`.
    config_class = NetworkPolicyConfig

    def __init__(self, folder: Path, *, num_threads: int = 1) -> None:
        self.config = config = load(folder, NetworkPolicyConfig)
        super().__init__(
            config.name,
            config.environment,
            hand_of(folder, config),
            config.inputs,
            config.actions,
            MadeOnce(partial(onnx_network, Path(folder) / "policy.onnx", num_threads)),
            learned_from=config.learned_from,
        )
