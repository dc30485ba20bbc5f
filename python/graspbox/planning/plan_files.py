"""Plans as JSON files, for other programs; a saved plan is read back bit for bit.

Version 1 of the format, with lengths in metres, angles in radians, and matrices as lists of rows:

| key | value |
|---|---|
| ``format``, ``version`` | ``"graspbox.plan"`` and 1 |
| ``graspbox`` | version of the package that wrote the file |
| ``units`` | ``{"length": "m", "angle": "rad"}`` |
| ``object`` | ``name``, ``sha256`` of the mesh's arrays (see `mesh_hash`); optional: ``source``, ``scale``, ``mass`` |
| ``hand`` | name of the hand, to whose grasp frame the poses refer |
| ``world_from_object`` | 4x4: resting pose of the object; the table is the plane z = 0 |
| ``boxes`` | tree nodes, parents first: ``center``, ``axes`` (columns), ``half_extents``, ``children``, ``depth`` |
| ``grasps`` | best first: ``object_from_hand`` (4x4), ``preshape``, ``feasible``, ``score``, ``box``, ``face``, |
| | ``touch``, ``press`` |
| ``features`` | optional: terms of the ranking, one row per grasp; null for grasps that are not feasible |
"""

import hashlib
import json
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import dumps, read_bounded, write_text
from graspbox._core import Mesh, __version__, is_rigid
from graspbox.errors import ConfigError, PlanError

__all__ = ["grasp_rows", "mesh_hash", "read", "write"]

_FORMAT, _VERSION = "graspbox.plan", 1
#: Largest file to read: about 300,000 grasps.
_MAX_BYTES = 256 << 20

#: Columns of grasps and of boxes: key in the file, type, shape of one row.
_GRASPS: dict[str, tuple[str, type, tuple[int, ...]]] = {
    "poses": ("object_from_hand", np.float64, (4, 4)),
    "preshape": ("preshape", np.float64, ()),
    "feasible": ("feasible", np.bool_, ()),
    "score": ("score", np.float64, ()),
    "box": ("box", np.int64, ()),
    "face": ("face", np.int64, ()),
    "touch": ("touch", np.float64, ()),
    "press": ("press", np.float64, ()),
}
_BOXES: dict[str, tuple[str, type, tuple[int, ...]]] = {
    "center": ("center", np.float64, (3,)),
    "axes": ("axes", np.float64, (3, 3)),
    "half_extents": ("half_extents", np.float64, (3,)),
    "children": ("children", np.int64, (2,)),
    "depth": ("depth", np.int64, ()),
}

Arrays = dict[str, NDArray[Any]]


def mesh_hash(mesh: Mesh) -> str:
    """Return the SHA-256 of the vertices (float64, little-endian) and then the faces (uint32), in hexadecimal."""
    digest = hashlib.sha256(mesh.vertices.astype("<f8", copy=False).tobytes())
    digest.update(mesh.faces.astype("<u4", copy=False).tobytes())
    return digest.hexdigest()


def grasp_rows(plan: Any) -> list[dict[str, Any]]:
    """Return the grasps of a plan as JSON objects, in the format of the file."""
    return _rows({name: getattr(plan, name) for name in _GRASPS}, _GRASPS)


def write(path: str | os.PathLike[str], facts: dict[str, Any], boxes: Arrays, grasps: Arrays) -> None:
    """Write a plan atomically: its other attributes, and the columns of its boxes and of its grasps.

    Raises
    ------
    FileError
        If the file cannot be written.
    ConfigError
        If a number is not finite.
    """
    features = facts["features"]
    document = {
        "format": _FORMAT,
        "version": _VERSION,
        "graspbox": __version__,
        "units": {"length": "m", "angle": "rad"},
        "object": {"name": facts["name"], "sha256": facts["mesh_sha256"], **_origin(facts)},
        "hand": facts["hand_name"],
        "world_from_object": facts["world_from_object"].tolist(),
        "boxes": _rows(boxes, _BOXES),
        "grasps": _rows(grasps, _GRASPS),
    }
    if features is not None:
        known = ~np.isnan(features).any(axis=1)
        document["features"] = [row.tolist() if ok else None for row, ok in zip(features, known, strict=True)]
    try:
        text = dumps(document)
    except ValueError:
        raise ConfigError("the plan holds NaN or infinity; only finite plans can be saved") from None
    write_text(path, text + "\n")


def _origin(facts: dict[str, Any]) -> dict[str, Any]:
    """Return where the object comes from, if that is known."""
    return {key: facts[key] for key in ("source", "scale", "mass")} if facts["source"] else {}


def _read_origin(about: dict[str, Any]) -> dict[str, Any]:
    source, scale, mass = about.get("source", ""), about.get("scale", 1.0), about.get("mass")
    if not isinstance(source, str):
        raise PlanError("object.source is not text")
    for name, value in (("scale", scale), ("mass", 1.0 if mass is None else mass)):
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
            raise PlanError(f"object.{name} is not a number greater than 0")
    return {"source": source, "scale": float(scale), "mass": None if mass is None else float(mass)}


