"""Poses in states and actions: read poses from the observation ``state``, encode poses as actions.

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

from graspbox._common.rotations import rotation_about
from graspbox._core import Hand
from graspbox.envs import spaces
from graspbox.envs.motion import pose_matrix, rotation_vector
from graspbox.errors import ConfigError
from graspbox.simulation import load_hand

__all__ = ["Codec", "encode_action", "hand_pose", "object_pose", "rotation_from_columns"]

Pose = NDArray[np.float64]
HandArgument = str | Hand | tuple[str, str]

#: Columns are degenerate if the first is shorter than this, or if the sine of the angle between them is smaller.
_DEGENERATE = 1e-3
#: Axis of the position for each action entry that holds a coordinate.
_AXES = {"x": 0, "y": 1, "z": 2}
#: Axis of the grasp centre for each action entry that holds a coordinate of it.
_CENTER_AXES = {f"center_{name}": axis for name, axis in _AXES.items()}
#: Rotation of a hand that faces down with its x along the world's.
_DOWN = np.diag([1.0, -1.0, -1.0])
_UP = np.array([0.0, 0.0, 1.0])
#: Control modes whose actions name a pose and a preshape.
_DECISIONS = ("grasp_pose", "grasp_point", "clear")


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
    control : {"twist", "delta_pose", "target_pose", "top_down", "grasp_pose", "grasp_point"}
        The control mode; the last two are those of ``GraspPose-v0``.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    vector : {"state", "proprio"}
        The observation to read.
    fingers : {"synergy", "each"}
        As in the environment.

    Raises
    ------
    ConfigError
        For an unknown control mode.
    """

    def __init__(
        self, control: str, hand: HandArgument = "reflex", vector: str = "state", *, fingers: str = "synergy"
    ) -> None:
        loaded = load_hand(hand)
        self._control, self._vector = control, vector
        self._closing_speeds, self._center = np.array(loaded.closing_speeds), np.array(loaded.grasp_center)
        self._actions, observations = spaces.columns_of(control, fingers, spaces.tables(loaded))
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
                f"obs={self._vector!r} has {self.state_size} numbers"
            )
        if name not in self._places:
            known = ", ".join(self._places)
            raise ConfigError(
                f"a {self._vector} of control mode {self._control!r} has no column {name!r}; choose from {known}"
            )
        return values[self._places[name]]

    def pose(self, state: ArrayLike, name: str) -> Pose:
        """Read the pose (4, 4) from the columns ``{name}_position`` and ``{name}_rotation``.

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
        return pose_matrix(self.column(state, f"{name}_position"), rotation)

    def encode_action(
        self,
        world_from_hand: ArrayLike,
        preshape: float,
        *,
        actuator_speed: ArrayLike = 0.0,
        world_from_start: ArrayLike | None = None,
        control_freq: float = 5.0,
    ) -> NDArray[np.float32]:
        """Encode a pose as an action: see the function `encode_action`."""
        goal = np.asarray(world_from_hand, dtype=np.float64)
        start = None if world_from_start is None else np.asarray(world_from_start, dtype=np.float64)
        for name, pose in (("world_from_hand", goal), ("world_from_start", start)):
            if pose is not None and pose.shape != (4, 4):
                raise ConfigError(f"{name} has shape {pose.shape}; give a pose (4, 4)")
        count = len(self._closing_speeds)
        speed = np.asarray(actuator_speed, dtype=np.float64)
        if speed.shape not in ((), (count,)):
            raise ConfigError(
                f"actuator_speed has shape {speed.shape}; give a number, or one for each of {count} actuators"
            )
        speed = np.broadcast_to(speed, count)
        speeds = iter(speed)
        values: list[ArrayLike] = []
        for row in self._actions:
            name, low, high = row["name"], row["low"], row["high"]
            if name in _AXES:
                values.append((goal[_AXES[name] : _AXES[name] + 1, 3] - low) / (high - low) * 2 - 1)
            elif name in _CENTER_AXES:
                axis = _CENTER_AXES[name]
                center = goal[axis, :3] @ self._center + goal[axis, 3]
                values.append([(center - low) / (high - low) * 2 - 1])
            elif name == "rotation":
                values.append(goal[:3, :2].T.ravel())
            elif self._control == "grasp_point" and name in ("tilt", "yaw"):
                values.append(_tilt_and_yaw(goal[:3, :3])[name] / high)
            elif name == "preshape":
                values.append([(preshape - low) / (high - low) * 2 - 1])
            elif name == "actuator":
                values.append([next(speeds) / high])
            elif name == "close":
                closing = self._closing_speeds > 0
                values.append([np.mean(speed[closing] / self._closing_speeds[closing])])
            else:
                values.append(self._motion(name, start, goal, high / control_freq))
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
        if self._control not in _DECISIONS or values.shape != (size,):
            raise ConfigError(
                f"the action of control mode {self._control!r} has shape {values.shape}; give one of control mode "
                f"{' or '.join(map(repr, _DECISIONS))}, here ({size},)"
            )
        pose, preshape, first, tilt = np.eye(4), 0.0, 0, np.zeros(3)
        for row in self._actions:
            part = values[first : first + row["size"]]
            first += row["size"]
            scaled = row["low"] + (part + 1) / 2 * (row["high"] - row["low"])
            if row["name"] in _AXES:
                pose[_AXES[row["name"]], 3] = scaled[0]
            elif row["name"] in _CENTER_AXES:
                pose[_CENTER_AXES[row["name"]], 3] = scaled[0]
            elif row["name"] == "tilt":
                tilt[:2] = part / max(1.0, float(np.linalg.norm(part))) * row["high"]
            elif row["name"] == "yaw":
                angle = float(np.linalg.norm(tilt))
                tilted = rotation_about(tilt / angle if angle else _UP, angle)
                pose[:3, :3] = tilted @ rotation_about(_UP, scaled[0]) @ _DOWN
                pose[:3, 3] -= pose[:3, :3] @ self._center
            elif row["name"] == "rotation":
                rotation = rotation_from_columns(part[:3], part[3:])
                if rotation is None:
                    raise ConfigError(f"the rotation of the action is {part}; its columns are degenerate")
                pose[:3, :3] = rotation
            elif row["name"] == "preshape":
                preshape = float(scaled[0])
        return pose, preshape

    def _motion(self, name: str, start: Pose | None, goal: Pose, longest: float) -> NDArray[np.float64]:
        """Entries of a motion from one pose to another, as shares of the longest one in a step."""
        if start is None:
            raise ConfigError(f"an action of control mode {self._control!r} is a motion; give world_from_start too")
        axes = np.eye(3) if self._control == "top_down" else start[:3, :3].T
        if name in ("linear", "step"):
            return np.asarray(axes @ (goal[:3, 3] - start[:3, 3]) / longest)
        if name == "yaw":
            return rotation_vector(goal[:3, :3] @ start[:3, :3].T)[2:] / longest
        return rotation_vector(axes @ goal[:3, :3]) / longest


def _tilt_and_yaw(rotation: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Split a rotation into a tilt, after a yaw, of a hand that faces down; radians."""
    turned = rotation @ _DOWN
    yaw = np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1])
    tilt = rotation_vector(turned @ rotation_about(_UP, yaw).T)
    return {"tilt": tilt[:2], "yaw": np.array([yaw])}


