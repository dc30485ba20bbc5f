"""Grasps of graspbox's own results: plans, tables of ``grasp``, data sets, and ``grasp-image``.

| source | function | objects |
|---|---|---|
| `graspbox.Plan` | `from_plan` | one |
| the table of ``graspbox grasp --out`` (`SetResult.table`, with details) | `from_table` | those of the set |
| a folder of ``graspbox dataset`` | `from_dataset` | those of the data set |
| the result of ``graspbox grasp-image --out`` (`ImageGrasps.to_json`) | `from_image` | one |
| any of these as a file or folder | `read` | |
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import read_bounded
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.exchange.checks import matrices, numbers, rows_of
from graspbox.exchange.grasps import ExchangeGrasps
from graspbox.hands import HandLike, load_hand
from graspbox.outcomes import Outcomes
from graspbox.planning import Plan

__all__ = ["ImageFrame", "from_dataset", "from_image", "from_plan", "from_table", "read"]

#: Frames in which grasps of an image can be given.
ImageFrame = Literal["table", "camera"]
#: Largest JSON file, bytes.
MAX_JSON = 256 << 20
#: Columns of a data set that are read.
_TRIALS = (
    "object",
    "sha256",
    "world_from_object",
    "hand",
    "executed_object_from_hand",
    "preshape",
    "mass",
    "mass_factor",
    "success",
    "score",
)


def _hand_of(name: object, override: HandLike | None) -> Hand:
    """Load the hand of a source, which stores its name alone."""
    if override is not None:
        hand = load_hand(override)
        if isinstance(name, str) and name and hand.name != name:
            raise ConfigError(f"the grasps are of the hand {name!r}, not {hand.name!r}; leave hand out, or give theirs")
        return hand
    if isinstance(name, str) and name in Hand.names():
        return load_hand(name)
    raise ConfigError(
        f"the grasps are of the hand {name!r}, which is not one of the package; give its two files (hand=, or --hand)"
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
        raise ConfigError(f"there are {len(outcomes)} outcomes for {len(plan)} grasps; give one for each")
    kept = np.flatnonzero(plan.feasible)
    return ExchangeGrasps.of(
        plan.poses[kept],
        plan.preshape[kept],
        hand=_hand_of(plan.hand_name, hand),
        success=None if outcomes is None else outcomes.success[kept].astype(np.float64),
        score=plan.score[kept],
        world_from_object=plan.world_from_object,
        object_name=plan.name,
        mesh_sha256=plan.mesh_sha256,
    )


def from_table(table: Mapping[str, Any], *, hand: HandLike | None = None) -> list[ExchangeGrasps]:
    """Take the grasps of every object of a table of ``graspbox grasp`` that has details; arguments as `from_plan`.

    Objects without a grasp are left out.

    Raises
    ------
    ConfigError
        If it is no such table, or the hand is unknown.
    """
    found = []
    for row in rows_of(table, "objects"):
        name = row.get("name")
        if "grasps" not in row or not isinstance(name, str):
            raise ConfigError(
                "the table has no grasps of its objects; write it with `graspbox grasp --out`, whose files have details"
            )
        grasps = rows_of(row, "grasps", f"grasps of {name!r}")
        if grasps:
            found.append(_table_row(name, row, grasps, hand))
    return found


def _table_row(
    name: str, row: Mapping[str, Any], grasps: list[dict[str, Any]], hand: HandLike | None
) -> ExchangeGrasps:
    label = f"grasps of {name!r}"
    return ExchangeGrasps.of(
        matrices([g.get("object_from_hand") for g in grasps], f"{label}: object_from_hand"),
        numbers([g.get("preshape") for g in grasps], f"{label}: preshape"),
        hand=_hand_of(row.get("hand"), hand),
        success=numbers([g.get("success") for g in grasps], f"{label}: success"),
        score=numbers([g.get("score") for g in grasps], f"{label}: score"),
        world_from_object=matrices([row.get("world_from_object")], f"{label}: world_from_object")[0],
        object_name=name,
    )


def from_image(
    found: Mapping[str, Any], *, frame: ImageFrame = "table", hand: HandLike | None = None
) -> ExchangeGrasps:
    """Take grasps that a policy found in a depth image; their confidence is the predicted probability of success.

    An image shows no mesh: instead of the object's frame the poses are in that of the table or of the camera.

    Parameters
    ----------
    found : dict
        `graspbox.policies.grasp_image.ImageGrasps.to_json`.
    frame : {"table", "camera"}
        Frame of the poses.
    hand : str, Hand or pair of paths, optional
        The hand, if it is not one of the package.

    Raises
    ------
    ConfigError
        If it is no such result, or the hand is unknown.
    """
    if frame not in ("table", "camera"):
        raise ConfigError(f"frame is {frame!r}; choose table or camera")
    grasps = rows_of(found, "grasps")
    key = f"{frame}_from_hand"
    table_from_camera = matrices([found.get("table_from_camera")], "table_from_camera")[0]
    return ExchangeGrasps.of(
        matrices([g.get(key) for g in grasps], f"grasps: {key}"),
        numbers([g.get("preshape") for g in grasps], "grasps: preshape"),
        hand=_hand_of(found.get("hand"), hand),
        confidence=numbers([g.get("success") for g in grasps], "grasps: success"),
        score=numbers([g.get("choice") for g in grasps], "grasps: choice"),
        world_from_object=np.eye(4) if frame == "table" else table_from_camera,
        object_name=frame,
    )


def from_dataset(
    folder: str | os.PathLike[str], split: str | None = None, *, hand: HandLike | None = None
) -> list[ExchangeGrasps]:
    """Take the trials of every object of a data set: the poses that were tried, with their outcomes.

    A trial had its own friction and mass. The mass here is the object's without that factor; the files of meshes have
    to be added (`graspbox.exchange.simulated`, or ``graspbox export-grasps --objects``).

    Parameters
    ----------
    folder : str or PathLike
        The folder.
    split : {"train", "validation", "test"}, optional
        Take only this split.
    hand : str, Hand or pair of paths, optional
        The hand, if it is not one of the package.

    Raises
    ------
    ConfigError
        As `graspbox.dataset.load`; if the hand is unknown.
    MissingExtraError
        Without pyarrow or pydantic (extra ``data``).
    """
    from graspbox.dataset import tables

    table = tables.load(folder, split, list(_TRIALS))
    values = {name: tables.column(table, name) for name in ("object", "sha256", "preshape", "score", "mass")}
    poses = tables.matrices(table, "executed_object_from_hand")
    worlds = tables.matrices(table, "world_from_object")
    success = tables.column(table, "success").astype(np.float64)
    mass = values["mass"] / tables.column(table, "mass_factor")
    hands = set(tables.column(table, "hand").tolist())
    if len(hands) != 1:
        raise ConfigError(f"the data set has trials of {len(hands)} hands; give one of a single hand")
    chosen = _hand_of(hands.pop(), hand)
    names, first, member = np.unique(values["object"], return_index=True, return_inverse=True)
    found = []
    for index in np.argsort(first):
        rows = np.flatnonzero(member == index)
        found.append(
            ExchangeGrasps.of(
                poses[rows],
                values["preshape"][rows],
                hand=chosen,
                success=success[rows],
                score=values["score"][rows],
                world_from_object=worlds[rows],
                object_name=str(names[index]),
                mass=float(mass[rows[0]]),
                mesh_sha256=str(values["sha256"][rows[0]]),
            )
        )
    return found


def sources_of(folder: str | os.PathLike[str]) -> dict[str, tuple[str, float]]:
    """Return a set with each object of a data set alone, and its scale, by the object's name."""
    from graspbox.dataset import tables

    table = tables.load(folder, None, ["object", "source", "scale"])
    columns: list[NDArray[Any]] = [tables.column(table, name) for name in ("object", "source", "scale")]
    return {str(name): (str(source), float(scale)) for name, source, scale in zip(*columns, strict=True)}


