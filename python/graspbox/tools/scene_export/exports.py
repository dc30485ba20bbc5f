"""Exports of scenes, of single objects and of object sets, each as a folder that appears whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from numpy.typing import ArrayLike

from graspbox import _core, object_sets
from graspbox._common.arguments import floats, shown
from graspbox._common.files import dumps
from graspbox._common.imports import imported
from graspbox._common.refusals import errors_of, is_refusal, reason
from graspbox.errors import ConfigError, GraspboxError
from graspbox.hands.description import describe
from graspbox.planning import Grasp
from graspbox.simulation import Scene
from graspbox.tools.scene_export.contents import (
    SceneData,
    Start,
    object_data,
    object_names,
    object_title,
    objects_of,
    wall_names,
    walls_of,
)
from graspbox.tools.scene_export.folders import check_folder, file_name, new_folder, write_all
from graspbox.tools.scene_export.losses import FORMATS, Format, not_expressed
from graspbox.tools.scene_export.mesh_files import mesh_files, mesh_texts
from graspbox.tools.scene_export.mjcf import ExportedParts, object_model, scene_model
from graspbox.tools.scene_export.records import object_record, scene_record
from graspbox.tools.scene_export.urdf import object_urdf, table_urdf, wall_urdf
from graspbox.tools.scene_export.urdf_hand import hand_urdf

__all__ = ["Export", "SetExport", "export_object", "export_objects", "export_scene"]

_SUFFIXES: dict[Format, str] = {"mjcf": "xml", "usd": "usda", "urdf": "urdf"}


@dataclass(frozen=True)
class Export:
    """Files of an export in the format `to`.

    Attributes
    ----------
    files : tuple of Path
        All files in the folder, first the one to open.
    not_expressed : tuple of str
        Properties of the scene that the format cannot express, as sentences.
    """

    to: Format
    folder: Path
    files: tuple[Path, ...]
    not_expressed: tuple[str, ...]


@dataclass(frozen=True)
class SetExport:
    """Files of the export of an object set in the format `to`.

    Attributes
    ----------
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
    from graspbox.tools.scene_export import usd

    return usd


def _start(pose: ArrayLike | Grasp, preshape: float | None, scene: Scene) -> Start:
    """Check a pose ``object_from_hand`` and a preshape."""
    if isinstance(pose, Grasp):
        if preshape is not None:
            raise ConfigError("preshape is given twice; leave it out, since a grasp includes it")
        preshape = pose.preshape
    matrix = pose.pose if isinstance(pose, Grasp) else floats(pose, "pose")
    if matrix.shape != (4, 4) or not bool(_core.is_rigid(matrix[None])[0]):
        raise ConfigError(f"pose has shape {list(matrix.shape)} or is not a rigid motion; pass a 4x4 object_from_hand")
    if preshape is None:
        raise ConfigError("preshape is missing; pass one, or a grasp of a plan instead of a pose")
    values = floats(preshape, "preshape").ravel().tolist()
    low, high = scene.hand.preshape_limits
    if len(values) != 1 or not low <= values[0] <= high:
        raise ConfigError(f"preshape is {shown(preshape)}; pass one number from {low:g} to {high:g}")
    if scene.hand.preshape_unit == "1" and not values[0].is_integer():
        raise ConfigError(f"preshape is {shown(preshape)}; pass the number of a named preshape, {low:g} to {high:g}")
    return Start(describe(scene.hand), scene.world_from_object @ matrix, values[0])


def _comments(title: str, points: Sequence[str]) -> list[str]:
    lines = [f"{title}, exported by graspbox {_core.__version__}. Metres, kilograms, seconds, radians; z is up."]
    return lines + list(points)


def _urdf_files(data: SceneData) -> dict[str, str]:
    """Return the URDF files of a scene by name, without the hand's."""
    objects = zip(object_names(len(data.objects)), data.objects, mesh_files(data.objects), strict=True)
    files = {f"{name}.urdf": object_urdf(item, meshes, data.physics) for name, item, meshes in objects}
    files["table.urdf"] = table_urdf(data.physics)
    walls = zip(wall_names(len(data.walls)), data.walls, strict=True)
    return files | {f"{name}.urdf": wall_urdf(name, wall, data.physics) for name, wall in walls}


