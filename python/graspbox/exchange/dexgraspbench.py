"""DexGraspBench (``.npy``): one grasp per file, a pickled dict of arrays.

``pregrasp_qpos``, ``grasp_qpos`` and ``squeeze_qpos`` have 7 numbers of the hand's base link in the world (position,
quaternion w x y z), then the positions of all joints, in the order of the hand's URDF
(`graspbox.exchange.conventions`); ``obj_pose`` has 7 numbers of the object. Metres, radians.

A pickle can run any code when it is read. `read` therefore builds numpy arrays, numbers and texts alone, and refuses
everything else.

Source: JYChen18/DexGraspBench, README and ``output/example_shadow``.
"""

import io
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import read_bounded, write_bytes
from graspbox._common.rotations import poses_from, quaternion_from_rotation, rotation_from_quaternion
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.exchange.checks import number
from graspbox.exchange.conventions import frame_from_hand, mechanism_of
from graspbox.exchange.grasps import ExchangeGrasps, default_preshape

__all__ = ["read", "read_fields", "write"]

Array = NDArray[np.float64]

#: Largest file, bytes; those of the benchmark have a few thousand.
_MAX_BYTES = 64 << 20
_STAGES = ("pregrasp", "grasp", "squeeze")


def write(grasps: ExchangeGrasps, path: Path) -> None:
    """Write a grasp.

    Raises
    ------
    ConfigError
        If there is not exactly one, or its joint positions or the object's pose are not known.
    """
    if len(grasps) != 1:
        raise ConfigError(f"a file of DexGraspBench has 1 grasp, not {len(grasps)}; give a folder, or select one")
    content = fields_of(grasps)
    buffer = io.BytesIO()
    np.save(buffer, np.array(content, dtype=object), allow_pickle=True)
    write_bytes(path, buffer.getvalue())


def fields_of(grasps: ExchangeGrasps) -> dict[str, Any]:
    """Return the entries of the file of the first of `grasps`."""
    if not grasps.closed[0] or np.isnan(grasps.squeeze[0]).any():
        raise ConfigError(
            f"the grasp of {grasps.object_name!r} has no joint positions, which this format stores; simulate it "
            "(`graspbox.exchange.simulated`), and leave out grasps at which the hand collides (`closed`)"
        )
    if np.isnan(grasps.world_from_object[0]).any():
        raise ConfigError(f"the pose of {grasps.object_name!r} in the world is not known; give world_from_object")
    mechanism = mechanism_of(grasps.hand)
    base = _seven((grasps.world_from_object[:1] @ grasps.object_from("base")[:1])[0])
    stages = {
        f"{stage}_qpos": np.concatenate([base, mechanism.all_positions(getattr(grasps, stage)[:1])[0]])
        for stage in _STAGES
    }
    return {
        "obj_pose": _seven(grasps.world_from_object[0]),
        "obj_scale": grasps.scale,
        "obj_path": grasps.mesh_file or grasps.object_name,
        **stages,
    }


def _seven(pose: Array) -> Array:
    return np.concatenate([pose[:3, 3], quaternion_from_rotation(pose[None, :3, :3])[0]])


