"""Grasps of graspbox's own results: plans, tables of ``grasp``, data sets, and ``grasp-image``."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._core import Hand
from graspbox.captures.capture import listed
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.planning import Plan
from graspbox.simulation.outcomes import Outcomes
from graspbox.tools.exchange.checks import matrices, number, numbers, read_json, rows_of, text
from graspbox.tools.exchange.grasps import ExchangeGrasps

__all__ = [
    "ImageFrame",
    "ObjectSource",
    "from_dataset",
    "from_image",
    "from_plan",
    "from_scene",
    "from_table",
    "read",
    "read_with_sources",
]

#: Frames in which grasps of an image can be given.
ImageFrame = Literal["table", "camera"]
#: Columns of a data set that are read.
_COLUMNS = ("object", "sha256", "hand", "preshape", "mass", "mass_factor", "success", "score")
_POSES = ("world_from_object", "executed_object_from_hand")
#: Columns that say where its objects come from.
_SOURCES = ("object", "source", "scale", "mass", "mass_factor")


@dataclass(frozen=True)
class ObjectSource:
    """Where an object of a result comes from: the arguments of `graspbox.object_sets.load` for a set of it alone."""

    objects: str
    scale: float = 1.0
    #: Kilograms; None where the set knows it.
    mass: float | None = None


def _hand_of(name: object, override: HandLike | None) -> Hand:
    """Load the hand that a source names."""
    if override is not None:
        hand = load_hand(override)
        if isinstance(name, str) and name and hand.name != name:
            raise ConfigError(f"the grasps are of the hand {name!r}, not {hand.name!r}; leave hand out, or pass theirs")
        return hand
    if isinstance(name, str) and name in Hand.names():
        return load_hand(name)
    raise ConfigError(
        f"the grasps are of the hand {name!r}, which is not one of the package; pass its two files (hand=, or --hand)"
    )


def from_plan(plan: Plan, outcomes: Outcomes | None = None, *, hand: HandLike | None = None) -> ExchangeGrasps:
    """Take the feasible grasps of a plan.

    Parameters
    ----------
    plan : Plan
        The plan.
    outcomes : Outcomes, optional
        Outcomes of all its grasps, in order (``scene.simulate(plan)``).
    hand : str, Hand or pair of paths, optional
        The hand, if it is not one of the package.

    Raises
    ------
    ConfigError
        If the number of outcomes differs, or the hand is unknown or another one.
    """
    if outcomes is not None and len(outcomes) != len(plan):
        raise ConfigError(f"there are {len(outcomes)} outcomes for {len(plan)} grasps; pass one for each")
    kept = np.flatnonzero(plan.feasible)
    return ExchangeGrasps.of(
        plan.poses[kept],
        plan.preshape[kept],
        hand=_hand_of(plan.hand_name, hand),
        success=None if outcomes is None else outcomes.success[kept].astype(np.float64),
        score=plan.score[kept],
        world_from_object=plan.world_from_object,
        object_name=plan.name,
        mass=plan.mass,
        mesh_sha256=plan.mesh_sha256,
    )


def from_table(table: Mapping[str, Any], *, hand: HandLike | None = None) -> list[ExchangeGrasps]:
    """Take the grasps of every object of a table of ``graspbox grasp --out`` (`SetResult.table`, with details).

    Objects without a grasp are left out. `hand` is as in `from_plan`.

    Raises
    ------
    ConfigError
        If it is no such table, or the hand is unknown.
    """
    tables = []
    for row in rows_of(table, "objects"):
        name = row.get("name")
        if "grasps" not in row or not isinstance(name, str):
            raise ConfigError(
                "the table has no grasps of its objects; write it with `graspbox grasp --out`, whose files have details"
            )
        grasps = rows_of(row, "grasps", f"grasps of {name!r}")
        if grasps:
            tables.append(_table_row(name, row, grasps, hand))
    return tables


def _table_row(
    name: str, row: Mapping[str, Any], grasps: list[dict[str, Any]], hand: HandLike | None
) -> ExchangeGrasps:
    label, mass = f"grasps of {name!r}", row.get("mass")
    return ExchangeGrasps.of(
        matrices([g.get("object_from_hand") for g in grasps], f"{label}: object_from_hand"),
        numbers([g.get("preshape") for g in grasps], f"{label}: preshape"),
        hand=_hand_of(row.get("hand"), hand),
        success=numbers([g.get("success") for g in grasps], f"{label}: success"),
        score=numbers([g.get("score") for g in grasps], f"{label}: score"),
        world_from_object=matrices([row.get("world_from_object")], f"{label}: world_from_object")[0],
        object_name=name,
        mass=None if mass is None else number(mass, f"mass of {name!r}"),
        mesh_sha256=text(row.get("sha256", ""), f"sha256 of {name!r}"),
    )


def from_image(
    document: Mapping[str, Any], *, frame: ImageFrame = "table", hand: HandLike | None = None, object_name: str = ""
) -> ExchangeGrasps:
    """Take the grasps of a policy in a depth image; their confidence is the predicted probability of success.

    An image shows no mesh: instead of the object's frame the poses are in that of the table or of the camera (`frame`).
    `document` is `graspbox.policies.grasp_image.ImageGrasps.to_json`, and `hand` is as in `from_plan`.
    `object_name` is by default the frame's.

    Raises
    ------
    ConfigError
        If it is no such result, or the hand is unknown.
    """
    if frame not in ("table", "camera"):
        raise ConfigError(f"frame is {frame!r}; choose table or camera")
    grasps = rows_of(document, "grasps")
    key = f"{frame}_from_hand"
    table_from_camera = matrices([document.get("table_from_camera")], "table_from_camera")[0]
    return ExchangeGrasps.of(
        matrices([g.get(key) for g in grasps], f"grasps: {key}"),
        numbers([g.get("preshape") for g in grasps], "grasps: preshape"),
        hand=_hand_of(document.get("hand"), hand),
        confidence=numbers([g.get("success") for g in grasps], "grasps: success"),
        score=numbers([g.get("choice") for g in grasps], "grasps: choice"),
        world_from_object=np.eye(4) if frame == "table" else table_from_camera,
        object_name=object_name or frame,
    )


def from_scene(
    document: Mapping[str, Any], *, frame: ImageFrame = "table", hand: HandLike | None = None
) -> list[ExchangeGrasps]:
    """Take the grasps of every thing in a depth image, as `from_image`; objects are named ``table_1`` for thing 1.

    `document` is `graspbox.policies.grasp_image.SceneGrasps.to_json`. Things without a grasp are left out.

    Raises
    ------
    ConfigError
        If it is no such result, no thing has a grasp, or the hand is unknown.
    """
    found, without = [], []
    for row in rows_of(document, "things"):
        thing = row.get("thing")
        if not isinstance(thing, int) or isinstance(thing, bool):
            raise ConfigError(f"things: thing is {shown(thing)}; use the number of a thing")
        if row.get("refused") or row.get("grasps") == []:
            without.append(f"{thing} ({row.get('refused') or 'no grasp is feasible'})")
            continue
        try:
            found.append(from_image(row, frame=frame, hand=hand, object_name=f"{frame}_{thing}"))
        except ConfigError as error:
            raise ConfigError(f"thing {thing}: {error}") from None
    if not found:
        raise ConfigError(f"no thing of the image has a grasp: {listed(without) or 'there are none'}")
    return found


def from_dataset(
    folder: str | os.PathLike[str], split: str | None = None, *, hand: HandLike | None = None
) -> list[ExchangeGrasps]:
    """Take the trials of every object of a data set: the poses that were tried, with their outcomes.

    A trial had its own friction and mass. The mass here is the object's without that factor; the files of meshes have
    to be added (`graspbox.tools.exchange.simulated`, or ``graspbox export-grasps --objects``).

    Parameters
    ----------
    folder : str or PathLike
        The folder of ``graspbox dataset``.
    split : {"train", "validation", "test"}, optional
        Take only this split.
    hand : str, Hand or pair of paths, optional
        As in `from_plan`.

    Raises
    ------
    ConfigError
        As `graspbox.data.trials.load`; if the hand is unknown.
    MissingExtraError
        Without pyarrow or pydantic (extra ``data``).
    """
    from graspbox.data.trials import tables

    table = tables.load(folder, split, [*_COLUMNS, *_POSES])
    values = {name: tables.column(table, name) for name in _COLUMNS}
    worlds, poses = (tables.matrices(table, name) for name in _POSES)
    hands = set(values["hand"].tolist())
    if len(hands) != 1:
        raise ConfigError(f"the data set has trials of {len(hands)} hands; pass one of a single hand")
    chosen = _hand_of(hands.pop(), hand)
    names, first, member = np.unique(values["object"], return_index=True, return_inverse=True)
    converted = []
    for index in np.argsort(first):
        rows = np.flatnonzero(member == index)
        own = {name: column[rows] for name, column in values.items()}
        converted.append(
            ExchangeGrasps.of(
                poses[rows],
                own["preshape"],
                hand=chosen,
                success=own["success"].astype(np.float64),
                score=own["score"],
                world_from_object=worlds[rows],
                object_name=str(names[index]),
                mass=_own_mass(own, 0),
                mesh_sha256=str(own["sha256"][0]),
            )
        )
    return converted


def _own_mass(columns: Mapping[str, NDArray[Any]], row: int) -> float:
    """Return the mass of a trial's object without the factor of that trial, kg."""
    return float(columns["mass"][row] / columns["mass_factor"][row])