def _scene_files(data: SceneData, scene: Scene, to: Format, points: Sequence[str]) -> dict[str, str]:
    """Return the files of a scene by name, the one to open first; the record is the last."""
    hand = None if data.start is None else data.start.hand
    title = object_title(data.objects)
    comments = _comments(title if hand is None else f"{title} and {hand.name}", points)
    main: dict[str, str]
    if to == "mjcf":
        parts = ExportedParts(data.start, mesh_files(data.objects), comments)
        main = {"scene.xml": scene_model(data.objects, data.walls, hand, data.physics, exported=parts)}
    elif to == "usd":
        main = {"scene.usda": _usd().scene_stage(data, comments)}
    else:
        main = _urdf_files(data)
    roles = {name.partition(".")[0]: name for name in main}
    if hand is not None:
        urdf, toml = scene.hand.files
        main |= {"hand.urdf": hand_urdf(urdf, hand), "hand.toml": toml}
        roles |= {"hand_urdf": "hand.urdf", "hand_toml": "hand.toml"}
    # USD contains its meshes.
    meshes = {} if to == "usd" else mesh_texts(data.objects)
    return {**main, **meshes, "scene.json": dumps(scene_record(data, to, roles, points)) + "\n"}


def _write(folder: str | os.PathLike[str], to: Format, files: dict[str, str], points: tuple[str, ...]) -> Export:
    with new_folder(folder) as temporary:
        write_all(temporary, files)
    return Export(to, Path(folder), tuple(Path(folder) / name for name in files), points)


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
        `graspbox.tools.scene_export.records`) and the hand's two files. Several objects are named by their places in
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
    if pose is None and preshape is not None:
        raise ConfigError(
            f"preshape is {shown(preshape)} without a pose; pass both, or neither for a scene without hand"
        )
    start = None if pose is None else _start(pose, preshape, scene)
    target = None if scene.any_target else scene.target
    data = SceneData(objects_of(scene), start, walls_of(scene), target, scene.physics)
    points = not_expressed(form, several=len(data.objects) > 1, hand=data.start is not None)
    return _write(folder, form, _scene_files(data, scene, form, points), points)


def _object_files(scene: Scene, to: Format) -> dict[str, str]:
    """Return the files of a single object by name, the one to open first; the record is the last."""
    item = object_data(scene)
    (names,) = mesh_files([item])
    comments, main = _comments(item.name, not_expressed(to)), f"object.{_SUFFIXES[to]}"
    if to == "mjcf":
        text = object_model(item, names, scene.physics, comments)
    elif to == "usd":
        text = _usd().object_stage(item, scene.physics, comments)
    else:
        text = object_urdf(item, names, scene.physics)
    record = dumps(object_record(item, scene.physics, to, {"object": main})) + "\n"
    return {main: text, **({} if to == "usd" else mesh_texts([item])), "object.json": record}


def export_object(scene: Scene, folder: str | os.PathLike[str], to: Format) -> Export:
    """Write only the object of a scene: visual mesh, convex parts, mass properties and friction.

    Parameters
    ----------
    scene : Scene
        The object, of several that of `graspbox.Scene.target`; its hand does not matter.
    folder, to
        As in `export_scene`; the file is ``object.xml``, ``object.usda`` or ``object.urdf``.
    """
    form = _format(to)
    check_folder(folder)
    return _write(folder, form, _object_files(scene, form), not_expressed(form))


def export_objects(
    objects: str | Path | object_sets.ObjectSet | Sequence[str | Path],
    folder: str | os.PathLike[str],
    to: Format,
    *,
    done: Callable[[str], None] | None = None,
) -> SetExport:
    """Write every object of a set as `export_object` does, each into its own folder, and ``objects.json``.

    An object that cannot be read or simulated is left out; `SetExport.refused` has the reason.

    Parameters
    ----------
    objects : str, Path, ObjectSet, or sequence of str
        See `graspbox.object_sets.load`.
    folder, to
        As in `export_scene`.
    done : callable, optional
        Called with the name of each object, exported or not.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `export_scene`.
    ObjectSetError
        As `graspbox.object_sets.load`.
    """
    form = _format(to)
    check_folder(folder)
    specs = object_sets.load(objects)
    written: dict[str, str] = {}
    records: list[dict[str, object]] = []
    refused: dict[str, str] = {}
    with new_folder(folder) as temporary:
        for spec in specs:
            try:
                with errors_of(spec.name):
                    scene = Scene(spec.load())
            except GraspboxError as error:
                if not is_refusal(error):
                    raise
                refused[spec.name] = reason(error, spec.path)
            else:
                files = _object_files(scene, form)
                place = _free_name(file_name(spec.name), temporary)
                write_all(temporary / place, files)
                written[spec.name] = f"{place}/{next(iter(files))}"
                mass = scene.body.mass
                records.append({"name": spec.name, "split": spec.split, "mass": mass, "file": written[spec.name]})
            if done is not None:
                done(spec.name)
        record = {"format": "graspbox.objects", "version": 1, "to": form, "objects": records, "refused": refused}
        write_all(temporary, {"objects.json": dumps(record) + "\n"})
    return SetExport(form, Path(folder), {name: Path(folder) / path for name, path in written.items()}, refused)


def _free_name(name: str, folder: Path) -> str:
    """Return a name that is not taken in a folder."""
    number, free = 2, name
    while (folder / free).exists():
        free, number = f"{name}_{number}", number + 1
    return free