def read(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read a grasp; its pose is that of ``grasp_qpos``."""
    fields = read_fields(path)
    mechanism = mechanism_of(hand)
    count = 7 + len(mechanism.joints)
    qpos = {stage: _vector(fields, f"{stage}_qpos", count) for stage in _STAGES}
    world_from_object = _pose(_vector(fields, "obj_pose", 7), "obj_pose")
    world_from_base = _pose(qpos["grasp"][:7], "grasp_qpos")
    file = fields.get("obj_path", "")
    made = ExchangeGrasps.of(
        (np.linalg.inv(world_from_object) @ world_from_base @ frame_from_hand(hand, "base"))[None],
        default_preshape(hand) if preshape is None else preshape,
        hand=hand,
        world_from_object=world_from_object,
        object_name=Path(file).name if isinstance(file, str) else "",
        mesh_file=file if isinstance(file, str) else "",
        scale=number(_plain(fields.get("obj_scale", 1.0)), "obj_scale"),
    )
    for stage in _STAGES:
        getattr(made, stage)[0] = mechanism.independent_positions(qpos[stage][None, 7:])[0]
    return made


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value


def _vector(fields: dict[str, Any], name: str, count: int) -> Array:
    value = fields.get(name)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu" or value.shape != (count,):
        shape = value.shape if isinstance(value, np.ndarray) else None
        raise ConfigError(f"{name} has shape {shape}; this hand needs ({count},): 7 of the base, then its joints")
    if not np.isfinite(value).all():
        raise ConfigError(f"{name} has entries that are not finite")
    return value.astype(np.float64)


def _pose(seven: Array, name: str) -> Array:
    length = float(np.linalg.norm(seven[3:7]))
    if abs(length - 1.0) > 1e-2:
        raise ConfigError(f"the quaternion of {name} has length {length:.4g}; give a unit quaternion")
    return np.asarray(poses_from(seven[None, :3], rotation_from_quaternion(seven[None, 3:7]))[0])


def read_fields(path: Path) -> dict[str, Any]:
    """Read the entries of a file without running its code: arrays, numbers and texts by their names.

    Raises
    ------
    ConfigError
        If it is no such file, or has other contents.
    FileError
        If it cannot be read, or is larger than 64 MiB.
    """
    stream = io.BytesIO(read_bounded(path, _MAX_BYTES))
    try:
        version = np.lib.format.read_magic(stream)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = header(stream)
        if shape != () or dtype != np.dtype(object):
            raise ConfigError(
                f"it has an array of shape {shape} and type {dtype}; those of DexGraspBench have one dict"
            )
        found = _Unpickler(stream).load()
        found = found.value if isinstance(found, _Array) else found
    except ConfigError:
        raise
    except Exception as error:  # a damaged pickle raises nearly anything
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise ConfigError(f"it is not a DexGraspBench file, or is damaged ({reason})") from None
    if not isinstance(found, dict) or not all(isinstance(name, str) for name in found):
        raise ConfigError("its content is not a dict of names and arrays; give a file of DexGraspBench")
    return {name: value.value if isinstance(value, _Array) else value for name, value in found.items()}


class _Unpickler(pickle.Unpickler):
    """Builds stand-ins for numpy arrays and scalars; Python's basic types need no import.

    numpy's own classes are not called: the state of an array or of a type can be forged. Stand-ins check it.
    """

    def find_class(self, module: str, name: str) -> Any:
        """Return the stand-in for one of the five names that pickled arrays use."""
        known = _ALLOWED.get((module.replace("numpy._core", "numpy.core"), name))
        if known is None:
            raise ConfigError(f"it calls {f'{module}.{name}'[:80]!r}; only arrays, numbers and text are read")
        return known

    def persistent_load(self, pid: Any) -> Any:
        """Refuse references to things outside the file."""
        raise ConfigError("it refers to something outside the file; only arrays, numbers and text are read")


_NDARRAY = object()
_TYPES = re.compile(r"[biuf][1248]|O8?|U\d{1,4}")
_UNUSUAL = "it builds an array in an unusual way; only files written by numpy are read"


class _Type:
    """Stand-in for the type of an array."""

    def __init__(self, name: str) -> None:
        self.name, self.order = name, "="

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) < 5 or state[1] not in ("<", ">", "=", "|"):
            raise ConfigError(_UNUSUAL)
        if any(part is not None for part in state[2:5]):
            raise ConfigError("it has an array of records; only numbers and text are read")
        self.order = state[1]

    def of(self, content: Any, shape: Any, order: str) -> Any:
        """Make an array (or the one object in an array without axes) of the content of the file."""
        if not isinstance(shape, tuple) or not all(isinstance(size, int) and size >= 0 for size in shape):
            raise ConfigError(_UNUSUAL)
        if self.name.startswith("O"):
            if shape != () or not isinstance(content, list) or len(content) != 1:
                raise ConfigError("it has an array of objects; only arrays of numbers and text are read")
            return content[0]
        if not isinstance(content, bytes | bytearray):
            raise ConfigError(_UNUSUAL)
        dtype = np.dtype((">" if self.order == ">" else "<") + self.name)
        return np.frombuffer(content, dtype=dtype).reshape(shape, order="F" if order == "F" else "C")


class _Array:
    """Stand-in for an array until its content is read."""

    def __init__(self) -> None:
        self.value: Any = None

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) != 5 or not isinstance(state[2], _Type):
            raise ConfigError(_UNUSUAL)
        _, shape, kind, fortran, content = state
        self.value = kind.of(content, shape, "F" if fortran else "C")


def _dtype(name: Any, align: Any = False, copy: Any = True) -> _Type:
    if not isinstance(name, str) or not _TYPES.fullmatch(name):
        raise ConfigError(f"it has an array of type {str(name)[:40]!r}; only numbers and text are read")
    return _Type(name)


def _reconstruct(kind: Any, shape: Any, code: Any) -> _Array:
    if kind is not _NDARRAY or shape != (0,) or code not in (b"b", "b"):
        raise ConfigError(_UNUSUAL)
    return _Array()


def _scalar(kind: Any, content: Any = b"") -> Any:
    if not isinstance(kind, _Type) or kind.name.startswith("O"):
        raise ConfigError(_UNUSUAL)
    return kind.of(content, (1,), "C")[0]


def _frombuffer(content: Any, kind: Any, shape: Any, order: Any) -> Any:
    if not isinstance(kind, _Type):
        raise ConfigError(_UNUSUAL)
    return kind.of(content, shape, order)


_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy.core.multiarray", "_reconstruct"): _reconstruct,
    ("numpy.core.multiarray", "scalar"): _scalar,
    ("numpy.core.numeric", "_frombuffer"): _frombuffer,
    ("numpy", "ndarray"): _NDARRAY,
    ("numpy", "dtype"): _dtype,
}
