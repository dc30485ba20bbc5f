"""Poses in states and actions: read one off the observation ``state``, write one as an action of a control mode.

| function | what it does |
|---|---|
| `object_pose` | ``world_from_object`` of a state of either environment |
| `hand_pose` | ``world_from_hand`` of a state of ``Grasp-v0`` |
| `encode_action` | the action that moves the hand to a pose, in any control mode |
| `rotation_from_columns` | a rotation from two columns, as the core makes it from an action |

The places of columns and the meaning of actions come from the core's tables (`graspbox.envs.spaces.tables`), so that
all of it holds for any hand. `Codec` does the same for one hand and control mode without looking them up again.

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

#: A direction shorter than this, or two directions with a smaller sine between them, name no rotation.
_DEGENERATE = 1e-3
#: Entries of an action by the axis of the position that they hold.
_AXES = {"x": 0, "y": 1, "z": 2}


def rotation_from_columns(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Make a rotation (3, 3) from its first two columns, by Gram-Schmidt in this order; None where they name none."""
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
    """States and actions of one hand in one control mode.

    Parameters
    ----------
    control : {"twist", "delta_pose", "target_pose", "grasp_pose"}
        The control mode; ``grasp_pose`` is that of ``GraspPose-v0``.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    vector : {"state", "proprio"}
        The observation that it reads.

    Raises
    ------
    ConfigError
        For a mode that does not exist.
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
        """Names of the columns of the observation that it reads."""
        return tuple(self._places)

    def column(self, state: ArrayLike, name: str) -> NDArray[np.float64]:
        """Read a column of a state (or of the other vector), by its name in the table of observations.

        Raises
        ------
        ConfigError
            If the state has another size, or no such field.
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
        """Read the pose (4, 4) whose fields are ``{name}_position`` and ``{name}_rotation``.

        The columns of a state are float32 and so slightly non-orthonormal; they are projected back to SO(3).

        Raises
        ------
        ConfigError
            As `column`, or if the columns name no rotation.
        """
        columns = self.column(state, f"{name}_rotation")
        rotation = rotation_from_columns(columns[:3], columns[3:])
        if rotation is None:
            raise ConfigError(f"{name}_rotation of the {self._vector} is {columns}; these columns name no rotation")
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
        """Write a pose as an action: see the function `encode_action`."""
        goal = np.asarray(world_from_hand, dtype=np.float64)
        start = None if world_from_start is None else np.asarray(world_from_start, dtype=np.float64)
        for name, pose in (("world_from_hand", goal), ("world_from_start", start)):
            if pose is not None and pose.shape != (4, 4):
                raise ConfigError(f"{name} has shape {pose.shape}; give a pose (4, 4)")
        count = sum(row["name"] == "actuator" for row in self._actions)
        given = np.asarray(actuator_speed, dtype=np.float64)
        if given.shape not in ((), (count,)) and count:
            raise ConfigError(
                f"actuator_speed has shape {given.shape}; give a number, or one for each of {count} actuators"
            )
        speeds = iter(np.broadcast_to(given, count) if count else np.zeros(0))
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

    def _motion(self, name: str, start: Pose | None, goal: Pose, limit: float, frame_skip: int) -> NDArray[np.float64]:
        """Share of the limit that a motion from one pose to another takes, in the axes of the first."""
        if start is None:
            raise ConfigError(f"an action of control mode {self._control!r} is a motion; give world_from_start too")
        turned_back = start[:3, :3].T
        # Rates are followed for all of the step, steps are those of one control period.
        time = self._period * frame_skip if name in ("linear", "angular") else float(frame_skip)
        if name in ("linear", "step"):
            return np.asarray(turned_back @ (goal[:3, 3] - start[:3, 3]) / (limit * time))
        return rotation_vector(turned_back @ goal[:3, :3]) / (limit * time)


@lru_cache(maxsize=64)
def _codec(control: str, hand: str | Hand) -> Codec:
    return Codec(control, hand)


def codec(control: str, hand: HandArgument) -> Codec:
    """Find the codec of a control mode and a hand; one of a hand that was loaded is kept."""
    return Codec(control, hand) if isinstance(hand, tuple) else _codec(control, hand)


def _codec_for(state: ArrayLike, control: str | None, hand: HandArgument) -> Codec:
    """Find the codec for a state, by its size where no control mode is given."""
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
    raise ConfigError(
        f"the state has shape {shape}; obs='state' gives as many numbers as the control mode has: {sizes}"
    )


def object_pose(state: ArrayLike, *, control: str | None = None, hand: HandArgument = "reflex") -> Pose:
    """Read the object's pose off a state of either environment.

    Parameters
    ----------
    state : (n,) array_like
        The observation ``state``.
    control : str, optional
        The control mode; by default the one whose states have this size (where several do, their poses are in the same
        columns).
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.

    Returns
    -------
    (4, 4) float64
        ``world_from_object``; its rotation is orthonormal to float64.

    Raises
    ------
    ConfigError
        If it is not a state, or its columns name no rotation.
    """
    return _codec_for(state, control, hand).pose(state, "object")


def hand_pose(state: ArrayLike, *, control: str | None = None, hand: HandArgument = "reflex") -> Pose:
    """Read ``world_from_hand`` (4, 4) as the arm knows it off a state of ``Grasp-v0``; parameters as `object_pose`.

    Raises
    ------
    ConfigError
        As `object_pose`; also for a state of ``GraspPose-v0``, which holds no pose of the hand.
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
    """Write a pose of the hand as an action.

    Parameters
    ----------
    world_from_hand : (4, 4) array_like
        Pose of the grasp frame that the hand is to reach. What lies beyond the limits of the action space is clipped.
    preshape : float
        See `graspbox.Hand.preshape_limits`; a hand without preshapes needs none.
    control : {"grasp_pose", "twist", "delta_pose", "target_pose"}
        The control mode; by default that of ``GraspPose-v0``.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    actuator_speed : float or (k,) array_like
        Speed of each actuator but the preshape's, rad/s or m/s; positive closes. ``grasp_pose`` does without.
    world_from_start : (4, 4) array_like, optional
        Where the motion of ``twist`` (where the hand is) or of ``delta_pose`` (where the last action led) begins.
    frame_skip : int
        That of the environment: a motion may take this many control periods.

    Returns
    -------
    (n,) float32
        In [-1, 1].

    Raises
    ------
    ConfigError
        For a pose of another shape, or a motion without its start.
    """
    return codec(control, hand).encode_action(
        world_from_hand,
        preshape,
        actuator_speed=actuator_speed,
        world_from_start=world_from_start,
        frame_skip=frame_skip,
    )
