"""Views of solids and a hand by a distant camera, with lines whose hidden parts are faint.

The renderer makes the image; matplotlib draws lines and text as vectors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.colors import TABLE
from graspbox.meshes.shapes import Floats
from graspbox.pictures.hands import PosedHand
from graspbox.pictures.solids import Solid, box_mesh
from graspbox.planning import Box

#: Distance of the camera as a multiple of the scene's radius: a long focal length, with little perspective.
_DISTANCE = 6.0
#: Margin at each side, as a share of the picture's width and height.
_MARGIN = 0.03
#: Samples along each side of a pixel.
_SAMPLES = 4
#: Direction of the lamp, above and to the left of the camera: azimuth relative to the camera's, and elevation, degrees.
_LAMP = (-65.0, 70.0)
#: Intensities of lamp and ambient light (together they render a white ground as white), and the width of the soft
#: borders of shadows, metres.
_LIGHT = {"intensity": 0.66, "ambient": 0.45, "softness": 0.02, "sky": (1.0, 1.0, 1.0), "floor": (1.0, 1.0, 1.0)}
#: Greatest depth, metres.
_FAR = 100.0
#: Thickness and border of the table, metres.
_THICKNESS, _BORDER = 0.012, 0.012
#: Degrees between the table's sides and the camera's azimuth.
_TABLE_TURN = 9.0
#: Points at most this far behind a surface count as visible, metres.
_ON_SURFACE = 0.0015
#: Steps along a line at which its visibility is tested.
_STEPS = 120


@dataclass(frozen=True)
class Camera:
    """Direction from the object to a distant camera, degrees: at 0, 0 it looks along -x; at elevation 90 down."""

    azimuth: float = -60.0
    elevation: float = 25.0

    @classmethod
    def across(cls, way: ArrayLike, *, elevation: float = 25.0) -> "Camera":
        """Look across a direction (3,), from the side closer to the default azimuth."""
        x, y, _ = np.asarray(way, dtype=np.float64)
        usual = cls.azimuth
        if np.hypot(x, y) < 0.3 * float(np.linalg.norm(way)):
            return cls(usual, elevation)
        along = float(np.degrees(np.arctan2(y, x)))
        # Less than a right angle: slightly from the front, the palm and all fingers of a hand are visible.
        nearest = min((along + 72.0, along - 72.0), key=lambda a: abs((a - usual + 180.0) % 360.0 - 180.0))
        return cls(nearest, elevation)

    @property
    def axes(self) -> Floats:
        """Directions of right, down and forward in the picture, world frame: columns (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [-np.sin(a), np.cos(a), 0.0]
        down = [np.cos(a) * np.sin(e), np.sin(a) * np.sin(e), -np.cos(e)]
        return np.array([right, down, -_direction(self.azimuth, self.elevation)]).T


@dataclass(frozen=True)
class Lens:
    """A camera: intrinsics (3, 3), pose (4, 4) of its frame (x right, y down, z forward), columns and rows."""

    intrinsics: Floats
    world_from_camera: Floats
    size: tuple[int, int]

    @classmethod
    def showing(cls, points: ArrayLike, camera: Camera, size: tuple[int, int]) -> "Lens":
        """Place a camera so that points (n, 3) fill the picture."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        pose = np.eye(4)
        pose[:3, :3] = camera.axes
        pose[:3, 3] = middle - _DISTANCE * float(np.linalg.norm(points - middle, axis=1).max()) * camera.axes[:, 2]
        seen = (points - pose[:3, 3]) @ pose[:3, :3]
        flat = seen[:, :2] / seen[:, 2:]
        low, high = flat.min(axis=0), flat.max(axis=0)
        focal = float(np.min((1 - 2 * _MARGIN) * np.array(size) / np.maximum(high - low, 1e-9)))
        center = np.array(size) / 2 - focal * (low + high) / 2
        return cls(np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]]), pose, size)

    def project(self, points: ArrayLike) -> Floats:
        """Project world points (..., 3) to column, row (pixels from the upper left corner) and depth (metres)."""
        pose, points = self.world_from_camera, np.asarray(points, dtype=np.float64)
        seen = (points - pose[:3, 3]) @ pose[:3, :3]
        flat = seen @ self.intrinsics.T
        projected: Floats = np.concatenate([flat[..., :2] / seen[..., 2:], seen[..., 2:]], axis=-1)
        return projected


class View:
    """A rendered picture of solids and a hand.

    Parameters
    ----------
    size : (int, int)
        Columns and rows.
    shown : (n, 3) array_like, optional
        Points that the picture must contain, metres; by default all of the solids and the hand.
    table : bool or (n, 3) array_like
        Whether to add a table with its top at z = 0, below the solids, the hand and their shadows; or the points above
        it, metres.
    """

    def __init__(
        self,
        solids: Sequence[Solid],
        camera: Camera,
        *,
        size: tuple[int, int],
        shown: ArrayLike | None = None,
        hand: PosedHand | None = None,
        table: bool | ArrayLike | None = None,
    ) -> None:
        lamp = -_direction(camera.azimuth + _LAMP[0], _LAMP[1])
        has_table = table is not None and table is not False
        points = [solid.points for solid in solids] + ([] if hand is None else [hand.corners()])
        everything = np.concatenate(points or [np.zeros((1, 3))])
        shown = everything if shown is None else np.asarray(shown, dtype=np.float64).reshape(-1, 3)
        if has_table:
            above = everything if table is True else np.asarray(table, dtype=np.float64).reshape(-1, 3)
            top = _table(np.concatenate([above, above - above[:, 2:] / lamp[2] * lamp]), camera)
            solids = [*solids, Solid(box_mesh(top, "table"), TABLE, casts_shadow=False)]
            shown = np.concatenate([shown, top.corners()])
        self.lens = Lens.showing(shown, camera, size)
        self.image, self.depth = self._render(solids, lamp, hand)
        if has_table:
            # Lower edges of objects on the table lie in its top, which must not hide them.
            self.depth[self._heights() < _ON_SURFACE] = 0.0

    def _heights(self) -> Floats:
        """Return the heights (H, W) of the visible surfaces above z = 0, metres."""
        columns, rows = np.meshgrid(np.arange(self.lens.size[0]) + 0.5, np.arange(self.lens.size[1]) + 0.5)
        ways = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(self.lens.intrinsics).T
        pose = self.lens.world_from_camera
        heights: Floats = self.depth * (ways @ pose[2, :3]) + pose[2, 3]
        return heights

    def _render(
        self, solids: Sequence[Solid], lamp: Floats, hand: PosedHand | None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        columns, rows = self.lens.size
        solids = solids if hand is None else [*solids, *hand.hinges()]
        config = {
            "image_size": (rows, columns),
            "samples": _SAMPLES,
            "near": 1e-3,
            "far": _FAR,
            "light": {**_LIGHT, "direction": lamp.tolist()},
        }
        return _core.render(
            [s.mesh for s in solids],
            np.array([s.world_from_mesh for s in solids], dtype=np.float64).reshape(-1, 4, 4),
            np.array([to_rgb(s.color) for s in solids], dtype=np.float64).reshape(-1, 3),
            [s.casts_shadow for s in solids],
            None if hand is None else (hand.hand, hand.world_from_hand, hand.joints),
            self.lens.intrinsics,
            self.lens.world_from_camera,
            config,
            None,
        )

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return a mask of the points (n, 3) that no surface hides."""
        projected = self.lens.project(points)
        columns, rows = self.lens.size
        at = np.floor(projected[:, :2]).astype(np.int64)
        inside = np.all((at >= 0) & (at < (columns, rows)), axis=1)
        x, y = np.clip(at, 0, (columns - 1, rows - 1)).T
        surface = self.depth[y, x]
        free: NDArray[np.bool_] = ~inside | (surface == 0) | (projected[:, 2] <= surface + _ON_SURFACE)
        return free

    def show(self, axes: Any) -> None:
        """Put the picture on axes and set their limits."""
        columns, rows = self.lens.size
        axes.imshow(self.image, extent=(0, columns, rows, 0), interpolation="antialiased", zorder=0)
        axes.set_xlim(0, columns)
        axes.set_ylim(rows, 0)
        axes.set_axis_off()

    def lines(
        self,
        axes: Any,
        lines: ArrayLike,
        color: str,
        *,
        width: float = 1.0,
        hidden: float = 0.25,
        halo: float = 0.0,
    ) -> None:
        """Add segments (n, 2, 3) to axes.

        Parts behind a surface have the opacity `hidden`. A white `halo`, in points on each side, separates the segments
        from earlier lines.
        """
        ends = np.asarray(lines, dtype=np.float64)
        t = np.linspace(0.0, 1.0, _STEPS + 1)[None, :, None]
        points = ends[:, None, 0] + (ends[:, None, 1] - ends[:, None, 0]) * t
        middles = (points[:, 1:] + points[:, :-1]) / 2
        seen = self.visible(middles.reshape(-1, 3)).reshape(middles.shape[:2])
        flat = self.lens.project(points)[..., :2]
        for wanted, alpha in ((False, hidden), (True, 1.0)):
            runs = [run for line, mask in zip(flat, seen == wanted, strict=True) for run in _runs(line, mask)]
            if runs and alpha > 0:
                caps: Literal["round", "butt"] = "round" if wanted else "butt"
                if halo and wanted:
                    around = width + 2 * halo
                    axes.add_collection(LineCollection(runs, colors="white", linewidths=around, capstyle=caps))
                axes.add_collection(LineCollection(runs, colors=color, linewidths=width, alpha=alpha, capstyle=caps))


def _direction(azimuth: float, elevation: float) -> Floats:
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def _table(points: Floats, camera: Camera) -> Box:
    """Make a slab below points (n, 3), its top at z = 0, its sides rotated slightly from the camera's azimuth."""
    a = np.radians(camera.azimuth + _TABLE_TURN)
    axes = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    flat = (points @ axes)[:, :2]
    low, high = flat.min(axis=0) - _BORDER, flat.max(axis=0) + _BORDER
    center = axes @ np.array([*(low + high) / 2, -_THICKNESS / 2])
    return Box(center, axes, np.array([*(high - low) / 2, _THICKNESS / 2]))


def _runs(line: Floats, mask: NDArray[np.bool_]) -> list[Floats]:
    """Cut a polyline of points (s + 1, 2) into the runs of segments (s,) selected by the mask."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [line[start : stop + 1] for start, stop in zip(change[::2], change[1::2], strict=True)]
