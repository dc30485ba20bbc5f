"""A view of shaded triangles: orthographic, with hidden surfaces removed pixel by pixel; lines know what hides them.

The raster goes onto matplotlib axes as an image whose units are metres across the view; lines and text stay vectors.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from PIL import Image

Floats = NDArray[np.float64]
#: Triangles (n, 3, 3) in metres, and their colour.
Solid = tuple[Floats, str]

#: Direction to the light, over the viewer's left shoulder (view frame: x right, y up, z to the eye).
_LIGHT = np.array([-0.35, 0.60, 0.72]) / np.linalg.norm([-0.35, 0.60, 0.72])
#: Share of a colour that a surface keeps that looks away from the light.
_AMBIENT = 0.42
#: Rays a pixel and axis: edges are smoothed.
_RAYS = 2
#: Pixels that are filled at a time; bounds the memory.
_CHUNK = 2_000_000
#: A line this far behind a surface is still on it, metres.
_ON_SURFACE = 0.0015
#: Steps a line is cut into to see where it is hidden.
_STEPS = 60


@dataclass(frozen=True)
class Camera:
    """Where the eye is: far away, in a direction.

    Attributes
    ----------
    azimuth, elevation : float
        Degrees: 0, 0 looks along -x; elevation 90 looks down.
    """

    azimuth: float = -60.0
    elevation: float = 25.0

    @classmethod
    def across(cls, way: ArrayLike, *, elevation: float = 25.0) -> "Camera":
        """Look across a direction (3,), slanting, from the side that is nearer to the default."""
        x, y, _ = np.asarray(way, dtype=np.float64)
        usual = cls.azimuth
        if np.hypot(x, y) < 0.3 * float(np.linalg.norm(way)):
            return cls(usual, elevation)
        along = float(np.degrees(np.arctan2(y, x)))
        # Not quite at right angles: a hand seen a little from behind shows its width as well.
        nearest = min((along + 110.0, along - 110.0), key=lambda a: abs((a - usual + 180.0) % 360.0 - 180.0))
        return cls(nearest, elevation)

    def project(self, points: ArrayLike) -> Floats:
        """Turn points (..., 3) into the view: x right, y up, z to the eye, metres."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [-np.sin(a), np.cos(a), 0.0]
        up = [-np.cos(a) * np.sin(e), -np.sin(a) * np.sin(e), np.cos(e)]
        eye = [np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]
        view: Floats = np.asarray(points, dtype=np.float64) @ np.array([right, up, eye]).T
        return view


