"""Spaces of the environments, built from the core's tables of shapes, dtypes and bounds.

A vector observation is a list of columns, each with its size, bounds and unit; its space is a ``Box`` of float32. An
image is one row: kind, camera, shape, dtype, bounds. One name selects one observation; a sequence of names selects a
``Dict``.
"""

import json
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, Literal, TypedDict

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._core import Hand
from graspbox.configs import CamerasConfig
from graspbox.errors import ConfigError
from graspbox.meshes import to_json

__all__ = [
    "IMAGES",
    "Column",
    "Entry",
    "Image",
    "Tables",
    "Term",
    "action_space",
    "columns_of",
    "entries",
    "image_names",
    "images",
    "observation_space",
    "size",
    "tables",
    "terms",
]

#: Kinds of images; ``kind_camera`` names the image of one camera.
IMAGES = tuple(_core.image_kinds())


class Column(TypedDict):
    """Consecutive entries of an observation or an action."""

    name: str
    size: int
    low: float
    high: float
    unit: str
    meaning: str
    privileged: bool


class Image(TypedDict):
    """An image. A single bound applies to all channels."""

    name: str
    kind: str
    shape: list[int]
    dtype: str
    low: list[float]
    high: list[float]
    cameras: list[str]
    frame: str
    unit: str
    missing: str
    meaning: str
    privileged: bool


class Term(TypedDict):
    """A reward term: its range per step, and its meaning."""

    name: str
    low: float
    high: float
    meaning: str


class Entry(TypedDict):
    """An entry of the info: its dtype (``bool``, ``float64``, ``int64`` or ``str``), its unit and its meaning.

    The arrays of a ``str`` hold indices into a list of names: ``failures`` or ``objects``.
    """

    name: str
    dtype: str
    names: Literal["failures", "objects"] | None
    unit: str
    meaning: str


class Decision(TypedDict):
    """Actions, observations, reward terms and infos of environments with one decision per episode."""

    actions: list[Column]
    observations: dict[str, list[Column]]
    terms: list[Term]
    info: list[Entry]


class Tables(TypedDict):
    """Tables of a hand's environments; ``observations`` are keyed by control mode, then by name.

    ``absent`` names the observations of sensors that the hand lacks; no space contains them.
    """

    actions: dict[str, list[Column]]
    observations: dict[str, dict[str, list[Column]]]
    decision: Decision
    clear: Decision
    privileged: list[str]
    absent: list[str]
    terms: list[Term]
    info: list[Entry]
    target_info: list[Entry]
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
    """Return the tables of a hand's environments; do not modify them."""
    return _parse(_core.agent_tables(hand))


def image_names(obs: str | Iterable[str]) -> tuple[str, ...]:
    """Pick the names of images, in order; the core checks whether their cameras exist."""
    names = (obs,) if isinstance(obs, str) else tuple(obs)
    return tuple(name for name in names if name.split("_")[0] in IMAGES)


def images(hand: Hand, cameras: CamerasConfig, objects: int = 1) -> list[Image]:
    """Return a row for each image in a config; `objects` is the greatest number of objects in a scene.

    Raises
    ------
    ConfigError
        For an invalid image or camera.
    """
    rows: list[Image] = json.loads(_core.image_tables(hand, to_json(cameras), objects))
    return rows


def image_space(row: Image) -> gymnasium.Space[Any]:
    dtype = np.dtype(row["dtype"])
    low, high = (np.full(row["shape"], bound, dtype=dtype) for bound in (row["low"], row["high"]))
    return gymnasium.spaces.Box(low, high, dtype=dtype.type)


def _bounds(columns: Sequence[Column]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lower and upper bound of every entry of a vector."""
    sizes = [column["size"] for column in columns]
    low = np.repeat(np.array([column["low"] for column in columns], dtype=np.float32), sizes)
    high = np.repeat(np.array([column["high"] for column in columns], dtype=np.float32), sizes)
    return low, high


def observation_names(obs: str | Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """Return the names in `obs`.

    Raises
    ------
    ConfigError
        For an unknown name, a repeated name, or no name at all.
    """
    names = (obs,) if isinstance(obs, str) else tuple(obs)
    choices = tuple(known)
    for name in names:
        if name not in choices:
            raise ConfigError(f"there is no observation {name!r}; choose from {', '.join(choices)}")
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"obs is {obs!r}; name at least one observation, and each once")
    return names


def columns_of(control: str, found: Tables) -> tuple[list[Column], dict[str, list[Column]]]:
    """Return the columns of the actions and observations of a control mode, of ``"grasp_pose"``, or of ``"clear"``.

    Raises
    ------
    ConfigError
        For an unknown control mode.
    """
    if (decision := _decision(control, found)) is not None:
        return decision["actions"], decision["observations"]
    if control not in found["actions"]:
        raise ConfigError(f"there is no control mode {control!r}; choose from {', '.join(found['actions'])}")
    return found["actions"][control], found["observations"][control]


def observation_space(
    obs: str | Iterable[str], control: str, found: Tables, image_rows: Iterable[Image] = ()
) -> gymnasium.Space[Any]:
    """Return the space of one observation, or a ``Dict`` of several.

    Parameters
    ----------
    obs : str or iterable of str
        Names from the table of observations.
    control : str
        The control mode: the state contains the last action.
    found : Tables
        The result of `tables`.
    image_rows : iterable of Image
        The result of `images`.

    Raises
    ------
    ConfigError
        As `observation_names`, and for an observation of sensors that the hand lacks.
    """
    for name in (obs,) if isinstance(obs, str) else (obs := tuple(obs)):
        if name in found["absent"]:
            raise ConfigError(f"this hand has no {name} sensors, so there is no observation {name!r}; leave it out")
    _, vectors = columns_of(control, found)
    pictures = {row["name"]: row for row in image_rows}
    names = observation_names(obs, dict.fromkeys([*vectors, *IMAGES, *pictures]))
    boxes: dict[str, gymnasium.Space[Any]] = {
        name: image_space(pictures[name])
        if name in pictures
        else gymnasium.spaces.Box(*_bounds(vectors[name]), dtype=np.float32)
        for name in names
    }
    return boxes[obs] if isinstance(obs, str) else gymnasium.spaces.Dict(boxes)


def size(columns: Sequence[Column]) -> int:
    """Count the entries of a vector."""
    return sum(column["size"] for column in columns)


def action_space(control: str, found: Tables) -> gymnasium.Space[Any]:
    """Return the action space of a control mode: every entry in [-1, 1].

    Raises
    ------
    ConfigError
        For an unknown control mode.
    """
    actions, _ = columns_of(control, found)
    return gymnasium.spaces.Box(-1.0, 1.0, (size(actions),), dtype=np.float32)


def terms(control: str, found: Tables) -> list[Term]:
    """Return the reward terms of a control mode, without those that are always 0."""
    return (_decision(control, found) or found)["terms"]


def entries(control: str, found: Tables, several: bool = False) -> list[Entry]:
    """Return the info entries of a control mode, and of one target among several objects."""
    shared = (_decision(control, found) or found)["info"]
    return [*shared, *found["target_info"]] if several and control != "clear" else shared


def _decision(control: str, found: Tables) -> Decision | None:
    """Return the tables of a control mode whose steps are decisions; None for another one."""
    return {"grasp_pose": found["decision"], "clear": found["clear"]}.get(control)