def _sources_of_rows(rows: Iterable[Mapping[str, Any]]) -> dict[str, ObjectSource]:
    """Return the sources of the objects of a result, by name; earlier versions of graspbox wrote none."""
    found = {}
    for row in (row for row in rows if row.get("source")):
        name, mass = row.get("name"), row.get("mass")
        found[str(name)] = ObjectSource(
            text(row["source"], f"source of {name!r}"),
            number(row.get("scale", 1.0), f"scale of {name!r}"),
            None if mass is None else number(mass, f"mass of {name!r}"),
        )
    return found


def _sources_of_trials(folder: Path) -> dict[str, ObjectSource]:
    """Return the sources of the objects of a data set, by name, with the masses of `from_dataset`."""
    from graspbox.data.trials import tables

    table = tables.load(folder, None, list(_SOURCES))
    columns = {name: tables.column(table, name) for name in _SOURCES}
    names, first = np.unique(columns["object"], return_index=True)
    return {
        str(name): ObjectSource(str(columns["source"][row]), float(columns["scale"][row]), _own_mass(columns, row))
        for name, row in zip(names, first, strict=True)
    }


def read(
    path: str | os.PathLike[str], *, hand: HandLike | None = None, frame: ImageFrame = "table"
) -> list[ExchangeGrasps]:
    """Read the grasps of a file or folder that graspbox wrote, one entry per object.

    Parameters
    ----------
    path : str or PathLike
        A saved plan, the JSON of ``graspbox grasp --out`` or ``graspbox grasp-image --out`` (``--all`` too), or a
        folder of ``graspbox dataset``.
    hand : str, Hand or pair of paths, optional
        The hand, if it is not one of the package.
    frame : {"table", "camera"}
        Frame of the grasps of an image.

    Raises
    ------
    ConfigError, PlanError
        If the file is of another kind, or is damaged; the message names the problem.
    FileError
        If it cannot be read, or is larger than 256 MiB.
    """
    return _read(Path(path), hand, frame)[0]


