"""Isaac Grasp (YAML): poses of the base link in the object's frame, and positions of the independent joints.

Sources: NVIDIA, "Isaac Sim: Grasp Editor", https://docs.isaacsim.omniverse.nvidia.com, and "Isaac Grasp File",
https://nvidia-isaac-ros.github.io; NVlabs/GraspGen, ``grasp_gen/dataset/eval_utils.py``.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded, write_text
from graspbox._common.rotations import poses_from, quaternion_from_rotation, rotation_from_quaternion
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.hands.conventions import convention_of, frame_from_hand, mechanism_of
from graspbox.tools.exchange.checks import number, optional_package, text
from graspbox.tools.exchange.grasps import MAX_GRASPS, ExchangeGrasps

__all__ = ["read", "write"]

_FORMAT, _VERSION = "isaac_grasp", 1.0
#: Entry of graspbox with the object's mesh file and scale, and its mass; other programs ignore it.
_ABOUT = "graspbox"
#: Largest file, bytes: about 100,000 grasps.
_MAX_BYTES = 64 << 20
#: Greatest depth of nested mappings and lists: of a grasp's orientation it is 5.
_DEEPEST = 8


def write(grasps: ExchangeGrasps, path: Path) -> None:
    """Write an Isaac Grasp file.

    The confidence is the predicted probability where it is known, else 1 for a success and 0 for a failure. Joint
    positions are within their limits. The entry ``graspbox`` has what the format lacks and is known: the mesh file with
    its scale, and the mass.
    """
    grasps = grasps.within_limits()
    yaml = optional_package("yaml", "pyyaml")
    confidence = np.where(np.isnan(grasps.confidence), grasps.success, grasps.confidence)
    if np.isnan(confidence).any():
        raise ConfigError(
            f"{int(np.isnan(confidence).sum())} of {len(grasps)} grasps of {grasps.object_name!r} have neither outcome "
            "nor predicted probability, from which this format's confidence follows; simulate them "
            "(`graspbox.tools.exchange.simulated`, or --objects on the command line)"
        )
    prefix = convention_of(grasps.hand).prefix
    names = [prefix + name for name in grasps.hand.joints]
    poses = grasps.object_from("base")
    quaternions = quaternion_from_rotation(poses[:, :3, :3])
    entries = {}
    for index in range(len(grasps)):
        w, *xyz = quaternions[index].tolist()
        entry = {
            "confidence": float(confidence[index]),
            "position": poses[index, :3, 3].tolist(),
            "orientation": {"w": w, "xyz": xyz},
        }
        if grasps.closed[index]:
            entry["cspace_position"] = dict(zip(names, grasps.grasp[index].tolist(), strict=True))
        entry["pregrasp_cspace_position"] = dict(zip(names, grasps.pregrasp[index].tolist(), strict=True))
        entries[f"grasp_{index}"] = entry
    document = {
        "format": _FORMAT,
        "format_version": _VERSION,
        "object_frame_link": grasps.object_name,
        "gripper_frame_link": prefix + mechanism_of(grasps.hand).base_link,
        "grasps": entries,
    }
    about: dict[str, Any] = {"mesh_file": grasps.mesh_file, "scale": grasps.scale} if grasps.mesh_file else {}
    if not np.isnan(grasps.mass):
        about["mass"] = grasps.mass
    if about:
        document[_ABOUT] = about
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    write_text(path, yaml.dump(document, Dumper=dumper, sort_keys=False, default_flow_style=None, width=120))


def read(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read an Isaac Grasp file; its joint positions are kept where all independent joints have one."""
    document = _document(path)
    if document.get("format") != _FORMAT or document.get("format_version") not in (_VERSION, "1.0"):
        raise ConfigError(
            f"its format is {shown(document.get('format'))}, version {shown(document.get('format_version'))}; files of "
            f"{_FORMAT!r} {_VERSION} are read"
        )
    entries = document.get("grasps")
    if not isinstance(entries, dict) or not all(isinstance(entry, dict) for entry in entries.values()):
        raise ConfigError("grasps is missing or is not a mapping of names to grasps")
    if len(entries) > MAX_GRASPS:
        raise ConfigError(f"grasps has {len(entries)} entries; at most {MAX_GRASPS} are read")
    rows = [(str(name)[:60], entry) for name, entry in entries.items()]
    positions = [_numbers(entry.get("position"), f"position of {name!r}", 3) for name, entry in rows]
    turns = [_orientation(entry.get("orientation"), name) for name, entry in rows]
    confidence = [number(entry.get("confidence"), f"confidence of {name!r}") for name, entry in rows]
    poses = poses_from(np.reshape(positions, (-1, 3)), rotation_from_quaternion(np.reshape(turns, (-1, 4))))
    made = ExchangeGrasps.of(
        poses @ frame_from_hand(hand, "base"),
        preshape,
        hand=hand,
        confidence=np.array(confidence, dtype=np.float64),
        object_name=str(document.get("object_frame_link", ""))[:1000],
        **_about(document.get(_ABOUT)),
    )
    for key, column in (("cspace_position", made.grasp), ("pregrasp_cspace_position", made.pregrasp)):
        for index, (name, entry) in enumerate(rows):
            angles = _joints(entry.get(key), hand, f"{key} of {name!r}")
            if angles is not None:
                column[index] = angles
    return made


