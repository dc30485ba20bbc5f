"""Spaces of the environments, built from the core's tables of shapes, dtypes and bounds.

A vector observation is a list of columns, each with its size, bounds and unit; its space is a ``Box`` of float32. An
image is one row: kind, camera, shape, dtype, bounds. One name selects one observation; a sequence of names selects a
``Dict``.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Literal, TypedDict

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict
from graspbox._core import Arm, Hand
from graspbox.configs import CamerasConfig
from graspbox.errors import ConfigError

__all__ = [
    "IMAGES",
    "ArrayColumn",
    "Entry",
    "Image",
    "Tables",
    "Term",
    "action_space",
    "columns_of",
    "depth_as_uint8",
    "depth_in_metres",
    "entries",
    "goal_space",
    "image_names",
    "images",
    "observation_space",
    "size",
    "tables",
    "terms",
]

#: Kinds of images; ``kind_camera`` names the image of one camera.
IMAGES = tuple(_core.image_kinds())


class ArrayColumn(TypedDict):
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

    actions: list[ArrayColumn]
    observations: dict[str, list[ArrayColumn]]
    terms: list[Term]
    info: list[Entry]


class GoalTables(TypedDict):
    """Observations of the goal, reward terms and infos of environments with goals."""

    observations: dict[str, list[ArrayColumn]]
    terms: list[Term]
    info: list[Entry]


class Tables(TypedDict):
    """Tables of a hand's environments.

    ``actions`` and ``observations`` are keyed by the names of control mode and fingers.

    ``absent`` names the observations of sensors that the hand lacks; no space contains them.
    """

    actions: dict[str, dict[str, list[ArrayColumn]]]
    observations: dict[str, dict[str, dict[str, list[ArrayColumn]]]]
    decision: Decision
    point: Decision
    clear: Decision
    goal: GoalTables
    privileged: list[str]
    absent: list[str]
    terms: list[Term]
    info: list[Entry]
    target_info: list[Entry]
    failures: list[str]
    workspace: list[list[float]]
    stop_force: float
    randomization: dict[str, Any]


@cache
def tables(hand: Hand, arm: Arm | None = None) -> Tables:
    """Return the tables of a hand's environments, those on an arm if there is one; do not modify them."""
    found: Tables = _core.env_tables(hand, arm)
    return found


def image_names(obs: str | Iterable[str]) -> tuple[str, ...]:
    """Pick the names of images, in order; the core checks whether their cameras exist."""
    names = (obs,) if isinstance(obs, str) else tuple(obs)
    return tuple(name for name in names if name.split("_")[0] in IMAGES)


def images(hand: Hand, cameras: CamerasConfig, objects: int = 1, arm: Arm | None = None) -> list[Image]:
    """Return a row for each image in a config; `objects` is the greatest number of objects in a scene."""
    rows: list[Image] = _core.image_tables(hand, config_dict(cameras), objects, arm)
    return rows


def coarse_depth(row: Image, limits: tuple[float, float]) -> Image:
    """Return the row of a depth image as uint8 between two limits."""
    near, far = limits
    unit = f"{(far - near) / 254:g} m from {near:g} m at 1"
    return {**row, "dtype": "uint8", "low": [0], "high": [255], "unit": unit}


def depth_as_uint8(depth: NDArray[np.float32], limits: tuple[float, float]) -> NDArray[np.uint8]:
    """Convert depth in metres, 0 where it is missing, to uint8, as the keyword ``depth_limits`` does.

    Parameters
    ----------
    depth : array of float32
        Metres.
    limits : pair of float
        Near and far limit, metres: 1 is the near one or less, 255 the far one or more. 0 still means missing.
    """
    near, far = limits
    shares = np.clip((depth - np.float32(near)) * np.float32(1.0 / (far - near)), 0.0, 1.0)
    codes: NDArray[np.uint8] = np.where(depth > 0, np.rint(1.0 + 254.0 * shares), 0.0).astype(np.uint8)
    return codes


def depth_in_metres(codes: NDArray[np.uint8], limits: tuple[float, float]) -> NDArray[np.float32]:
    """Convert what `depth_as_uint8` returned to metres: off by at most 1/508 of the range, 0 where it is missing."""
    near, far = limits
    metres = np.float32(near) + (codes.astype(np.float32) - 1.0) * np.float32((far - near) / 254)
    return np.where(codes > 0, metres, np.float32(0.0)).astype(np.float32)


