"""Base class of the single environments; their modules add keywords and tables."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox.envs.core import CoreEnvironment, GraspCore, checked_seed, fresh_seed
from graspbox.envs.settings import RENDER_MODES, ObjectsArgument
from graspbox.simulation.layouts import Arrangement

__all__ = ["SingleEnv"]


class SingleEnv(CoreEnvironment, gymnasium.Env[Any, NDArray[np.float32]]):
    """A pool of one environment with Gymnasium's interface.

    It can be pickled and copied (by `pickle`, `cloudpickle`, `copy.deepcopy`): the copy is at the same step of the same
    episode, and the same actions give the same bits.

    Parameters
    ----------
    objects : str, Path, ObjectSet or sequence of str
        Object sets to sample from: see `graspbox.object_sets`.
    **keywords
        Fields of the config of the environment in `graspbox.envs.settings`.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, HandError
        For a wrong argument; objects are read when they are first sampled.
    """

    metadata = {"render_modes": [*RENDER_MODES], "render_fps": 1}  # noqa: RUF012 (as Gymnasium declares it)

    def __init__(self, objects: ObjectsArgument = "procedural", **keywords: Any) -> None:
        self._core = core = GraspCore(self.config_class, 1, objects, keywords)
        self.render_mode = core.render_mode
        self.observation_space = core.observation_space
        self.action_space = core.action_space
        self.metadata = {**self.metadata, "render_fps": core.fps}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Restarts the environment's random stream. Without it the stream continues; the first reset chooses a random
            seed, which ``np_random_seed`` returns.
        options : dict, optional
            Parts of the initial state that replace sampled ones: see the environment's module.

        Raises
        ------
        ConfigError
            For an invalid seed or option; the episode continues as if `reset` had not been called.
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
        """Simulate one step: ``1 / control_freq`` seconds, or one decision.

        Parameters
        ----------
        action : (n,) array
            See the table of actions; values outside [-1, 1] are clipped.

        Raises
        ------
        ConfigError
            If the action has another size or is not finite, or the episode is over.
        """
        arrays, _ = self._core.step(action)
        observation, info = self._core.first(arrays)
        return observation, float(self._core.rewards(arrays)[0]), bool(arrays["terminated"][0]), False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Render a picture, (H, W, 3), with ``render_mode="rgb_array"``; otherwise return None.

        With ``render_mode="human"``, update the window, as every reset and step does.
        """
        pictures = self._core.pictures([0])
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Free the environment and close the window; afterwards only another close is allowed."""
        self._core.close()

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (4, 4) of every camera at present, by name."""
        return {name: (intrinsics, poses[0]) for name, (intrinsics, poses) in self._core.pool.cameras().items()}

    def arrangement(self) -> Arrangement:
        """Return the objects as they lie, and walls; **privileged**, for environments in this process."""
        return self._core.arrangement(0)

    def get_state(self) -> bytes:
        """Return the complete state of the environment, its random stream included."""
        return self._core.pool.get_state(0)

    def set_state(self, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Restore a state returned by `get_state`; returns its observation and info.

        From there the same actions give the same bits.

        Raises
        ------
        ConfigError
            If the state is damaged, or from another version, object set, hand, control mode, control frequency, set of
            cameras, or other fingers.
        SimulationError
            If the object of that name has another shape here, or the physics differ.
        """
        begun = self._core.begun[0]
        arrays = self._core.restore(0, state)
        if not begun:
            # The random stream comes from the state; its seed is unknown.
            self._np_random_seed = -1
        return self._core.first(arrays)
