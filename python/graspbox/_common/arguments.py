"""Conversion and checks of users' arguments for the core; errors name the argument.

numpy's scalars and arrays count as numbers and lists anywhere in a config.
"""

import math
import operator
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from numbers import Real
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.errors import ConfigError, GraspboxError

__all__ = ["about", "check_range", "config_dict", "config_of", "floats", "natural", "plain", "shown", "with_settings"]

#: Greatest depth of nested lists in a config; lists of matrices need the most.
_MAX_DEPTH = 8
#: Errors repeat values up to this number of characters.
_SHOWN = 60

Config = TypeVar("Config")


@contextmanager
def about(field: str) -> Iterator[None]:
    """Mark errors of a block as errors of an argument (`GraspboxError.field`), unless they name another one."""
    try:
        yield
    except GraspboxError as error:
        error.field = error.field or field
        raise


def floats(values: ArrayLike, name: str = "the array") -> NDArray[np.float64]:
    """Convert an array, called `name` in errors, to the core's layout: C-contiguous float64."""
    try:
        if values is not None:  # numpy would convert None to NaN
            return np.asarray(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        pass
    raise ConfigError(f"{name} is {shown(values)}; give an array of numbers")


def natural(value: Any, name: str, bits: int = 32) -> int:
    """Return a non-negative integer of Python or numpy of at most `bits` bits; a bool is none."""
    try:
        if isinstance(value, bool):
            raise TypeError
        number = operator.index(value)
    except TypeError:
        raise ConfigError(f"{name} is {shown(value)}; give an integer") from None
    if number < 0:
        raise ConfigError(f"{name} is {shown(number)}; give an integer that is not negative")
    if number >= 2**bits:
        raise ConfigError(f"{name} is {shown(number)}; give an integer below 2^{bits}")
    return number


def check_range(config: object, name: str, least: float, most: float) -> None:
    """Refuse a field of a config that is no number from `least` to `most` with a `ConfigError`."""
    value = getattr(config, name)
    if not isinstance(value, Real) or isinstance(value, bool) or not least <= float(value) <= most:
        raise ConfigError(f"{name} is {shown(value)}; give a number from {least:g} to {most:g}")


def config_dict(config: Any, kind: type | None = None, name: str = "config") -> dict[str, Any]:
    """Convert a config of the class `kind` to a dictionary for the core; `name` is the argument in errors.

    A `ConfigError` refuses other classes, and values other than text, finite numbers and lists of these.
    """
    if kind is not None and not isinstance(config, kind):
        raise ConfigError(f"{name} is {shown(config)}; give a {kind.__name__}")
    found: dict[str, Any] = plain(config, type(config).__name__)
    return found


def with_settings(config: Config, kind: type, settings: Mapping[str, Any]) -> Config:
    """Replace fields of a config of the class `kind` by name; an unknown name is a TypeError."""
    if not isinstance(config, kind):
        raise ConfigError(f"config is {shown(config)}; give a {kind.__name__}")
    known = [f.name for f in fields(kind)]
    for name in settings:
        if name not in known:
            raise TypeError(_no_field(kind.__name__, name, known))
    return replace(config, **settings)  # type: ignore[type-var]


def config_of(kind: type[Config], values: Mapping[str, Any], name: str) -> Config:
    """Make a config from a dictionary of its fields, as read from JSON; a `ConfigError` names an unknown field."""
    hints = get_type_hints(kind)
    for field in values:
        if field not in hints:
            raise ConfigError(_no_field(name, field, hints))
    return kind(**{field: _configured(value, hints[field], f"{name}.{field}") for field, value in values.items()})


def _no_field(config: str, name: Any, known: Iterable[str]) -> str:
    near = get_close_matches(str(name), known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"its fields are {', '.join(known)}"
    return f"{config} has no field {name!r}; {hint}"


def _configured(value: Any, hint: Any, name: str) -> Any:
    """Convert dictionaries to the configs in a field's annotation."""
    if isinstance(value, Mapping) and (kind := config_in(hint)) is not None:
        return config_of(kind, value, name)
    if isinstance(value, list | tuple) and get_origin(hint) is tuple:
        return tuple(_configured(item, get_args(hint)[0], f"{name}[{i}]") for i, item in enumerate(value))
    return value


def config_in(hint: Any) -> type | None:
    """Return the config class of an annotation or of a union's member; None if there is none."""
    return next((kind for kind in (hint, *get_args(hint)) if isinstance(kind, type) and is_dataclass(kind)), None)


def shown(value: object) -> str:
    """Format a value for an error: truncated, with its type."""
    kind = type(value).__name__
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        text = "too large"
    # Split no more than is shown: a list of numbers has as many words.
    start = " ".join(text[: 8 * _SHOWN].split())
    whole = len(text) <= 8 * _SHOWN and len(start) <= _SHOWN
    return f"{start if whole else start[:_SHOWN] + '...'} ({kind})"


def plain(value: Any, name: str, kind: Any = None, depth: int = 0) -> Any:
    """Convert a value to text, numbers, lists and dictionaries; `kind` is the annotation of the field `name`.

    Raises as `config_dict`.
    """
    _check_class(value, name, kind)
    if is_dataclass(value) and not isinstance(value, type):
        hints = _hints(type(value))
        return {f.name: plain(getattr(value, f.name), f"{name}.{f.name}", hints[f.name]) for f in fields(value)}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    elif isinstance(value, np.generic):
        value = float(value) if isinstance(value, np.floating) else value.item()
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return _text(value, name)
    if isinstance(value, int | float):
        return _number(value, name)
    if depth < _MAX_DEPTH and isinstance(value, list | tuple):
        inner = next(iter(get_args(kind)), None) if get_origin(kind) is tuple else None
        return [plain(item, f"{name}[{i}]", inner, depth + 1) for i, item in enumerate(value)]
    if depth < _MAX_DEPTH and isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: plain(item, f"{name}.{key}", None, depth + 1) for key, item in value.items()}
    raise ConfigError(f"{name} is {shown(value)}; give a number, a text, or a list of these")


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _check_class(value: Any, name: str, kind: Any) -> None:
    """Refuse a value of another type for a field that holds a config: serde would read a list as its fields."""
    optional = type(None) in get_args(kind)
    config = config_in(kind) if optional else kind
    if (optional and value is None) or not (isinstance(config, type) and is_dataclass(config)):
        return
    if not isinstance(value, config | Mapping):
        raise ConfigError(f"{name} is {shown(value)}; give a {config.__name__}{' or None' if optional else ''}")


def _number(value: int | float, name: str) -> int | float:
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        raise ConfigError(f"{name} is {value} ({type(value).__name__}); give a finite number")
    if -(2**63) <= value < 2**64:
        return value
    raise ConfigError(f"{name} is an integer of {value.bit_length()} bits; give one of at most 64")


def _text(value: str, name: str) -> str:
    try:
        value.encode()
    except UnicodeEncodeError:
        raise ConfigError(f"{name} is {value!a} (str); give valid Unicode text") from None
    return value
