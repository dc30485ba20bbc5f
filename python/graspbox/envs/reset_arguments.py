"""Arguments of a vector environment's reset, checked and split by environment: seeds, options, mask."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.envs.core import checked_options, checked_seed, fresh_seed
from graspbox.errors import ConfigError

__all__ = ["options_of_each", "reset_mask", "seeds_of"]


def seeds_of(
    seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_] | None, before: Sequence[int | None]
) -> list[int | None]:
    """Return one seed per environment; a stream that has not begun (None in `before`) gets a fresh seed."""
    count = len(before)
    given: list[int | None]
    if seed is None:
        given = [None] * count
    elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
        given = list(seed)
    else:
        given = [checked_seed(seed) + i for i in range(count)]
    if len(given) != count:
        raise ConfigError(f"there are {len(given)} seeds; give one for each of the {count} environments")
    for env, (old, new) in enumerate(zip(before, given, strict=True)):
        if mask is not None and not mask[env]:
            given[env] = None
        elif new is None:
            given[env] = fresh_seed() if old is None else None
        else:
            given[env] = checked_seed(new)
    return given


def reset_mask(given: Any, count: int) -> NDArray[np.bool_] | None:
    """Check the mask of a reset; None selects all environments."""
    if given is None:
        return None
    if not isinstance(given, np.ndarray) or given.dtype != np.bool_ or given.shape != (count,):
        raise ConfigError(f"reset_mask must be an array of {count} bools")
    if not given.any():
        raise ConfigError("reset_mask selects no environment; set at least one entry to True")
    return np.ascontiguousarray(given)


def options_of_each(given: Any, shared: Mapping[str, Any], count: int) -> list[Mapping[str, Any]]:
    """Return the options shared by all environments, or one mapping per environment with its own options added."""
    if given is None:
        return [shared]
    if isinstance(given, Mapping | str) or not isinstance(given, Sequence) or len(given) != count:
        raise ConfigError(f"options['each'] must be a sequence of {count} dictionaries or None")
    return [{**shared, **checked_options(own, f"options['each'][{env}]")} for env, own in enumerate(given)]
