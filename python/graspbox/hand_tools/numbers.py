"""Units, limits, masses and inertias: numbers that no hand has."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspbox.exchange import frame_from_hand
from graspbox.hand_tools.findings import CheckedHand, Finding
from graspbox.hand_tools.urdf import Tree

__all__ = ["inertias", "limits", "sizes", "units"]

Floats = NDArray[np.float64]

#: Longest offset of a joint and side of a shape, metres; larger numbers are probably millimetres.
_LONGEST = 1.0
#: Range of masses of a hand, kg.
_MASSES = (0.01, 20.0)
#: Least range of a joint, rad and m.
_LEAST_RANGE = {"rad": 1e-3, "m": 1e-4}
#: Range of densities of a body relative to the boxes around its shapes, kg/m3: foam to tungsten.
_DENSITIES = (200.0, 20000.0)
#: Least radius of gyration as a share of the longest side of a body; a thin rod has 0.29, a ball 0.32.
_LEAST_GYRATION = 0.05
#: Room around a body for its centre of mass, as a share of its longest side.
_ROOM = 0.25


def units(tree: Tree) -> Iterator[Finding]:
    """Find lengths in millimetres, angles in degrees and masses in grams, in the URDF alone."""
    for joint in tree.joints:
        offset = float(np.linalg.norm(joint.parent_from_joint[:3, 3]))
        if offset > _LONGEST:
            yield Finding(
                "error",
                "units",
                f"joint {joint.name}",
                f"{offset:.4g} m",
                "its origin is farther than 1 m from its parent: lengths are probably in millimetres",
                "give all lengths of the URDF in metres: origins, sizes and limits of prismatic joints",
            )
        largest = max(map(abs, joint.limits))
        if joint.kind == "revolute" and largest > 2 * np.pi + 1e-3:
            yield Finding(
                "warning",
                "units",
                f"joint {joint.name}",
                f"{largest:.4g} rad",
                "a limit exceeds a full turn: angles are probably in degrees",
                "give limits in radians: degrees times 0.01745",
            )
    total = sum(link.mass for link in tree.links)
    if not _MASSES[0] <= total <= _MASSES[1]:
        heavy = total > _MASSES[1]
        yield Finding(
            "error" if heavy else "warning",
            "units",
            "mass of all links",
            f"{total:.4g} kg",
            "masses are probably in grams"
            if heavy
            else "no hand is that light, and light links make the simulation stiff",
            "give masses in kilograms, and inertias in kg m2",
        )
    else:
        yield Finding(
            "note", "mass", "all links", f"{total:.3g} kg", "the hand's own mass; compare it with the maker's"
        )


def sizes(checked: CheckedHand) -> Iterator[Finding]:
    """Find collision shapes that are larger than any hand."""
    sides = 2 * np.asarray(checked.hand.shapes(checked.start)[1]).max(axis=1)
    for name, side in zip(checked.shape_names, sides, strict=True):
        if side > _LONGEST:
            yield Finding(
                "error",
                "units",
                f"shape {name}",
                f"{side:.4g} m",
                "a side of it is longer than 1 m: sizes are probably in millimetres",
                "give sizes in metres, or the mesh a scale of 0.001",
            )


def limits(checked: CheckedHand) -> Iterator[Finding]:
    """Find joints without a range."""
    for joint in checked.tree.moving:
        low, high = joint.limits
        if high - low < _LEAST_RANGE[joint.unit]:
            yield Finding(
                "warning",
                "limits",
                f"joint {joint.name}",
                f"[{low:.4g}, {high:.4g}] {joint.unit}",
                "its range is next to nothing, so the joint costs time in simulation and moves nothing",
                "correct its limits, or make it fixed",
            )


def inertias(checked: CheckedHand) -> Iterator[Finding]:
    """Find masses and inertias that do not suit the size of the collision shapes, per rigid body."""
    shapes, halves, _, _ = checked.hand.shapes(checked.start)
    poses = checked.tree.link_poses(checked.start)
    base_from_hand = frame_from_hand(checked.hand, "base")
    for row in range(-1, len(checked.tree.moving)):
        own = np.flatnonzero(checked.bodies == row)
        mass, center, inertia = _body(checked.tree, poses, row)
        if not len(own) or mass <= 0:
            continue
        name = f"link {checked.tree.body_name(row)}"
        corners = _corners(base_from_hand @ shapes[own], halves[own])
        yield from _mass_findings(name, mass, float(8 * halves[own].prod(axis=1).sum()))
        yield from _moment_findings(name, mass, center, inertia, corners)


def _body(tree: Tree, poses: Floats, row: int) -> tuple[float, Floats, Floats]:
    """Return mass, centre of mass (3,) and inertia about it (3, 3) of a rigid body, along the axes of the base."""
    parts = [index for index, body in enumerate(tree.body_of) if body == row]
    masses = np.array([tree.links[index].mass for index in parts])
    centers = np.array([(poses[index] @ np.append(tree.links[index].center, 1.0))[:3] for index in parts])
    mass = float(masses.sum())
    center = masses @ centers / mass if mass > 0 else centers.mean(axis=0)
    inertia = np.zeros((3, 3))
    for index, part_mass, at in zip(parts, masses, centers, strict=True):
        turn, away = poses[index][:3, :3], at - center
        inertia += turn @ tree.links[index].inertia @ turn.T
        inertia += part_mass * (float(away @ away) * np.eye(3) - np.outer(away, away))
    return mass, center, inertia


def _corners(poses: Floats, halves: Floats) -> Floats:
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    placed = np.einsum("nij,nkj->nki", poses[:, :3, :3], signs[None] * halves[:, None]) + poses[:, None, :3, 3]
    return np.asarray(placed.reshape(-1, 3))


def _mass_findings(name: str, mass: float, volume: float) -> Iterator[Finding]:
    density = mass / volume
    if not _DENSITIES[0] <= density <= _DENSITIES[1]:
        light = density < _DENSITIES[0]
        yield Finding(
            "warning",
            "inertia",
            name,
            f"{density:.3g} kg/m3",
            f"its mass of {mass:.3g} kg is too {'small' if light else 'large'} for boxes of {volume * 1e6:.3g} cm3, "
            "so contacts move it too easily or hardly at all",
            "correct the mass, or the sizes of the shapes",
        )


def _moment_findings(name: str, mass: float, center: Floats, inertia: Floats, corners: Floats) -> Iterator[Finding]:
    low, high = corners.min(axis=0), corners.max(axis=0)
    longest = float((high - low).max())
    outside = float(np.maximum(np.maximum(low - center, center - high), 0.0).max())
    if outside > _ROOM * longest:
        yield Finding(
            "warning",
            "inertia",
            name,
            f"{outside * 1e3:.3g} mm",
            "its centre of mass is that far outside its collision boxes, so it swings like a pendulum",
            "correct the origin of its inertial, which is in the link's frame",
        )
    moments = np.linalg.eigvalsh(inertia)
    gyration = float(np.sqrt(max(moments[-1], 0.0) / mass))
    farthest = float(np.linalg.norm(corners - (low + high) / 2, axis=1).max()) + outside
    if gyration > farthest or gyration < _LEAST_GYRATION * longest:
        large = gyration > farthest
        yield Finding(
            "warning",
            "inertia",
            name,
            f"{moments[-1]:.3g} kg m2",
            f"its inertia is that of a mass {gyration * 1e3:.3g} mm from the axis, but its boxes are "
            f"{longest * 1e3:.3g} mm long: the joint would {'hardly accelerate' if large else 'need tiny steps'}",
            "compute it for a uniform box: mass / 12 times the sum of the squares of two sides, in kg m2",
        )
