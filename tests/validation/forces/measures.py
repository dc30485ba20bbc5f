"""Force-closure measures of contacts: how much disturbance they resist, without a simulation.

A contact presses with a normal force f >= 0 and tangential forces up to mu f, whose cone is replaced by a pyramid.
Lengths are divided by the contacts' mean distance from their middle, so that torques compare with forces and size does
not matter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import LinearConstraint, minimize
from scipy.spatial import ConvexHull

from validation.forces.config import PULLS, Array, Contact

__all__ = ["ferrari_canny", "residual", "wrenches"]

#: Edges of a pyramid.
EDGES = 8
#: Force of each pull in `residual`, as a share of the greatest normal force of a contact.
_PULL = 0.1


def wrenches(contacts: Sequence[Contact], friction: float = 1.0) -> Array:
    """Return the wrenches of unit normal forces along the edges of every pyramid.

    Parameters
    ----------
    contacts : sequence of Contact
        At least one.
    friction : float
        Factor on the coefficients of friction.

    Returns
    -------
    (n, 8, 6) float64
        Force and torque about the contacts' middle, without unit.
    """
    points = np.stack([contact.point for contact in contacts])
    arms = points - points.mean(axis=0)
    size = float(np.linalg.norm(arms, axis=1).mean())
    arms = arms / size if size > 0.0 else arms
    rows = []
    for contact, arm in zip(contacts, arms, strict=True):
        normal = contact.inward
        # Any two tangents will do; the axis least along the normal gives the first.
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        first /= np.linalg.norm(first)
        angles = 2.0 * np.pi * np.arange(EDGES) / EDGES
        around = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(normal, first))
        forces = normal + friction * contact.friction * around
        rows.append(np.concatenate([forces, np.cross(arm, forces)], axis=1))
    return np.stack(rows)


def ferrari_canny(contacts: Sequence[Contact], friction: float = 1.0) -> float:
    """Return Q1: the radius of the largest ball about the origin in the convex hull of `wrenches`; 0 without one.

    Source: Ferrari, Canny, "Planning optimal grasps", 1992.
    """
    if len(contacts) < 2:
        return 0.0
    points = wrenches(contacts, friction).reshape(-1, 6)
    if np.linalg.matrix_rank(points - points[0], tol=1e-9) < points.shape[1]:
        # All wrenches are in a hyperplane: forces across it are not resisted.
        return 0.0
    # Two contacts may coincide. Qhull fails on wrenches that nearly do, unless it may move them ("joggle", by 1e-11).
    hull = ConvexHull(points, qhull_options="QJ")
    # Facets are n x + d <= 0 inside, with unit normals.
    return max(0.0, float(-hull.equations[:, -1].max()))


def residual(contacts: Sequence[Contact], friction: float = 1.0) -> float:
    """Return the mean, over six pulls, of the least wrench that remains when the contacts resist a pull.

    Every contact presses with at most 1, all together with at least 1, and a pull has 0.1. 0 means that all pulls can
    be resisted. NaN without contacts.

    As the benchmark's measure ``qp``, without torsional friction, and with torques by `wrenches`. Source: Chen, Ke,
    Wang, "BODex", 2025.
    """
    if not contacts:
        return float("nan")
    rows = wrenches(contacts, friction)
    count, edges = rows.shape[:2]
    matrix = rows.reshape(-1, 6).T
    sums = np.kron(np.eye(count), np.ones(edges))
    rows_of = np.vstack([sums, np.ones(count * edges)])
    limits = LinearConstraint(rows_of, [-np.inf] * count + [1.0], [1.0] * count + [np.inf])
    start = np.full(count * edges, 1.0 / (count * edges))
    left = []
    for pull in PULLS:
        wanted = np.concatenate([_PULL * pull, np.zeros(3)])
        solution = minimize(
            lambda x, wanted=wanted: _squared(matrix @ x + wanted),
            start,
            jac=lambda x, wanted=wanted: 2.0 * matrix.T @ (matrix @ x + wanted),
            bounds=[(0.0, 1.0)] * len(start),
            constraints=[limits],
            method="SLSQP",
            options={"maxiter": 200, "ftol": 1e-12},
        )
        left.append(float(np.linalg.norm(matrix @ solution.x + wanted)))
    return float(np.mean(left))


def _squared(vector: Array) -> float:
    return float(vector @ vector)
