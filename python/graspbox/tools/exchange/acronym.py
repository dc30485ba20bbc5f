"""ACRONYM: grasps of one object as HDF5 (``.h5``) or JSON, and the JSON of GraspGen, which has the same contents.

Transforms are poses of the frame ``gripper`` in the mesh's frame, after scaling, metres. Files of graspbox
add the preshapes, the mass (kg) and the name of the hand, which other programs ignore and `read_hdf5` and
`read_json_grasps` use. Where no mesh file is known, they have the object's name in its place.

Sources: NVlabs/acronym, ``acronym_tools/acronym.py``; NVlabs/GraspGen, ``docs/GRASP_DATASET_FORMAT.md``.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import dumps, read_bounded, replacing, write_text
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.hands.conventions import convention_of, frame_from_hand
from graspbox.tools.exchange.checks import matrices, number, numbers, optional_package, read_json, text
from graspbox.tools.exchange.grasps import MAX_GRASPS, ExchangeGrasps, mesh_file_in

__all__ = ["read_hdf5", "read_json_grasps", "write_graspgen", "write_hdf5", "write_json"]

Array = NDArray[np.float64]

_TRANSFORMS, _SUCCESS = "grasps/transforms", "grasps/qualities/flex/object_in_gripper"
_MASS = "graspbox_mass"
_PRESHAPE, _GRIPPER = "grasps/graspbox_preshape", "gripper/type"


def _labels(grasps: ExchangeGrasps) -> NDArray[np.bool_]:
    """Return the outcomes, which these formats require."""
    unknown = int(np.isnan(grasps.success).sum())
    if unknown:
        raise ConfigError(
            f"{unknown} of {len(grasps)} grasps of {grasps.object_name!r} have no outcome, which this format stores; "
            "simulate them (`graspbox.tools.exchange.simulated`, or --objects), or pass grasps of an "
            "image a threshold"
        )
    return np.asarray(grasps.success >= 0.5)


def write_hdf5(grasps: ExchangeGrasps, path: Path) -> None:
    """Write ACRONYM's HDF5."""
    h5py = optional_package("h5py", "h5py")
    labels = _labels(grasps)
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        file[_TRANSFORMS] = grasps.object_from("gripper")
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
        "transforms": grasps.object_from("gripper").tolist(),
        "quality_flex_object_in_gripper": labels.astype(int).tolist(),
        "gripper": convention_of(grasps.hand).gripper,
        "graspbox_preshape": grasps.preshape.tolist(),
        **_mass(grasps),
    }
    write_text(path, dumps(document) + "\n")


def write_graspgen(grasps: ExchangeGrasps, path: Path) -> None:
    """Write GraspGen's JSON; its outcomes are true and false, with which GraspGen selects rows."""
    labels = _labels(grasps)
    document = {
        "object": {"file": grasps.mesh_file or grasps.object_name, "scale": grasps.scale},
        "grasps": {
            "transforms": grasps.object_from("gripper").tolist(),
            "object_in_gripper": labels.tolist(),
            "graspbox_preshape": grasps.preshape.tolist(),
        },
        "gripper": convention_of(grasps.hand).gripper,
        **_mass(grasps),
    }
    write_text(path, dumps(document) + "\n")


def _mass(grasps: ExchangeGrasps) -> dict[str, float]:
    return {} if np.isnan(grasps.mass) else {_MASS: grasps.mass}


def _grasps(
    hand: Hand,
    gripper: str | None,
    transforms: Array,
    preshape: Array | float | None,
    success: Array,
    *,
    file: str,
    **about: Any,
) -> ExchangeGrasps:
    """Make grasps of the entries of a file, whose numbers `ExchangeGrasps` checks; `file` names the object."""
    theirs = convention_of(hand).gripper
    if gripper is not None and gripper not in (theirs, hand.name):
        raise ConfigError(f"the grasps are of the gripper {gripper!r}, not {theirs!r}; pass that hand")
    known = np.isin(success, (0.0, 1.0))
    if not known.all():
        row = int(np.argmin(known))
        raise ConfigError(f"the outcome of grasp {row} is {success[row]}; it must be 0 or 1")
    if len(success) != len(transforms):
        raise ConfigError(f"there are {len(transforms)} transforms and {len(success)} outcomes; one of them is missing")
    mesh_file = mesh_file_in(file)
    name = Path(mesh_file).stem if mesh_file else file[:1000]
    # Rounding errors of files would add up with those of the conversion, so they are checked before it.
    made = ExchangeGrasps.of(
        transforms, preshape, hand=hand, success=success, object_name=name, mesh_file=mesh_file, **about
    )
    return replace(made, poses=made.poses @ frame_from_hand(hand, "gripper"))


