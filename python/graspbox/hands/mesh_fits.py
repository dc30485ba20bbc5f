"""Boxes, cylinders and spheres in place of a mesh, chosen by the distance of their surface from that of the mesh.

Decompositions into one box and more are compared; each box may become the cylinder or the sphere inside it. A further
primitive must be worth its time in simulation: it must bring the surface nearer by a share of the mesh's size.
"""

import hashlib
import json
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict
from graspbox._common.files import write_text
from graspbox._common.rotations import poses_from
from graspbox._core import Mesh
from graspbox.configs import DecomposeConfig
from graspbox.hands.caching import cache_folder

__all__ = ["MeshFit", "MeshFits", "Primitive", "cached_fits", "chosen", "fit_mesh", "fits_of", "mesh_key"]

Array = NDArray[np.float64]

_LOG = logging.getLogger(__name__)
#: Changes with the method, so that cached fits of another one are not used.
_METHOD = "2"

#: Numbers of boxes that are tried.
_BOXES = (1, 2, 3, 4, 6, 8)
#: Points on the mesh, and on the primitives, at which distances are measured.
_SAMPLES, _PRIMITIVE_SAMPLES = 4000, 600
#: Points whose distances are measured at a time: so few that OpenBLAS starts no threads of its own beside ours.
_BLOCK = 16
#: Mean distance that is near enough, metres.
_NEAR = 1e-3
#: A further primitive must lower the mean distance by this share of the mesh's diagonal, times one of these factors:
#: the least one with which the primitives of all meshes of a hand are within the budget, if any is.
_WORTH, _FACTORS, _BUDGET = 0.005, (1.0, 1.5, 2.0, 3.0, 5.0, 10.0, float("inf")), 64
#: Fits without a better one after which no more primitives are tried.
_PATIENCE = 2
#: Share of the area below which a cut is worth trying: every cut that helps at all.
_AREA_GAIN = 0.98
#: Sides of a box that differ by less than this share are equal.
_EQUAL = 0.08
#: A surface deeper than this inside another primitive is not part of the union's, metres.
_COVERED = 5e-4


