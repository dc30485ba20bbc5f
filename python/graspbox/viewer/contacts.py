"""Contacts of hand and object in a recorded trial: points by geometry, forces by balance, tactile values from both.

A trace records poses, joints and the sum of the normal forces, not single contacts. Each collision shape of the hand
that is nearer than `MARGIN` to the object has one contact, in the middle of the part of the surface that is so near.
The forces are those within the friction cones that best balance the weight of the object, once the table does not carry
it, and whose normal parts add up to the recorded sum. They are estimates: the page says so.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.hands import Hand
from graspbox.meshes import Mesh
from graspbox.outcomes import Trace
from graspbox.viewer.geometry import Floats, place
from graspbox.viewer.links import HandLinks

__all__ = ["MARGIN", "Contacts", "estimate", "tactile"]

#: Distance at which surfaces count as touching, metres: simulated contacts penetrate by less.
MARGIN = 0.0015
#: Points of the object's surface.
_POINTS = 4000
#: The table carries the object until it has risen by this, metres.
_RISEN = 0.001
_GRAVITY = 9.81
#: Steps of the projected gradient, and weight of the smallest forces.
_STEPS, _RIDGE = 80, 1e-4
#: Reach of a tactile sensor, metres, as in the core.
_REACH = 0.008


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts at one sample of a trace; n may be 0.

    Attributes
    ----------
    points : (n, 3) float64
        World frame, metres.
    normals : (n, 3) float64
        Unit vectors into the object, world frame.
    forces : (n, 3) float64
        Estimated forces on the object, world frame, N.
    shapes : (n,) int64
        Index of the hand's collision shape.
    """

    points: Floats
    normals: Floats
    forces: Floats
    shapes: NDArray[np.int64]


class Surface:
    """Points and normals of an object's surface, object frame."""

    def __init__(self, mesh: Mesh) -> None:
        self.points, self.normals = mesh.sample(_POINTS, 0)
        self.mass, self.center = mesh.mass, mesh.center_of_mass
        low, high = mesh.bounds
        self.size = float(np.linalg.norm(high - low))


def estimate(surface: Surface, hand: Hand, links: HandLinks, trace: Trace, sample: int, mass: float) -> Contacts:
    """Estimate the contacts at a sample of a trace.

    Parameters
    ----------
    surface : Surface
        The object.
    hand, links : Hand, HandLinks
        The hand.
    trace : Trace
        The recording.
    sample : int
        Index of the sample.
    mass : float
        Of the object, kg.
    """
    total = float(trace.hand_force[sample])
    none = np.zeros((0, 3))
    if total <= 0.0:
        return Contacts(none, none, none, np.zeros(0, dtype=np.int64))
    world_from_hand, world_from_object = trace.world_from_hand[sample], trace.world_from_object[sample]
    frames, halves, _, _ = hand.shapes(np.ascontiguousarray(trace.joints[sample]))
    points = place(surface.points, world_from_object)
    normals = surface.normals @ world_from_object[:3, :3].T
    near = _near(points, world_from_hand @ frames, halves)
    found = [shape for shape in range(len(halves)) if near[shape].any()]
    if not found:
        return Contacts(none, none, none, np.zeros(0, dtype=np.int64))
    at = np.array([points[near[shape]].mean(axis=0) for shape in found])
    into = -np.array([normals[near[shape]].mean(axis=0) for shape in found])
    into /= np.maximum(np.linalg.norm(into, axis=1, keepdims=True), 1e-9)
    center = place(surface.center, world_from_object)
    rise = world_from_object[2, 3] - trace.world_from_object[0, 2, 3]
    weight = mass * _GRAVITY if rise > _RISEN else None
    forces = _balance(at - center, into, links.friction[found], total, weight, surface.size)
    return Contacts(at, into, forces, np.array(found, dtype=np.int64))


def _near(points: Floats, frames: Floats, halves: Floats) -> NDArray[np.bool_]:
    """Tell which points (k, 3) are within `MARGIN` of each box: (n, k)."""
    reach = np.linalg.norm(halves, axis=1) + MARGIN
    near = np.zeros((len(halves), len(points)), dtype=np.bool_)
    for shape, (frame, half) in enumerate(zip(frames, halves, strict=True)):
        offset = points - frame[:3, 3]
        close = np.flatnonzero(np.einsum("ij,ij->i", offset, offset) < reach[shape] ** 2)
        local = np.abs(offset[close] @ frame[:3, :3])
        near[shape, close] = (local <= half + MARGIN).all(axis=1)
    return near


def _balance(
    arms: Floats, normals: Floats, friction: Floats, total: float, weight: float | None, size: float
) -> Floats:
    """Return forces (n, 3) within friction cones that balance a weight and whose normal parts add up to `total`.

    Without a weight the table carries the object: vertical forces need no balance.
    """
    count = len(arms)
    rows = np.zeros((7, count, 3))
    for axis in range(3):
        rows[axis, :, axis] = 1.0
    for index in range(count):
        x, y, z = arms[index] / (0.5 * size)
        rows[3:6, index] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    rows[6] = normals
    wanted = np.array([0.0, 0.0, weight or 0.0, 0.0, 0.0, 0.0, total])
    if weight is None:
        rows[2:6] = 0.0
    matrix = rows.reshape(7, 3 * count)
    square = matrix.T @ matrix + _RIDGE * np.eye(3 * count)
    pull = matrix.T @ wanted
    step = 1.0 / float(np.linalg.eigvalsh(square)[-1])
    force = (total / count) * normals
    ahead, momentum = force, 1.0
    for _ in range(_STEPS):
        moved = ahead - step * (ahead.ravel() @ square - pull).reshape(count, 3)
        following = _in_cone(moved, normals, friction)
        grown = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
        ahead = following + (momentum - 1.0) / grown * (following - force)
        force, momentum = following, grown
    pressed = float(np.sum(force * normals))
    return force * (total / pressed) if pressed > 1e-6 * total else (total / count) * normals


def _in_cone(forces: Floats, normals: Floats, friction: Floats) -> Floats:
    """Project forces (n, 3) onto their friction cones."""
    along = np.einsum("ij,ij->i", forces, normals)
    across = forces - along[:, None] * normals
    slide = np.sqrt(np.einsum("ij,ij->i", across, across))
    inside = slide <= friction * along
    behind = friction * slide <= -along
    pressed = (along + friction * slide) / (1.0 + friction**2)
    onto = pressed[:, None] * normals + (friction * pressed / np.maximum(slide, 1e-12))[:, None] * across
    projected: Floats = np.where(inside[:, None], forces, np.where(behind[:, None], 0.0, onto))
    return projected


def tactile(found: Contacts, points: Floats, normals: Floats) -> Floats:
    """Share the normal forces of contacts among tactile sensors, by the core's rule: distance and direction.

    Parameters
    ----------
    found : Contacts
        The contacts.
    points, normals : (s, 3) float64
        Sensors, world frame, and their outward normals.

    Returns
    -------
    (s,) float64
        Estimated force on each, N.
    """
    values = np.zeros(len(points))
    for point, normal, force in zip(found.points, found.normals, found.forces, strict=True):
        # The force on the link points into it, against the sensor's normal.
        facing = np.maximum(normals @ normal, 0.0)
        weights = facing * np.maximum(1.0 - np.linalg.norm(points - point, axis=1) / _REACH, 0.0)
        if (sum_ := float(weights.sum())) > 0.0:
            values += float(force @ normal) * weights / max(sum_, 1.0)
    return values