@lru_cache(maxsize=64)
def _codec(control: str, hand: str | Hand, fingers: str) -> Codec:
    return Codec(control, hand, fingers=fingers)


def codec(control: str, hand: HandArgument, fingers: str = "synergy") -> Codec:
    """Return the codec of a control mode, a hand and fingers; cached unless the hand is a pair of paths."""
    return Codec(control, hand, fingers=fingers) if isinstance(hand, tuple) else _codec(control, hand, fingers)


def _codec_for(state: ArrayLike, control: str | None, hand: HandArgument) -> Codec:
    """Return the first codec whose states have the size of a state, of a control mode if one is named."""
    loaded = load_hand(hand) if isinstance(hand, tuple) else hand
    closed_loop = spaces.tables(load_hand(loaded))["actions"]
    modes = [(mode, fingers) for mode, by_fingers in closed_loop.items() for fingers in by_fingers]
    modes += [("grasp_pose", "synergy"), ("grasp_point", "synergy")]
    found = [codec(mode, loaded, fingers) for mode, fingers in modes if control in (None, mode)]
    if not found:
        return codec(str(control), loaded)
    shape = np.shape(state)
    for one in found:
        if shape == (one.state_size,):
            return one
    sizes = ", ".join(dict.fromkeys(f"{one.state_size}" for one in found))
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
    fingers: str = "synergy",
    hand: HandArgument = "reflex",
    actuator_speed: ArrayLike = 0.0,
    world_from_start: ArrayLike | None = None,
    control_freq: float = 5.0,
) -> NDArray[np.float32]:
    """Encode a pose of the hand as an action.

    Parameters
    ----------
    world_from_hand : (4, 4) array_like
        Target pose of the grasp frame. Entries beyond the limits of the action space are clipped.
    preshape : float
        See `graspbox.Hand.preshape_limits`; ignored for a hand without preshapes.
    control : {"grasp_pose", "grasp_point", "twist", "delta_pose", "target_pose", "top_down"}
        The control mode; by default that of ``GraspPose-v0``. ``top_down`` encodes position and yaw only.
    fingers : {"synergy", "each"}
        As in the environment.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    actuator_speed : float or (k,) array_like
        Speed of each actuator except the preshape's, rad/s or m/s; positive closes. Decisions ignore it;
        ``fingers="synergy"`` takes the mean share of `graspbox.Hand.closing_speeds`.
    world_from_start : (4, 4) array_like, optional
        Start of the motion; required by ``twist`` and ``top_down`` (the present pose of the hand) and ``delta_pose``
        (the goal of the last action).
    control_freq : float
        Actions per second, as in the environment.

    Returns
    -------
    (n,) float32
        The action, in [-1, 1].

    Raises
    ------
    ConfigError
        For a pose of another shape, or if `world_from_start` is missing.
    """
    return codec(control, hand, fingers).encode_action(
        world_from_hand,
        preshape,
        actuator_speed=actuator_speed,
        world_from_start=world_from_start,
        control_freq=control_freq,
    )
