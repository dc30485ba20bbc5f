"""What the single environments share: everything but their keywords and tables."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox.envs.core import GraspCore, checked_seed, fresh_seed
from graspbox.envs.preparation import PreparesObjects
from graspbox.object_sets import ObjectSet

__all__ = ["SingleEnv"]


class SingleEnv(PreparesObjects, gymnasium.Env[Any, NDArray[np.float32]]):
    """A pool of one environment, with Gymnasium's interface.

    It can be pickled and copied (by `pickle`, `cloudpickle`, `copy.deepcopy`): the copy is at the same step of the same
    episode, and the same actions lead to the same bits.

    Parameters
    ----------
    core : GraspCore
        The pool.
    """

    def __init__(self, core: GraspCore) -> None:
        self._core = core
        self.render_mode = core.render_mode
        self.observation_space = core.observation_space
        self.action_space = core.action_space
        self.metadata = {**self.metadata, "render_fps": core.fps}

    @property
    def objects(self) -> ObjectSet:
        """The objects that episodes sample from."""
        return self._core.object_set

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Restarts the environment's random stream; without it the stream continues (the first time: from a random
            seed, which ``np_random_seed`` returns).
        options : dict, optional
            Parts of the initial state that are given instead of sampled: see the module of the environment.

        Raises
        ------
        ConfigError
            For a wrong seed or option; the episode continues as if `reset` had not been called.
        MeshError, FileError, SimulationError
            If the object cannot be read or simulated.
        """
        if seed is None and not self._core.begun[0]:
            seed = fresh_seed()
        seed = None if seed is None else checked_seed(seed)
        arrays = self._core.reset(None if seed is None else [seed], None, [options])
        super().reset(seed=seed)
        return self._core.first(arrays)

    def step(self, action: NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act for one step: ``frame_skip`` control periods of 0.05 s, or one decision.

        Parameters
        ----------
        action : (n,) array
            See the table of actions; numbers beyond [-1, 1] are clipped.

        Raises
        ------
        ConfigError
            If the action has another size or holds numbers that are not finite, or the episode is over.
        """
        arrays, _ = self._core.step(action)
        observation, info = self._core.first(arrays)
        return observation, float(self._core.rewards(arrays)[0]), bool(arrays["terminated"][0]), False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Take a picture, (H, W, 3), with ``render_mode="rgb_array"``; otherwise return None.

        With ``render_mode="human"`` show it in the window, as every reset and step does.
        """
        pictures = self._core.pictures([0])
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Give the memory back and close the window; after that only another close is allowed."""
        self._core.close()

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (4, 4) of every camera at present, by name."""
        return {name: (intrinsics, poses[0]) for name, (intrinsics, poses) in self._core.cameras().items()}

    def get_state(self) -> bytes:
        """Return all that the environment's future depends on, its random stream included."""
        return self._core.pool.get_state(0)

    def set_state(self, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Restore a state that `get_state` returned: from there the same actions lead to the same bits.

        Returns
        -------
        observation, info
            As they were then.

        Raises
        ------
        ConfigError
            If the state is damaged, of another version, or of other objects, cameras, another hand, control mode or
            frame_skip.
        SimulationError
            If the object of that name has another shape here, or the physics differ.
        """
        begun = self._core.begun[0]
        arrays = self._core.restore(0, state)
        if not begun:
            # The stream is that of the state, with an unknown seed.
            self._np_random_seed = -1
        return self._core.first(arrays)
