"""Units, limits, masses and inertias: numbers that no hand has."""

from collections.abc import Iterator, Sequence

import numpy as np

from graspbox.hand_tools.bodies import Floats
from graspbox.hand_tools.findings import CheckedHand, Finding
from graspbox.hands.description import BASE, Link
from graspbox.hands.geometry import box_corners, combined_mass

__all__ = ["inertias", "limits", "sizes", "units"]

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


def units(links: Sequence[Link]) -> Iterator[Finding]:
    """Find lengths in millimetres, angles in degrees and masses in grams, in the URDF only."""
    for link in links[BASE + 1 :]:
        offset = float(np.linalg.norm(link.parent_from_link[:3, 3]))
        if offset > _LONGEST:
            message = "its origin is farther than 1 m from its parent: lengths are probably in millimetres"
            remedy = "state all lengths of the URDF in metres: origins, sizes and limits of prismatic joints"
            yield Finding("error", "units", f"joint {link.joint}", f"{offset:.4g} m", message, remedy)
        largest = max(map(abs, link.limits))
        if link.kind == "revolute" and largest > 2 * np.pi + 1e-3:
            message = "a limit exceeds a full turn: angles are probably in degrees"
            remedy = "state limits in radians: degrees times 0.01745"
            yield Finding("warning", "units", f"joint {link.joint}", f"{largest:.4g} rad", message, remedy)
    total = sum(link.mass for link in links)
    remedy = "state masses in kilograms, and inertias in kg m2"
    if total > _MASSES[1]:
        message = "masses are probably in grams"
        yield Finding("error", "units", "mass of all links", f"{total:.4g} kg", message, remedy)
    elif total < _MASSES[0]:
        message = "no hand is that light, and light links make the simulation stiff"
        yield Finding("warning", "units", "mass of all links", f"{total:.4g} kg", message, remedy)
    else:
        message = "the hand's own mass; compare it with the maker's"
        yield Finding("note", "mass", "all links", f"{total:.3g} kg", message)


def sizes(checked: CheckedHand) -> Iterator[Finding]:
    """Find collision shapes that are larger than any hand."""
    sides = 2 * checked.boxes(checked.start)[1].max(axis=1)
    for name, side in zip(checked.shape_names, sides, strict=True):
        if side > _LONGEST:
            message = "a side of it is longer than 1 m: sizes are probably in millimetres"
            remedy = "state sizes in metres, or set the scale of the mesh to 0.001"
            yield Finding("error", "units", f"shape {name}", f"{side:.4g} m", message, remedy)


def limits(checked: CheckedHand) -> Iterator[Finding]:
    """Find joints without a range."""
    for link in checked.described.moving:
        low, high = link.limits
        if high - low < _LEAST_RANGE[link.unit]:
            value = f"[{low:.4g}, {high:.4g}] {link.unit}"
            message = "its range is next to nothing, so the joint costs time in simulation and moves nothing"
            remedy = "correct its limits, or make it fixed"
            yield Finding("warning", "limits", f"joint {link.joint}", value, message, remedy)


def inertias(checked: CheckedHand) -> Iterator[Finding]:
    """Find masses and inertias that do not suit the size of the collision shapes, per rigid body."""
    shapes, halves = checked.boxes(checked.start)
    described = checked.described
    poses = described.base_from_hand @ checked.hand.link_frames(checked.start)
    for body in range(-1, len(described.moving)):
        own = checked.bodies == body
        mass, center, inertia = combined_mass(
            (link.mass, (pose @ np.append(link.center, 1.0))[:3], pose[:3, :3] @ link.inertia @ pose[:3, :3].T)
            for link, pose, carrier in zip(described.links, poses, described.carriers, strict=True)
            if carrier == body
        )
        if own.any() and mass > 0:
            name = f"link {(described.links[BASE] if body < 0 else described.moving[body]).name}"
            yield from _mass_findings(name, mass, float(8 * halves[own].prod(axis=1).sum()))
            corners = box_corners(described.base_from_hand @ shapes[own], halves[own])
            yield from _moment_findings(name, mass, center, inertia, corners)


def _mass_findings(name: str, mass: float, volume: float) -> Iterator[Finding]:
    density = mass / volume
    if not _DENSITIES[0] <= density <= _DENSITIES[1]:
        size = "small" if density < _DENSITIES[0] else "large"
        message = (
            f"its mass of {mass:.3g} kg is too {size} for boxes of {volume * 1e6:.3g} cm3, "
            "so contacts move it too easily or hardly at all"
        )
        remedy = "correct the mass, or the sizes of the shapes"
        yield Finding("warning", "inertia", name, f"{density:.3g} kg/m3", message, remedy)


def _moment_findings(name: str, mass: float, center: Floats, inertia: Floats, corners: Floats) -> Iterator[Finding]:
    low, high = corners.min(axis=0), corners.max(axis=0)
    longest = float((high - low).max())
    outside = float(np.maximum(np.maximum(low - center, center - high), 0.0).max())
    if outside > _ROOM * longest:
        message = "its centre of mass is that far outside its collision boxes, so it swings like a pendulum"
        remedy = "correct the origin of its inertial, which is in the link's frame"
        yield Finding("warning", "inertia", name, f"{outside * 1e3:.3g} mm", message, remedy)
    moments = np.linalg.eigvalsh(inertia)
    gyration = float(np.sqrt(max(moments[-1], 0.0) / mass))
    farthest = float(np.linalg.norm(corners - (low + high) / 2, axis=1).max()) + outside
    if gyration > farthest or gyration < _LEAST_GYRATION * longest:
        effect = "hardly accelerate" if gyration > farthest else "need tiny steps"
        message = (
            f"its inertia is that of a mass {gyration * 1e3:.3g} mm from the axis, but its boxes are "
            f"{longest * 1e3:.3g} mm long: the joint would {effect}"
        )
        remedy = "compute it for a uniform box: mass / 12 times the sum of the squares of two sides, in kg m2"
        yield Finding("warning", "inertia", name, f"{moments[-1]:.3g} kg m2", message, remedy)
