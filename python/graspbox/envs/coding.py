"""Poses in states and actions: read poses from the observation ``state``, encode poses as actions.

| function | result |
|---|---|
| `object_pose` | ``world_from_object`` of a state of either environment |
| `hand_pose` | ``world_from_hand`` of a state of ``Grasp-v0`` |
| `encode_action` | the action that moves the hand to a pose, in any control mode |
| `rotation_from_columns` | a rotation from its first two columns, computed as the core decodes an action |

Column indices and the meaning of actions come from the core's tables (`graspbox.envs.spaces.tables`), so the functions
work for any hand. `Codec` keeps the tables of one hand and control mode.

>>> import gymnasium, graspbox
>>> from graspbox.envs.coding import encode_action, object_pose
>>> env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0").unwrapped
>>> state, info = env.reset(seed=0)
>>> world_from_object = object_pose(state)
>>> plan = graspbox.plan(env.objects[0].load(), world_from_object=world_from_object)
>>> action = encode_action(world_from_object @ plan.poses[0], plan.preshape[0])
>>> env.step(action)[1]
1.0
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._core import Hand
from graspbox.envs import spaces
from graspbox.envs.motion import rotation_vector
from graspbox.errors import ConfigError
from graspbox.simulation import load_hand

__all__ = ["Codec", "encode_action", "hand_pose", "object_pose", "rotation_from_columns"]

Pose = NDArray[np.float64]
HandArgument = str | Hand | tuple[str, str]

#: Columns are degenerate if the first is shorter than this, or if the sine of the angle between them is smaller.
_DEGENERATE = 1e-3
#: Axis of the position for each action entry that holds a coordinate.
_AXES = {"x": 0, "y": 1, "z": 2}


def rotation_from_columns(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Make a rotation (3, 3) from its first two columns by Gram-Schmidt, in this order; None if they are degenerate."""
    length = np.linalg.norm(first)
    if length < _DEGENERATE:
        return None
    x = first / length
    rest = second - x * (x @ second)
    if np.linalg.norm(rest) < _DEGENERATE * max(1.0, float(np.linalg.norm(second))):
        return None
    y = rest / np.linalg.norm(rest)
    return np.stack([x, y, np.cross(x, y)], axis=1)


