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
from graspbox.scene_export.contents import (
    ObjectData,
    SceneData,
    Start,
    object_data,
    object_names,
    objects_of,
    wall_names,
    walls_of,
)
from graspbox.scene_export.description import Array, read_hand
from graspbox.scene_export.folders import check_folder, file_name, new_folder, write_all
from graspbox.scene_export.losses import FORMATS, Format, not_expressed
from graspbox.scene_export.mesh_files import VISUAL, object_meshes, part_name
from graspbox.scene_export.mjcf import ExportedParts, MeshFiles, object_model, scene_model
from graspbox.scene_export.records import object_record, scene_record
from graspbox.scene_export.urdf import object_urdf, table_urdf, wall_urdf
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


def scene_data(scene: Scene, pose: ArrayLike | Grasp | None, preshape: float | None = None) -> SceneData:
    """Collect the contents of a scene, with a grasp or without a hand; the arguments are those of `export_scene`."""
    start = None
    if pose is not None:
        object_from_hand, value = _pose(pose, preshape, scene)
        world_from_hand = np.asarray(scene.world_from_object @ object_from_hand)
        start = Start(read_hand(*scene.hand.files), world_from_hand, value)
    elif preshape is not None:
        raise ConfigError(
            f"preshape is {shown(preshape)} without a pose; give both, or neither for a scene without hand"
        )
    target = None if scene.any_target else scene.target
    return SceneData(objects_of(scene), start, walls_of(scene), target, scene.physics)


def _comments(title: str, points: Sequence[str]) -> list[str]:
    lines = [f"{title}, exported by graspbox {_core.__version__}. Metres, kilograms, seconds, radians; z is up."]
    return lines + list(points)


def _object_files(objects: Sequence[ObjectData], to: Format) -> dict[str, str]:
    """Return the mesh files of objects by their names in the folder; USD contains its meshes."""
    files: dict[str, str] = {}
    for folder, item in zip(_mesh_folders(len(objects)), objects, strict=True):
        files |= {f"{folder}/{name}": text for name, text in object_meshes(item).items() if to != "usd"}
    return files


def _mesh_folders(count: int) -> list[str]:
    """Name the folders of the meshes of a scene of `count` objects."""
    return [_MESHES] if count == 1 else [f"{_MESHES}/{name}" for name in object_names(count)]


def _mesh_names(objects: Sequence[ObjectData]) -> list[MeshFiles]:
    found = []
    for folder, item in zip(_mesh_folders(len(objects)), objects, strict=True):
        parts = [f"{folder}/{part_name(i)}" for i in range(len(item.parts))]
        found.append(MeshFiles(parts, None if item.visual is None else f"{folder}/{VISUAL}"))
    return found


def _urdf_files(data: SceneData) -> dict[str, str]:
    """Return the URDF files of a scene by name, without the hand's."""
    objects, names = object_names(len(data.objects)), _mesh_names(data.objects)
    files = {
        f"{name}.urdf": object_urdf(item, list(meshes.parts), meshes.visual, data.physics)
        for name, item, meshes in zip(objects, data.objects, names, strict=True)
    }
    files["table.urdf"] = table_urdf(data.physics)
    for name, wall in zip(wall_names(len(data.walls)), data.walls, strict=True):
        files[f"{name}.urdf"] = wall_urdf(name, wall, data.physics)
    return files


def _scene_files(data: SceneData, scene: Scene, to: Format) -> dict[str, str]:
    """Return the files of a scene by name, the one to open first; the record is the last."""
    comments = _comments(data.title, _points(data, to))
    main: dict[str, str]
    if to == "mjcf":
        parts = ExportedParts(data.start, _mesh_names(data.objects), comments)
        main = {"scene.xml": scene_model(data.objects, data.walls, data.hand, data.physics, exported=parts)}
    elif to == "usd":
        main = {"scene.usda": _usd().scene_stage(data, comments)}
    else:
        main = _urdf_files(data)
    roles = {name.partition(".")[0]: name for name in main}
    if data.start is not None:
        urdf, toml = scene.hand.files
        main |= {"hand.urdf": urdf, "hand.toml": toml}
        roles |= {"hand_urdf": "hand.urdf", "hand_toml": "hand.toml"}
    record = dumps(scene_record(data, to, roles, _points(data, to))) + "\n"
    return {**main, **_object_files(data.objects, to), SCENE_RECORD: record}


def _points(data: SceneData, to: Format) -> tuple[str, ...]:
    return not_expressed(to, several=len(data.objects) > 1, hand=data.start is not None)


def export_scene(
    scene: Scene,
    folder: str | os.PathLike[str],
    to: Format,
    pose: ArrayLike | Grasp | None = None,
    preshape: float | None = None,
) -> Export:
    """Write a scene at the start of a trial: objects at rest, open hand at a pose, table, walls.

    Parameters
    ----------
    scene : Scene
        The objects and walls, the hand and the physics.
    folder : str or PathLike
        Folder to make; it may exist if it is empty.
    to : str
        The format: ``mjcf`` writes ``scene.xml`` with its meshes, ``usd`` ``scene.usda``, and ``urdf`` a file each for
        every object, the table, every wall and the hand. Every format has ``scene.json`` (see
        `graspbox.scene_export.records`) and the hand's two files. Several objects are named by their places in
        `graspbox.Scene.of`: ``object_0``, ``object_1`` and so on.
    pose : (4, 4) array_like, or Grasp, optional
        ``object_from_hand``, metres, of the scene's object (`graspbox.Scene.target`); a grasp of a plan includes its
        preshape. It is not tested for collisions. None: without a hand.
    preshape : float, optional
        See `graspbox.Hand.preshape_limits`; not with a grasp.

    Raises
    ------
    ConfigError
        For an unknown format, a pose that is not a rigid motion, a preshape out of range or without a pose, a folder
        with files, or a hand with names that an MJCF model cannot have.
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
    return _export(form, folder, files, _points(data, form))


def _export(to: Format, folder: str | os.PathLike[str], files: dict[str, str], points: tuple[str, ...]) -> Export:
    return Export(to, Path(folder), tuple(Path(folder) / name for name in files), points)


def _single_files(scene: Scene, to: Format) -> dict[str, str]:
    """Return the files of an object alone by name, the one to open first; the record is the last."""
    item = object_data(scene)
    (names,) = _mesh_names([item])
    comments = _comments(item.name, not_expressed(to))
    main = f"object.{_NAMES[to]}"
    if to == "mjcf":
        text = object_model(item, names, scene.physics, comments)
    elif to == "usd":
        text = _usd().object_stage(item, scene.physics, comments)
    else:
        text = object_urdf(item, list(names.parts), names.visual, scene.physics)
    record = dumps(object_record(item, scene.physics, to, {"object": main})) + "\n"
    return {main: text, **_object_files([item], to), OBJECT_RECORD: record}


def export_object(scene: Scene, folder: str | os.PathLike[str], to: Format) -> Export:
    """Write the object of a scene alone: visual mesh, convex parts, mass properties and friction.

    Parameters
    ----------
    scene : Scene
        The object, of several that of `graspbox.Scene.target`; its hand does not matter.
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
    return _export(form, folder, files, not_expressed(form))


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
