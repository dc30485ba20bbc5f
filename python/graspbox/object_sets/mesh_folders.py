"""Folders of meshes: object files, object names, and masses."""

import csv
import logging
import os
from collections.abc import Collection, Iterator
from difflib import get_close_matches
from pathlib import Path

from graspbox._common.files import read_bounded
from graspbox._core import MESH_SUFFIXES
from graspbox.errors import ObjectSetError

__all__ = ["MASSES", "MESH_SUFFIXES", "masses_in", "meshes_in"]

#: Table of a folder with the masses of its objects.
MASSES = "masses.csv"
_COLUMNS = ["name", "mass"]
#: Greatest size of a table, bytes.
_MAX_TABLE = 1 << 26
#: Greatest mass that a hand can hold, kilograms: a greater number is in grams.
_MAX_MASS = 25.0

#: Suffixes of meshes and scenes that are not read; files with them are named when a folder is searched.
_NOT_READ = frozenset(f".{name}" for name in ("3ds", "3mf", "blend", "dae", "fbx", "iges", "igs", "step", "stp", "usd"))
_NOT_READ |= {".usda", ".usdc", ".usdz", ".wrl", ".x3d"}
#: Files that the warning names.
_NAMED = 5
#: Files that represent their folder, best first: YCB (two reconstructions, and the scanner's), APC 2015.
_LAYOUTS = (
    "meshes/tsdf_mesh.stl",
    "meshes/poisson_mesh.stl",
    "google_16k/nontextured.stl",
    "textured_meshes/optimized_tsdf_textured_mesh.ply",
)
#: Larger folders are refused: they are a mistake, such as ``dir:/``.
_MAX_FILES = 1_000_000
_log = logging.getLogger(__name__)


def meshes_in(folder: Path) -> list[tuple[str, Path]]:
    """Find the meshes of a folder with their names; a subfolder in a known layout is one object with its name.

    A warning names what is left out: dangling links, and files of formats that are not read.
    """
    found: list[tuple[str, Path]] = []
    others: list[Path] = []
    for entry in sorted(folder.iterdir()):
        if entry.is_file() and entry.suffix.lower() in MESH_SUFFIXES:
            found.append((entry.stem, entry))
        elif entry.is_dir():
            layout = next((entry / file for file in _LAYOUTS if (entry / file).is_file()), None)
            found += [(entry.name, layout)] if layout else _meshes_below(folder, entry, others)
        elif entry.suffix.lower() in _NOT_READ:
            others.append(entry)
        elif entry.suffix.lower() in MESH_SUFFIXES or not entry.suffix:
            _warn_of_dangling(entry)
    if others:
        names = ", ".join(str(path.relative_to(folder)) for path in others[:_NAMED])
        _log.warning(
            "%d files of %s are left out, because their formats are not read: %s%s; convert them, for example with "
            "trimesh or Blender, to one of %s",
            len(others),
            folder,
            names,
            ", ..." if len(others) > _NAMED else "",
            ", ".join(MESH_SUFFIXES),
        )
    return found


def _meshes_below(root: Path, folder: Path, others: list[Path]) -> Iterator[tuple[str, Path]]:
    """Find the meshes in a folder and its subfolders, named by their path from `root`; does not follow links.

    Files of formats that are not read are added to `others`.
    """

    def fail(error: OSError) -> None:
        raise error

    paths: list[Path] = []
    seen = 0
    for parent, _, names in os.walk(folder, onerror=fail):
        seen += len(names)
        if seen > _MAX_FILES:
            raise ObjectSetError(f"there are more than {_MAX_FILES} files in {str(folder)!r}; name a smaller folder")
        files = [Path(parent, name) for name in names]
        paths += [path for path in files if path.suffix.lower() in MESH_SUFFIXES]
        others += sorted(path for path in files if path.suffix.lower() in _NOT_READ)
    for path in sorted(paths):
        if path.is_file():
            yield path.relative_to(root).with_suffix("").as_posix(), path
        else:
            _warn_of_dangling(path)


def _warn_of_dangling(path: Path) -> None:
    """Warn of a link to nothing."""
    if path.is_symlink() and not path.exists():
        _log.warning("%s is left out: it is a link to %s, which does not exist", path, path.readlink())


def masses_in(folder: Path, names: Collection[str]) -> dict[str, float]:
    """Read the table of masses of a folder: a CSV file with the columns ``name`` and ``mass``, kilograms.

    Parameters
    ----------
    folder : Path
        The folder.
    names : collection of str
        Its objects; those missing in the table get their mass by other means.

    Returns
    -------
    dict
        Mass by name; empty if the folder has no table.

    Raises
    ------
    ObjectSetError
        If a row names no object or repeats one, or its mass is not a number of kilograms.
    FileError
        If the file cannot be read.
    """
    path = folder / MASSES
    if not path.exists():
        return {}
    try:
        rows = list(csv.reader(read_bounded(path, _MAX_TABLE).decode("utf-8-sig").splitlines(), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ObjectSetError(f"{str(path)!r} is not a UTF-8 CSV file: {error}") from None
    if not rows or [cell.strip() for cell in rows[0]] != _COLUMNS:
        raise ObjectSetError(f"{str(path)!r} must begin with the line 'name,mass'; masses are in kilograms")
    masses: dict[str, float] = {}
    for line, row in enumerate(rows[1:], 2):
        if not row:
            continue
        where = f"{str(path)!r}, line {line}"
        if len(row) != len(_COLUMNS):
            columns = f"{len(row)} column{'' if len(row) == 1 else 's'}"
            raise ObjectSetError(f"{where} has {columns}; write a name and a mass in kilograms")
        name = row[0].strip()
        if name not in names:
            near = get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else "'graspbox objects' lists the names"
            raise ObjectSetError(f"{where} names {name!r}, which is not an object of the folder; {hint}")
        if name in masses:
            raise ObjectSetError(f"{where} repeats {name!r}")
        masses[name] = _kilograms(row[1], f"{where}: the mass of {name!r}")
    return masses


def _kilograms(text: str, name: str) -> float:
    try:
        mass = float(text)
    except ValueError:
        raise ObjectSetError(f"{name} is {text!r}; write a number of kilograms, such as 0.25") from None
    if mass > _MAX_MASS:
        raise ObjectSetError(f"{name} is {text.strip()}, which looks like grams; write kilograms: {mass / 1000:g}")
    if not mass > 0.0:
        raise ObjectSetError(f"{name} is {text.strip()}; write a positive number of kilograms")
    return mass
