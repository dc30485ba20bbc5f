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
from graspbox.hands import HandLike, load_hand
from graspbox.meshes import MeshLike
from graspbox.object_sets import ObjectSpec
from graspbox.tools.exchange import acronym, dexgraspbench, isaac
from graspbox.tools.exchange.grasps import ExchangeGrasps, own_mesh

__all__ = ["FORMATS", "Format", "file_name", "load", "row_of", "rows_named", "save", "save_each", "with_mesh"]

Writer = Callable[[ExchangeGrasps, Path], None]
Reader = Callable[[Path, Hand, float | None], ExchangeGrasps]


@dataclass(frozen=True)
class Format:
    """One format of grasps, by its name in ``--to`` and the suffix of its files.

    ``write`` writes grasps into a file. ``read`` reads a file of a hand, with a preshape or None; it is None for files
    that run code when they are read. ``outcomes`` and ``joints`` say whether the format stores outcomes and joint
    positions of the closed hand, ``single`` whether a file has a single grasp.
    """

    name: str
    suffix: str
    write: Writer
    read: Reader | None
    outcomes: bool = False
    joints: bool = False
    single: bool = False


#: A name can have several rows, which differ in suffix; the first is the one of folders.
FORMATS = (
    Format("acronym", ".h5", acronym.write_hdf5, acronym.read_hdf5, outcomes=True),
    Format("acronym", ".json", acronym.write_json, acronym.read_json_grasps, outcomes=True),
    Format("graspgen", ".json", acronym.write_graspgen, acronym.read_json_grasps, outcomes=True),
    Format("isaac", ".yaml", isaac.write, isaac.read, outcomes=True, joints=True),
    Format("dexgraspbench", ".npy", dexgraspbench.write, None, joints=True, single=True),
)


def rows_named(to: str) -> tuple[Format, ...]:
    """Return the rows of a format; a ConfigError lists the names."""
    rows = tuple(row for row in FORMATS if row.name == to)
    if not rows:
        raise ConfigError(f"there is no format {to!r}; choose from {', '.join(dict.fromkeys(r.name for r in FORMATS))}")
    return rows


def row_of(path: Path, to: str) -> Format | None:
    """Return the row of a format that a file's suffix names; None if the path has no suffix, so is a folder."""
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
        The file, whose suffix is that of the format in `FORMATS`.
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

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `save`; if two objects have the same name.
    """
    row, target = rows_named(to)[0], Path(folder)
    names = [file_name(one.object_name) for one in grasps]
    if len(set(names)) < len(names):
        again = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f"{again!r} names two objects; rename one of them")
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
    paths = {True: folder / "train.txt", False: folder / "valid.txt"}
    for is_train, path in paths.items():
        own = [one for one in grasps if (ObjectSpec(one.object_name).split == "train") == is_train]
        write_text(path, "".join(f"{one.mesh_file or one.object_name}\n" for one in own))
    return list(paths.values())


def file_name(name: str) -> str:
    """Return the name of an object as the name of a file."""
    safe = "".join(letter if letter.isalnum() or letter in "-_. " else "_" for letter in name).strip(". ")
    return safe[:150] or "object"


def with_mesh(grasps: ExchangeGrasps, mesh: MeshLike, folder: str | os.PathLike[str]) -> ExchangeGrasps:
    """Write the mesh of the grasps as ``meshes/NAME.obj`` in a folder, and return grasps that name this file.

    The file has the mesh as graspbox uses it: in metres, in the object's frame. Relative to the folder, its path is
    the one in the files of the grasps (`ExchangeGrasps.load_mesh` reads it). The grasps get the mass of the mesh.

    Raises
    ------
    FileError
        If it cannot be written.
    ConfigError
        If the grasps are for another mesh.
    """
    loaded, relative = own_mesh(grasps, mesh), f"meshes/{file_name(grasps.object_name)}.obj"
    vertices = ["v {:.9g} {:.9g} {:.9g}".format(*row) for row in loaded.vertices.tolist()]
    faces = ["f {} {} {}".format(*row) for row in (loaded.faces.astype(np.int64) + 1).tolist()]
    write_text(check_output(Path(folder) / relative), "\n".join(["# metres", *vertices, *faces]) + "\n")
    return replace(grasps, mesh_file=relative, scale=1.0, mass=loaded.mass)


def load(
    path: str | os.PathLike[str],
    *,
    hand: HandLike = "panda_gripper",
    preshape: float | None = None,
    to: str | None = None,
) -> ExchangeGrasps:
    """Read grasps of another program, in the order of the file, as poses to try.

    ``graspbox.simulate(mesh, grasps.poses, grasps.preshape, hand=grasps.hand)`` tries them, where `mesh` is the file
    ``grasps.mesh_file`` with the scale ``grasps.scale``.

    Parameters
    ----------
    hand : str, Hand or pair of paths
        The hand of the grasps; that of ACRONYM is the Franka Hand.
    preshape : float, optional
        Preshape of all grasps; by default as in the file, else the only one of the hand.
    to : str, optional
        Name of the format; by default it follows from the suffix. The contents of a JSON file
        distinguish ACRONYM from GraspGen.

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
    target, loaded = Path(path), load_hand(hand)
    rows = FORMATS if to is None else rows_named(to)
    row = next((row for row in rows if row.suffix == target.suffix.lower()), None)
    if row is None:
        known = ", ".join(dict.fromkeys(row.suffix for row in rows if row.read is not None))
        raise ConfigError(f"{str(target)!r} has the suffix {target.suffix!r}; files with {known} are read")
    if row.read is None:
        raise ConfigError(
            f"{str(target)!r} is a pickle, which can run any code when it is read; convert a file that you trust with "
            "scripts/convert_dexgraspbench.py"
        )
    shape = None if preshape is None else float(floats(preshape, "preshape").reshape(-1)[0])
    try:
        made = row.read(target, loaded, shape)
    except ConfigError as error:
        raise ConfigError(f"{str(target)!r}: {error}") from None
    return made if made.object_name else replace(made, object_name=target.stem)
