"""URDFs whose collision meshes are replaced by boxes, cylinders and spheres, which the simulation supports.

A fitted shape is cached in `graspbox.cache_folder`, by the content of its mesh.
"""

import hashlib
import json
import logging
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import config_dict
from graspbox._common.files import read_bounded, write_text
from graspbox._common.rotations import euler_from_rotation, rotation_from_euler
from graspbox._core import Mesh
from graspbox.configs import CleanConfig, LoadConfig
from graspbox.errors import FileError, GraspboxError, HandError
from graspbox.hands.caching import cache_folder
from graspbox.hands.mesh_fits import MeshFit, Primitive, fit_mesh
from graspbox.hands.mjcf_loops import LoopFit

__all__ = ["FittedUrdf", "add_origin", "collisions", "fitted_urdf", "numbers_text", "read_text"]

Array = NDArray[np.float64]

_LOG = logging.getLogger(__name__)
#: Largest URDF and ``hand.toml``, bytes; the core has the same limit.
LARGEST = 1 << 20
#: Largest mesh file, bytes, and most collision meshes of a hand.
_LARGEST_MESH, _MOST_MESHES = 32 << 20, 64
#: Changes with the method, so that cached shapes of another one are not used.
_METHOD = "1"


@dataclass(frozen=True, eq=False)
class FittedUrdf:
    """A URDF without collision meshes.

    Attributes
    ----------
    text : str
        Its content.
    fits : dict of str to MeshFit
        The shapes in place of each collision mesh, by the name of its collider. Several shapes of a collider NAME are
        named ``NAME.0``, ``NAME.1``, ...; ``pads`` in ``hand.toml`` takes NAME for all of them.
    loops : dict of str to LoopFit
        The mimic joints in place of closed loops of an MJCF file, by their names.
    """

    text: str
    fits: dict[str, MeshFit]
    loops: dict[str, LoopFit] = field(default_factory=dict)


def fitted_urdf(path: str | os.PathLike[str], text: str | None = None) -> FittedUrdf:
    """Read a URDF, and fit primitives to its collision meshes; without any, its text stays the same.

    Parameters
    ----------
    path : str or PathLike
        The URDF. Meshes are STL, OBJ or PLY files in metres, named relative to its folder, by ``file://``, or by
        ``package://NAME/...``, where a folder NAME above the URDF holds them.
    text : str, optional
        Its content, where it is not that of the file.

    Raises
    ------
    HandError
        If the URDF cannot be read, is no XML, or a mesh is missing, cannot be read or is flat.
    """
    path = Path(path)
    text = read_text(path) if text is None else text
    if not re.search(r"<\s*mesh\b", text):
        return FittedUrdf(text, {})
    if re.search(r"<!\s*(DOCTYPE|ENTITY)", text):
        raise HandError(f"{path}: has a document type; remove <!DOCTYPE ...>")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise HandError(f"{path}: {error}") from None
    fits: dict[str, MeshFit] = {}
    for link in root.iter("link"):
        for number, collision in enumerate(link.findall("collision")):
            # The name that the core would use: replaced colliders change the numbers of those after them.
            name = collision.attrib.setdefault("name", f"{link.get('name')}_{number}")
            if collision.find("geometry/mesh") is None:
                continue
            if len(fits) == _MOST_MESHES:
                raise HandError(f"{path}: has more than {_MOST_MESHES} collision meshes; merge them, or use primitives")
            fit = fits[name] = _fit(path, name, collision)
            at = list(link).index(collision)
            link[at : at + 1] = collisions(name, _pose_of(collision.find("origin")), fit.primitives)
            _LOG.info(
                "%s: %s is %d primitives, %.1f mm from its mesh on average and %.1f mm at most",
                path.name, name, len(fit.primitives), 1e3 * fit.mean, 1e3 * fit.most,
            )  # fmt: skip
    return FittedUrdf(ElementTree.tostring(root, encoding="unicode") if fits else text, fits)


def read_text(path: Path) -> str:
    """Read a file of a hand; a HandError names one that cannot be read."""
    try:
        return read_bounded(path, LARGEST).decode()
    except UnicodeDecodeError:
        raise HandError(f"{path} is not UTF-8 text") from None
    except FileError as error:
        raise HandError(f"{path}: {error}") from None


