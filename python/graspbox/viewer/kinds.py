"""Kinds of sources: a row each, with a recogniser and a page.

The first recogniser that returns a value decides the kind; others return None.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from graspbox import object_sets
from graspbox._common.files import read_bounded
from graspbox.dataset import manifest
from graspbox.envs import IDS
from graspbox.errors import ConfigError, ObjectSetError
from graspbox.hands import Hand, load_hand
from graspbox.layouts import Arrangement
from graspbox.meshes import Mesh, as_mesh
from graspbox.object_sets import ObjectSet
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES
from graspbox.perception.depth_images import metric_depth, read_depth
from graspbox.planning import Plan
from graspbox.policies.grasp_image import ImageGrasps
from graspbox.simulation import Scene
from graspbox.viewer.page import Options, Page
from graspbox.viewer.pages.datasets import DatasetPage
from graspbox.viewer.pages.depth_images import DepthImage, DepthImagePage
from graspbox.viewer.pages.environments import EnvironmentPage
from graspbox.viewer.pages.galleries import GalleryPage
from graspbox.viewer.pages.grasp_tables import GraspTablePage, read_table
from graspbox.viewer.pages.hands import HandPage, HandSource
from graspbox.viewer.pages.objects import ObjectPage, PlannedObject
from graspbox.viewer.pages.runs import RunPage, is_run
from graspbox.viewer.wanted import find_object

__all__ = ["KINDS", "Kind", "find"]

#: Largest JSON document that is read to recognise it.
_MAX_BYTES = 256 << 20


@dataclass(frozen=True)
class Kind:
    """A kind of source.

    Attributes
    ----------
    name : str
        Its name, in errors.
    recognise : callable
        Maps a source and `Options` to the content of the page, or to None.
    page : type of Page
        The page.
    """

    name: str
    recognise: Callable[[Any, Options], Any]
    page: type[Page]


def _object(source: Any, options: Options) -> PlannedObject | None:
    if isinstance(source, PlannedObject):
        return source
    if isinstance(source, Mesh):
        return PlannedObject(source)
    if isinstance(source, Arrangement):
        source = Scene.of(source, target=source.target, hand=options.hand)
    if isinstance(source, Scene):
        return PlannedObject(source.mesh, scene=source)
    if isinstance(source, tuple) and len(source) == 2 and isinstance(source[1], Plan):
        return PlannedObject(as_mesh(source[0]), source[1])
    found = _set(source, options)
    return PlannedObject(found[0].load()) if found is not None and len(found) == 1 else None


def _set(source: Any, options: Options) -> ObjectSet | None:
    if isinstance(source, ObjectSet):
        return source
    if not isinstance(source, str | Path):
        return None
    name = str(source)
    if name.partition(":")[0] in ("procedural", "ycb", "dir") or Path(name).suffix.lower() in MESH_SUFFIXES:
        return object_sets.load(source, scale=options.scale)
    return None


def _hand(source: Any, options: Options) -> HandSource | None:
    del options
    if isinstance(source, Hand):
        return HandSource(source)
    if isinstance(source, str) and source in Hand.names():
        return HandSource(source)
    if isinstance(source, tuple) and len(source) == 2 and all(isinstance(one, str | Path) for one in source):
        return HandSource(source, (Path(source[0]), Path(source[1])))
    if isinstance(source, str) and source.endswith((".urdf", ".toml")):
        urdf, comma, toml = source.partition(",")
        if not comma:
            load_hand(source)  # raises: a hand has two files
        return HandSource((urdf, toml), (Path(urdf), Path(toml)))
    return None


def _environment(source: Any, options: Options) -> str | None:
    del options
    name = source.removeprefix("graspbox:") if isinstance(source, str) else ""
    if name in IDS:
        return name
    if name.startswith("graspbox/"):
        raise ConfigError(f"there is no environment {name!r}; choose from {', '.join(IDS)}")
    return None


def _depth_image(source: Any, options: Options) -> DepthImage | None:
    if isinstance(source, ImageGrasps):
        return DepthImage(found=source)
    if isinstance(source, np.ndarray):
        return DepthImage(metric_depth(source, options.depth_scale))
    if isinstance(source, str | Path) and Path(source).suffix.lower() in (".npy", ".png"):
        return DepthImage(read_depth(source, options.depth_scale))
    return None


def _plan(source: Any, options: Options) -> PlannedObject | None:
    if isinstance(source, Plan):
        plan = source
    elif _is_json(source) and (table := _document(Path(source))) is not None and table.get("format") == "graspbox.plan":
        plan = Plan.load(source)
    else:
        return None
    return PlannedObject(find_object(plan.name, plan.mesh_sha256, options), plan)


def _grasps(source: Any, options: Options) -> dict[str, Any] | None:
    del options
    if not _is_json(source):
        return None
    found = read_table(Path(source))
    if found is None:
        raise ConfigError(
            f"{str(source)!r} is neither a plan (graspbox plan --out) nor a table of grasps (graspbox grasp --out)"
        )
    return found


def _is_json(source: Any) -> bool:
    return isinstance(source, str | Path) and Path(source).suffix.lower() == ".json"


def _document(path: Path) -> dict[str, Any] | None:
    """Read a JSON document; None if it is none."""
    try:
        found = json.loads(read_bounded(path, _MAX_BYTES))
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _data_set(source: Any, options: Options) -> Path | None:
    del options
    folder = Path(source) if isinstance(source, str | Path) else None
    return folder if folder is not None and (folder / manifest.FILE).is_file() else None


def _run(source: Any, options: Options) -> Path | None:
    del options
    folder = Path(source) if isinstance(source, str | Path) else None
    return folder if folder is not None and folder.is_dir() and is_run(folder) else None


def _gallery(source: Any, options: Options) -> ObjectSet | None:
    return _set(source, options)


KINDS: tuple[Kind, ...] = (
    Kind(f"environment: {', '.join(IDS)}", _environment, EnvironmentPage),
    Kind("hand: a name, or hand.urdf,hand.toml", _hand, HandPage),
    Kind("depth image: .npy or 16-bit .png", _depth_image, DepthImagePage),
    Kind("plan: .json of graspbox plan --out", _plan, ObjectPage),
    Kind("table of grasps: .json of graspbox grasp --out", _grasps, GraspTablePage),
    Kind("folder of a data set", _data_set, DatasetPage),
    Kind("folder of a run", _run, RunPage),
    Kind("object, mesh file, scene or arrangement", _object, ObjectPage),
    Kind("object set", _gallery, GalleryPage),
)


def find(source: Any, options: Options) -> tuple[type[Page], Any]:
    """Find the page of a source; returns the class of the page and its content.

    Raises
    ------
    ConfigError, ObjectSetError
        If no recogniser accepts it, or it cannot be read.
    """
    for kind in KINDS:
        if (found := kind.recognise(source, options)) is not None:
            return kind.page, found
    known = "; ".join(kind.name for kind in KINDS)
    if isinstance(source, str | Path):
        raise ObjectSetError(f"{str(source)!r} names nothing that can be viewed; give one of: {known}")
    raise ConfigError(f"source is of the type {type(source).__name__}; give one of: {known}")