class View:
    """A raster of solids, ready for lines.

    Parameters
    ----------
    solids : iterable of (triangles, colour)
        What is seen.
    camera : Camera
        From where.
    shown : (n, 3) array_like, optional
        Points that must lie in the picture; those of the solids by default.
    pixels : int
        Along the longer side.
    aspect : float, optional
        Width over height of the picture; as the shown points need by default.
    """

    def __init__(
        self,
        solids: Iterable[Solid],
        camera: Camera = Camera(),
        *,
        shown: ArrayLike | None = None,
        pixels: int = 480,
        aspect: float | None = None,
    ) -> None:
        solids = list(solids)
        self.camera = camera
        triangles = np.concatenate([t for t, _ in solids])
        colors = np.concatenate([np.tile(to_rgb(color), (len(t), 1)) for t, color in solids])
        view = camera.project(triangles)
        frame = view[..., :2].reshape(-1, 2) if shown is None else camera.project(shown).reshape(-1, 3)[:, :2]
        low, high = frame.min(axis=0), frame.max(axis=0)
        middle, half = (low + high) / 2, (high - low) / 2 * 1.04
        if aspect is not None:
            half = np.array([max(half[0], half[1] * aspect), max(half[1], half[0] / aspect)])
        self.low, self.high = middle - half, middle + half
        self._step = float(2 * half.max() / (pixels * _RAYS))
        self._size = np.maximum(np.ceil(2 * half / self._step / _RAYS).astype(np.int64), 1) * _RAYS
        self.depth, self.image = self._fill(view, _shade(view, colors))

    def _fill(self, view: Floats, colors: Floats) -> tuple[Floats, Floats]:
        width, height = self._size
        depth, face = np.full(width * height, -np.inf), np.full(width * height, -1)
        corners = (view[..., :2] - self.low) / self._step - 0.5
        first = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
        last = np.minimum(np.floor(corners.max(axis=1)), self._size - 1).astype(np.int64)
        counts = np.prod(np.maximum(last - first + 1, 0), axis=1)
        ends = np.cumsum(counts)
        start = 0
        while start < len(view):
            done = ends[start - 1] if start else 0
            stop = max(int(np.searchsorted(ends, done + _CHUNK)), start + 1)
            rows = np.arange(start, stop)
            self._fill_chunk(rows, counts[rows], _planes(corners[rows], view[rows, :, 2]), (first, last), depth, face)
            start = stop
        rgba = np.concatenate([colors[face], (face >= 0).astype(np.float64)[:, None]], axis=1)
        rgba[face < 0] = 0.0
        blocks = rgba.reshape(height // _RAYS, _RAYS, width // _RAYS, _RAYS, 4).mean(axis=(1, 3))
        # Colours are averaged over the rays that hit, the last channel over all.
        blocks[..., :3] /= np.maximum(blocks[..., 3:], 1e-9)
        return depth.reshape(height, width), np.clip(blocks, 0, 1)

    def _fill_chunk(
        self,
        rows: NDArray[np.int64],
        counts: NDArray[np.int64],
        planes: Floats,
        bounds: tuple[NDArray[np.int64], NDArray[np.int64]],
        depth: Floats,
        face: NDArray[np.int64],
    ) -> None:
        """Test every pixel in the bounds of each triangle; keep what is nearest to the eye."""
        first, last = bounds
        owner = np.repeat(rows, counts)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        down, across = np.divmod(within, (last[owner, 0] - first[owner, 0]) + 1)
        x, y = first[owner, 0] + across, first[owner, 1] + down
        weights = planes[owner - rows[0]]
        inside = np.ones(len(owner), dtype=np.bool_)
        for k in range(3):
            inside &= weights[:, k, 0] * x + weights[:, k, 1] * y + weights[:, k, 2] >= -1e-9
        weights, x, y, owner = weights[inside, 3], x[inside], y[inside], owner[inside]
        z = weights[:, 0] * x + weights[:, 1] * y + weights[:, 2]
        pixel = y * self._size[0] + x
        np.maximum.at(depth, pixel, z)
        nearest = z == depth[pixel]
        face[pixel[nearest]] = owner[nearest]

    def visible(self, points: Floats) -> NDArray[np.bool_]:
        """Which of the points (n, 3) no surface hides."""
        view = self.camera.project(points)
        at = np.floor((view[:, :2] - self.low) / self._step).astype(np.int64)
        inside = np.all((at >= 0) & (at < self._size), axis=1)
        x, y = np.clip(at, 0, self._size - 1).T
        free: NDArray[np.bool_] = ~inside | (view[:, 2] >= self.depth[y, x] - _ON_SURFACE)
        return free

    def show(self, axes: Any) -> None:
        """Put the raster on axes and set their limits."""
        extent = (self.low[0], self.high[0], self.low[1], self.high[1])
        axes.imshow(self.image, origin="lower", extent=extent, interpolation="antialiased", zorder=0)
        axes.set_xlim(extent[:2])
        axes.set_ylim(extent[2:])
        axes.set_aspect("equal")
        axes.set_axis_off()

    def lines(self, axes: Any, lines: ArrayLike, color: str, *, width: float = 1.0, hidden: float = 0.25) -> None:
        """Draw segments (n, 2, 3); where a surface hides them, with the opacity `hidden`."""
        ends = np.asarray(lines, dtype=np.float64)
        t = np.linspace(0.0, 1.0, _STEPS + 1)[None, :, None]
        points = ends[:, None, 0] + (ends[:, None, 1] - ends[:, None, 0]) * t
        middles = (points[:, 1:] + points[:, :-1]) / 2
        seen = self.visible(middles.reshape(-1, 3)).reshape(middles.shape[:2])
        flat = self.camera.project(points)[..., :2]
        for wanted, alpha in ((False, hidden), (True, 1.0)):
            runs = [run for line, mask in zip(flat, seen == wanted, strict=True) for run in _runs(line, mask)]
            if runs and alpha > 0:
                caps: Literal["round", "butt"] = "round" if wanted else "butt"
                axes.add_collection(LineCollection(runs, colors=color, linewidths=width, alpha=alpha, capstyle=caps))


def write(figure: Figure, path: Path) -> None:
    """Write a figure; a PNG with a palette of 256 colours, which is a third of the size."""
    if path.suffix.lower() != ".png":
        figure.savefig(path)
        return
    raw = BytesIO()
    figure.savefig(raw, format="png")
    with Image.open(raw) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def _runs(line: Floats, mask: NDArray[np.bool_]) -> list[Floats]:
    """Cut a line at points (s + 1, 2) into the stretches whose steps (s,) are in the mask."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [line[start : stop + 1] for start, stop in zip(change[::2], change[1::2], strict=True)]


def _planes(corners: Floats, heights: Floats) -> Floats:
    """Find what is linear in a pixel's place (x, y, 1): three barycentric weights and the height, (n, 4, 3)."""
    planes = np.full((len(corners), 4, 3), -1.0)  # seen edge-on, a triangle covers no pixel
    (a, b, c) = np.moveaxis(corners, 1, 0)
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    wide = np.abs(area) > 1e-12
    for k, (p, q) in enumerate(((b, c), (c, a), (a, b))):
        line = np.stack([p[:, 1] - q[:, 1], q[:, 0] - p[:, 0], p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]], axis=1)
        planes[wide, k] = line[wide] / area[wide, None]
    planes[wide, 3] = np.einsum("nk,nki->ni", heights[wide], planes[wide, :3])
    return planes


def _shade(view: Floats, colors: Floats) -> Floats:
    """Light each triangle from both sides, so that open surfaces do not turn black."""
    normals = np.cross(view[:, 1] - view[:, 0], view[:, 2] - view[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    normals *= np.where(normals[:, 2:] < 0, -1.0, 1.0)
    light = _AMBIENT + (1 - _AMBIENT) * np.maximum(normals @ _LIGHT, 0.0)
    shaded: Floats = np.clip(colors * light[:, None], 0, 1)
    return shaded
