"""Triangles of boxes, cylinders and voxels as arrays, and points moved by poses."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
#: Vertices (n, 3) and faces (m, 3), counter-clockwise from outside.
Triangles = tuple[Floats, NDArray[np.uint32]]

_SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
#: Indices of the corners of a box, ordered as `graspbox.Box.corners`, at its edges (12, 2) and faces (12, 3).
BOX_EDGES = np.array([(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)])
BOX_FACES = np.array([half for a, b, c, d in _SIDES for half in ((a, b, c), (a, c, d))], dtype=np.uint32)
_CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def place(points: Floats, pose: Floats) -> Floats:
    """Transform points (..., 3) by a pose (4, 4)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def boxes(frames: Floats, half_extents: Floats) -> Triangles:
    """Return boxes with frames (n, 4, 4) and half extents (n, 3) as one mesh, 8 vertices each."""
    vertices = [place(_CORNERS * half, frame) for frame, half in zip(frames, half_extents, strict=True)]
    faces = BOX_FACES + 8 * np.arange(len(vertices), dtype=np.uint32)[:, None, None]
    return np.concatenate(vertices), faces.reshape(-1, 3)


def frame_along(axis: ArrayLike) -> Floats:
    """Extend a direction (3,) to a right-handed frame; rows (3, 3), the direction first."""
    along = np.asarray(axis, dtype=np.float64)
    along = along / np.linalg.norm(along)
    side = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    side /= np.linalg.norm(side)
    return np.array([along, side, np.cross(along, side)])


def cylinder(center: ArrayLike, axis: ArrayLike, radius: float, half_length: float, facets: int = 32) -> Triangles:
    """Return a cylinder about the direction `axis` (3,); metres."""
    along, side, up = frame_along(axis)
    turns = 2 * np.pi * np.arange(facets) / facets
    ring = radius * (np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * up)
    middle = np.asarray(center, dtype=np.float64)
    ends = [middle - half_length * along, middle + half_length * along]
    n, faces = facets, []
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n + j), (i, n + j, n + i), (2 * n, j, i), (2 * n + 1, n + i, n + j)]
    return np.concatenate([ring + ends[0], ring + ends[1], ends]), np.array(faces, dtype=np.uint32)


def voxels(filled: NDArray[np.bool_], origin: ArrayLike, side: float) -> Triangles:
    """Return the surface of voxels (X, Y, Z) with a side in metres; the first one begins at `origin` (3,)."""
    padded = np.pad(filled, 1)
    quads = []
    for axis, way in np.ndindex(3, 2):
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        cells = np.argwhere(padded & ~np.roll(padded, 1 - 2 * way, axis=axis)) - 1
        ring = np.array([np.zeros(3), u, u + v, v] if way else [np.zeros(3), v, u + v, u])
        quads.append((cells + way * np.eye(3)[axis])[:, None] + ring)
    corners = np.concatenate(quads).reshape(-1, 3)
    halves = np.array([(0, 1, 2), (0, 2, 3)], dtype=np.uint32)
    faces = halves + 4 * np.arange(len(corners) // 4, dtype=np.uint32)[:, None, None]
    return np.asarray(origin) + side * corners, faces.reshape(-1, 3)
