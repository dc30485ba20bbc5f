"""The table of formats, and writing and reading files of them."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from graspbox._common.arguments import floats
from graspbox._common.files import check_output, write_text
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.exchange import acronym, dexgraspbench, isaac
from graspbox.exchange.grasps import ExchangeGrasps
from graspbox.hands import HandLike, load_hand
from graspbox.meshes import MeshLike, as_mesh
from graspbox.object_sets import ObjectSpec

__all__ = ["FORMATS", "Format", "file_name", "load", "row_of", "rows_named", "save", "save_each", "with_mesh"]

Writer = Callable[[ExchangeGrasps, Path], None]
Reader = Callable[[Path, Hand, float | None], ExchangeGrasps]


@dataclass(frozen=True)
class Format:
    """One format of grasps.

    Attributes
    ----------
    name : str
        Its name in ``--to``.
    suffix : str
        Extension of its files.
    write, read : callable
        Write grasps into a file; read a file of a hand, with a preshape or None.
    outcomes, joints : bool
        Whether it stores outcomes, and whether it stores joint positions of the closed hand.
    single : bool
        Whether a file has a single grasp.
    """

    name: str
    suffix: str
    write: Writer
    read: Reader
    outcomes: bool = False
    joints: bool = False
    single: bool = False


#: A name can have several rows, which differ in suffix; the first is the one of folders.
FORMATS = (
    Format("acronym", ".h5", acronym.write_hdf5, acronym.read_hdf5, outcomes=True),
    Format("acronym", ".json", acronym.write_json, acronym.read_json, outcomes=True),
    Format("graspgen", ".json", acronym.write_graspgen, acronym.read_graspgen, outcomes=True),
    Format("isaac", ".yaml", isaac.write, isaac.read, outcomes=True, joints=True),
    Format("dexgraspbench", ".npy", dexgraspbench.write, dexgraspbench.read, joints=True, single=True),
)
_NAMES = tuple(dict.fromkeys(row.name for row in FORMATS))


def rows_named(to: str) -> list[Format]:
    """Return the rows of a format.

    Raises
    ------
    ConfigError
        If there is none of this name.
    """
    rows = [row for row in FORMATS if row.name == to]
    if not rows:
        raise ConfigError(f"there is no format {to!r}; choose from {', '.join(_NAMES)}")
    return rows


def row_of(path: Path, to: str) -> Format | None:
    """Return the row of a format that a file's suffix names; None if the path has no suffix, so is a folder.

    Raises
    ------
    ConfigError
        For another suffix, or a format that does not exist.
    """
    rows = rows_named(to)
    for row in rows:
        if path.suffix.lower() == row.suffix:
            return row
    if path.suffix and not path.is_dir():
        known = " or ".join(row.suffix for row in rows)
        raise ConfigError(f"{str(path)!r} has the suffix {path.suffix!r}; files of {to} end in {known}")
    return None


def save(grasps: ExchangeGrasps, path: str | os.PathLike[str], to: str) -> None:
    """Write grasps of one object into a file, which is replaced atomically.

    Parameters
    ----------
    grasps : ExchangeGrasps
        The grasps; ``dexgraspbench`` stores one per file.
    path : str or PathLike
        The file. Its suffix is one of `FORMATS`: ``.h5`` or ``.json`` (``acronym``), ``.json`` (``graspgen``),
        ``.yaml`` (``isaac``), ``.npy`` (``dexgraspbench``).
    to : str
        Name of the format.

    Raises
    ------
    ConfigError
        If the format or the suffix does not exist, or the format needs something that is not known: outcomes
        (``acronym``, ``graspgen``), outcomes or probabilities (``isaac``), joint positions (``dexgraspbench``).
    FileError
        If the file cannot be written.
    MissingExtraError
        Without h5py or PyYAML (extra ``exchange``).
    """
    target = Path(path)
    row = row_of(target, to)
    if row is None:
        raise ConfigError(f"{str(target)!r} has no suffix; end it in {rows_named(to)[0].suffix}, or use save_each")
    row.write(grasps, check_output(target))


def save_each(grasps: Sequence[ExchangeGrasps], folder: str | os.PathLike[str], to: str) -> list[Path]:
    """Write the grasps of several objects into a folder, and return the files.

    There is one file per object, ``NAME.h5``, ``NAME.json`` or ``NAME.yaml``; ``dexgraspbench`` gets one per grasp,
    ``NAME/INDEX.npy``, without those at which the hand collides. ``graspgen`` also gets the lists ``train.txt`` and
    ``valid.txt`` of the objects' files by split (`graspbox.object_sets`).

    Parameters
    ----------
    grasps : sequence of ExchangeGrasps
        The grasps of each object; the names of the objects differ.
    folder : str or PathLike
        The folder, which is made if it is missing.
    to : str
        Name of the format.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `save`; if two objects have the same name.
    """
    row, target = rows_named(to)[0], Path(folder)
    names = [file_name(one.object_name) for one in grasps]
    if len(set(names)) < len(names):
        again = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f"{again!r} names two objects; give every object another name")
    written = []
    for name, one in zip(names, grasps, strict=True):
        parts = [(target / f"{name}{row.suffix}", one)]
        if row.single:
            closed = one[one.closed]
            parts = [(target / name / f"{index}{row.suffix}", closed[[index]]) for index in range(len(closed))]
        for path, part in parts:
            row.write(part, check_output(path))
            written.append(path)
    if to == "graspgen":
        written += _write_splits(grasps, target)
    return written


def _write_splits(grasps: Sequence[ExchangeGrasps], folder: Path) -> list[Path]:
    """Write GraspGen's lists of objects."""
    lists: dict[str, list[str]] = {"train": [], "valid": []}
    for one in grasps:
        split = "train" if ObjectSpec(one.object_name).split == "train" else "valid"
        lists[split].append(one.mesh_file or one.object_name)
    for name, files in lists.items():
        write_text(folder / f"{name}.txt", "".join(f"{file}\n" for file in files))
    return [folder / f"{name}.txt" for name in lists]