def read_with_sources(
    path: str | os.PathLike[str], *, hand: HandLike | None = None, frame: ImageFrame = "table"
) -> tuple[list[ExchangeGrasps], dict[str, ObjectSource]]:
    """Read as `read`, and the sources of the objects, by name, which plans, tables and data sets carry."""
    path = Path(path)
    grasps, rows = _read(path, hand, frame)
    if path.is_dir():
        return grasps, _sources_of_trials(path)
    try:
        return grasps, _sources_of_rows(rows)
    except ConfigError as error:
        raise ConfigError(f"{str(path)!r}: {error}") from None


def _read(
    path: Path, hand: HandLike | None, frame: ImageFrame
) -> tuple[list[ExchangeGrasps], Iterable[Mapping[str, Any]]]:
    """Read as `read`, and the rows of a plan or a table, which may have the sources of the objects."""
    if path.is_dir():
        return from_dataset(path, hand=hand), ()
    try:
        document = read_json(path)
        if isinstance(document, dict) and document.get("format") == "graspbox.plan":
            found = Plan.load(path)
            return [from_plan(found, hand=hand)], [vars(found)]
        if isinstance(document, dict) and "objects" in document:
            return from_table(document, hand=hand), document["objects"]
        if isinstance(document, dict) and "table_from_camera" in document:
            return [from_image(document, frame=frame, hand=hand)], ()
        if isinstance(document, dict) and "things" in document:
            return from_scene(document, frame=frame, hand=hand), ()
        raise ConfigError(
            "it is JSON, but not of graspbox's grasps; pass a plan, or a result of `grasp` or `grasp-image`"
        )
    except ConfigError as error:
        raise ConfigError(f"{str(path)!r}: {error}") from None
