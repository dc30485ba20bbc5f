"""The columns of a data set in one table, the source of files, documentation and checks."""

import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, get_type_hints

from graspbox.data.files import pyarrow
from graspbox.simulation.outcomes import Outcome, Outcomes

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["IMAGES", "NEIGHBOUR", "SPLITS", "TRIALS", "WALL", "Column", "arrow_schema", "image_schema"]

#: Splits of a data set, in their order.
SPLITS = ("train", "validation", "test")


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes
    ----------
    name : str
    type : str
        A type of Arrow; ``matrix``: 16 float64, a 4x4 homogeneous matrix row by row; ``matrices``: a list of these;
        ``neighbours`` and ``walls``: lists of structures with the fields `NEIGHBOUR` and `WALL`.
    meaning : str
        Its contents, with frame and unit.
    alone : Any
        Its value in scenes of a single object without walls; None for columns that depend on the trial.
    """

    name: str
    type: str
    meaning: str
    alone: Any = None


_OUTCOME_TYPES = {bool: "bool", str: "string", float: "double", int: "int64"}


def _outcome_columns() -> Iterator[Column]:
    """Turn each field of `Outcome` into a column, with the meaning from the docstring of `Outcomes`."""
    text = inspect.cleandoc(Outcomes.__doc__ or "").partition("Attributes\n----------\n")[2]
    meanings: dict[str, str] = {}
    for names, meaning in re.findall(r"^(\w[\w, ]*) : .*\n((?:    .*\n?)+)", text, flags=re.MULTILINE):
        for name in names.split(", "):
            meanings[name] = " ".join(textwrap.dedent(meaning).split())
    hints = get_type_hints(Outcome)
    for field in fields(Outcome):
        yield Column(field.name, _OUTCOME_TYPES[hints[field.name]], f"outcome: {meanings[field.name].rstrip('.')}")


#: Fields of a neighbour, by name, with their types: those of the columns of the same names.
NEIGHBOUR = {
    "object": "string",
    "source": "string",
    "sha256": "string",
    "scale": "double",
    "size_factor": "double",
    "world_from_object": "matrix",
}
#: Fields of a wall.
WALL = {"world_from_wall": "matrix", "half_extents": "list<double>[3]"}

#: Columns of a trial.
TRIALS: tuple[Column, ...] = (
    Column(
        "scene",
        "string",
        "object and number of its resting pose, as `mug-000003/0`; its trials share objects and cameras",
    ),
    Column("trial", "int32", "number of the trial in its scene"),
    Column("object", "string", "name of the object"),
    Column("source", "string", "object set with only this object (`graspbox.object_sets.load` finds it)"),
    Column("group", "string", "group of near-duplicates; no group is in two splits"),
    Column("split", "string", "`train`, `validation` or `test`"),
    Column("sha256", "string", "hash of the mesh's vertices and faces (`graspbox.planning.plan_files.mesh_hash`)"),
    Column("scale", "double", "metres per unit of the mesh file; a factor on the size of procedural objects"),
    Column("layout", "string", "how objects lie: `single`, `packed`, `pile` or `bin`", "single"),
    Column("size_factor", "double", "factor on all lengths of the object in this scene; 1 in the layout `single`", 1.0),
    Column("world_from_object", "matrix", "pose of the object at rest; the table is the plane z = 0, metres"),
    Column("neighbours", "neighbours", "the other objects of the scene, with fields as the columns of these names", ()),
    Column("walls", "walls", "walls of a bin: boxes with their poses and half extents, metres", ()),
    Column("hand", "string", "name of the hand"),
    Column("object_from_hand", "matrix", "nominal pose of the hand, object frame, metres"),
    Column("world_from_hand", "matrix", "the same in the world"),
    Column("executed_object_from_hand", "matrix", "pose that was tried: the nominal one with the hand's error"),
    Column("executed_world_from_hand", "matrix", "the same in the world"),
    Column("preshape", "double", "preshape of the hand (`graspbox.Hand.preshape_unit`)"),
    Column("friction_factor", "double", "factor on the object's friction in this trial"),
    Column("friction", "double", "friction factor of the object after it (`FrictionConfig.object`)"),
    Column("mass_factor", "double", "factor on the object's mass in this trial"),
    Column("mass", "double", "mass after it, kg"),
    *_outcome_columns(),
    Column("candidate", "string", "source of the pose: `planner`, `normal`, `low`, `jitter` or `random`"),
    Column("rank", "int32", "rank of the planner's pose among its feasible ones, from 0; null for other sources"),
    Column("score", "double", "the planner's score; null for other sources"),
    Column("replays", "int32", "further trials of the nominal pose, each with its own error, friction and mass"),
    Column("replay_successes", "int32", "how many of them succeeded"),
    Column("replay_secure", "int32", "how many of them were secure"),
    Column("seed", "uint64", "seed of the scene, from which its resting pose, candidates and disturbances follow"),
    Column("view_seed", "uint64", "seed of the scene's cameras"),
    Column("fov", "double", "vertical field of view of the cameras, radians"),
    Column("world_from_camera", "matrices", "cameras of the scene; x right, y down, z forward, metres"),
)

#: Columns of a stored image; H and W are `DatasetConfig.image_size`.
IMAGES: tuple[Column, ...] = (
    Column("scene", "string", "scene, as in the trials"),
    Column("split", "string", "split, as in the trials"),
    Column("view", "int32", "index of the camera in `world_from_camera` of the trials"),
    Column("world_from_object", "matrix", "pose of the object, metres"),
    Column("world_from_camera", "matrix", "pose of the camera, metres"),
    Column("intrinsics", "list<double>[9]", "3x3, row by row: camera frame to pixels"),
    Column("depth", "list<uint16>[H*W]", "along the optical axis, millimetres, row by row; 0 where nothing was seen"),
    Column(
        "segmentation",
        "list<uint8>[H*W]",
        "0 background, 1 table, ground and walls, 2 object, 3 and more its neighbours",
    ),
)


def _arrow(kind: str, pixels: int = 0) -> "pa.DataType":
    pa = pyarrow()
    if kind in ("neighbours", "walls"):
        fields = NEIGHBOUR if kind == "neighbours" else WALL
        return pa.list_(pa.struct({name: _arrow(each) for name, each in fields.items()}))
    if kind == "matrices":
        return pa.list_(_arrow("matrix"))
    if sized := re.fullmatch(r"list<(\w+)>\[(.+)\]", "list<double>[16]" if kind == "matrix" else kind):
        return pa.list_(pa.type_for_alias(sized[1]), pixels if sized[2] == "H*W" else int(sized[2]))
    return pa.type_for_alias(kind)


def arrow_schema() -> "pa.Schema":
    """Arrow's schema of the trials."""
    return pyarrow().schema([(column.name, _arrow(column.type)) for column in TRIALS])


def image_schema(image_size: tuple[int, int]) -> "pa.Schema":
    """Arrow's schema of the images of this size."""
    pixels = image_size[0] * image_size[1]
    return pyarrow().schema([(column.name, _arrow(column.type, pixels)) for column in IMAGES])
