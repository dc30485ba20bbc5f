"""An environment of graspbox with the interface of OpenEnv."""

from typing import Any
from uuid import uuid4

import gymnasium
import numpy as np

import graspbox
from graspbox.errors import ConfigError
from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import EnvironmentMetadata

try:
    from ..models import GraspAction, GraspObservation, GraspState, encoded
    from .settings import ServerSettings
except ImportError:  # the folder itself is on the path
    from models import GraspAction, GraspObservation, GraspState, encoded
    from server.settings import ServerSettings

__all__ = ["GraspEnvironment"]


class GraspEnvironment(Environment[GraspAction, GraspObservation, GraspState]):
    """One session: its own environment.

    Parameters
    ----------
    settings : ServerSettings, optional
        By default those of the environment variables.

    Raises
    ------
    ConfigError, ObjectSetError
        If the settings are those of no environment.
    """

    SUPPORTS_CONCURRENT_SESSIONS: bool = True

    def __init__(self, settings: ServerSettings | None = None) -> None:
        super().__init__()
        self._settings = settings = settings or ServerSettings.from_environment()
        keywords = {"num_threads": 1, **settings.keywords}
        self._env = gymnasium.make(
            settings.env_id,
            objects=settings.objects,
            obs=settings.obs,
            remote=settings.remote,
            disable_env_checker=True,
            **keywords,
        )
        (size,) = self._env.action_space.shape or (0,)
        self._state = GraspState(env_id=settings.env_id, action_size=size)

    def reset(
        self,
        seed: int | None = None,
        episode_id: str | None = None,
        options: dict[str, Any] | None = None,
        **kwargs: Any,
    ) -> GraspObservation:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            The same seed begins the same episode; without one the stream of the last seed continues.
        episode_id : str, optional
            Name of the episode.
        options : dict, optional
            Reset options of graspbox: object, place, friction, and others.
        **kwargs
            Refused.

        Raises
        ------
        ConfigError
            For a wrong seed or option.
        """
        if kwargs:
            raise ConfigError(f"reset has no argument {min(kwargs)!r}; pass seed, episode_id or options")
        observation, info = self._env.reset(seed=seed, options=options)
        self._state = self._state.model_copy(
            update={
                "episode_id": episode_id or str(uuid4()),
                "step_count": 0,
                "seed": self._state.seed if seed is None else seed,
                "is_success": False,
                "done": False,
            }
        )
        return self._observation(observation, info)

    def step(self, action: GraspAction, timeout_s: float | None = None, **kwargs: Any) -> GraspObservation:
        """Act.

        Parameters
        ----------
        action : GraspAction
            ``state.action_size`` numbers.
        timeout_s : float, optional
            Is ignored: a step takes milliseconds.
        **kwargs
            Are ignored.

        Raises
        ------
        ConfigError
            If the action has another size, or the episode is over.
        ResetNeeded
            Before the first reset.
        """
        if self._state.done and self._state.step_count > 0:
            raise ConfigError("the episode is over; call reset")
        values = np.asarray(action.values, dtype=np.float32)
        observation, reward, terminated, truncated, info = self._env.step(values)
        done = bool(terminated or truncated)
        self._state = self._state.model_copy(
            update={
                "step_count": self._state.step_count + 1,
                "is_success": bool(info["is_success"]),
                "done": done,
            }
        )
        # A decision is over after its one step; that is no truncation.
        cut = bool(truncated and not terminated)
        return self._observation(observation, info, reward=float(reward), done=done, truncated=cut)

    @property
    def state(self) -> GraspState:
        """The present episode."""
        return self._state

    def get_metadata(self) -> EnvironmentMetadata:
        """Name and description, for ``/metadata``."""
        return EnvironmentMetadata(
            name="graspbox_openenv",
            description=f"{self._settings.env_id} of graspbox: a robot hand grasps objects on a table.",
            version=graspbox.__version__,
        )

    def close(self) -> None:
        """Release the environment."""
        self._env.close()

    def _observation(
        self,
        observation: dict[str, Any],
        info: dict[str, Any],
        *,
        reward: float | None = None,
        done: bool = False,
        truncated: bool = False,
    ) -> GraspObservation:
        arrays = {name: encoded(array, self._settings.images) for name, array in observation.items()}
        return GraspObservation(arrays=arrays, reward=reward, done=done, truncated=truncated, metadata=info)