def read_hdf5(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read ACRONYM's HDF5."""
    h5py = optional_package("h5py", "h5py")
    if not path.is_file():
        read_bounded(path, 0)  # raises if it cannot be read
    try:
        with h5py.File(path, "r") as file:
            reader = _Hdf5(h5py, file)
            return _grasps(
                hand,
                reader.text(_GRIPPER) if _GRIPPER in file else None,
                reader.array(_TRANSFORMS, (4, 4)),
                reader.array(_PRESHAPE, ()) if preshape is None and _PRESHAPE in file else preshape,
                reader.array(_SUCCESS, ()),
                file=reader.text("object/file"),
                scale=reader.value("object/scale"),
                mass=reader.value("object/mass") if "object/mass" in file else None,
            )
    except ConfigError:
        raise
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(f"it is not an HDF5 file, or is damaged ({reason}); copy it again") from None


class _Hdf5:
    """Reader of datasets in a file of unknown origin: only data in the file itself, of the expected shape."""

    def __init__(self, h5py: Any, file: Any) -> None:
        self.h5py, self.file = h5py, file

    def _dataset(self, name: str, kinds: str, expected: str) -> Any:
        entry = self.file
        for part in name.split("/"):
            link = entry.get(part, getlink=True) if isinstance(entry, self.h5py.Group) else None
            if link is None:
                raise ConfigError(f"it lacks {name!r}; pass a file of ACRONYM")
            if not isinstance(link, self.h5py.HardLink):
                raise ConfigError(f"{name!r} is a link to another file or place; pass a file with its own data")
            entry = entry[part]
        if not isinstance(entry, self.h5py.Dataset) or entry.dtype.kind not in kinds:
            raise ConfigError(f"{name!r} is not {expected}")
        if entry.external or entry.is_virtual:
            raise ConfigError(f"{name!r} is stored in another file; pass a file with its own data")
        return entry

    def array(self, name: str, row: tuple[int, ...]) -> Array:
        """Return an array (n, *row) of numbers."""
        dataset = self._dataset(name, "fiub", "an array of numbers")
        shape = dataset.shape
        if shape is None or len(shape) != 1 + len(row) or shape[1:] != row:
            wanted = ", ".join(["n", *map(str, row)])
            raise ConfigError(f"{name!r} has shape {shape}; it must be ({wanted})")
        if shape[0] > MAX_GRASPS:
            raise ConfigError(f"{name!r} has {shape[0]} rows; at most {MAX_GRASPS} are read")
        return np.asarray(dataset[()], dtype=np.float64)

    def _single(self, name: str, kinds: str, kind: str) -> Any:
        dataset = self._dataset(name, kinds, kind)
        if dataset.shape not in ((), (1,)):
            raise ConfigError(f"{name!r} has shape {dataset.shape}; it must be one {kind.removeprefix('a ')}")
        return np.asarray(dataset[()], dtype=object).reshape(()).item()

    def value(self, name: str) -> float:
        """Return one number."""
        return number(float(self._single(name, "fiub", "a number")), repr(name))

    def text(self, name: str) -> str:
        """Return a text."""
        value = self._single(name, "OS", "text")
        return value.decode() if isinstance(value, bytes) else text(value, repr(name))


def read_json_grasps(path: Path, hand: Hand, preshape: float | None) -> ExchangeGrasps:
    """Read ACRONYM's JSON, or that of GraspGen, in which ``grasps`` and ``object`` are mappings."""
    document = read_json(path)
    if not isinstance(document, dict):
        raise ConfigError("it is JSON, but no object with grasps")
    rows, success = document, "quality_flex_object_in_gripper"
    about: Any = {"file": document.get("object"), "scale": document.get("object_scale")}
    if isinstance(document.get("grasps"), dict):
        rows, success, about = document["grasps"], "object_in_gripper", document.get("object")
        if not isinstance(about, dict):
            raise ConfigError("object is missing or is not an object with file and scale")
    transforms = matrices(rows.get("transforms"), "transforms")
    mass = document.get(_MASS)
    stored, gripper = rows.get("graspbox_preshape"), document.get("gripper")
    if preshape is None and stored is not None:
        stored = numbers(stored, "graspbox_preshape", count=len(transforms))
    return _grasps(
        hand,
        None if gripper is None else text(gripper, "gripper"),
        transforms,
        stored if preshape is None else preshape,
        numbers(rows.get(success), success, count=len(transforms)),
        file=text(about.get("file"), "the object's file"),
        scale=number(about.get("scale"), "the object's scale"),
        mass=None if mass is None else number(mass, _MASS),
    )
