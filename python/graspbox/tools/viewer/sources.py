"""Kinds of sources: a row each, with a recogniser and a page.

The first recogniser that returns a value decides the kind; others return None.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from graspbox import object_sets
from graspbox._common.files import read_bounded
from graspbox.captures import Capture, read_capture
from graspbox.captures.capture import Camera, Found
from graspbox.captures.files import DEPTH_SUFFIXES, RECORDING_SUFFIXES
from graspbox.captures.reading import capture_of
from graspbox.envs import GOAL_IDS, IDS
from graspbox.errors import ConfigError, ObjectSetError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.meshes import Mesh, as_mesh
from graspbox.object_sets import ObjectSet
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES
from graspbox.perception.depth_images import intrinsics_of
from graspbox.planning import Plan
from graspbox.policies import Policy
from graspbox.policies.grasp_image import ImageGrasps, SceneGrasps
from graspbox.policies.published.folders import CONFIG, policy_of
from graspbox.policies.published.registry import other_policy
from graspbox.simulation import Scene
from graspbox.simulation.layouts import Arrangement
from graspbox.simulation.path_motion import PathMotion
from graspbox.tools.viewer.named_objects import find_object
from graspbox.tools.viewer.page import Page, ViewerOptions
from graspbox.tools.viewer.pages.depth_images import DepthImagePage
from graspbox.tools.viewer.pages.environments import EnvironmentPage
from graspbox.tools.viewer.pages.galleries import GalleryPage
from graspbox.tools.viewer.pages.hands import HandPage
from graspbox.tools.viewer.pages.objects import ObjectPage, PlannedObject
from graspbox.tools.viewer.pages.paths import PathPage

#: Largest JSON document that is read to recognise it, and longest header of a PLY file, bytes.
_MAX_BYTES, _LONGEST_HEADER = 256 << 20, 1 << 16
#: Suffixes of depth images, clouds and recordings; PLY files may also be meshes.
_CAPTURES = (DEPTH_SUFFIXES | RECORDING_SUFFIXES) - {".ply"}
#: Faces in the header of a PLY file.
_FACES = re.compile(rb"^element\s+(face|tristrips)\s+0*[1-9]", re.MULTILINE)


class PageKind(NamedTuple):
    """A kind of source: its description for errors, a function that returns the content or None, and its page."""

    name: str
    recognise: Callable[[Any, ViewerOptions], Any]
    page: type[Page]


def _object(source: Any, options: ViewerOptions) -> PlannedObject | None:
    if isinstance(source, PlannedObject):
        return source
    if isinstance(source, Mesh):
        return PlannedObject(source)
    if isinstance(source, Arrangement):
        source = Scene.of(source, target=source.target, hand=options.hand_or())
    if isinstance(source, Scene):
        return PlannedObject(source.mesh, scene=source)
    if isinstance(source, tuple) and len(source) == 2 and isinstance(source[1], Plan):
        return PlannedObject(as_mesh(source[0]), source[1])
    objects = _set(source, options)
    return PlannedObject(objects[0].load()) if objects is not None and len(objects) == 1 else None


def _set(source: Any, options: ViewerOptions) -> ObjectSet | None:
    if isinstance(source, ObjectSet):
        return source
    if not isinstance(source, str | Path):
        return None
    name = str(source)
    if name.partition(":")[0] in ("procedural", "ycb", "dir") or Path(name).suffix.lower() in MESH_SUFFIXES:
        return object_sets.load(source, scale=options.scale)
    return None


def _hand(source: Any, options: ViewerOptions) -> HandLike | None:
    del options
    if isinstance(source, Hand) or (isinstance(source, str) and source in Hand.names()):
        return source
    if isinstance(source, tuple) and len(source) == 2 and all(isinstance(one, str | Path) for one in source):
        return source
    if isinstance(source, str) and source.endswith((".urdf", ".toml")):
        urdf, comma, toml = source.partition(",")
        if not comma:
            load_hand(source)  # raises: a hand has two files
        return urdf, toml
    return None


def _environment(source: Any, options: ViewerOptions) -> str | None:
    del options
    name = source.removeprefix("graspbox:") if isinstance(source, str) else ""
    if name in IDS:
        return name
    if name.startswith("graspbox/"):
        raise ConfigError(f"there is no environment {name!r}; choose from {', '.join(IDS)}")
    return None


def _policy(source: Any, options: ViewerOptions) -> Policy | None:
    del options
    if not isinstance(source, str | Path) or not Path(source).is_dir():
        return None
    found: Policy | None = policy_of(source) if (Path(source) / CONFIG).is_file() else other_policy(Path(source))
    if found is not None and found.env_id in GOAL_IDS:
        raise ConfigError(f"the policy {found.name!r} acts in the goal task {found.env_id!r}; graspbox play shows it")
    return found


def _depth_image(source: Any, options: ViewerOptions) -> Capture | ImageGrasps | SceneGrasps | None:
    if isinstance(source, Capture | ImageGrasps | SceneGrasps):
        return source
    if isinstance(source, np.ndarray):
        return _of_array(source, options)
    if not isinstance(source, str | Path) or not _is_capture(Path(source)):
        return None
    if options.intrinsics is not None and options.camera_info is not None:
        raise ConfigError(
            "intrinsics and camera_info (--intrinsics, --camera-info) both state the intrinsics; pass one"
        )
    return read_capture(
        source,
        intrinsics=options.camera_info if options.intrinsics is None else intrinsics_of(*options.intrinsics),
        labels=options.mask,
        topic=options.topic,
        time=options.time,
        **_reading(options),
    )


def _reading(options: ViewerOptions) -> dict[str, Any]:
    """Return how depths are read, from files and arrays."""
    return {name: getattr(options, name) for name in ("depth_scale", "depth_is", "limits", "camera_pose")}


def _of_array(depth: np.ndarray[Any, Any], options: ViewerOptions) -> Capture:
    """Make a capture of a depth image (H, W) in memory."""
    if options.intrinsics is None or options.mask is not None:
        raise ConfigError(
            "an array needs intrinsics, (fx, fy, cx, cy) in pixels, and no mask; pass a Capture for labels"
        )
    lens = Camera(intrinsics_of(*options.intrinsics), "intrinsics")
    return capture_of(Found("the depth", image=depth), lens, **_reading(options))


def _is_capture(path: Path) -> bool:
    """Tell a depth image, a cloud or a recording from a mesh and other folders."""
    if path.suffix.lower() == ".ply" and path.is_file():
        with path.open("rb") as file:
            return _FACES.search(file.read(_LONGEST_HEADER).partition(b"end_header")[0]) is None
    return path.suffix.lower() in _CAPTURES or (path / "metadata.yaml").is_file()


def _plan(source: Any, options: ViewerOptions) -> PlannedObject | None:
    if _is_json(source):
        try:
            document = json.loads(read_bounded(Path(source), _MAX_BYTES))
        except (ValueError, RecursionError):
            return None
        if isinstance(document, dict) and document.get("format") == "graspbox.plan":
            source = Plan.load(source)
    if not isinstance(source, Plan):
        return None
    return PlannedObject(find_object(source.name, source.mesh_sha256, options), source)


def _path(source: Any, options: ViewerOptions) -> PathMotion | None:
    del options
    return source if isinstance(source, PathMotion) else None


def _is_json(source: Any) -> bool:
    return isinstance(source, str | Path) and Path(source).suffix.lower() == ".json"


PAGES: tuple[PageKind, ...] = (
    PageKind(f"environment: {', '.join(IDS)}", _environment, EnvironmentPage),
    PageKind("hand: a name, or hand.urdf,hand.toml", _hand, HandPage),
    PageKind("depth image, point cloud or recording, as of graspbox grasp-image", _depth_image, DepthImagePage),
    PageKind("plan: .json of graspbox plan --out", _plan, ObjectPage),
    PageKind("policy: the folder of one, or of a run", _policy, EnvironmentPage),
    PageKind("object, mesh file, scene or arrangement", _object, ObjectPage),
    PageKind("object set", _set, GalleryPage),
    PageKind("path, by graspbox arm path --view", _path, PathPage),
)


def page_of(source: Any, options: ViewerOptions) -> tuple[type[Page], Any]:
    """Return the class of the page that shows a source, and the content of the page.

    Raises
    ------
    ConfigError, ObjectSetError
        If no recogniser accepts it, or it cannot be read.
    """
    for _, recognise, page in PAGES:
        if (content := recognise(source, options)) is not None:
            return page, content
    known = "; ".join(kind.name for kind in PAGES)
    if isinstance(source, str | Path):
        if _is_json(source) or Path(source).is_dir():
            raise ConfigError(
                f"{str(source)!r} has no view in 3D; show tables of grasps, evaluations, data sets and runs with "
                f"`graspbox report {source}`, a folder of meshes with `graspbox view dir:{source}`"
            )
        raise ObjectSetError(f"{str(source)!r} names nothing that can be viewed; pass one of: {known}")
    raise ConfigError(f"source is of the type {type(source).__name__}; pass one of: {known}")
