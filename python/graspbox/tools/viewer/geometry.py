"""Colours, poses in viser's notation, and meshes for instanced nodes; without viser."""

import html
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common import colors
from graspbox._common.rotations import quaternion_from_rotation
from graspbox.meshes.shapes import Floats, Triangles

Color: TypeAlias = tuple[int, int, int]

OBJECT, SUCCESS, FAILURE, EDGES = map(colors.rgb, (colors.OBJECT, colors.SUCCESS, colors.FAILURE, colors.NOT_SIMULATED))
COLORS: tuple[Color, ...] = tuple(map(colors.rgb, colors.COLORS))
UNTRIED: Color = (120, 120, 120)
#: Of all objects but that of the page, or the target.
OTHER: Color = colors.rgb(colors.OBJECTS[1])
#: Colours of shares 0, 0.5 and 1.
_RAMP = np.array([COLORS[0], (150, 150, 150), COLORS[5]], dtype=np.float64)
#: Five stops of matplotlib's plasma, reversed.
_DEPTHS = np.array([(240, 249, 33), (248, 149, 64), (204, 71, 120), (126, 3, 168), (13, 8, 135)], dtype=np.float64)
_PANEL = "padding:0 0.75em 0.5em;font-size:0.8em;line-height:1.5"
_MARK = "display:inline-block;width:0.7em;height:0.7em;border-radius:50%;margin-right:0.5em"


def split(pose: ArrayLike) -> tuple[Floats, Floats]:
    """Split a pose (4, 4) into a quaternion (w, x, y, z) and a position."""
    matrix = np.asarray(pose, dtype=np.float64)
    return quaternion_from_rotation(matrix[None, :3, :3])[0], matrix[:3, 3]


def _interpolated(shares: Floats, stops: Floats) -> Floats:
    """Interpolate colours (k, 3) at shares (...) of the way through them; (..., 3)."""
    places = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(shares, places, channel) for channel in stops.T], axis=-1)


def ramp(values: ArrayLike) -> NDArray[np.uint8]:
    """Map shares (n,) to colours (n, 3): blue at 0, grey, orange at 1; NaN becomes grey."""
    shares = np.clip(np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.5), 0.0, 1.0)
    return _interpolated(shares, _RAMP).astype(np.uint8)


def depth_picture(depth: ArrayLike) -> NDArray[np.uint8]:
    """Colour a depth image (H, W), metres, as (H, W, 3): yellow near, violet far, white where nothing was measured."""
    metres = np.asarray(depth, dtype=np.float64)
    seen = metres > 0
    logs = np.log(np.where(seen, metres, metres.max() or 1.0))
    picture = _interpolated((logs - logs.min()) / max(float(np.ptp(logs)), 1e-3), _DEPTHS)
    picture[~seen] = 255.0
    return picture.astype(np.uint8)


def sphere(radius: float) -> Triangles:
    """Return a sphere of few faces: an octahedron divided once."""
    corners = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], dtype=np.float64)
    faces = np.array([(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)])
    a, b, c = corners[faces].transpose(1, 0, 2)
    ab, bc, ca = a + b, b + c, c + a
    points = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return points, np.arange(len(points), dtype=np.uint32).reshape(-1, 3)


def strips(segments: Floats, half_width: float) -> Triangles:
    """Return horizontal segments (n, 2, 3) as flat strips of two triangles."""
    side = np.cross(segments[:, 1] - segments[:, 0], (0.0, 0.0, 1.0))
    side *= half_width / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    start, end = segments[:, 0], segments[:, 1]
    vertices = np.stack([start - side, start + side, end + side, end - side], axis=1)
    faces = np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(len(segments))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.uint32)


def legend(entries: Iterable[tuple[Color, str]]) -> str:
    """Return a legend as HTML: each colour and its meaning, as text."""
    lines = (
        f'<div><span style="{_MARK};background:rgb{color}"></span>{html.escape(meaning)}</div>'
        for color, meaning in entries
    )
    return f'<div style="{_PANEL}">{"".join(lines)}</div>'
