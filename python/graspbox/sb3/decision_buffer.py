"""A replay buffer of episodes of one step, whose observations are large."""

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.buffers import DictReplayBuffer

__all__ = ["DecisionBuffer"]


class DecisionBuffer(DictReplayBuffer):  # type: ignore[misc]
    """Stores observations once: after the only step of an episode none follows that counts.

    It stands where Stable-Baselines3 takes a ``DictReplayBuffer``. Saved are the rows that were filled alone, and
    compressed.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.next_observations = self.observations

    def add(
        self,
        obs: dict[str, NDArray[Any]],
        next_obs: dict[str, NDArray[Any]],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Add a row for each environment; `next_obs` is left out."""
        del next_obs
        super().add(obs, obs, action, reward, done, infos)

    def __getstate__(self) -> dict[str, Any]:
        """Pack the observations for a file."""
        filled = self.size()
        packed = {name: zlib.compress(rows[:filled].tobytes(), 1) for name, rows in self.observations.items()}
        types = {name: rows.dtype.str for name, rows in self.observations.items()}
        own = {k: v for k, v in self.__dict__.items() if k not in ("observations", "next_observations")}
        return {**own, "packed": (packed, types, filled)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Unpack them."""
        packed, types, filled = state.pop("packed")
        self.__dict__.update(state)
        self.observations = {}
        for name, values in packed.items():
            shape = (self.buffer_size, self.n_envs, *self.obs_shape[name])
            rows = self.observations[name] = np.zeros(shape, dtype=types[name])
            found = np.frombuffer(zlib.decompress(values), dtype=types[name])
            rows[:filled] = found.reshape(filled, *shape[1:])
        self.next_observations = self.observations
