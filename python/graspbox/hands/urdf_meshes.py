"""URDFs whose collision meshes are replaced by boxes, cylinders and spheres, which the simulation supports.

A fitted shape is cached in `graspbox.hands.cache_folder`, by the content of its mesh. The new text has the lines of the
old one, so that errors and assumptions about it name those of the file.
"""

import hashlib
import logging
import os
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.files import read_bounded
from graspbox._common.progress import ProgressBar
from graspbox._common.rotations import euler_from_rotation
from graspbox.errors import FileError, GraspboxError, HandError, MissingExtraError
from graspbox.hands.loop_fits import LoopFit
from graspbox.hands.mesh_files import LARGEST_MESH, check_reader, read_mesh
from graspbox.hands.mesh_fits import MeshFit, MeshFits, Primitive, cached_fits, chosen, fits_of, mesh_key

__all__ = ["FittedUrdf", "add_origin", "collisions", "numbers_text", "read_text", "with_primitives"]

Array = NDArray[np.float64]

_LOG = logging.getLogger(__name__)
#: Largest URDF and ``hand.toml``, bytes; the core has the same limit.
LARGEST = 1 << 20
#: Most collision meshes of a hand.
_MOST_MESHES = 256
#: Mesh files whose triangles may be in files beside them.
_WITH_OTHERS = (".gltf", ".glb")
#: Time after which fitting shows its progress, seconds.
_DELAY = 2.0


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
    assumptions : tuple of str
        What was assumed to make it, a sentence each; those about the text itself are in `graspbox.Hand.assumptions`.
    name : str
        What errors and assumptions about the text call it: the file with the same lines.
    no_contact : tuple of tuple of str
        Lists of links and colliders of an MJCF file that do not touch each other.
    """

    text: str
    fits: dict[str, MeshFit]
    loops: dict[str, LoopFit] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    name: str = "URDF"
    no_contact: tuple[tuple[str, ...], ...] = ()


def with_primitives(
    text: str,
    path: Path,
    name: str,
    check: Callable[[str], object] | None = None,
) -> FittedUrdf:
    """Replace the collision meshes of a URDF by primitives; without any, its text stays the same.

    Parameters
    ----------
    text : str
        The URDF.
    path : Path
        Where it is: meshes are named relative to its folder.
    name : str
        What errors call it.
    check : callable, optional
        Called before meshes are fitted, which may take minutes, with the URDF with a box in place of each; raises the
        errors of what goes with it.
    """
    if not re.search(r"<\s*mesh\b", text):
        return FittedUrdf(text, {}, name=name)
    meshes, unnamed = _core.urdf_meshes(text, name)
    if len(meshes) > _MOST_MESHES:
        raise HandError(f"{name}: has {len(meshes)} collision meshes; merge them, or use primitives ({_MOST_MESHES})")
    at = [f"{name}:{mesh['line']}: collider {mesh['name']!r}: mesh {mesh['file']!r}" for mesh in meshes]
    assumptions: list[str] = []
    files = [_file_of(path.parent, place, mesh["file"], assumptions) for place, mesh in zip(at, meshes, strict=True)]
    if check is not None:
        check(_replaced(text, meshes, unnamed, {mesh["name"]: (_PLACEHOLDER,) for mesh in meshes}))
    found = _fitted(at, meshes, files)
    fits = dict(zip((mesh["name"] for mesh in meshes), chosen(found), strict=True))
    for each, fit in fits.items():
        _LOG.info(
            "%s: %s is %d primitives, %.1f mm from its mesh on average and %.1f mm at most",
            path.name, each, len(fit.primitives), 1e3 * fit.mean, 1e3 * fit.most,
        )  # fmt: skip
    text = _replaced(text, meshes, unnamed, {each: fit.primitives for each, fit in fits.items()})
    return FittedUrdf(text, fits, assumptions=tuple(assumptions), name=name)


_PLACEHOLDER = Primitive("box", np.eye(4), (0.01, 0.01, 0.01))


def _fitted(places: Sequence[str], meshes: Sequence[dict[str, Any]], files: Sequence[Path]) -> list[MeshFits]:
    """Fit primitives to every mesh, on all cores; those of equal files once."""
    keys = [(file, tuple(mesh["scale"])) for mesh, file in zip(meshes, files, strict=True)]
    first = {key: number for number, key in reversed(list(enumerate(keys)))}
    jobs = sorted(first.values())
    found: dict[int, MeshFits] = {}
    with (
        ThreadPoolExecutor(_core.num_threads()) as pool,
        ProgressBar("fit shapes to meshes", len(jobs), delay=_DELAY) as bar,
    ):
        every = ([each[job] for job in jobs] for each in (places, meshes, files))
        for job, fits in zip(jobs, pool.map(_fit, *every), strict=True):
            found[job] = fits
            bar.update(len(found))
    return [found[first[key]] for key in keys]


def _replaced(
    text: str,
    meshes: Sequence[dict[str, Any]],
    unnamed: Sequence[tuple[int, str]],
    primitives: dict[str, tuple[Primitive, ...]],
) -> str:
    """Write primitives in place of meshes, and the names of shapes beside them; every line keeps its number."""
    content = text.encode()
    within = [(mesh["start"], mesh["end"]) for mesh in meshes]
    edits = [(at, at, f' name="{name}"') for at, name in unnamed if not any(start <= at < end for start, end in within)]
    for mesh in meshes:
        start, end = mesh["start"], mesh["end"]
        shapes = collisions(mesh["name"], np.array(mesh["link_from_mesh"]), primitives[mesh["name"]], mesh["element"])
        written = "".join(ElementTree.tostring(shape, encoding="unicode") for shape in shapes)
        edits.append((start, end, written + "\n" * content[start:end].count(b"\n")))
    for start, end, written in sorted(edits, reverse=True):
        content = content[:start] + written.encode() + content[end:]
    return content.decode()


def read_text(path: Path) -> str:
    """Read a file of a hand; a HandError names one that cannot be read."""
    try:
        return read_bounded(path, LARGEST).decode().removeprefix("\ufeff")
    except UnicodeDecodeError:
        raise HandError(f"{path} is not UTF-8 text") from None
    except FileError as error:
        raise HandError(f"{path}: {error}") from None


def _file_of(folder: Path, place: str, filename: str, assumptions: list[str]) -> Path:
    """Find the file of a mesh, and what reads it; add what had to be assumed."""
    # A name that is too long for the system is that of no file.
    file = next((each for each in _places(folder, filename) if os.path.isfile(each)), None)
    if file is None:
        file = next((each for each in _moved(folder, filename) if os.path.isfile(each)), None)
        if file is not None:
            assumptions.append(f"{place} is missing; it is taken to be {file}")
    if file is None:
        raise HandError(
            f"{place} is missing; name it from the URDF's folder, or as package://NAME/... with NAME above it, or "
            "source the ROS workspace of NAME"
        )
    check_reader(file, place)
    return file


def _fit(place: str, mesh: dict[str, Any], file: Path) -> MeshFits:
    """Fit primitives to the mesh of a collider, or take them from the cache."""
    try:
        content = read_bounded(file, LARGEST_MESH)
        if file.suffix.lower() in _WITH_OTHERS:
            read = read_mesh(file, content, mesh["scale"])
            return cached_fits(mesh_key(read), lambda: fits_of(read))
        # Readers change with the version.
        head = f"{_core.__version__} {mesh['scale']} {file.suffix.lower()} "
        key = hashlib.sha256(head.encode() + content).hexdigest()
        return cached_fits(key, lambda: fits_of(read_mesh(file, content, mesh["scale"])))
    except MissingExtraError:
        raise
    except GraspboxError as error:
        raise HandError(f"{place}: {error}") from None


def _places(folder: Path, filename: str) -> Iterator[Path]:
    """List the files that a name in a URDF may mean."""
    package = re.match(r"(?:package|model)://", filename)
    if package is None:
        yield folder / filename.removeprefix("file://")
        return
    inside = Path(filename[package.end() :])
    for above in (folder.resolve(), *folder.resolve().parents):
        yield above / inside
        # The package's own folder, under another name.
        yield above / Path(*inside.parts[1:])
    for variable, share in (("AMENT_PREFIX_PATH", "share"), ("ROS_PACKAGE_PATH", "")):  # of a sourced ROS workspace
        for found in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(found, share) / inside


def _moved(folder: Path, filename: str) -> Iterator[Path]:
    """List the files that a path of another machine may mean: its longest ends, of a folder and a file or more."""
    path = Path(filename.removeprefix("file://"))
    if path.is_absolute():
        for start in range(1, len(path.parts) - 1):
            for above in (folder.resolve(), *folder.resolve().parents):
                yield above / Path(*path.parts[start:])


def collisions(
    name: str, pose: Array, primitives: Sequence[Primitive], tag: str = "collision"
) -> list[ElementTree.Element]:
    """Return the elements of a URDF for the primitives of a collider at a pose (4, 4); several get numbers."""
    elements = []
    for number, primitive in enumerate(primitives):
        element = ElementTree.Element(tag, name=name if len(primitives) == 1 else f"{name}.{number}")
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


def numbers_text(values: Array | Sequence[float]) -> str:
    """Write numbers for an attribute, with 9 digits."""
    return " ".join(f"{float(value):.9g}" for value in values)