@dataclass(frozen=True, eq=False)
class Primitive:
    """One shape.

    Attributes
    ----------
    kind : {"box", "cylinder", "sphere"}
        Its kind.
    pose : (4, 4) float64
        ``mesh_from_shape``, metres; the axis of a cylinder is z.
    size : tuple of float
        As in a URDF, metres: the sides of a box; radius and length of a cylinder; the radius of a sphere.
    """

    kind: Literal["box", "cylinder", "sphere"]
    pose: Array
    size: tuple[float, ...]

    def outside(self, points: Array) -> Array:
        """Return the signed distance of points (n, 3) from the surface, metres; negative inside."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        if self.kind == "sphere":
            return np.asarray(np.linalg.norm(local, axis=1) - self.size[0])
        if self.kind == "cylinder":
            beyond = np.stack(
                [np.hypot(local[:, 0], local[:, 1]) - self.size[0], np.abs(local[:, 2]) - self.size[1] / 2]
            )
        else:
            beyond = (np.abs(local) - np.array(self.size) / 2).T
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=0) + np.minimum(beyond.max(axis=0), 0.0))

    def surface(self, count: int, rng: np.random.Generator) -> Array:
        """Return random points (count, 3) of its surface, uniform by area, metres."""
        unit = rng.normal(size=(count, 3))
        if self.kind == "sphere":
            local = self.size[0] * unit / np.linalg.norm(unit, axis=1)[:, None]
        elif self.kind == "cylinder":
            local = self._on_cylinder(count, rng)
        else:
            local = self._on_box(count, rng)
        return np.asarray(local @ self.pose[:3, :3].T + self.pose[:3, 3])

    def _on_cylinder(self, count: int, rng: np.random.Generator) -> Array:
        radius, length = self.size
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        on_side = rng.random(count) < length / (length + radius)
        out = np.where(on_side, radius, radius * np.sqrt(rng.random(count)))
        end = np.where(rng.random(count) < 0.5, -0.5, 0.5)
        height = length * np.where(on_side, rng.uniform(-0.5, 0.5, count), end)
        return np.stack([out * np.cos(angle), out * np.sin(angle), height], axis=1)

    def _on_box(self, count: int, rng: np.random.Generator) -> Array:
        half = np.array(self.size) / 2
        areas = np.prod(half) / half
        axis = rng.choice(3, count, p=areas / areas.sum())
        local = rng.uniform(-1.0, 1.0, (count, 3))
        local[np.arange(count), axis] = np.where(rng.random(count) < 0.5, -1.0, 1.0)
        return np.asarray(local * half)


@dataclass(frozen=True, eq=False)
class MeshFit:
    """Primitives for a mesh, and how well they fit.

    Attributes
    ----------
    primitives : tuple of Primitive
        The shapes.
    mean, most : float
        Mean and greatest distance between the surfaces of mesh and primitives, measured between random points of each,
        metres.
    """

    primitives: tuple[Primitive, ...]
    mean: float
    most: float


@dataclass(frozen=True, eq=False)
class MeshFits:
    """Fits of a mesh with more and more primitives, and the diagonal of the box around it, metres."""

    fits: tuple[MeshFit, ...]
    diagonal: float

    def best(self, factor: float) -> MeshFit:
        """Return the fit whose last primitives are worth their number."""
        if factor == float("inf"):
            return self.fits[0]
        price = factor * _WORTH * self.diagonal
        return min(self.fits, key=lambda fit: fit.mean + price * len(fit.primitives))


def fit_mesh(mesh: Mesh) -> MeshFit:
    """Fit primitives to a mesh; fits are cached in `graspbox.hands.cache_folder`.

    Raises
    ------
    PlanError
        If the mesh is flat.
    """
    return chosen([cached_fits(mesh_key(mesh), lambda: fits_of(mesh))])[0]


def mesh_key(mesh: Mesh) -> str:
    """Return the key of the fits of a mesh: its vertices and triangles."""
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()


def chosen(meshes: Sequence[MeshFits]) -> list[MeshFit]:
    """Return the fits of the meshes of a hand, with few primitives altogether."""
    for factor in _FACTORS:
        best = [each.best(factor) for each in meshes]
        if sum(len(fit.primitives) for fit in best) <= _BUDGET:
            break
    return best


def fits_of(mesh: Mesh) -> MeshFits:
    """Fit ever more primitives to a mesh, until they are near enough, or more do not help.

    Raises
    ------
    PlanError
        If the mesh is flat.
    """
    points = mesh.sample(_SAMPLES, 0)[0]
    fits = MeshFits((_rounded(_boxes(mesh, 1), points),), float(np.linalg.norm(np.ptp(points, axis=0))))
    tried, in_vain = 1, 0
    for most in _BOXES[1:]:
        if fits.fits[-1].mean <= _NEAR or in_vain == _PATIENCE:
            break
        boxes = _boxes(mesh, most)
        if len(boxes) > tried:
            tried = len(boxes)
            fits = replace(fits, fits=(*fits.fits, _rounded(boxes, points)))
            in_vain = 0 if fits.best(1.0) is fits.fits[-1] else in_vain + 1
    return fits


def cached_fits(key: str, make: Callable[[], MeshFits]) -> MeshFits:
    """Return the fits of a key from the cache, or make and cache them."""
    folder = cache_folder()
    if folder is None:
        return make()
    stored = folder / "hand_meshes" / f"{key}-{_METHOD}.json"
    if (known := _read(stored)) is not None:
        return known
    made = make()
    try:
        stored.parent.mkdir(parents=True, exist_ok=True)
        write_text(stored, _dump(made))
    except OSError as error:
        _LOG.warning("the fit of a mesh is not cached, and will be made again: %s", error)
    return made


def _dump(fits: MeshFits) -> str:
    rows = [
        {
            "mean": fit.mean,
            "most": fit.most,
            "primitives": [
                {"kind": one.kind, "pose": one.pose.tolist(), "size": list(one.size)} for one in fit.primitives
            ],
        }
        for fit in fits.fits
    ]
    return json.dumps({"diagonal": fits.diagonal, "fits": rows})


def _read(path: Path) -> MeshFits | None:
    """Read cached fits; None if there are none, or their file is damaged."""
    try:
        stored = json.loads(path.read_text())
        fits = [
            MeshFit(
                tuple(Primitive(p["kind"], np.array(p["pose"]), tuple(p["size"])) for p in row["primitives"]),
                float(row["mean"]),
                float(row["most"]),
            )
            for row in stored["fits"]
        ]
        return MeshFits(tuple(fits), float(stored["diagonal"])) if fits else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _rounded(boxes: tuple[Primitive, ...], points: Array) -> MeshFit:
    """Replace each box by the cylinder or sphere inside it where that is nearer to the mesh."""
    best = _measured(boxes, points)
    for number, box in enumerate(boxes):
        for other in _round(box):
            fit = _measured((*best.primitives[:number], other, *best.primitives[number + 1 :]), points)
            best = fit if fit.mean < best.mean else best
    return best


def _boxes(mesh: Mesh, most: int) -> tuple[Primitive, ...]:
    """Decompose a mesh into at most `most` boxes."""
    config = replace(DecomposeConfig(), max_boxes=most, min_volume=1e-9, area_gain=_AREA_GAIN)
    tree = _core.decompose(mesh, config_dict(config, DecomposeConfig))
    leaves = np.flatnonzero(tree["children"][:, 0] < 0)
    poses = poses_from(tree["center"][leaves], tree["axes"][leaves])
    sizes = (2.0 * tree["half_extents"][leaves]).tolist()
    return tuple(Primitive("box", pose, tuple(size)) for pose, size in zip(poses, sizes, strict=True))


def _round(box: Primitive) -> Iterator[Primitive]:
    """Make the cylinders and the sphere in a box whose sides are equal."""
    sides = np.array(box.size)
    for axis in range(3):
        others = np.delete(sides, axis)
        if np.ptp(others) <= _EQUAL * others.max():
            pose = box.pose.copy()
            # A rotation that makes this axis the third, and stays right-handed.
            pose[:3, :3] = np.roll(box.pose[:3, :3], 2 - axis, axis=1)
            yield Primitive("cylinder", pose, (float(others.mean()) / 2, float(sides[axis])))
    if np.ptp(sides) <= _EQUAL * sides.max():
        yield Primitive("sphere", box.pose, (float(sides.mean()) / 2,))


def _measured(primitives: Sequence[Primitive], points: Array) -> MeshFit:
    """Measure distances both ways: of the mesh's points from the primitives, and of their outer surface from it."""
    rng = np.random.default_rng(0)
    signed = np.stack([one.outside(points) for one in primitives])
    missed = np.abs(signed.min(axis=0))
    parts = []
    for number, one in enumerate(primitives):
        own = one.surface(_PRIMITIVE_SAMPLES, rng)
        others = [other.outside(own) for index, other in enumerate(primitives) if index != number]
        parts.append(own[np.min(others, axis=0) > -_COVERED] if others else own)
    nearest = _distances(np.concatenate(parts), points)
    mean = 0.5 * (float(missed.mean()) + float(nearest.mean()))
    return MeshFit(tuple(primitives), mean, max(float(missed.max()), float(nearest.max())))


def _distances(of: Array, to: Array) -> Array:
    """Return the distance of each point (n, 3) from the nearest of others (m, 3)."""
    # |a - b|^2 = |a|^2 + [a, 1] . [-2 b, |b|^2], in blocks that stay in a processor's cache.
    others = np.concatenate([-2.0 * to, (to**2).sum(axis=1)[:, None]], axis=1).T
    ones = np.concatenate([of, np.ones((len(of), 1))], axis=1)
    least = [(ones[first : first + _BLOCK] @ others).min(axis=1) for first in range(0, len(of), _BLOCK)]
    return np.asarray(np.sqrt(np.maximum((of**2).sum(axis=1) + np.concatenate(least), 0.0)))
