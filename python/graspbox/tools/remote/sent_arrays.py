"""Lists of numbers in requests: checked before numpy makes an array of them."""

from collections.abc import Iterable
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox.errors import ConfigError

__all__ = ["sent_array"]

#: What lists may hold.
_KNOWN = (bool, int, float, np.bool_, np.number, np.ndarray)


def sent_array(value: Any, name: str, wanted: str, *, deepest: int = 3) -> NDArray[np.generic]:
    """Return numbers, lists of them or arrays as an array of the type that they have.

    Numpy would make an array of texts, each as long as the longest: anything but numbers is refused before.

    Parameters
    ----------
    value : object
        An array, a number, or lists of numbers or of arrays.
    name, wanted : str
        The entry, and what to give instead, for errors.
    deepest : int
        Most levels of lists; by default those of several images.

    Raises
    ------
    ConfigError
        For anything else, and for rows of different lengths.
    """
    if isinstance(value, np.ndarray):
        return value
    _check(value, name, wanted, deepest)
    try:
        array: NDArray[np.generic] = np.asarray(value)
    except (OverflowError, ValueError):
        raise _ragged(name, wanted) from None
    return array


def _check(value: Any, name: str, wanted: str, deepest: int) -> None:
    """Refuse lists of anything but numbers and arrays; each level is read in turn, and nothing is copied."""
    for depth in range(deepest + 1):
        kinds = set(map(type, _level(value, depth)))
        rows = {kind for kind in kinds if issubclass(kind, list | tuple)}
        if not all(issubclass(kind, _KNOWN) for kind in kinds - rows):
            stray = next(one for one in _level(value, depth) if not isinstance(one, (*_KNOWN, list, tuple)))
            raise ConfigError(f"{name} holds {shown(stray)}; {wanted}")
        if not rows:
            return
        if rows != kinds:
            raise _ragged(name, wanted)
    raise ConfigError(f"{name} has lists more than {deepest} deep; {wanted}")


def _level(value: Any, depth: int) -> Iterable[Any]:
    """Iterate over the items of lists so deep in a value."""
    items: Iterable[Any] = (value,)
    for _ in range(depth):
        items = chain.from_iterable(items)
    return items


def _ragged(name: str, wanted: str) -> ConfigError:
    return ConfigError(f"{name} has rows of different lengths; {wanted}")
