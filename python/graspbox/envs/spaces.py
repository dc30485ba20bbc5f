"""Spaces of the environments, made from the core's tables: one place for shapes, dtypes and bounds.

A vector observation is a list of fields, each with its size, bounds and unit; its space is a ``Box`` of float32. An
observation is asked for by name, or several by a sequence of names, which gives a ``Dict``.
"""

import json
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, TypedDict

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._core import Hand
from graspbox.errors import ConfigError

__all__ = ["Field", "Tables", "action_space", "action_table", "observation_space", "observation_table", "tables"]


class Field(TypedDict):
    """Some neighbouring numbers of an observation or an action."""

    name: str
    size: int
    low: float
    high: float
    unit: str
    meaning: str


class Term(TypedDict):
    """A reward term: its range in one step, and what it means."""

    name: str
    low: float
    high: float
    meaning: str


class Tables(TypedDict):
    """What the core says about a hand's environments; observations are by control mode, then by name."""

    actions: dict[str, list[Field]]
    observations: dict[str, dict[str, list[Field]]]
    privileged: list[str]
    terms: list[Term]
    failures: list[str]
    control_period: float
    workspace: list[list[float]]
    stop_force: float
    randomization: dict[str, Any]


@cache
def _parse(text: str) -> Tables:
    found: Tables = json.loads(text)
    return found


def tables(hand: Hand) -> Tables:
    """Everything that the environments of a hand take and give; to be read, not changed."""
    return _parse(_core.agent_tables(hand))


def _bounds(fields: Sequence[Field]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least and greatest value of every number of a vector."""
    sizes = [field["size"] for field in fields]
    low = np.repeat(np.array([field["low"] for field in fields], dtype=np.float32), sizes)
    high = np.repeat(np.array([field["high"] for field in fields], dtype=np.float32), sizes)
    return low, high


def observation_names(obs: str | Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """Find the names that `obs` asks for.

    Raises
    ------
    ConfigError
        For a name that is not known, one that comes twice, or none at all.
    """
    names = (obs,) if isinstance(obs, str) else tuple(obs)
    choices = tuple(known)
    for name in names:
        if name not in choices:
            raise ConfigError(f"there is no observation {name!r}; choose from {', '.join(choices)}")
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"obs is {obs!r}; name at least one observation, and each once")
    return names


def observation_space(obs: str | Iterable[str], control: str, found: Tables) -> gymnasium.Space[Any]:
    """Space of one observation, or a ``Dict`` of several.

    Parameters
    ----------
    obs : str or iterable of str
        Names from the table of observations.
    control : str
        The control mode: the state holds the last action.
    found : Tables
        What `tables` gave.

    Raises
    ------
    ConfigError
        As `observation_names`.
    """
    rows = found["observations"][control]
    names = observation_names(obs, rows)
    boxes: dict[str, gymnasium.Space[Any]] = {
        name: gymnasium.spaces.Box(*_bounds(rows[name]), dtype=np.float32) for name in names
    }
    return boxes[obs] if isinstance(obs, str) else gymnasium.spaces.Dict(boxes)


def size(fields: Sequence[Field]) -> int:
    """Count the numbers of a vector."""
    return sum(field["size"] for field in fields)


def action_space(control: str, found: Tables) -> gymnasium.Space[Any]:
    """Space of the actions of a control mode: every number in [-1, 1].

    Raises
    ------
    ConfigError
        For a mode that does not exist.
    """
    if control not in found["actions"]:
        raise ConfigError(f"there is no control mode {control!r}; choose from {', '.join(found['actions'])}")
    return gymnasium.spaces.Box(-1.0, 1.0, (size(found["actions"][control]),), dtype=np.float32)


def _place(first: int, size: int) -> str:
    return str(first) if size == 1 else f"{first}-{first + size - 1}"


def _number(value: float) -> str:
    known = {round(np.pi, 6): "pi", round(np.pi / 2, 6): "pi/2"}
    return known.get(round(value, 6), f"{value:g}")


def action_table(control: str, found: Tables) -> str:
    """Write the table of a control mode's actions, as Markdown."""
    lines = ["| index | name | -1 | 1 | unit | meaning |", "|---|---|---|---|---|---|"]
    first = 0
    for row in found["actions"][control]:
        cells = (_place(first, row["size"]), row["name"], _number(row["low"]), _number(row["high"]), row["unit"])
        lines.append(f"| {' | '.join(cells)} | {row['meaning']} |")
        first += row["size"]
    return "\n".join(lines)


def observation_table(control: str, found: Tables) -> str:
    """Write the table of all observations, as Markdown: where each field stands in which observation."""
    columns = found["observations"][control]
    lines = [f"| field | {' | '.join(columns)} | min | max | unit | meaning |", "|---" * (len(columns) + 5) + "|"]
    places: dict[str, dict[str, str]] = {}
    fields: dict[str, Field] = {}
    for name, rows in columns.items():
        first = 0
        for row in rows:
            places.setdefault(row["name"], {})[name] = _place(first, row["size"])
            fields[row["name"]] = row
            first += row["size"]
    for name, row in fields.items():
        where = " | ".join(places[name].get(column, "") for column in columns)
        bounds = f"{_number(row['low'])} | {_number(row['high'])}"
        lines.append(f"| {name} | {where} | {bounds} | {row['unit']} | {row['meaning']} |")
    return "\n".join(lines)
