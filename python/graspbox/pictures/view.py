"""What a far camera sees of meshes and a hand, as the renderer draws it, ready for lines that know what hides them.

The picture goes onto matplotlib axes as an image whose units are pixels; lines and text stay vectors.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from graspbox import _core
from graspbox.meshes import Mesh, mesh_from_arrays
from graspbox.planning import Box
from graspbox.simulation import Hand

Floats = NDArray[np.float64]

#: The eye is this many times farther from the middle than what is shown reaches: a long lens, which bends little.
_DISTANCE = 6.0
#: What is shown keeps this share of the picture's sides free.
_MARGIN = 0.03
#: Samples along each side of a pixel.
_SAMPLES = 4
#: The lamp stands over the viewer's left shoulder: degrees from the eye's azimuth, and above the table.
_LAMP = (-60.0, 62.0)
#: Strengths of the lamp and of the light from everywhere (together they show a white ground white), and the width of a
#: shadow's soft border, metres.
_LIGHT = {"intensity": 0.74, "ambient": 0.38, "softness": 0.02, "sky": (1.0, 1.0, 1.0), "floor": (1.0, 1.0, 1.0)}
#: Half the side of the ground, metres.
_GROUND = 50.0
#: A line this far behind a surface is still on it, metres.
_ON_SURFACE = 0.0015
#: Steps a line is cut into to see where it is hidden.
_STEPS = 120


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
        # Not quite at right angles: seen a little from before, a hand shows its palm and all its fingers.
        nearest = min((along + 72.0, along - 72.0), key=lambda a: abs((a - usual + 180.0) % 360.0 - 180.0))
        return cls(nearest, elevation)

    @property
    def axes(self) -> Floats:
        """World directions of the picture's right, of its down, and of the view: columns (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [-np.sin(a), np.cos(a), 0.0]
        down = [np.cos(a) * np.sin(e), np.sin(a) * np.sin(e), -np.cos(e)]
        return np.array([right, down, -_direction(self.azimuth, self.elevation)]).T