def image_space(row: Image) -> gymnasium.Space[Any]:
    dtype = np.dtype(row["dtype"])
    low, high = (np.full(row["shape"], bound, dtype=dtype) for bound in (row["low"], row["high"]))
    return gymnasium.spaces.Box(low, high, dtype=dtype.type)


def _bounds(columns: Sequence[ArrayColumn]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lower and upper bound of every entry of a vector."""
    sizes = [column["size"] for column in columns]
    low = np.repeat(np.array([column["low"] for column in columns], dtype=np.float32), sizes)
    high = np.repeat(np.array([column["high"] for column in columns], dtype=np.float32), sizes)
    return low, high


def observation_names(obs: str | Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """Return the names in `obs`; ConfigError for an unknown name, a repeated name, or none."""
    names = (obs,) if isinstance(obs, str) else tuple(obs)
    choices = tuple(known)
    for name in names:
        if name not in choices:
            raise ConfigError(f"there is no observation {name!r}; choose from {', '.join(choices)}")
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"obs is {obs!r}; name at least one observation, and each once")
    return names


def columns_of(control: str, fingers: str, found: Tables) -> tuple[list[ArrayColumn], dict[str, list[ArrayColumn]]]:
    """Return the columns of the actions and observations of a control mode and fingers.

    The modes ``"grasp_pose"``, ``"grasp_point"`` and ``"clear"`` have the same ones for all fingers.

    Raises
    ------
    ConfigError
        For an unknown control mode or fingers.
    """
    if (decision := _decision(control, found)) is not None:
        return decision["actions"], decision["observations"]
    if control not in found["actions"]:
        raise ConfigError(f"there is no control mode {control!r}; choose from {', '.join(found['actions'])}")
    if fingers not in found["actions"][control]:
        raise ConfigError(f"there is no fingers {fingers!r}; choose from {', '.join(found['actions'][control])}")
    return found["actions"][control][fingers], found["observations"][control][fingers]


def observation_space(
    obs: str | Iterable[str],
    vectors: Mapping[str, Sequence[ArrayColumn]],
    found: Tables,
    image_rows: Iterable[Image] = (),
) -> gymnasium.Space[Any]:
    """Return the space of one observation, or a ``Dict`` of several.

    `vectors` are columns from `columns_of`, `image_rows` is the result of `images`.

    Raises
    ------
    ConfigError
        As `observation_names`, and for an observation of sensors that the hand lacks.
    """
    for name in (obs,) if isinstance(obs, str) else (obs := tuple(obs)):
        if name in found["absent"]:
            raise ConfigError(f"this hand has no {name} sensors, so there is no observation {name!r}; leave it out")
    pictures = {row["name"]: row for row in image_rows}
    names = observation_names(obs, dict.fromkeys([*vectors, *IMAGES, *pictures]))
    boxes: dict[str, gymnasium.Space[Any]] = {
        name: image_space(pictures[name])
        if name in pictures
        else gymnasium.spaces.Box(*_bounds(vectors[name]), dtype=np.float32)
        for name in names
    }
    return boxes[obs] if isinstance(obs, str) else gymnasium.spaces.Dict(boxes)


def goal_space(observation: gymnasium.Space[Any], found: Tables) -> gymnasium.spaces.Dict:
    """Return the space of an environment with goals: ``observation``, ``achieved_goal`` and ``desired_goal``."""
    goals = {
        name: gymnasium.spaces.Box(*_bounds(columns), dtype=np.float32)
        for name, columns in found["goal"]["observations"].items()
    }
    return gymnasium.spaces.Dict({"observation": observation, **goals})


def size(columns: Sequence[ArrayColumn]) -> int:
    """Count the entries of a vector."""
    return sum(column["size"] for column in columns)


def action_space(actions: Sequence[ArrayColumn]) -> gymnasium.Space[Any]:
    """Return the space of actions with these columns: every entry is in [-1, 1]."""
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
    decisions = {"grasp_pose": found["decision"], "grasp_point": found["point"], "clear": found["clear"]}
    return decisions.get(control)
