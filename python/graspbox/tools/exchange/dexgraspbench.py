"""DexGraspBench (``.npy``): one grasp per file, a pickled dict of arrays.

``pregrasp_qpos``, ``grasp_qpos`` and ``squeeze_qpos`` have 7 numbers of the hand's base link in the world (position,
quaternion w x y z), then the positions of all joints, in the order of the hand's URDF
(`graspbox.hands.conventions`); ``obj_pose`` has 7 numbers of the object. Metres, radians.

A pickle can run any code when it is read, so this package writes such files and reads none:
``scripts/convert_dexgraspbench.py`` converts files that you trust.

Source: JYChen18/DexGraspBench, README and ``output/example_shadow``.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import write_bytes
from graspbox._common.rotations import poses_from, quaternion_from_rotation, rotation_from_quaternion
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.hands.conventions import frame_from_hand, mechanism_of
from graspbox.tools.exchange.checks import number
from graspbox.tools.exchange.grasps import ExchangeGrasps, mesh_file_in

__all__ = ["grasps_of", "write"]

Array = NDArray[np.float64]

_STAGES = ("pregrasp", "grasp", "squeeze")


def write(grasps: ExchangeGrasps, path: Path) -> None:
    """Write a grasp, whose joint positions and object's pose must be known; the positions are within their limits."""
    if len(grasps) != 1:
        raise ConfigError(f"a file of DexGraspBench has 1 grasp, not {len(grasps)}; pass a folder, or select one")
    if not grasps.closed[0] or np.isnan(grasps.squeeze[0]).any():
        raise ConfigError(
            f"the grasp of {grasps.object_name!r} has no joint positions, which this format stores; simulate it "
            "(`graspbox.tools.exchange.simulated`), and leave out grasps at which the hand collides (`closed`)"
        )
    if np.isnan(grasps.world_from_object[0]).any():
        raise ConfigError(f"the pose of {grasps.object_name!r} in the world is not known; pass world_from_object")
    grasps, mechanism = grasps.within_limits(), mechanism_of(grasps.hand)
    base = _seven((grasps.world_from_object[:1] @ grasps.object_from("base")[:1])[0])
    stages = {
        f"{stage}_qpos": np.concatenate([base, mechanism.all_positions(getattr(grasps, stage)[:1])[0]])
        for stage in _STAGES
    }
    content = {
        "obj_pose": _seven(grasps.world_from_object[0]),
        "obj_scale": grasps.scale,
        "obj_path": grasps.mesh_file or grasps.object_name,
        **stages,
    }
    buffer = io.BytesIO()
    np.save(buffer, np.array(content, dtype=object), allow_pickle=True)
    write_bytes(path, buffer.getvalue())


def _seven(pose: Array) -> Array:
    return np.concatenate([pose[:3, 3], quaternion_from_rotation(pose[None, :3, :3])[0]])


def grasps_of(fields: Mapping[str, Any], hand: Hand, preshape: float | None = None) -> ExchangeGrasps:
    """Make a grasp from the entries of a file; its pose is that of ``grasp_qpos``."""
    mechanism = mechanism_of(hand)
    count = 7 + len(mechanism.joints)
    qpos = {stage: _vector(fields, f"{stage}_qpos", count) for stage in _STAGES}
    world_from_object = _pose(_vector(fields, "obj_pose", 7), "obj_pose")
    world_from_base = _pose(qpos["grasp"][:7], "grasp_qpos")
    path = fields.get("obj_path", "")
    file = path if isinstance(path, str) else ""
    made = ExchangeGrasps.of(
        (np.linalg.inv(world_from_object) @ world_from_base @ frame_from_hand(hand, "base"))[None],
        preshape,
        hand=hand,
        world_from_object=world_from_object,
        object_name=Path(file).name,
        mesh_file=mesh_file_in(file),
        scale=number(_plain(fields.get("obj_scale", 1.0)), "obj_scale"),
    )
    for stage in _STAGES:
        getattr(made, stage)[0] = mechanism.independent_positions(qpos[stage][None, 7:])[0]
    return made


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value


def _vector(fields: Mapping[str, Any], name: str, count: int) -> Array:
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
        raise ConfigError(f"the quaternion of {name} has length {length:.4g}; use a unit quaternion")
    return np.asarray(poses_from(seven[None, :3], rotation_from_quaternion(seven[None, 3:7]))[0])
