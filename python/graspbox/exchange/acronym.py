"""ACRONYM: grasps of one object as HDF5 (``.h5``) or JSON, and the JSON of GraspGen, which has the same contents.

Transforms are poses of the frame ``gripper`` in the mesh's frame, after scaling, metres. Files of graspbox
add the preshapes and the name of the hand, which other programs ignore and `read_hdf5` and `read_json` use.

Sources: NVlabs/acronym, ``acronym_tools/acronym.py``; NVlabs/GraspGen, ``docs/GRASP_DATASET_FORMAT.md``.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import dumps, read_bounded, replacing, write_text
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.exchange.checks import matrices, number, numbers, optional_package, text
from graspbox.exchange.conventions import convention_of, frame_from_hand
from graspbox.exchange.grasps import MAX_GRASPS, ExchangeGrasps, default_preshape

__all__ = ["read_graspgen", "read_hdf5", "read_json", "write_graspgen", "write_hdf5", "write_json"]

Array = NDArray[np.float64]

#: Largest JSON file, bytes; the largest HDF5 file follows from `MAX_GRASPS`.
_MAX_JSON = 256 << 20
_TRANSFORMS, _SUCCESS = "grasps/transforms", "grasps/qualities/flex/object_in_gripper"
_PRESHAPE, _GRIPPER = "grasps/graspbox_preshape", "gripper/type"


def _labels(grasps: ExchangeGrasps) -> NDArray[np.bool_]:
    """Return the outcomes, which these formats require."""
    unknown = int(np.isnan(grasps.success).sum())
    if unknown:
        raise ConfigError(
            f"{unknown} of {len(grasps)} grasps of {grasps.object_name!r} have no outcome, which this format stores; "
            "simulate them (`graspbox.exchange.simulated`, or --objects on the command line), or give grasps of an "
            "image a threshold"
        )
    return np.asarray(grasps.success >= 0.5)


def _transforms(grasps: ExchangeGrasps) -> Array:
    return grasps.object_from("gripper")


def write_hdf5(grasps: ExchangeGrasps, path: Path) -> None:
    """Write ACRONYM's HDF5."""
    h5py = optional_package("h5py", "h5py")
    labels = _labels(grasps)
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        file[_TRANSFORMS] = _transforms(grasps)
        file[_SUCCESS] = labels.astype(np.int64)
        file[_PRESHAPE] = grasps.preshape
        file[_GRIPPER] = convention_of(grasps.hand).gripper
        file["object/file"] = grasps.mesh_file or grasps.object_name
        file["object/scale"] = grasps.scale
        if not np.isnan(grasps.mass):
            file["object/mass"] = grasps.mass


def write_json(grasps: ExchangeGrasps, path: Path) -> None:
    """Write ACRONYM's JSON."""
    labels = _labels(grasps)
    document = {
        "object": grasps.mesh_file or grasps.object_name,
        "object_scale": grasps.scale,
        "transforms": _transforms(grasps).tolist(),
        "quality_flex_object_in_gripper": labels.astype(int).tolist(),
        "gripper": convention_of(grasps.hand).gripper,
        "graspbox_preshape": grasps.preshape.tolist(),
    }
    write_text(path, dumps(document) + "\n")


def write_graspgen(grasps: ExchangeGrasps, path: Path) -> None:
    """Write GraspGen's JSON; its outcomes are true and false, with which GraspGen selects rows."""
    labels = _labels(grasps)
    document = {
        "object": {"file": grasps.mesh_file or grasps.object_name, "scale": grasps.scale},
        "grasps": {
            "transforms": _transforms(grasps).tolist(),
            "object_in_gripper": labels.tolist(),
            "graspbox_preshape": grasps.preshape.tolist(),
        },
        "gripper": convention_of(grasps.hand).gripper,
    }
    write_text(path, dumps(document) + "\n")


def _grasps(
    hand: Hand,
    preshape: float | None,
    *,
    transforms: Array,
    success: Array,
    gripper: str | None,
    stored_preshape: Array | None,
    mesh_file: str,
    scale: float,
    mass: float | None = None,
) -> ExchangeGrasps:
    """Make grasps of the entries of a file, whose numbers `ExchangeGrasps` checks."""
    theirs = convention_of(hand).gripper
    if gripper is not None and gripper not in (theirs, hand.name):
        raise ConfigError(f"the grasps are of the gripper {gripper!r}, not {theirs!r}; give that hand")
    if not np.isin(success, (0.0, 1.0)).all():
        row = int(np.argmin(np.isin(success, (0.0, 1.0))))
        raise ConfigError(f"the outcome of grasp {row} is {success[row]}; it must be 0 or 1")
    if len(success) != len(transforms):
        raise ConfigError(f"there are {len(transforms)} transforms and {len(success)} outcomes; one of them is missing")
    if preshape is not None:
        preshapes = np.full(len(transforms), preshape)
    elif stored_preshape is not None:
        preshapes = stored_preshape
    else:
        preshapes = np.full(len(transforms), default_preshape(hand))
    # Rounding errors of files would add up with those of the conversion.
    checked = ExchangeGrasps.of(transforms, preshapes, hand=hand, success=success)
    return ExchangeGrasps.of(
        checked.poses @ frame_from_hand(hand, "gripper"),
        preshapes,
        hand=hand,
        success=success,
        object_name=Path(mesh_file).stem,
        mesh_file=mesh_file,
        scale=scale,
        mass=mass,
    )


