"""`RunPolicy`: a checkpoint of a run of Stable-Baselines3 as a policy, run by torch."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

from gymnasium import spaces
from numpy.typing import NDArray

from graspbox._common.made_once import MadeOnce
from graspbox.envs.settings import kind_of
from graspbox.errors import ConfigError, GraspboxError
from graspbox.learn.sb3.action_graphs import is_transposed
from graspbox.learn.sb3.export import published_settings
from graspbox.learn.sb3.histories import learned_from, settings_of, trained_on
from graspbox.learn.sb3.running import ALGORITHMS, load_policy
from graspbox.object_sets import Split, set_names
from graspbox.policies.network import ActingNetwork
from graspbox.policies.published.configs import Environment, NetworkInput

__all__ = ["RunPolicy"]


class RunPolicy(ActingNetwork):
    """The deterministic actions of a checkpoint, in the environment of its run.

    Loading it may run code that the checkpoint holds: load your own runs alone.

    Parameters
    ----------
    run : Path
        Folder of the run.
    checkpoint : Path
        Folder of the checkpoint, in that of the run.

    Raises
    ------
    ConfigError
        If the checkpoint is missing or cannot be read, or the algorithm is unknown.
    """

    def __init__(self, run: Path, checkpoint: Path) -> None:
        #: Folder of the run, and the name of the checkpoint.
        self.run, self.checkpoint = run, checkpoint.name
        settings = settings_of(run)
        algorithm, env = settings["algorithm"], settings["env"]
        if algorithm not in ALGORITHMS:
            raise ConfigError(
                f"{run / 'settings.json'}: algorithm is {algorithm!r}; only policies of {', '.join(ALGORITHMS)}, which "
                "have no memory, are loaded"
            )
        kind = kind_of(settings["id"], vector=True)
        hand, obs = (env.get(name, getattr(kind, name)) for name in ("hand", "obs"))
        hand, obs = (value if isinstance(value, str) else tuple(value) for value in (hand, obs))
        network: MadeOnce[Any] = MadeOnce(partial(_Network, algorithm, checkpoint))
        acts_in = Environment(settings["id"], obs, published_settings(settings["id"], env))
        space = network().space
        boxes: dict[str, Any] = space.spaces if isinstance(space, spaces.Dict) else {acts_in.names[0]: space}
        chosen_on = settings["evaluate"] if checkpoint.name == "best" else None
        super().__init__(
            f"{run.resolve().name}/{checkpoint.name}",
            acts_in,
            hand,
            [_input(name, boxes[name]) for name in acts_in.names],
            network().actions,
            network,
            learned_from=learned_from(trained_on(run), chosen_on),
        )
        # Returns are then those of the training.
        rewards = {name: env[name] for name in ("reward", "reward_weights") if name in env}
        self.settings = {**self.settings, **rewards}
        split: Split = "validation" if settings["evaluate"] == "test" else "test"
        self.held_out = tuple(set_names(env.get("objects", "procedural"))), split


class _Network:
    """The model of a checkpoint as a function of named observations; raises as `RunPolicy`."""

    def __init__(self, algorithm: str, checkpoint: Path) -> None:
        try:
            self._policy = load_policy(algorithm, checkpoint)
        except GraspboxError:
            raise
        except Exception as error:  # those of zip files, pickles and torch share no base class
            why = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise ConfigError(
                f"{checkpoint} cannot be read, it is damaged or of another version of its packages; train again: {why}"
            ) from error
        self.space: Any = self._policy.model.observation_space
        self.actions = int(self._policy.model.action_space.shape[0])
        self._named, self._lock = isinstance(self.space, spaces.Dict), Lock()

    def __call__(self, rows: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return the actions (n, k) for observations (n, ...)."""
        # Stable-Baselines3's policies keep the distribution of the last prediction, so that threads would mix actions.
        with self._lock:
            return {"action": self._policy.act(dict(rows) if self._named else next(iter(rows.values())))}


def _input(name: str, box: spaces.Box) -> NetworkInput:
    """Describe an observation as the environment has it: colours last."""
    shape = (*box.shape[1:], box.shape[0]) if is_transposed(box) else box.shape
    return NetworkInput(name, tuple(int(size) for size in shape), str(box.dtype))
