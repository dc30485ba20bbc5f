"""Parts of vector environments: arguments of resets, infos in Gymnasium's format.

Infos are a column per entry, each with its mask ``_entry``. A column is an array, or a dictionary of columns.
"""

from collections.abc import Mapping, Sequence
from typing import Any

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
    """Make a mask (count,) that is True at these rows."""
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
