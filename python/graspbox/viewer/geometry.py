"""Colours, poses in viser's notation, and meshes for instanced nodes; without viser."""

from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.rotations import quaternion_from_rotation
from graspbox.hands import Hand

__all__ = [
    "BOX_EDGES",
    "COLORS",
    "FAILURE",
    "FREE",
    "OBJECT",
    "SUCCESS",
    "UNTRIED",
    "Color",
    "Floats",
    "Solid",
    "boxes",
    "depth_picture",
    "hinge",
    "needles",
    "place",
    "ramp",
    "rows",
    "sphere",
    "split",
    "split_all",
    "sticks",
    "strips",
    "voxels",
    "wire_hand",
]

Floats: TypeAlias = NDArray[np.float64]
Color: TypeAlias = tuple[int, int, int]
Solid: TypeAlias = tuple[NDArray[np.float32], NDArray[np.uint32]]

# The colours of `graspbox.pictures`, which readers with any colour vision can distinguish.
OBJECT: Color = (216, 183, 140)
SUCCESS: Color = (0, 158, 115)
FAILURE: Color = (213, 94, 0)
UNTRIED: Color = (120, 120, 120)
FREE: Color = (68, 68, 68)
COLORS: tuple[Color, ...] = (
    (0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0), (0, 0, 0),
    (140, 108, 31),
)  # fmt: skip
#: Indices of the corners of a box (`Box.corners`) at its edges.
BOX_EDGES = np.array([(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)])
#: Facets of cylinders.
_FACETS = 12
#: Size of a wire hand relative to the hand, length of its stem in metres, and the share by which its fingers close.
_WIRE_SCALE, _STEM, _CLOSED = 0.36, 0.03, 0.3


def split(pose: ArrayLike) -> tuple[Floats, Floats]:
    """Split a pose (4, 4) into a quaternion (w, x, y, z) and a position."""
    matrix = np.asarray(pose, dtype=np.float64)
    return quaternion_from_rotation(matrix[None, :3, :3])[0], matrix[:3, 3]


def split_all(poses: ArrayLike) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Split poses (n, 4, 4) into quaternions (n, 4) and positions (n, 3), for instances."""
    matrices = np.asarray(poses, dtype=np.float64)
    return quaternion_from_rotation(matrices[:, :3, :3]).astype(np.float32), matrices[:, :3, 3].astype(np.float32)


def rows(segments: ArrayLike) -> Floats:
    """Return segments as (n, 2, 3)."""
    found: Floats = np.asarray(segments, dtype=np.float64).reshape(-1, 2, 3)
    return found


def place(points: Floats, pose: Floats) -> Floats:
    """Transform points (..., 3) by a pose (4, 4)."""
    moved: Floats = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def ramp(values: ArrayLike) -> NDArray[np.uint8]:
    """Map shares (n,) to colours (n, 3): blue at 0, grey, orange at 1; NaN becomes grey."""
    shares = np.clip(np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.5), 0.0, 1.0)
    stops = np.array([(0, 114, 178), (150, 150, 150), (230, 159, 0)], dtype=np.float64)
    mixed = [np.interp(shares, (0.0, 0.5, 1.0), stops[:, channel]) for channel in range(3)]
    return np.stack(mixed, axis=-1).astype(np.uint8)


def depth_picture(depth: ArrayLike) -> NDArray[np.uint8]:
    """Colour a depth image (H, W), metres, as (H, W, 3): yellow near, violet far, white where nothing was measured."""
    metres = np.asarray(depth, dtype=np.float64)
    seen = metres > 0
    if not seen.any():
        return np.full((*metres.shape, 3), 255, dtype=np.uint8)
    low, high = np.log(metres[seen].min()), np.log(metres[seen].max())
    shares = (np.log(np.where(seen, metres, 1.0)) - low) / max(high - low, 1e-3)
    # Five stops of matplotlib's plasma, reversed.
    stops = np.array([(240, 249, 33), (248, 149, 64), (204, 71, 120), (126, 3, 168), (13, 8, 135)], dtype=np.float64)
    places = np.linspace(0.0, 1.0, len(stops))
    picture = np.stack([np.interp(shares, places, stops[:, channel]) for channel in range(3)], axis=-1)
    picture[~seen] = 255.0
    return picture.astype(np.uint8)


def boxes(frames: ArrayLike, halves: ArrayLike) -> Solid:
    """Return boxes with frames (n, 4, 4) and half sides (n, 3) as one mesh."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))])
    pairs = list(zip(np.asarray(frames), np.asarray(halves), strict=True))
    vertices = [place(signs * half, frame) for frame, half in pairs]
    indices = [faces + 8 * index for index in range(len(pairs))]
    return np.concatenate(vertices).astype(np.float32), np.concatenate(indices).astype(np.uint32)


