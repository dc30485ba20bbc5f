"""Values that copies of an object share."""

import threading
from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar

__all__ = ["MadeOnce"]

Made = TypeVar("Made")


class MadeOnce(Generic[Made]):
    """Makes a value at its first use, once for all copies of its owner; threads may share it.

    Each combination of arguments of `make`, which are hashable, has its own value. A pickle holds the function only.
    """

    def __init__(self, make: Callable[..., Made]) -> None:
        self._make, self._lock = make, threading.Lock()
        self._made: dict[tuple[Any, ...], Made] = {}

    def __call__(self, *arguments: Any) -> Made:
        """Return the value, which the first call makes."""
        with self._lock:
            if arguments not in self._made:
                self._made[arguments] = self._make(*arguments)
            return self._made[arguments]

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def __reduce__(self) -> tuple[type[Self], tuple[Callable[..., Made]]]:
        return type(self), (self._make,)