def read_hdf5(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read ACRONYM's HDF5."""
    h5py = optional_package("h5py", "h5py")
    if not path.is_file():
        read_bounded(path, 0)  # raises if it cannot be read
    try:
        with h5py.File(path, "r") as file:
            reader = _Hdf5(h5py, file)
            transforms = reader.array(_TRANSFORMS, (4, 4))
            mass = reader.value("object/mass") if "object/mass" in file else None
            return _grasps(
                hand,
                preshape,
                transforms=transforms,
                success=reader.array(_SUCCESS, ()),
                gripper=reader.text(_GRIPPER) if _GRIPPER in file else None,
                stored_preshape=reader.array(_PRESHAPE, ()) if _PRESHAPE in file else None,
                mesh_file=reader.text("object/file"),
                scale=reader.value("object/scale"),
                mass=mass,
            )
    except ConfigError:
        raise
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(f"it is not an HDF5 file, or is damaged ({reason}); copy it again") from None


class _Hdf5:
    """Reads datasets of a file of unknown origin: only data in the file itself, of the expected shape."""

    def __init__(self, h5py: Any, file: Any) -> None:
        self.h5py, self.file = h5py, file

    def _dataset(self, name: str, kinds: str, expected: str) -> Any:
        group = self.file
        for part in name.split("/"):
            link = group.get(part, getlink=True) if isinstance(group, self.h5py.Group) else None
            if link is None:
                raise ConfigError(f"it lacks {name!r}; give a file of ACRONYM")
            if not isinstance(link, self.h5py.HardLink):
                raise ConfigError(f"{name!r} is a link to another file or place; give a file with its own data")
            group = group[part]
        found = group
        if not isinstance(found, self.h5py.Dataset) or found.dtype.kind not in kinds:
            raise ConfigError(f"{name!r} is not {expected}")
        if found.external or found.is_virtual:
            raise ConfigError(f"{name!r} is stored in another file; give a file with its own data")
        return found

    def array(self, name: str, row: tuple[int, ...]) -> Array:
        """Return an array (n, *row) of numbers."""
        found = self._dataset(name, "fiub", "an array of numbers")
        shape = found.shape
        if shape is None or len(shape) != 1 + len(row) or shape[1:] != row:
            wanted = ", ".join(["n", *map(str, row)])
            raise ConfigError(f"{name!r} has shape {shape}; it must be ({wanted})")
        if shape[0] > MAX_GRASPS:
            raise ConfigError(f"{name!r} has {shape[0]} rows; at most {MAX_GRASPS} are read")
        return np.asarray(found[()], dtype=np.float64)

    def value(self, name: str) -> float:
        """Return one number."""
        found = self._dataset(name, "fiub", "a number")
        if found.shape not in ((), (1,)):
            raise ConfigError(f"{name!r} has shape {found.shape}; it must be one number")
        return number(float(np.asarray(found[()]).reshape(())), repr(name))

    def text(self, name: str) -> str:
        """Return a text."""
        found = self._dataset(name, "OS", "text")
        if found.shape not in ((), (1,)):
            raise ConfigError(f"{name!r} has shape {found.shape}; it must be one text")
        value = np.asarray(found[()], dtype=object).reshape(()).item()
        return value.decode() if isinstance(value, bytes) else text(value, repr(name))


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_bounded(path, _MAX_JSON))
    except (ValueError, RecursionError):
        raise ConfigError("it is not JSON, or a damaged file; copy it again") from None
    if not isinstance(document, dict):
        raise ConfigError("it is JSON, but no object with grasps")
    return document


def _json_grasps(
    hand: Hand, preshape: float | None, grasps: dict[str, Any], success: str, gripper: Any, mesh_file: Any, scale: Any
) -> ExchangeGrasps:
    transforms = matrices(grasps.get("transforms"), "transforms")
    stored = grasps.get("graspbox_preshape")
    return _grasps(
        hand,
        preshape,
        transforms=transforms,
        success=numbers(grasps.get(success), success, count=len(transforms)),
        gripper=None if gripper is None else text(gripper, "gripper"),
        stored_preshape=None if stored is None else numbers(stored, "graspbox_preshape", count=len(transforms)),
        mesh_file=text(mesh_file, "the object's file"),
        scale=number(scale, "the object's scale"),
    )


def read_json(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read ACRONYM's JSON, or that of GraspGen."""
    document = _document(path)
    if isinstance(document.get("grasps"), dict):
        return _graspgen(document, hand, preshape)
    success, about = "quality_flex_object_in_gripper", (document.get("object"), document.get("object_scale"))
    return _json_grasps(hand, preshape, document, success, document.get("gripper"), *about)


def read_graspgen(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read GraspGen's JSON, or that of ACRONYM."""
    return read_json(path, hand, preshape)


def _graspgen(document: dict[str, Any], hand: Hand, preshape: float | None) -> ExchangeGrasps:
    about = document.get("object")
    if not isinstance(about, dict):
        raise ConfigError("object is missing or is not an object with file and scale")
    metadata = (document.get("gripper"), about.get("file"), about.get("scale"))
    return _json_grasps(hand, preshape, document["grasps"], "object_in_gripper", *metadata)