def _fit(urdf: Path, name: str, collision: ElementTree.Element) -> MeshFit:
    """Fit primitives to the mesh of a collider, or take them from the cache."""
    (mesh,) = collision.iterfind("geometry/mesh")
    filename = mesh.get("filename") or ""
    scale = _numbers(mesh.get("scale"), (1.0, 1.0, 1.0))
    place = f"{urdf}: collider {name!r}: mesh {filename!r}"
    file = next((each for each in _places(urdf.parent, filename) if each.is_file()), None)
    if file is None:
        raise HandError(
            f"{place} is missing; name it from the URDF's folder, or as package://NAME/... with NAME above it"
        )
    if len(scale) != 3 or not all(np.isfinite(scale)) or min(map(abs, scale)) <= 0.0:
        raise HandError(f"{place} has scale {mesh.get('scale')!r}; use three numbers other than 0")
    try:
        content = read_bounded(file, _LARGEST_MESH)
        key = hashlib.sha256(f"{_METHOD} {scale} {file.suffix}".encode() + content).hexdigest()
        folder = cache_folder()
        stored = None if folder is None else folder / "hand_meshes" / f"{key}.json"
        if stored is not None and (known := _read(stored)) is not None:
            return known
        fit = fit_mesh(_scaled(file, scale))
    except GraspboxError as error:
        raise HandError(f"{place}: {error}") from None
    if stored is not None:
        try:
            stored.parent.mkdir(parents=True, exist_ok=True)
            write_text(stored, _dump(fit))
        except OSError as error:
            _LOG.warning("the fit of %s is not cached, and will be made again: %s", place, error)
    return fit


def _scaled(file: Path, scale: tuple[float, ...]) -> Mesh:
    """Read a mesh, in metres after its scale along each axis."""
    options, cleaning = config_dict(LoadConfig(max_bytes=_LARGEST_MESH)), config_dict(CleanConfig())
    mesh = Mesh.load(file, file.stem, None, options, cleaning)
    if scale == (1.0, 1.0, 1.0):
        return mesh
    return Mesh(mesh.vertices * np.array(scale), mesh.faces, file.stem, None, cleaning, None)


def _places(folder: Path, filename: str) -> Iterator[Path]:
    """List the files that a name in a URDF may mean."""
    if filename.startswith("package://"):
        inside = Path(filename.removeprefix("package://"))
        for above in (folder.resolve(), *folder.resolve().parents):
            yield above / inside
            # The package's own folder, under another name.
            yield above / Path(*inside.parts[1:])
    else:
        yield folder / filename.removeprefix("file://")


def _pose_of(origin: ElementTree.Element | None) -> Array:
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = _numbers(origin.get("xyz"), (0.0, 0.0, 0.0))
        pose[:3, :3] = rotation_from_euler([_numbers(origin.get("rpy"), (0.0, 0.0, 0.0))])[0]
    return pose


def collisions(name: str, pose: Array, primitives: Sequence[Primitive]) -> list[ElementTree.Element]:
    """Return the elements of a URDF for the primitives of a collider at a pose (4, 4); several get numbers."""
    elements = []
    for number, primitive in enumerate(primitives):
        element = ElementTree.Element("collision", name=name if len(primitives) == 1 else f"{name}.{number}")
        add_origin(element, pose @ primitive.pose)
        names = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}[primitive.kind]
        values = [primitive.size] if primitive.kind == "box" else [(each,) for each in primitive.size]
        sizes = dict(zip(names, map(numbers_text, values), strict=True))
        ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), primitive.kind, sizes)
        elements.append(element)
    return elements


def add_origin(element: ElementTree.Element, pose: Array) -> None:
    """Add a pose (4, 4) to an element of a URDF."""
    (angles,) = euler_from_rotation(pose[None, :3, :3])
    ElementTree.SubElement(element, "origin", xyz=numbers_text(pose[:3, 3]), rpy=numbers_text(angles))


def _numbers(text: str | None, default: tuple[float, ...]) -> tuple[float, ...]:
    """Read numbers of an attribute; wrong ones are left to the core, which names their line."""
    try:
        return default if text is None else tuple(float(word) for word in text.split())
    except ValueError:
        raise HandError(f"{text!r} is not a list of numbers; separate numbers by blanks") from None


def numbers_text(values: Array | Sequence[float]) -> str:
    """Write numbers for an attribute, with 9 digits."""
    return " ".join(f"{float(value):.9g}" for value in values)


def _dump(fit: MeshFit) -> str:
    shapes = [{"kind": p.kind, "pose": p.pose.tolist(), "size": list(p.size)} for p in fit.primitives]
    return json.dumps({"mean": fit.mean, "most": fit.most, "primitives": shapes})


def _read(path: Path) -> MeshFit | None:
    """Read a cached fit; None if there is none, or its file is damaged."""
    try:
        stored = json.loads(path.read_text())
        shapes = tuple(Primitive(p["kind"], np.array(p["pose"]), tuple(p["size"])) for p in stored["primitives"])
        return MeshFit(shapes, float(stored["mean"]), float(stored["most"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