@dataclass(frozen=True)
class Lens:
    """A camera in its place.

    Attributes
    ----------
    intrinsics : (3, 3) float64
        Takes a point in the camera's frame to homogeneous image positions, pixels.
    world_from_camera : (4, 4) float64
        Camera frames have x right, y down, z forward.
    size : (int, int)
        Columns and rows.
    """

    intrinsics: Floats
    world_from_camera: Floats
    size: tuple[int, int]

    @classmethod
    def showing(cls, points: ArrayLike, camera: Camera, size: tuple[int, int]) -> "Lens":
        """Stand back and aim so that points (n, 3) fill the picture as far as they can."""
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
        """Turn world points (..., 3) into column, row (pixels from the upper left corner) and depth (metres)."""
        pose, points = self.world_from_camera, np.asarray(points, dtype=np.float64)
        seen = (points - pose[:3, 3]) @ pose[:3, :3]
        flat = seen @ self.intrinsics.T
        projected: Floats = np.concatenate([flat[..., :2] / seen[..., 2:], seen[..., 2:]], axis=-1)
        return projected


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh of one colour (matplotlib's) at a pose."""

    mesh: Mesh
    color: str
    world_from_mesh: Floats = field(default_factory=lambda: np.eye(4))
    casts_shadow: bool = True


@dataclass(frozen=True, eq=False)
class PosedHand:
    """A hand in a moment.

    Attributes
    ----------
    hand : Hand
        The hand.
    world_from_hand : (4, 4) float64
        Pose of the grasp frame.
    preshape : float
        Radians.
    fingers : (f, 2), optional
        Proximal and distal angle of each finger, radians; all 0, the open hand, by default.
    """

    hand: Hand
    world_from_hand: Floats
    preshape: float
    fingers: Floats | None = None

    def angles(self) -> tuple[Floats, Floats]:
        """Proximal and distal angles (f,), radians."""
        angles = np.zeros((self.hand.fingers, 2)) if self.fingers is None else self.fingers
        return np.ascontiguousarray(angles[:, 0]), np.ascontiguousarray(angles[:, 1])

    def corners(self) -> Floats:
        """Corners (n, 3) of its shapes' boxes, world frame, metres."""
        shapes, halves, _ = self.hand.shapes(self.preshape, *self.angles())
        frames = self.world_from_hand @ shapes
        boxes = [Box(frame[:3, 3], frame[:3, :3], half) for frame, half in zip(frames, halves, strict=True)]
        return np.concatenate([box.corners() for box in boxes])


class View:
    """A picture of solids and a hand.

    Parameters
    ----------
    solids : sequence of Solid
        What is seen.
    camera : Camera
        From where.
    shown : (n, 3) array_like
        Points that must lie in the picture, metres.
    size : (int, int)
        Columns and rows.
    hand : PosedHand, optional
        The hand.
    opacity : float
        Of the hand; below 1 what is behind it shines through, and it hides no lines.
    ground : bool
        Whether there is a white ground at z = 0, for shadows to fall on.
    """

    def __init__(
        self,
        solids: Sequence[Solid],
        camera: Camera,
        *,
        shown: ArrayLike,
        size: tuple[int, int],
        hand: PosedHand | None = None,
        opacity: float = 1.0,
        ground: bool = False,
    ) -> None:
        lamp = -_direction(camera.azimuth + _LAMP[0], _LAMP[1])
        if ground:
            solids = [*solids, Solid(_ground(), "#ffffff", casts_shadow=False)]
            shown = np.asarray(shown, dtype=np.float64).reshape(-1, 3)
            shown = np.concatenate([shown, shown - shown[:, 2:] / lamp[2] * lamp])
        self.lens = Lens.showing(shown, camera, size)
        self.image, self.depth = self._draw(solids, lamp, hand)
        if hand is not None and opacity < 1.0:
            bare, self.depth = self._draw(solids, lamp, None)
            mixed = opacity * self.image.astype(np.float64) + (1 - opacity) * bare
            self.image = np.rint(mixed).astype(np.uint8)
        if ground:
            # What rests on the ground has its lower edges in it: it hides none.
            self.depth[self._heights() < _ON_SURFACE] = 0.0

    def _heights(self) -> Floats:
        """Heights (H, W) of what is seen above the world's origin, metres."""
        columns, rows = np.meshgrid(np.arange(self.lens.size[0]) + 0.5, np.arange(self.lens.size[1]) + 0.5)
        ways = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(self.lens.intrinsics).T
        pose = self.lens.world_from_camera
        heights: Floats = self.depth * (ways @ pose[2, :3]) + pose[2, 3]
        return heights

    def _draw(
        self, solids: Sequence[Solid], lamp: Floats, hand: PosedHand | None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        columns, rows = self.lens.size
        config = {
            "image_size": (rows, columns),
            "samples": _SAMPLES,
            "near": 1e-3,
            "far": 2 * _GROUND,
            "light": {**_LIGHT, "direction": lamp.tolist()},
        }
        return _core.render(
            [s.mesh for s in solids],
            np.array([s.world_from_mesh for s in solids]),
            np.array([to_rgb(s.color) for s in solids]),
            [s.casts_shadow for s in solids],
            None if hand is None else (hand.hand, hand.world_from_hand, hand.preshape, *hand.angles()),
            self.lens.intrinsics,
            self.lens.world_from_camera,
            json.dumps(config),
            None,
        )

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which of the points (n, 3) no surface hides."""
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

    def lines(self, axes: Any, lines: ArrayLike, color: str, *, width: float = 1.0, hidden: float = 0.25) -> None:
        """Draw segments (n, 2, 3); where a surface hides them, with the opacity `hidden`."""
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
                axes.add_collection(LineCollection(runs, colors=color, linewidths=width, alpha=alpha, capstyle=caps))


def pixels(axes: Any) -> tuple[int, int]:
    """Count the columns and rows that axes cover on their figure."""
    box = axes.get_window_extent()
    return round(box.width), round(box.height)


def write(figure: Figure, path: Path, *, palette: bool = True) -> None:
    """Write a figure; a PNG with a palette of 256 colours, which is a third of the size, or with all its colours."""
    if path.suffix.lower() != ".png" or not palette:
        figure.savefig(path)
        return
    raw = BytesIO()
    figure.savefig(raw, format="png")
    with Image.open(raw) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def _direction(azimuth: float, elevation: float) -> Floats:
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


@cache
def _ground() -> Mesh:
    """Make a slab with its upper side at z = 0."""
    middle, half = np.array([0.0, 0.0, -0.5]), np.array([_GROUND, _GROUND, 0.5])
    corners = Box(middle, np.eye(3), half).corners()
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return mesh_from_arrays(corners, np.array(faces), name="ground")


def _runs(line: Floats, mask: NDArray[np.bool_]) -> list[Floats]:
    """Cut a line at points (s + 1, 2) into the stretches whose steps (s,) are in the mask."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [line[start : stop + 1] for start, stop in zip(change[::2], change[1::2], strict=True)]