class Codec:
    """Reads states and encodes actions of one hand in one control mode.

    Parameters
    ----------
    control : {"twist", "delta_pose", "target_pose", "grasp_pose"}
        The control mode; ``GraspPose-v0`` uses ``grasp_pose``.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    vector : {"state", "proprio"}
        The observation to read.

    Raises
    ------
    ConfigError
        For an unknown control mode.
    """

    def __init__(self, control: str, hand: HandArgument = "reflex", vector: str = "state") -> None:
        found = spaces.tables(load_hand(hand))
        self._control, self._period, self._vector = control, found["control_period"], vector
        self._actions, observations = spaces.columns_of(control, found)
        self._places: dict[str, slice] = {}
        self.state_size = 0
        for row in observations[vector]:
            self._places[row["name"]] = slice(self.state_size, self.state_size + row["size"])
            self.state_size += row["size"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the observation's columns."""
        return tuple(self._places)

    def column(self, state: ArrayLike, name: str) -> NDArray[np.float64]:
        """Read a column of an observation by its name in the table of observations.

        Raises
        ------
        ConfigError
            If the observation has another size, or no such column.
        """
        values = np.asarray(state, dtype=np.float64)
        if values.shape != (self.state_size,):
            raise ConfigError(
                f"the {self._vector} has shape {values.shape}; control mode {self._control!r} with "
                f"obs={self._vector!r} gives {self.state_size} numbers"
            )
        if name not in self._places:
            known = ", ".join(self._places)
            raise ConfigError(
                f"a {self._vector} of control mode {self._control!r} has no column {name!r}; choose from {known}"
            )
        return values[self._places[name]]

    def pose(self, state: ArrayLike, name: str) -> Pose:
        """Read the pose (4, 4) given by the columns ``{name}_position`` and ``{name}_rotation``.

        Rounding to float32 leaves the rotation slightly non-orthonormal; it is projected back to SO(3).

        Raises
        ------
        ConfigError
            As `column`, or if the two columns of the rotation are degenerate.
        """
        columns = self.column(state, f"{name}_rotation")
        rotation = rotation_from_columns(columns[:3], columns[3:])
        if rotation is None:
            raise ConfigError(f"{name}_rotation of the {self._vector} is {columns}; they are degenerate")
        pose = np.eye(4)
        pose[:3, 3], pose[:3, :3] = self.column(state, f"{name}_position"), rotation
        return pose

    def encode_action(
        self,
        world_from_hand: ArrayLike,
        preshape: float,
        *,
        actuator_speed: ArrayLike = 0.0,
        world_from_start: ArrayLike | None = None,
        frame_skip: int = 1,
    ) -> NDArray[np.float32]:
        """Encode a pose as an action: see the function `encode_action`."""
        goal = np.asarray(world_from_hand, dtype=np.float64)
        start = None if world_from_start is None else np.asarray(world_from_start, dtype=np.float64)
        for name, pose in (("world_from_hand", goal), ("world_from_start", start)):
            if pose is not None and pose.shape != (4, 4):
                raise ConfigError(f"{name} has shape {pose.shape}; give a pose (4, 4)")
        count = sum(row["name"] == "actuator" for row in self._actions)
        speed = np.asarray(actuator_speed, dtype=np.float64)
        if speed.shape not in ((), (count,)) and count:
            raise ConfigError(
                f"actuator_speed has shape {speed.shape}; give a number, or one for each of {count} actuators"
            )
        speeds = iter(np.broadcast_to(speed, count) if count else np.zeros(0))
        values: list[ArrayLike] = []
        for row in self._actions:
            name, low, high = row["name"], row["low"], row["high"]
            if name in _AXES:
                values.append((goal[_AXES[name] : _AXES[name] + 1, 3] - low) / (high - low) * 2 - 1)
            elif name == "rotation":
                values.append(goal[:3, :2].T.ravel())
            elif name == "preshape":
                values.append([(preshape - low) / (high - low) * 2 - 1])
            elif name == "actuator":
                values.append([next(speeds) / high])
            else:
                values.append(self._motion(name, start, goal, high, frame_skip))
        action: NDArray[np.float32] = np.clip(np.concatenate(values), -1, 1).astype(np.float32)
        return action

    def decode_grasp(self, action: ArrayLike) -> tuple[Pose, float]:
        """Read the hand's pose (4, 4) and the preshape of an action of ``GraspPose-v0``, as the core decodes it.

        Raises
        ------
        ConfigError
            If this is the codec of another control mode, the action has another size, or its rotation is degenerate.
        """
        values = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        size = sum(row["size"] for row in self._actions)
        if self._control != "grasp_pose" or values.shape != (size,):
            raise ConfigError(f"the action has shape {values.shape}; give one of control mode 'grasp_pose' ({size},)")
        pose, preshape, first = np.eye(4), 0.0, 0
        for row in self._actions:
            part = values[first : first + row["size"]]
            first += row["size"]
            scaled = row["low"] + (part + 1) / 2 * (row["high"] - row["low"])
            if row["name"] in _AXES:
                pose[_AXES[row["name"]], 3] = scaled[0]
            elif row["name"] == "rotation":
                rotation = rotation_from_columns(part[:3], part[3:])
                if rotation is None:
                    raise ConfigError(f"the rotation of the action is {part}; its columns are degenerate")
                pose[:3, :3] = rotation
            elif row["name"] == "preshape":
                preshape = float(scaled[0])
        return pose, preshape

    def _motion(self, name: str, start: Pose | None, goal: Pose, limit: float, frame_skip: int) -> NDArray[np.float64]:
        """Entries of a motion from one pose to another, in the axes of the first, as shares of the limit."""
        if start is None:
            raise ConfigError(f"an action of control mode {self._control!r} is a motion; give world_from_start too")
        turned_back = start[:3, :3].T
        # A velocity holds for the whole step; `step` and `turn` are applied once per control period.
        time = self._period * frame_skip if name in ("linear", "angular") else float(frame_skip)
        if name in ("linear", "step"):
            return np.asarray(turned_back @ (goal[:3, 3] - start[:3, 3]) / (limit * time))
        return rotation_vector(turned_back @ goal[:3, :3]) / (limit * time)


@lru_cache(maxsize=64)
def _codec(control: str, hand: str | Hand) -> Codec:
    return Codec(control, hand)


def codec(control: str, hand: HandArgument) -> Codec:
    """Return the codec of a control mode and a hand; codecs are cached unless the hand is a pair of paths."""
    return Codec(control, hand) if isinstance(hand, tuple) else _codec(control, hand)


def _codec_for(state: ArrayLike, control: str | None, hand: HandArgument) -> Codec:
    """Return the codec for a state; without a control mode, the first one whose states have this size."""
    if control is not None:
        return codec(control, hand)
    loaded = load_hand(hand) if isinstance(hand, tuple) else hand
    modes = (*spaces.tables(load_hand(loaded))["actions"], "grasp_pose")
    shape = np.shape(state)
    found = [codec(mode, loaded) for mode in modes]
    for one in found:
        if shape == (one.state_size,):
            return one
    sizes = ", ".join(f"{one.state_size} ({mode})" for mode, one in zip(modes, found, strict=True))
    raise ConfigError(f"the state has shape {shape}; obs='state' has length {sizes}")


def object_pose(state: ArrayLike, *, control: str | None = None, hand: HandArgument = "reflex") -> Pose:
    """Read the object's pose from a state of either environment.

    Parameters
    ----------
    state : (n,) array_like
        The observation ``state``.
    control : str, optional
        The control mode; by default it follows from the size of the state (modes with states of the same size have the
        poses in the same columns).
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.

    Returns
    -------
    (4, 4) float64
        ``world_from_object``; its rotation is orthonormal to float64.

    Raises
    ------
    ConfigError
        If `state` is not a state of the hand, or the columns of its rotation are degenerate.
    """
    return _codec_for(state, control, hand).pose(state, "object")


def hand_pose(state: ArrayLike, *, control: str | None = None, hand: HandArgument = "reflex") -> Pose:
    """Read ``world_from_hand`` (4, 4), as the arm measures it, from a state of ``Grasp-v0``.

    Parameters are those of `object_pose`.

    Raises
    ------
    ConfigError
        As `object_pose`; also for a state of ``GraspPose-v0``, which does not contain the hand's pose.
    """
    return _codec_for(state, control, hand).pose(state, "hand")


def encode_action(
    world_from_hand: ArrayLike,
    preshape: float,
    *,
    control: str = "grasp_pose",
    hand: HandArgument = "reflex",
    actuator_speed: ArrayLike = 0.0,
    world_from_start: ArrayLike | None = None,
    frame_skip: int = 1,
) -> NDArray[np.float32]:
    """Encode a pose of the hand as an action.

    Parameters
    ----------
    world_from_hand : (4, 4) array_like
        Target pose of the grasp frame. Entries beyond the limits of the action space are clipped.
    preshape : float
        See `graspbox.Hand.preshape_limits`; ignored for a hand without preshapes.
    control : {"grasp_pose", "twist", "delta_pose", "target_pose"}
        The control mode; by default that of ``GraspPose-v0``.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    actuator_speed : float or (k,) array_like
        Speed of each actuator except the preshape's, rad/s or m/s; positive closes. ``grasp_pose`` ignores it.
    world_from_start : (4, 4) array_like, optional
        Start of the motion; required by ``twist`` (the present pose of the hand) and ``delta_pose`` (the goal of the
        last action).
    frame_skip : int
        Control periods per step, as in the environment.

    Returns
    -------
    (n,) float32
        The action, in [-1, 1].

    Raises
    ------
    ConfigError
        For a pose of another shape, or if `world_from_start` is missing.
    """
    return codec(control, hand).encode_action(
        world_from_hand,
        preshape,
        actuator_speed=actuator_speed,
        world_from_start=world_from_start,
        frame_skip=frame_skip,
    )
