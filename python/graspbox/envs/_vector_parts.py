"""Parts of vector environments: arguments of resets, infos in Gymnasium's format, views of one environment.

Infos are a column per entry, each with its mask ``_entry``. A column is an array, or a dictionary of columns.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspbox.envs.core import checked_options, checked_seed, fresh_seed
from graspbox.errors import ConfigError


def seeds_of(
    seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_] | None, before: Sequence[int | None]
) -> list[int | None]:
    """Return one seed per environment; a stream that has not begun (None in `before`) gets a fresh seed."""
    count = len(before)
    seeds: list[int | None]
    if seed is None:
        seeds = [None] * count
    elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
        seeds = list(seed)
    else:
        seeds = [checked_seed(seed) + i for i in range(count)]
    if len(seeds) != count:
        raise ConfigError(f"there are {len(seeds)} seeds; give one for each of the {count} environments")
    for env, (old, new) in enumerate(zip(before, seeds, strict=True)):
        if mask is not None and not mask[env]:
            seeds[env] = None
        elif new is None:
            seeds[env] = fresh_seed() if old is None else None
        else:
            seeds[env] = checked_seed(new)
    return seeds


def reset_mask(mask: Any, count: int) -> NDArray[np.bool_] | None:
    """Check the mask of a reset; None selects all environments."""
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (count,):
        raise ConfigError(f"reset_mask must be an array of {count} bools")
    if not mask.any():
        raise ConfigError("reset_mask selects no environment; set at least one entry to True")
    return np.ascontiguousarray(mask)


def options_of_each(each: Any, shared: Mapping[str, Any], count: int) -> list[Mapping[str, Any]]:
    """Return the options shared by all environments, or one mapping per environment with its own options added."""
    if each is None:
        return [shared]
    if isinstance(each, Mapping | str) or not isinstance(each, Sequence) or len(each) != count:
        raise ConfigError(f"options['each'] must be a sequence of {count} dictionaries or None")
    return [{**shared, **checked_options(own, f"options['each'][{env}]")} for env, own in enumerate(each)]


def mask_of(rows: NDArray[np.intp], count: int) -> NDArray[np.bool_]:
    """Make a mask (count,) that is True at the given rows."""
    mask = np.zeros(count, dtype=np.bool_)
    mask[rows] = True
    return mask


def taken(columns: dict[str, Any], rows: NDArray[np.intp]) -> dict[str, Any]:
    """Select rows of all columns."""
    return {name: taken(v, rows) if isinstance(v, dict) else v[rows] for name, v in columns.items()}


def full(columns: dict[str, Any], count: int) -> dict[str, Any]:
    """Add to every column a mask that is True in all rows."""
    infos: dict[str, Any] = {}
    every = np.ones(count, dtype=np.bool_)
    for name, values in columns.items():
        infos[name] = full(values, count) if isinstance(values, dict) else values
        infos[f"_{name}"] = every.copy()
    return infos


def scattered(columns: dict[str, Any], rows: NDArray[np.intp], count: int) -> dict[str, Any]:
    """Scatter columns of a few rows into columns of `count`, with their masks; other rows are zero, or None."""
    infos: dict[str, Any] = {}
    for name, values in columns.items():
        if isinstance(values, dict):
            infos[name] = scattered(values, rows, count)
        else:
            infos[name] = np.full(count, None if values.dtype == object else 0, dtype=values.dtype)
            infos[name][rows] = values
        infos[f"_{name}"] = mask_of(rows, count)
    return infos


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
    def np_random_seed(self) -> tuple[int | None, ...]: ...
    def get_state(self, env: int) -> bytes: ...
    def set_state(self, env: int, state: bytes) -> tuple[Any, dict[str, Any]]: ...
    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]: ...
    def picture(self, env: int) -> NDArray[np.uint8] | None: ...


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