def file_name(name: str) -> str:
    """Return the name of an object as the name of a file."""
    safe = "".join(letter if letter.isalnum() or letter in "-_. " else "_" for letter in name).strip(". ")
    return safe[:150] or "object"


def with_mesh(grasps: ExchangeGrasps, mesh: MeshLike, folder: str | os.PathLike[str]) -> ExchangeGrasps:
    """Write the mesh of the grasps as ``meshes/NAME.obj`` in a folder, and return grasps that name this file.

    The file has the mesh as graspbox uses it: in metres, in the object's frame. Relative to the folder, its path is
    the one in the files of the grasps.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    loaded, relative = as_mesh(mesh), f"meshes/{file_name(grasps.object_name)}.obj"
    vertices = ["v {:.9g} {:.9g} {:.9g}".format(*row) for row in loaded.vertices.tolist()]
    faces = ["f {} {} {}".format(*row) for row in (loaded.faces.astype(np.int64) + 1).tolist()]
    write_text(check_output(Path(folder) / relative), "\n".join(["# metres", *vertices, *faces]) + "\n")
    return replace(grasps, mesh_file=relative, scale=1.0)


def load(
    path: str | os.PathLike[str],
    *,
    hand: HandLike = "panda_gripper",
    preshape: float | None = None,
    to: str | None = None,
) -> ExchangeGrasps:
    """Read grasps of another program, as poses to try.

    ``graspbox.simulate(mesh, found.poses, found.preshape, hand=found.hand)`` tries them, where `mesh` is the file
    ``found.mesh_file`` with the scale ``found.scale``.

    Parameters
    ----------
    path : str or PathLike
        The file.
    hand : str, Hand or pair of paths
        The hand of the grasps; that of ACRONYM is the Franka Hand.
    preshape : float, optional
        Preshape of all grasps; by default as in the file, else the only one of the hand.
    to : str, optional
        Name of the format; by default it follows from the suffix. The contents of a JSON file
        distinguish ACRONYM from GraspGen.

    Returns
    -------
    ExchangeGrasps
        In the order of the file.

    Raises
    ------
    ConfigError
        If the file is damaged, too large, of another format or another gripper, or the preshape is missing;
        the message names the entry.
    FileError
        If it cannot be read.
    MissingExtraError
        Without h5py or PyYAML (extra ``exchange``).
    """
    target, found = Path(path), load_hand(hand)
    rows = [row for row in FORMATS if to is None or row.name == to]
    if to is not None:
        rows_named(to)
    row = next((row for row in rows if row.suffix == target.suffix.lower()), None)
    if row is None:
        known = ", ".join(dict.fromkeys(row.suffix for row in rows))
        raise ConfigError(f"{str(target)!r} has the suffix {target.suffix!r}; files with {known} are read")
    shape = None if preshape is None else float(floats(preshape, "preshape").reshape(-1)[0])
    try:
        made = row.read(target, found, shape)
    except ConfigError as error:
        raise ConfigError(f"{str(target)!r}: {error}") from None
    return made if made.object_name else replace(made, object_name=target.stem)
