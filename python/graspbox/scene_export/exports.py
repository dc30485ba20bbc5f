"""Exports of scenes, of single objects and of object sets, each as a folder that appears whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from graspbox import _core, object_sets
from graspbox._common.arguments import floats, shown
from graspbox._common.extras import imported
from graspbox._common.files import dumps
from graspbox._common.refusals import errors_of, is_refusal, reason
from graspbox.errors import ConfigError, GraspboxError
from graspbox.planning import Grasp
from graspbox.scene_export.contents import ObjectData, SceneData, Start
from graspbox.scene_export.description import Array, read_hand
from graspbox.scene_export.folders import check_folder, file_name, new_folder, write_all
from graspbox.scene_export.losses import FORMATS, NOT_EXPRESSED, Format
from graspbox.scene_export.mesh_files import VISUAL, object_meshes, part_name
from graspbox.scene_export.mjcf import MeshFiles, object_model, scene_model
from graspbox.scene_export.records import object_record, scene_record
from graspbox.scene_export.urdf import object_urdf, table_urdf
from graspbox.simulation import Scene

__all__ = ["Export", "SetExport", "export_object", "export_objects", "export_scene", "scene_data"]

#: Folder of the mesh files of an export, and name of its record.
_MESHES, SCENE_RECORD, OBJECT_RECORD, SET_RECORD = "meshes", "scene.json", "object.json", "objects.json"
_NAMES: dict[Format, str] = {"mjcf": "xml", "usd": "usda", "urdf": "urdf"}


@dataclass(frozen=True)
class Export:
    """Files of an export.

    Attributes
    ----------
    to : str
        The format.
    folder : Path
        The folder.
    files : tuple of Path
        All files, first the one to open.
    not_expressed : tuple of str
        Properties of the scene that the format cannot express, as sentences.
    """

    to: Format
    folder: Path
    files: tuple[Path, ...]
    not_expressed: tuple[str, ...]


@dataclass(frozen=True)
class SetExport:
    """Files of the export of an object set.

    Attributes
    ----------
    to, folder
        As of `Export`.
    files : dict of str to Path
        The file to open, by the name of the object.
    refused : dict of str to str
        Reason why an object could not be exported, by name.
    """

    to: Format
    folder: Path
    files: dict[str, Path]
    refused: dict[str, str]


def _format(to: str) -> Format:
    for known in FORMATS:
        if to == known:
            return known
    raise ConfigError(f"the format is {shown(to)}; choose from {', '.join(FORMATS)}")


def _usd() -> ModuleType:
    """Import the writer of USD."""
    imported("pxr", "USD needs usd-core, from the extra 'usd'", "usd")
    from graspbox.scene_export import usd

    return usd


def _object(scene: Scene) -> ObjectData:
    body = scene.body
    rest = np.array(scene.world_from_object)
    return ObjectData(scene.name, body.parts, body.mass, body.center_of_mass, body.inertia, rest, scene.mesh)


def _pose(pose: ArrayLike | Grasp, preshape: float | None, scene: Scene) -> tuple[Array, float]:
    """Check a pose and a preshape; returns ``object_from_hand``."""
    if isinstance(pose, Grasp):
        if preshape is not None:
            raise ConfigError("preshape is given twice; leave it out, since a grasp includes it")
        matrix, preshape = pose.pose, pose.preshape
    else:
        matrix = floats(pose, "pose")
    if matrix.shape != (4, 4) or not bool(_core.is_rigid(matrix[None])[0]):
        raise ConfigError(f"pose has shape {list(matrix.shape)} or is not a rigid motion; give a 4x4 object_from_hand")
    if preshape is None:
        raise ConfigError("preshape is missing; give one, or a grasp of a plan instead of a pose")
    value = floats(preshape, "preshape")
    low, high = scene.hand.preshape_limits
    if value.size != 1 or not low <= float(value.item()) <= high:
        raise ConfigError(f"preshape is {shown(preshape)}; give one number from {low:g} to {high:g}")
    if scene.hand.preshape_unit == "1" and not float(value.item()).is_integer():
        raise ConfigError(f"preshape is {shown(preshape)}; give the number of a named preshape, {low:g} to {high:g}")
    return matrix, float(value.item())


def scene_data(scene: Scene, pose: ArrayLike | Grasp, preshape: float | None = None) -> SceneData:
    """Collect the contents of a scene with a grasp; the arguments are those of `export_scene`."""
    if scene.others or len(scene.world_from_walls):
        raise ConfigError(
            f"the scene has {1 + len(scene.others)} objects and {len(scene.world_from_walls)} walls, an export one "
            f"object on the table; export graspbox.Scene(mesh) for one of them"
        )
    object_from_hand, value = _pose(pose, preshape, scene)
    world_from_hand = np.asarray(scene.world_from_object @ object_from_hand)
    start = Start(read_hand(*scene.hand.files), world_from_hand, value)
    return SceneData(_object(scene), start, scene.physics)


def _comments(title: str, to: Format) -> list[str]:
    lines = [f"{title}, exported by graspbox {_core.__version__}. Metres, kilograms, seconds, radians; z is up."]
    return lines + list(NOT_EXPRESSED[to])


def _object_files(item: ObjectData, to: Format) -> dict[str, str]:
    """Return the mesh files of an object by their names in the folder; USD contains its meshes."""
    return {} if to == "usd" else {f"{_MESHES}/{name}": text for name, text in object_meshes(item).items()}


def _mesh_names(item: ObjectData) -> MeshFiles:
    visual = None if item.visual is None else f"{_MESHES}/{VISUAL}"
    return MeshFiles([f"{_MESHES}/{part_name(i)}" for i in range(len(item.parts))], visual)


def _scene_files(data: SceneData, scene: Scene, to: Format) -> dict[str, str]:
    """Return the files of a scene by name, the one to open first; the record is the last."""
    item, names = data.object, _mesh_names(data.object)
    urdf, toml = scene.hand.files
    comments = _comments(f"{item.name} and {data.hand.name}", to)
    roles = {"hand_urdf": "hand.urdf", "hand_toml": "hand.toml"}
    main: dict[str, str]
    if to == "mjcf":
        main = {"scene.xml": scene_model(item, data.start, names, data.physics, comments)}
        roles = {"scene": "scene.xml", **roles}
    elif to == "usd":
        main = {"scene.usda": _usd().scene_stage(data, comments)}
        roles = {"scene": "scene.usda", **roles}
    else:
        main = {
            "object.urdf": object_urdf(item, list(names.parts), names.visual, data.physics),
            "table.urdf": table_urdf(data.physics),
        }
        roles = {"object": "object.urdf", "table": "table.urdf", **roles}
    record = dumps(scene_record(data, to, roles)) + "\n"
    return {**main, "hand.urdf": urdf, "hand.toml": toml, **_object_files(item, to), SCENE_RECORD: record}


def export_scene(
    scene: Scene,
    folder: str | os.PathLike[str],
    to: Format,
    pose: ArrayLike | Grasp,
    preshape: float | None = None,
) -> Export:
    """Write a scene at the start of a trial: object at rest, open hand at a pose, table.

    Parameters
    ----------
    scene : Scene
        The object, the hand and the physics.
    folder : str or PathLike
        Folder to make; it may exist if it is empty.
    to : str
        The format: ``mjcf`` writes ``scene.xml`` with its meshes, ``usd`` ``scene.usda``, and ``urdf`` a file each for
        object, table and hand. Every format has ``scene.json`` (see `graspbox.scene_export.records`) and the hand's
        two files.
    pose : (4, 4) array_like, or Grasp
        ``object_from_hand``, metres; a grasp of a plan includes its preshape. It is not tested for collisions.
    preshape : float, optional
        See `graspbox.Hand.preshape_limits`; not with a grasp.

    Raises
    ------
    ConfigError
        For an unknown format, a scene of several objects, a pose that is not a rigid motion, a preshape out of range, a
        folder with files, or a hand with names that an MJCF model cannot have.
    FileError
        If the folder cannot be written.
    MissingExtraError
        Without SciPy (extra ``scenes``), or for ``usd`` without usd-core (extra ``usd``).
    """
    form = _format(to)
    check_folder(folder)
    data = scene_data(scene, pose, preshape)
    files = _scene_files(data, scene, form)
    with new_folder(folder) as temporary:
        write_all(temporary, files)
    return _export(form, folder, files)


def _export(to: Format, folder: str | os.PathLike[str], files: dict[str, str]) -> Export:
    return Export(to, Path(folder), tuple(Path(folder) / name for name in files), NOT_EXPRESSED[to])


def _single_files(scene: Scene, to: Format) -> dict[str, str]:
    """Return the files of an object alone by name, the one to open first; the record is the last."""
    item, names = _object(scene), _mesh_names(_object(scene))
    comments = _comments(item.name, to)
    main = f"object.{_NAMES[to]}"
    if to == "mjcf":
        text = object_model(item, names, scene.physics, comments)
    elif to == "usd":
        text = _usd().object_stage(item, scene.physics, comments)
    else:
        text = object_urdf(item, list(names.parts), names.visual, scene.physics)
    record = dumps(object_record(item, scene.physics, to, {"object": main})) + "\n"
    return {main: text, **_object_files(item, to), OBJECT_RECORD: record}


def export_object(scene: Scene, folder: str | os.PathLike[str], to: Format) -> Export:
    """Write the object of a scene alone: visual mesh, convex parts, mass properties and friction.

    Parameters
    ----------
    scene : Scene
        The object; its hand does not matter.
    folder : str or PathLike
        Folder to make; it may exist if it is empty.
    to : str
        The format, ``mjcf``, ``usd`` or ``urdf``; the file is ``object.xml``, ``object.usda`` or ``object.urdf``.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `export_scene`.
    """
    form = _format(to)
    check_folder(folder)
    files = _single_files(scene, form)
    with new_folder(folder) as temporary:
        write_all(temporary, files)
    return _export(form, folder, files)


def export_objects(
    objects: str | Path | object_sets.ObjectSet | Sequence[str | Path],
    folder: str | os.PathLike[str],
    to: Format,
    *,
    done: Callable[[str], None] | None = None,
) -> SetExport:
    """Write every object of a set as `export_object` does, each into its own folder, and ``objects.json``.

    Parameters
    ----------
    objects : str, Path, ObjectSet, or sequence of str
        See `graspbox.object_sets.load`.
    folder : str or PathLike
        Folder to make; it may exist if it is empty.
    to : str
        The format, ``mjcf``, ``usd`` or ``urdf``.
    done : callable, optional
        Called with the name of each object, exported or not.

    Returns
    -------
    SetExport
        An object that cannot be read or simulated is left out; ``refused`` has the reason.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `export_scene`.
    ObjectSetError
        As `graspbox.object_sets.load`.
    """
    form = _format(to)
    check_folder(folder)
    found = object_sets.load(objects)
    written: dict[str, str] = {}
    records: list[dict[str, object]] = []
    refused: dict[str, str] = {}
    with new_folder(folder) as temporary:
        for spec in found:
            try:
                with errors_of(spec.name):
                    scene = Scene(spec.load())
            except GraspboxError as error:
                if not is_refusal(error):
                    raise
                refused[spec.name] = reason(error, spec.path)
            else:
                files = _single_files(scene, form)
                place = _free_name(file_name(spec.name), temporary)
                write_all(temporary / place, files)
                written[spec.name] = f"{place}/{next(iter(files))}"
                mass = scene.body.mass
                records.append({"name": spec.name, "split": spec.split, "mass": mass, "file": written[spec.name]})
            if done is not None:
                done(spec.name)
        record = {"format": "graspbox.objects", "version": 1, "to": form, "objects": records, "refused": refused}
        write_all(temporary, {SET_RECORD: dumps(record) + "\n"})
    return SetExport(form, Path(folder), {name: Path(folder) / path for name, path in written.items()}, refused)


def _free_name(name: str, folder: Path) -> str:
    """Return a name that is not taken in a folder."""
    number, found = 2, name
    while (folder / found).exists():
        found, number = f"{name}_{number}", number + 1
    return found