def hinge(center: float, half_length: float, radius: float) -> Solid:
    """Return a cylinder about x with its centre at x = `center`; metres."""
    turns = 2 * np.pi * np.arange(_FACETS) / _FACETS
    ring = np.stack([np.zeros(_FACETS), radius * np.cos(turns), radius * np.sin(turns)], axis=1)
    ends = [(center - half_length, 0.0, 0.0), (center + half_length, 0.0, 0.0)]
    vertices = np.concatenate([ring + ends[0], ring + ends[1], ends])
    n, faces = _FACETS, []
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n + j), (i, n + j, n + i), (2 * n, j, i), (2 * n + 1, n + i, n + j)]
    return vertices.astype(np.float32), np.array(faces, dtype=np.uint32)


def sphere(radius: float) -> Solid:
    """Return a sphere of few faces: an octahedron divided once."""
    corners = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], dtype=np.float64)
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    vertices, triangles = list(corners), []
    for a, b, c in faces:
        first = len(vertices)
        vertices += [vertices[a] + vertices[b], vertices[b] + vertices[c], vertices[c] + vertices[a]]
        ab, bc, ca = first, first + 1, first + 2
        triangles += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    found = np.array(vertices)
    found *= radius / np.linalg.norm(found, axis=1, keepdims=True)
    return found.astype(np.float32), np.array(triangles, dtype=np.uint32)


def sticks(segments: ArrayLike, radius: float) -> Solid:
    """Return segments (n, 2, 3) as thin prisms with three sides."""
    vertices: list[Floats] = []
    faces: list[tuple[int, int, int]] = []
    for start, end in rows(segments):
        along = end - start
        side = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        side *= radius / max(float(np.linalg.norm(side)), 1e-12)
        up = np.cross(along, side)
        up *= radius / max(float(np.linalg.norm(up)), 1e-12)
        first = 6 * len(vertices)
        turns = 2 * np.pi * np.arange(3) / 3
        ring = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * up
        vertices.append(np.concatenate([start + ring, end + ring]))
        for i in range(3):
            j = (i + 1) % 3
            faces += [(first + i, first + j, first + 3 + j), (first + i, first + 3 + j, first + 3 + i)]
    return np.concatenate(vertices).astype(np.float32), np.array(faces, dtype=np.uint32)


def needles(segments: ArrayLike, radius: float) -> Solid:
    """Return segments (n, 2, 3) as one thin triangle each, for sets that are drawn thousands of times."""
    found = rows(segments)
    along = found[:, 1] - found[:, 0]
    side = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    side *= 1.5 * radius / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    vertices = np.stack([found[:, 0] - side, found[:, 0] + side, found[:, 1]], axis=1)
    return vertices.reshape(-1, 3).astype(np.float32), np.arange(3 * len(found), dtype=np.uint32).reshape(-1, 3)


def strips(segments: ArrayLike, half_width: float) -> Solid:
    """Return horizontal segments (n, 2, 3) as flat strips of two triangles."""
    found = rows(segments)
    side = np.cross(found[:, 1] - found[:, 0], (0.0, 0.0, 1.0))
    side *= half_width / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    vertices = np.stack([found[:, 0] - side, found[:, 0] + side, found[:, 1] + side, found[:, 1] - side], axis=1)
    faces = np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(len(found))[:, None, None]
    return vertices.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.uint32)


def voxels(filled: NDArray[np.bool_], origin: ArrayLike, side: float) -> Solid:
    """Return the surface of voxels (X, Y, Z) with a side in metres, whose first one begins at `origin` (3,)."""
    padded = np.pad(filled, 1)
    quads = []
    for axis in range(3):
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for way in (1, -1):
            cells = np.argwhere(padded & ~np.roll(padded, -way, axis=axis)) - 1
            base = cells + (np.eye(3)[axis] if way > 0 else np.zeros(3))
            ring = [np.zeros(3), u, u + v, v] if way > 0 else [np.zeros(3), v, u + v, u]
            quads.append(base[:, None] + np.array(ring))
    corners = np.concatenate(quads).reshape(-1, 3)
    first = 4 * np.arange(len(corners) // 4)[:, None, None]
    faces = (first + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3)
    return (np.asarray(origin) + side * corners).astype(np.float32), faces.astype(np.uint32)


def wire_hand(hand: Hand, preshape: float) -> Floats:
    """Return a small hand with half-closed fingers as segments (s, 2, 3), hand frame, metres.

    A stem along the approach ends at the palm's centre; from there, lines along the joints of each finger to its tip
    show roll and preshape.
    """
    positions = hand.closed(preshape, _CLOSED)
    shapes, halves, _, carriers = hand.shapes(positions)
    joints, chains, _ = hand.joint_frames(positions)
    palm = np.zeros(3)
    segments = [(np.array([0.0, 0.0, -_STEM]) / _WIRE_SCALE, palm)]
    for chain in range(len(hand.chains)):
        found = [row for row in np.flatnonzero(chains == chain) if (carriers == row).any()]
        if not found:
            continue
        last = int(np.where(carriers == found[-1], halves.prod(axis=1), -1.0).argmax())
        center = shapes[last, :3, 3]
        points = [joints[row, :3, 3] for row in found]
        points.append(2 * center - points[-1])
        segments += pairwise([palm, *points])
    return _WIRE_SCALE * np.array(segments)