def _rows(columns: Arrays, keys: dict[str, tuple[str, type, tuple[int, ...]]]) -> list[dict[str, Any]]:
    names = [keys[name][0] for name in keys]
    values = zip(*(columns[name].tolist() for name in keys), strict=True)
    return [dict(zip(names, row, strict=True)) for row in values]


def read(path: str | os.PathLike[str]) -> tuple[dict[str, Any], Arrays, Arrays]:
    """Read a plan; returns the arguments of `write`: facts, boxes, grasps.

    Raises
    ------
    FileError
        If the file cannot be read, or is larger than 256 MiB.
    PlanError
        If it contains no plan of a known version; the message names the key.
    """
    content = read_bounded(path, _MAX_BYTES)
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        raise PlanError(f"{str(path)!r} is not JSON; write plans with Plan.save") from None
    try:
        return _plan(document)
    except PlanError as error:
        raise PlanError(f"{str(path)!r}: {error}") from None


def _plan(document: Any) -> tuple[dict[str, Any], Arrays, Arrays]:
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise PlanError(f"this is not a plan: its format is not {_FORMAT!r}")
    if document.get("version") != _VERSION:
        raise PlanError(f"its version is {document.get('version')!r}; this graspbox reads {_VERSION}")
    about = document.get("object")
    about = about if isinstance(about, dict) else {}
    names = {"object.name": about.get("name"), "object.sha256": about.get("sha256"), "hand": document.get("hand")}
    if bad := [key for key, value in names.items() if not isinstance(value, str)]:
        raise PlanError(f"{bad[0]} is missing or is not text")
    facts: dict[str, Any] = dict(zip(("name", "mesh_sha256", "hand_name"), names.values(), strict=True))
    facts |= _read_origin(about)
    facts["world_from_object"] = _array(document.get("world_from_object"), "world_from_object", np.float64, (4, 4))
    boxes = _columns(document, "boxes", _BOXES)
    grasps = _columns(document, "grasps", _GRASPS)
    _check_rigid(facts["world_from_object"][None], "world_from_object")
    _check_rigid(grasps["poses"], "grasps: object_from_hand")
    _check_tree(boxes, grasps)
    facts["features"] = _features(document.get("features"), len(grasps["poses"]))
    return facts, boxes, grasps


def _columns(document: dict[str, Any], key: str, keys: dict[str, tuple[str, type, tuple[int, ...]]]) -> Arrays:
    rows = document.get(key)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise PlanError(f"{key} is missing or is not a list of objects")
    columns: Arrays = {}
    for name, (inside, kind, shape) in keys.items():
        if lacking := [i for i, row in enumerate(rows) if inside not in row]:
            raise PlanError(f"{key}[{lacking[0]}] lacks {inside!r}")
        columns[name] = _array([row[inside] for row in rows], f"{key}: {inside}", kind, (len(rows), *shape))
    return columns


def _array(values: Any, name: str, kind: type, shape: tuple[int, ...]) -> NDArray[Any]:
    """Make an array of the given type and shape; floats are not truncated, and bools do not count as numbers."""
    wanted = {np.float64: "iuf", np.int64: "iu", np.bool_: "b"}[kind]
    try:
        found = np.asarray(values) if 0 not in shape else np.zeros(shape, kind)
        if found.dtype.kind in wanted and found.shape == shape and np.isfinite(found).all():
            return np.ascontiguousarray(found, dtype=kind)
    except (ValueError, OverflowError):
        pass
    raise PlanError(f"{name} is not an array of shape {shape} and type {np.dtype(kind).name} with finite entries")


def _check_rigid(poses: NDArray[Any], name: str) -> None:
    rigid = is_rigid(poses)
    if not rigid.all():
        raise PlanError(f"{name} of row {int(np.argmin(rigid))} is not a rigid motion")


def _check_tree(boxes: Arrays, grasps: Arrays) -> None:
    children, count = boxes["children"], len(boxes["children"])
    leaf = (children == -1).all(axis=1)
    later = (children > np.arange(count)[:, None]).all(axis=1) & (children < count).all(axis=1)
    if count == 0 or not (leaf | later).all():
        raise PlanError("boxes: children are not -1, -1 or the indices of two later boxes")
    leaves, of, face = int(leaf.sum()), grasps["box"], grasps["face"]
    if ((of < 0) | (of > leaves)).any() or ((face < 0) | (face > 5)).any():
        raise PlanError(f"grasps: box is not in 0 to {leaves}, or face not in 0 to 5")


def _features(rows: Any, count: int) -> NDArray[np.float64] | None:
    if rows is None:
        return None
    if not isinstance(rows, list) or len(rows) != count:
        raise PlanError(f"features is not a list of {count} rows")
    width = next((len(row) for row in rows if isinstance(row, list)), 0)
    full = [[float("nan")] * width if row is None else row for row in rows]
    try:
        found = np.array(full, dtype=np.float64).reshape(count, width)
    except (TypeError, ValueError):
        raise PlanError("features is not a table of numbers") from None
    return found
