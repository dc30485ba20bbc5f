"""Wavefront OBJ files of objects: their visual meshes and convex parts.

Coordinates are rounded to float32 (6e-9 m at 0.1 m), as MuJoCo, USD and Bullet store them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.imports import imported
from graspbox.tools.scene_export.contents import ObjectData, object_names

__all__ = ["MeshFiles", "hull_faces", "mesh_files", "mesh_texts", "obj"]


@dataclass(frozen=True)
class MeshFiles:
    """Names of the mesh files of an object, relative to the file of the scene."""

    parts: Sequence[str]
    visual: str | None = None


def mesh_files(objects: Sequence[ObjectData]) -> list[MeshFiles]:
    """Name the mesh files of the objects of an export; those of several are in a folder each."""
    folders = ["meshes"] if len(objects) == 1 else [f"meshes/{name}" for name in object_names(len(objects))]
    return [
        MeshFiles(
            [f"{folder}/part_{index}.obj" for index in range(len(item.parts))],
            None if item.visual is None else f"{folder}/visual.obj",
        )
        for folder, item in zip(folders, objects, strict=True)
    ]


def mesh_texts(objects: Sequence[ObjectData]) -> dict[str, str]:
    """Return the mesh files of `mesh_files` by name."""
    texts = {}
    for item, files in zip(objects, mesh_files(objects), strict=True):
        if item.visual is not None and files.visual is not None:
            texts[files.visual] = obj(item.visual.vertices, item.visual.faces, item.name)
        for index, (name, points) in enumerate(zip(files.parts, item.parts, strict=True)):
            texts[name] = obj(points, hull_faces(np.asarray(points)), f"{item.name}_part_{index}")
    return texts


def hull_faces(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Triangulate the convex hull of at least 4 points (n, 3): indices (m, 3), counter-clockwise seen from outside.

    Raises
    ------
    MissingExtraError
        Without SciPy.
    """
    spatial = imported("scipy.spatial", "exported scenes need scipy, from the extra 'scenes'", "scenes")
    try:
        hull = spatial.ConvexHull(points)
    except spatial.QhullError:
        # The points are coplanar within rounding: joggle them.
        hull = spatial.ConvexHull(points, qhull_options="QJ Pp")
    faces = np.asarray(hull.simplices, dtype=np.int64)
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def obj(vertices: ArrayLike, faces: ArrayLike, name: str) -> str:
    """Write a mesh of vertices (n, 3), metres, and triangles (m, 3) as OBJ; white space in its name is replaced."""
    lines = [f"o {'_'.join(name.split()) or 'mesh'}"]
    # Nine digits distinguish all float32 numbers.
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in np.asarray(vertices, dtype=np.float32).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(faces, dtype=np.int64) + 1).tolist()]
    return "\n".join(lines) + "\n"
