"""A view of one environment of a vector environment, with attributes and methods of the single one."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["EnvView", "VectorAccess"]

#: Attributes shared by all environments, and their names in the vector environment.
_SHARED = {
    "objects": "objects",
    "render_mode": "render_mode",
    "spec": "spec",
    "observation_space": "single_observation_space",
    "action_space": "single_action_space",
}


class VectorAccess(Protocol):
    """The part of a vector environment that its views use; `env` is the index of an environment."""

    @property
    def np_random_seed(self) -> tuple[int | None, ...]: ...  # noqa: D102
    def get_state(self, env: int) -> bytes: ...  # noqa: D102
    def set_state(self, env: int, state: bytes) -> tuple[Any, dict[str, Any]]: ...  # noqa: D102
    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]: ...  # noqa: D102
    def picture(self, env: int) -> NDArray[np.uint8] | None: ...  # noqa: D102


class EnvView:
    """The environment that `NativeVectorEnv.call`, ``get_attr`` and ``set_attr`` access; new attributes can be set.

    Parameters
    ----------
    vector : VectorAccess
        The vector environment.
    index : int
        Index of the environment.
    """

    def __init__(self, vector: VectorAccess, index: int) -> None:
        self._vector, self._index = vector, index

    def __getattr__(self, name: str) -> Any:
        # Called for attributes not found otherwise; a copy under construction has no vector environment yet.
        if name in _SHARED and "_vector" in self.__dict__:
            return getattr(self._vector, _SHARED[name])
        raise AttributeError(f"an environment has no attribute {name!r} here")

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _SHARED:
            raise AttributeError(f"{name!r} is shared by all environments")
        super().__setattr__(name, value)

    @property
    def np_random_seed(self) -> int | None:
        """The initial seed of its random stream; None before its first reset, -1 if unknown."""
        return self._vector.np_random_seed[self._index]

    def get_state(self) -> bytes:
        """Return the complete state of the environment."""
        return self._vector.get_state(self._index)

    def set_state(self, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Restore a state; returns observation and info."""
        return self._vector.set_state(self._index, state)

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (4, 4) of every camera at present, by name."""
        found = self._vector.cameras().items()
        return {name: (intrinsics, poses[self._index]) for name, (intrinsics, poses) in found}

    def render(self) -> NDArray[np.uint8] | None:
        """Render a picture, (H, W, 3); None without a render mode."""
        return self._vector.picture(self._index)
