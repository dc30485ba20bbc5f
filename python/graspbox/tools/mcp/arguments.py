"""Schemas of the tools' arguments: strict types, bounded values, no unknown names (pydantic)."""

import json
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from graspbox._common.arguments import shown
from graspbox.errors import ConfigError
from graspbox.perception.real import DepthKind, Frame
from graspbox.tools.mcp.settings import MAX_GRASPS, MAX_SIDE

__all__ = [
    "GraspImageArguments",
    "LookArguments",
    "ObjectArguments",
    "PlanArguments",
    "SimulateArguments",
    "SomeGrasp",
    "parsed",
]

Row = Annotated[list[float], Field(min_length=4, max_length=4)]
#: A pose, row by row.
Matrix = Annotated[list[Row], Field(min_length=4, max_length=4)]
Pair = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2, max_length=2)]
Text = Annotated[str, Field(min_length=1, max_length=1000)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Picture = Annotated[bool, Field(description="Whether to add a picture.")]


class _Arguments(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class SomeGrasp(_Arguments):
    """One grasp: a pose of the hand and a preshape."""

    object_from_hand: Matrix = Field(description="4x4 pose of the hand's grasp frame in the object's frame, metres.")
    preshape: float = Field(description="Preshape, as in the answers of plan.")


class ObjectArguments(_Arguments):
    """Arguments that name an object and a hand."""

    object: Text = Field(
        description="An offered object set that names one object (procedural:mug:3), or the path of a mesh file "
        "(.stl, .ply, .obj, .off, .glb, .gltf) in the folder."
    )
    name: Text | None = Field(None, description="Name of one object, if the set has several.")
    scale: float = Field(1.0, gt=0, le=1e4, description="Metres per unit of a mesh file: 0.001 for millimetres.")
    mass: float | None = Field(None, gt=0, le=25, description="Mass, kilograms; by default that of the set.")
    hand: Text | None = Field(None, description="Name of the hand; by default the first that is offered.")


class PlanArguments(ObjectArguments):
    """Arguments of ``plan``."""

    count: int = Field(10, ge=1, le=MAX_GRASPS, description="Most grasps in the answer, best first.")
    fit: Literal["minimum", "pca"] = Field("minimum", description="Boxes of least volume, or along principal axes.")
    max_boxes: int = Field(8, ge=1, le=32, description="Maximum number of boxes.")
    settle: bool = Field(True, description="Let the object settle first; otherwise plan for the pose in its file.")
    seed: Seed = 0
    picture: Picture = True


class SimulateArguments(ObjectArguments):
    """Arguments of ``simulate``."""

    grasps: Annotated[list[SomeGrasp], Field(min_length=1, max_length=MAX_GRASPS)] | None = Field(
        None, description="Grasps to try; by default the best that are planned."
    )
    count: int = Field(10, ge=1, le=MAX_GRASPS, description="Planned grasps to try, best first, without `grasps`.")
    shake: bool = Field(False, description="Shake every success on six axes with 2 g.")
    seed: Seed = Field(0, description="Seed of the plan.")
    picture: Picture = True


class LookArguments(ObjectArguments):
    """Arguments of ``look``."""

    azimuth: float | None = Field(
        None,
        ge=-360,
        le=360,
        description="Direction from object to camera, degrees about +z; by default -60, or across the hand.",
    )
    elevation: float = Field(25.0, ge=1, le=89, description="Degrees above the table; 89 looks straight down.")
    width: int = Field(640, ge=64, le=MAX_SIDE, description="Pixels.")
    height: int = Field(480, ge=64, le=MAX_SIDE, description="Pixels.")
    grasp: SomeGrasp | None = Field(None, description="Show the open hand at this grasp.")


class GraspImageArguments(_Arguments):
    """Arguments of ``grasp_image``."""

    depth: Text = Field(
        description="Path in the folder: a depth image (.npy, .npz, 16-bit .png, .tiff, .exr), a point cloud in the "
        "camera's frame (.ply, .pcd, .npy), or a ROS recording (.bag, .db3, .mcap, a folder)."
    )
    intrinsics: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        None,
        description="FX, FY, CX, CY: focal lengths and principal point, pixels; by default those of the source or of "
        "camera_info.",
    )
    camera_info: Text | None = Field(
        None, description="Path of a file with intrinsics: ROS CameraInfo, OpenCV, RealSense, Open3D, BOP, .npy, .txt."
    )
    depth_scale: float | None = Field(
        None, gt=0, description="Metres per unit; by default as the file states, else 1 for floats, 0.001 for integers."
    )
    depth_is: DepthKind = Field(
        "z", description="What an image holds: depths along the optical axis, or distances along the pixels' rays."
    )
    topic: Text | None = Field(None, description="Topic of a recording; by default the only one with depth.")
    time: float | None = Field(None, ge=0, lt=1e9, description="Seconds since the topic's first message; 0 by default.")
    mask: Text | None = Field(
        None, description="Path of an image (.npy, .png) that is not 0 where the object to grasp is."
    )
    labels: Text | None = Field(
        None, description="Path of an image (.npy, .png) with the numbers of things, 0 for none, instead of mask."
    )
    label: int | None = Field(None, ge=1, lt=2**63, description="The thing of labels to grasp.")
    all: bool = Field(
        False, description="Find grasps of every thing: those of labels, or all that rise above the table."
    )
    table_from_camera: Matrix | None = Field(
        None,
        description="4x4 pose of the camera (x right, y down, z forward), metres; the table is z = 0. By default the "
        "table is found in the image.",
    )
    region: Annotated[list[int], Field(min_length=4, max_length=4)] | None = Field(
        None, description="LEFT, TOP, RIGHT, BOTTOM: pixels within which the object is searched for."
    )
    workspace: Annotated[list[float], Field(min_length=6, max_length=6)] | None = Field(
        None,
        description="X, Y, Z, X, Y, Z: least and greatest corner of a box, metres, within which the object is searched "
        "for; in the table's frame if table_from_camera is given, else in the camera's.",
    )
    workspace_frame: Frame | None = Field(None, description="Another frame of workspace.")
    hand_error: Pair | None = Field(
        None, description="Positioning error of the hand, one standard deviation: millimetres, degrees."
    )
    count: int = Field(5, ge=1, le=MAX_GRASPS, description="Most grasps.")
    seed: Seed = Field(0, description="Seed of the refinement.")
    picture: Picture = True


Arguments = TypeVar("Arguments", bound=_Arguments)


def parsed(kind: type[Arguments], values: Mapping[str, Any]) -> Arguments:
    """Check the arguments of a call; a `ConfigError` names the first wrong one, its value and the remedy."""
    try:
        # As JSON, in which a list is an array of any kind and 1 is a number.
        return kind.model_validate_json(json.dumps(values))
    except ValidationError as error:
        raise ConfigError(_sentence(error, kind)) from None
    except ValueError as error:
        raise ConfigError(f"the arguments are no JSON: {error}") from None


def _sentence(error: ValidationError, kind: type[_Arguments]) -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    where = ".".join(map(str, first["loc"]))
    if first["type"] == "extra_forbidden":
        names = list(kind.model_fields)
        near = get_close_matches(where, names, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"choose from {', '.join(names)}"
        return f"there is no argument {where[:100]!r}; {hint}"
    if first["type"] == "missing":
        return f"{where} is missing; add it"
    message = first["msg"][:1].lower() + first["msg"][1:]
    return f"{where or 'the call'} is {shown(first['input'])}: {message}"
