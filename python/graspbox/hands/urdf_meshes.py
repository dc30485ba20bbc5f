"""URDFs whose collision meshes are replaced by primitives: the simulation takes boxes, cylinders and spheres alone.

A fitted shape is cached in `graspbox.cache_folder`, by the content of its mesh.
"""

import hashlib
import json
import logging
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from graspbox._common.arguments import to_json
from graspbox._common.files import read_bounded, write_text
from graspbox._common.rotations import euler_from_rotation, rotation_from_euler
from graspbox._core import Mesh
from graspbox.configs import CleanConfig, LoadConfig
from graspbox.errors import FileError, GraspboxError, HandError
from graspbox.hands.caching import cache_folder
from graspbox.hands.mesh_fits import MeshFit, Primitive, fit_mesh
from graspbox.hands.mjcf_loops import LoopFit

__all__ = ["FittedUrdf", "element_of", "fitted_urdf"]

_LOG = logging.getLogger(__name__)
#: Largest URDF, bytes; the core has the same limit.
_LARGEST = 1 << 20
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


def fitted_urdf(path: str | os.PathLike[str]) -> FittedUrdf:
    """Read a URDF, and fit primitives to its collision meshes.

    Parameters
    ----------
    path : str or PathLike
        The URDF. Meshes are STL, OBJ or PLY files in metres, named relative to its folder, by ``file://``, or by
        ``package://NAME/...``, where a folder NAME above the URDF holds them.

    Returns
    -------
    FittedUrdf
        The same text where there are no collision meshes.

    Raises
    ------
    HandError
        If the URDF cannot be read, is no XML, or a mesh is missing, cannot be read or is flat.
    """
    path = Path(path)
    try:
        text = read_bounded(path, _LARGEST).decode()
    except (FileError, UnicodeDecodeError) as error:
        raise HandError(f"{path}: {error}") from None
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
        _name_colliders(link)
        for collision in [one for one in link.findall("collision") if one.find("geometry/mesh") is not None]:
            name = collision.get("name", "")
            if len(fits) == _MOST_MESHES:
                raise HandError(f"{path}: has more than {_MOST_MESHES} collision meshes; merge them, or use primitives")
            fits[name] = _fit(path, name, collision)
            _replace(link, collision, fits[name])
    if not fits:
        return FittedUrdf(text, {})
    for name, fit in fits.items():
        _LOG.info(
            "%s: %s is %d primitives, %.1f mm from its mesh on average and %.1f mm at most",
            path.name, name, len(fit.primitives), 1e3 * fit.mean, 1e3 * fit.most,
        )  # fmt: skip
    return FittedUrdf(ElementTree.tostring(root, encoding="unicode"), fits)


def _name_colliders(link: ElementTree.Element) -> None:
    """Give unnamed colliders the names that the core would give them, since replaced ones change their numbers."""
    for number, collision in enumerate(link.findall("collision")):
        if collision.get("name") is None:
            collision.set("name", f"{link.get('name')}_{number}")


def _fit(urdf: Path, name: str, collision: ElementTree.Element) -> MeshFit:
    """Fit primitives to the mesh of a collider, or take them from the cache."""
    mesh = collision.find("geometry/mesh")
    assert mesh is not None
    filename = mesh.get("filename") or ""
    scale = _numbers(mesh.get("scale"), (1.0, 1.0, 1.0))
    place = f"{urdf}: collider {name!r}: mesh {filename!r}"
    file = next((each for each in _places(urdf.parent, filename) if each.is_file()), None)
    if file is None:
        raise HandError(
            f"{place} is missing; name it from the URDF's folder, or as package://NAME/... with NAME above it"
        )
    if len(scale) != 3 or not all(np.isfinite(scale)) or min(map(abs, scale)) <= 0.0:
        raise HandError(f"{place} has scale {mesh.get('scale')!r}; give three numbers other than 0")
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
    options, cleaning = to_json(LoadConfig(max_bytes=_LARGEST_MESH)), to_json(CleanConfig())
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


def _replace(link: ElementTree.Element, collision: ElementTree.Element, fit: MeshFit) -> None:
    """Put the shapes of a fit in place of a collider."""
    name, at = collision.get("name", ""), list(link).index(collision)
    origin = collision.find("origin")
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = _numbers(origin.get("xyz"), (0.0, 0.0, 0.0))
        pose[:3, :3] = rotation_from_euler([_numbers(origin.get("rpy"), (0.0, 0.0, 0.0))])[0]
    link.remove(collision)
    for number, primitive in enumerate(fit.primitives):
        called = name if len(fit.primitives) == 1 else f"{name}.{number}"
        link.insert(at + number, element_of(called, pose @ primitive.pose, primitive))


def element_of(name: str, pose: np.ndarray, primitive: Primitive) -> ElementTree.Element:
    """Describe a shape as an element of a URDF."""
    made = ElementTree.Element("collision", name=name)
    (angles,) = euler_from_rotation(pose[None, :3, :3])
    ElementTree.SubElement(made, "origin", xyz=_text(pose[:3, 3]), rpy=_text(angles))
    geometry = ElementTree.SubElement(made, "geometry")
    names = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}[primitive.kind]
    values = [_text(primitive.size)] if primitive.kind == "box" else [_text([each]) for each in primitive.size]
    ElementTree.SubElement(geometry, primitive.kind, dict(zip(names, values, strict=True)))
    return made


def _numbers(text: str | None, default: tuple[float, ...]) -> tuple[float, ...]:
    """Read numbers of an attribute; wrong ones are left to the core, which names their line."""
    try:
        return default if text is None else tuple(float(word) for word in text.split())
    except ValueError:
        raise HandError(f"{text!r} is not a list of numbers; separate numbers by blanks") from None


def _text(values: "np.ndarray | tuple[float, ...] | list[float]") -> str:
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