def _about(entry: Any) -> dict[str, Any]:
    """Return what graspbox adds about the object; each entry may be missing."""
    if not isinstance(entry, dict):
        return {}
    about: dict[str, Any] = {}
    if "mesh_file" in entry:
        about["mesh_file"] = text(entry["mesh_file"], f"{_ABOUT}.mesh_file")[:1000]
    return about | {name: number(entry[name], f"{_ABOUT}.{name}") for name in ("scale", "mass") if name in entry}


def _document(path: Path) -> dict[str, Any]:
    yaml = optional_package("yaml", "pyyaml")
    content = read_bounded(path, _MAX_BYTES)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        depth = 0
        for event in yaml.parse(content, Loader=loader):
            # Aliases let a small file expand to a huge one; deep nesting exhausts the stack of the constructor.
            if isinstance(event, yaml.events.AliasEvent):
                raise ConfigError("it has aliases (*name), which Isaac Grasp files do not need; write values out")
            depth += isinstance(event, yaml.events.CollectionStartEvent)
            depth -= isinstance(event, yaml.events.CollectionEndEvent)
            if depth > _DEEPEST:
                raise ConfigError(f"it is nested more than {_DEEPEST} levels deep; pass an Isaac Grasp file")
        document = yaml.load(content, Loader=loader)
    except ConfigError:
        raise
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"it is not YAML ({' '.join(str(error).split())[:160]}); pass an Isaac Grasp file") from None
    if not isinstance(document, dict):
        raise ConfigError("it is YAML, but no mapping with grasps")
    return document


def _numbers(values: Any, name: str, count: int) -> list[float]:
    if not isinstance(values, list) or len(values) != count:
        raise ConfigError(f"{name} is not a list of {count} numbers")
    return [number(value, name) for value in values]


def _orientation(value: Any, name: str) -> list[float]:
    if not isinstance(value, dict):
        raise ConfigError(f"orientation of {name!r} is missing or is not a mapping with w and xyz")
    quaternion = [
        number(value.get("w"), f"orientation.w of {name!r}"),
        *_numbers(value.get("xyz"), f"orientation.xyz of {name!r}", 3),
    ]
    if abs(float(np.linalg.norm(quaternion)) - 1.0) > 1e-2:
        raise ConfigError(f"orientation of {name!r} has length {np.linalg.norm(quaternion):.4g}; use a unit quaternion")
    return quaternion


def _joints(value: Any, hand: Hand, name: str) -> NDArray[np.float64] | None:
    if value is None:
        return None
    if not isinstance(value, dict):
        raise ConfigError(f"{name} is not a mapping of joints to positions")
    prefix = convention_of(hand).prefix
    if not all(prefix + joint in value for joint in hand.joints):
        return None
    return np.array([number(value[prefix + joint], f"{joint} in {name}") for joint in hand.joints], dtype=np.float64)
