"""Arguments as the core takes them: what a user gives is converted, or refused by its name.

numpy's scalars and arrays are numbers and lists here, wherever they appear in a config.
"""

import json
import math
import operator
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.errors import ConfigError

__all__ = ["config_of", "floats", "natural", "plain", "shown", "to_json", "with_settings"]

#: Lists within lists of a config: the deepest holds matrices.
_MAX_DEPTH = 8
#: Longest value that an error repeats, characters.
_SHOWN = 60

Config = TypeVar("Config")


def floats(values: ArrayLike, name: str = "the array") -> NDArray[np.float64]:
    """Lay an array out as the core takes it: C-contiguous float64.

    Raises
    ------
    ConfigError
        If the values, called `name`, are not numbers in rows of equal length.
    """
    try:
        if values is not None:  # which numpy takes for NaN
            return np.asarray(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        pass
    raise ConfigError(f"{name} is {shown(values)}; give an array of numbers")


def natural(value: Any, name: str, bits: int = 32) -> int:
    """Take an integer, also numpy's, of at most `bits` bits; the core checks the range that makes sense.

    Raises
    ------
    ConfigError
        If the value, called `name`, is no integer, negative or larger.
    """
    try:
        found = operator.index(value)
    except TypeError:
        raise ConfigError(f"{name} is {shown(value)}; give an integer") from None
    if found < 0:
        raise ConfigError(f"{name} is {shown(found)}; give an integer that is not negative")
    if found >= 2**bits:
        raise ConfigError(f"{name} is {shown(found)}; give an integer below 2^{bits}")
    return found


def to_json(config: Any, kind: type | None = None, name: str = "config") -> str:
    """Write a config as the core reads it.

    Parameters
    ----------
    config : dataclass
        A config of `graspbox.configs`.
    kind : type, optional
        The class that it must have.
    name : str
        The argument that it was given as.

    Raises
    ------
    ConfigError
        If it is another class, or holds what is neither text nor a finite number.
    """
    if kind is not None and not isinstance(config, kind):
        raise ConfigError(f"{name} is {shown(config)}; give a {kind.__name__}")
    return json.dumps(plain(config, type(config).__name__))


def with_settings(config: Config, kind: type, settings: Mapping[str, Any]) -> Config:
    """Replace fields of a config by name.

    Raises
    ------
    ConfigError
        If `config` is not of the class `kind`.
    TypeError
        If there is no such field; the message names the nearest.
    """
    if not isinstance(config, kind):
        raise ConfigError(f"config is {shown(config)}; give a {kind.__name__}")
    known = [f.name for f in fields(kind)]
    for name in settings:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"its fields are {', '.join(known)}"
            raise TypeError(f"{kind.__name__} has no field {name!r}; {hint}")
    return replace(config, **settings)  # type: ignore[type-var]


def config_of(kind: type[Config], given: Mapping[str, Any], name: str) -> Config:
    """Make a config from a dictionary of its fields, as JSON holds it; fields that are missing have their defaults.

    Raises
    ------
    ConfigError
        For a field that it does not have; the message names the nearest.
    """
    hints = get_type_hints(kind)
    for field in given:
        if field not in hints:
            near = get_close_matches(str(field), hints, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"its fields are {', '.join(hints)}"
            raise ConfigError(f"{name} has no field {field!r}; {hint}")
    return kind(**{field: _configured(value, hints[field], f"{name}.{field}") for field, value in given.items()})


def _configured(value: Any, hint: Any, name: str) -> Any:
    """Convert dictionaries to the configs that the annotation of a field names."""
    if isinstance(value, Mapping) and (kind := config_in(hint)) is not None:
        return config_of(kind, value, name)
    if isinstance(value, list | tuple) and get_origin(hint) is tuple:
        return tuple(_configured(item, get_args(hint)[0], f"{name}[{i}]") for i, item in enumerate(value))
    return value


def config_in(hint: Any) -> type | None:
    """Find the config that an annotation allows, alone or as part of a union."""
    return next((kind for kind in (hint, *get_args(hint)) if isinstance(kind, type) and is_dataclass(kind)), None)


def shown(value: object) -> str:
    """Show a value in an error: cut short, with its type."""
    kind = type(value).__name__
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        text = "too large"
    text = " ".join(text.split())
    return f"{text if len(text) <= _SHOWN else text[:_SHOWN] + '...'} ({kind})"


def plain(value: Any, name: str, kind: Any = None, depth: int = 0) -> Any:
    """Convert a value to what JSON holds; `kind` is the annotation of the field `name`.

    Raises
    ------
    ConfigError
        As `to_json`.
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
    """Refuse what is not the config that a field holds: serde would take a list for one, field by field."""
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
