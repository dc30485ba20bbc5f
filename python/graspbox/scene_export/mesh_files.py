"""Wavefront OBJ files of an object: its visual mesh and its convex parts.

Coordinates are rounded to float32 (6e-9 m at 0.1 m), as MuJoCo, USD and Bullet store them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.extras import imported
from graspbox.scene_export.contents import ObjectData

__all__ = ["VISUAL", "hull_faces", "obj", "object_meshes", "part_name"]

#: Name of the file of the visual mesh.
VISUAL = "visual.obj"


def part_name(index: int) -> str:
    """Name the file of a convex part."""
    return f"part_{index}.obj"


def hull_faces(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Triangulate the convex hull of points.

    Parameters
    ----------
    points : (n, 3) float64
        At least 4 points.

    Returns
    -------
    (m, 3) int64
        Indices of the points, counter-clockwise seen from outside.

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
    """Write a triangle mesh as OBJ.

    Parameters
    ----------
    vertices : (n, 3) array_like
        Metres.
    faces : (m, 3) array_like of int
        Indices of vertices.
    name : str
        Name of the OBJ object; white space is replaced.
    """
    lines = [f"o {'_'.join(name.split()) or 'mesh'}"]
    # Nine digits distinguish all float32 numbers.
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in np.asarray(vertices, dtype=np.float32).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(faces, dtype=np.int64) + 1).tolist()]
    return "\n".join(lines) + "\n"


def object_meshes(item: ObjectData) -> dict[str, str]:
    """Return the OBJ files of an object by name: `VISUAL` if it has a visual mesh, then its parts."""
    files = {}
    if item.visual is not None:
        files[VISUAL] = obj(item.visual.vertices, item.visual.faces, item.name)
    for index, points in enumerate(item.parts):
        files[part_name(index)] = obj(points, hull_faces(np.asarray(points)), f"{item.name}_part_{index}")
    return files