def read(
    path: str | os.PathLike[str], *, hand: HandLike | None = None, frame: ImageFrame = "table"
) -> list[ExchangeGrasps]:
    """Read the grasps of a file or folder that graspbox wrote, one entry per object.

    Parameters
    ----------
    path : str or PathLike
        A saved plan, the JSON of ``graspbox grasp --out`` or ``graspbox grasp-image --out``, or a folder of
        ``graspbox dataset``.
    hand : str, Hand or pair of paths, optional
        The hand, if it is not one of the package.
    frame : {"table", "camera"}
        Frame of the grasps of an image.

    Raises
    ------
    ConfigError, PlanError
        If it is none of these; the message names the problem.
    FileError
        If it cannot be read, or is larger than 256 MiB.
    """
    path = Path(path)
    if path.is_dir():
        return from_dataset(path, hand=hand)
    try:
        document = json.loads(read_bounded(path, MAX_JSON))
    except (ValueError, RecursionError):
        raise ConfigError(f"{str(path)!r} is not JSON; give a plan, or a result of `grasp` or `grasp-image`") from None
    try:
        if isinstance(document, dict) and document.get("format") == "graspbox.plan":
            return [from_plan(Plan.load(path), hand=hand)]
        if isinstance(document, dict) and "objects" in document:
            return from_table(document, hand=hand)
        if isinstance(document, dict) and "table_from_camera" in document:
            return [from_image(document, frame=frame, hand=hand)]
    except ConfigError as error:
        raise ConfigError(f"{str(path)!r}: {error}") from None
    raise ConfigError(
        f"{str(path)!r} is JSON, but not of graspbox's grasps; give a plan, or a result of `grasp` or `grasp-image`"
    )
