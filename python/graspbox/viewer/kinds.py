"""What can be viewed: one row per kind, with the function that recognises it and the page that shows it.

The first row whose recogniser returns something has the thing; a recogniser returns None for things of other kinds.
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
from graspbox.meshes import Mesh, as_mesh
from graspbox.object_sets import ObjectSet
from graspbox.object_sets.mesh_folders import MESH_SUFFIXES
from graspbox.perception.depth_images import metric_depth, read_depth
from graspbox.planning import Plan
from graspbox.policies.grasp_image import ImageGrasps
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
    """A kind of thing.

    Attributes
    ----------
    name : str
        Its name, in errors.
    recognise : callable
        Takes a thing and `Options`; returns what the page shows, or None.
    page : type of Page
        Shows it.
    """

    name: str
    recognise: Callable[[Any, Options], Any]
    page: type[Page]


def _object(what: Any, options: Options) -> PlannedObject | None:
    if isinstance(what, PlannedObject):
        return what
    if isinstance(what, Mesh):
        return PlannedObject(what)
    if isinstance(what, tuple) and len(what) == 2 and isinstance(what[1], Plan):
        return PlannedObject(as_mesh(what[0]), what[1])
    found = _set(what, options)
    return PlannedObject(found[0].load()) if found is not None and len(found) == 1 else None


def _set(what: Any, options: Options) -> ObjectSet | None:
    if isinstance(what, ObjectSet):
        return what
    if not isinstance(what, str | Path):
        return None
    name = str(what)
    if name.partition(":")[0] in ("procedural", "ycb", "dir") or Path(name).suffix.lower() in MESH_SUFFIXES:
        return object_sets.load(what, scale=options.scale)
    return None


def _hand(what: Any, options: Options) -> HandSource | None:
    del options
    if isinstance(what, Hand):
        return HandSource(what)
    if isinstance(what, str) and what in Hand.names():
        return HandSource(what)
    if isinstance(what, tuple) and len(what) == 2 and all(isinstance(one, str | Path) for one in what):
        return HandSource(what, (Path(what[0]), Path(what[1])))
    if isinstance(what, str) and what.endswith((".urdf", ".toml")):
        urdf, comma, toml = what.partition(",")
        if not comma:
            load_hand(what)  # says that a hand has two files
        return HandSource((urdf, toml), (Path(urdf), Path(toml)))
    return None


def _environment(what: Any, options: Options) -> str | None:
    del options
    name = what.removeprefix("graspbox:") if isinstance(what, str) else ""
    if name in IDS:
        return name
    if name.startswith("graspbox/"):
        raise ConfigError(f"there is no environment {name!r}; choose from {', '.join(IDS)}")
    return None


def _depth_image(what: Any, options: Options) -> DepthImage | None:
    if isinstance(what, ImageGrasps):
        return DepthImage(found=what)
    if isinstance(what, np.ndarray):
        return DepthImage(metric_depth(what, options.depth_scale))
    if isinstance(what, str | Path) and Path(what).suffix.lower() in (".npy", ".png"):
        return DepthImage(read_depth(what, options.depth_scale))
    return None


def _plan(what: Any, options: Options) -> PlannedObject | None:
    if isinstance(what, Plan):
        plan = what
    elif _is_json(what) and (table := _document(Path(what))) is not None and table.get("format") == "graspbox.plan":
        plan = Plan.load(what)
    else:
        return None
    return PlannedObject(find_object(plan.name, plan.mesh_sha256, options), plan)


def _grasps(what: Any, options: Options) -> dict[str, Any] | None:
    del options
    if not _is_json(what):
        return None
    found = read_table(Path(what))
    if found is None:
        raise ConfigError(
            f"{str(what)!r} is neither a plan (graspbox plan --out) nor a table of grasps (graspbox grasp --out)"
        )
    return found


def _is_json(what: Any) -> bool:
    return isinstance(what, str | Path) and Path(what).suffix.lower() == ".json"


def _document(path: Path) -> dict[str, Any] | None:
    """Read a JSON document; None if it is none."""
    try:
        found = json.loads(read_bounded(path, _MAX_BYTES))
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _data_set(what: Any, options: Options) -> Path | None:
    del options
    folder = Path(what) if isinstance(what, str | Path) else None
    return folder if folder is not None and (folder / manifest.FILE).is_file() else None


def _run(what: Any, options: Options) -> Path | None:
    del options
    folder = Path(what) if isinstance(what, str | Path) else None
    return folder if folder is not None and folder.is_dir() and is_run(folder) else None


def _gallery(what: Any, options: Options) -> ObjectSet | None:
    return _set(what, options)


KINDS: tuple[Kind, ...] = (
    Kind(f"environment: {' or '.join(IDS)}", _environment, EnvironmentPage),
    Kind("hand: a name, or hand.urdf,hand.toml", _hand, HandPage),
    Kind("depth image: .npy or 16-bit .png", _depth_image, DepthImagePage),
    Kind("plan: .json of graspbox plan --out", _plan, ObjectPage),
    Kind("table of grasps: .json of graspbox grasp --out", _grasps, GraspTablePage),
    Kind("folder of a data set", _data_set, DatasetPage),
    Kind("folder of a run", _run, RunPage),
    Kind("object or mesh file", _object, ObjectPage),
    Kind("object set", _gallery, GalleryPage),
)


def find(what: Any, options: Options) -> tuple[type[Page], Any]:
    """Find the page for a thing; returns its class and what it shows.

    Raises
    ------
    ConfigError, ObjectSetError
        If no kind has it, or it is of a kind but cannot be read.
    """
    for kind in KINDS:
        if (found := kind.recognise(what, options)) is not None:
            return kind.page, found
    known = "; ".join(kind.name for kind in KINDS)
    if isinstance(what, str | Path):
        raise ObjectSetError(f"{str(what)!r} names nothing that can be viewed; give one of: {known}")
    raise ConfigError(f"what is of the type {type(what).__name__}; give one of: {known}")
