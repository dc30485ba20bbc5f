"""Scenes of training data, as text: what a trial stores, so that its scene can be rendered again.

A single object is named by an object set that holds only this object. The text of a scene of several is JSON: a list of
objects with ``source`` (such a set), ``scale`` and ``pose`` (position in metres, then quaternion w, x, y, z), and of
walls with ``half_extents`` (metres) and ``pose``.
"""

import json
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._common.rotations import quaternion_from_rotation, rotation_from_quaternion
from graspbox._core import Mesh
from graspbox.learn.models.scenes import PlacedObjects
from graspbox.meshes import Surroundings
from graspbox.simulation.layouts import scaled

__all__ = ["is_scene", "place", "read_scene", "text_of", "write_scene"]

#: Meshes that are kept, about 1 MB each.
_MESHES = 1024


def is_scene(source: str) -> bool:
    """Whether a source is the text of a scene, not an object set."""
    return source.startswith("[")


def write_scene(placed: Surroundings, sources: Sequence[str], scales: Sequence[float]) -> str:
    """Write a scene as text; `sources` and `scales` are those of its objects."""
    walls = placed.world_from_walls, placed.wall_half_extents
    return text_of(sources, scales, placed.world_from_objects, *walls)


def text_of(
    sources: Sequence[str],
    scales: Sequence[float],
    world_from_objects: NDArray[np.float64],
    world_from_walls: NDArray[np.float64],
    wall_half_extents: NDArray[np.float64],
) -> str:
    """Write k objects with their poses (k, 4, 4), and w walls with poses (w, 4, 4) and half extents (w, 3), as text."""
    rows: list[dict[str, Any]] = [
        {"source": source, "scale": float(f"{scale:.9g}"), "pose": pose}
        for source, scale, pose in zip(sources, scales, _pose_rows(world_from_objects), strict=True)
    ]
    sides, walls = wall_half_extents.round(6).tolist(), _pose_rows(world_from_walls)
    rows += [{"half_extents": half, "pose": pose} for half, pose in zip(sides, walls, strict=True)]
    return json.dumps(rows, separators=(",", ":"))


def read_scene(text: str) -> PlacedObjects:
    """Load the objects and walls of a scene that was written as text."""
    rows = json.loads(text)
    objects = [row for row in rows if "source" in row]
    walls = [row for row in rows if "source" not in row]
    meshes = tuple(_mesh(row["source"], row["scale"]) for row in objects)
    sides = np.array([row["half_extents"] for row in walls], dtype=np.float64).reshape(-1, 3)
    return PlacedObjects(meshes, _poses(objects), _poses(walls), sides)


def place(source: str, world_from_object: NDArray[np.float64]) -> PlacedObjects:
    """Load a scene: the object of a set at its pose (4, 4), or the objects and walls of a text."""
    if is_scene(source):
        return read_scene(source)
    return PlacedObjects((_mesh(source, 1.0),), world_from_object[None])


def _pose_rows(poses: NDArray[np.float64]) -> list[list[float]]:
    """Turn poses (k, 4, 4) into rows of 7 numbers, to a micrometre and a millionth of a radian."""
    turns = quaternion_from_rotation(poses[:, :3, :3])
    return cast("list[list[float]]", np.concatenate([poses[:, :3, 3], turns], axis=1).round(7).tolist())


def _poses(rows: Sequence[dict[str, Any]]) -> NDArray[np.float64]:
    """Read the poses (k, 4, 4) of rows."""
    numbers = np.array([row["pose"] for row in rows], dtype=np.float64).reshape(-1, 7)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation_from_quaternion(numbers[:, 3:]), numbers[:, :3]
    return poses


@lru_cache(_MESHES)
def _mesh(source: str, scale: float) -> Mesh:
    return scaled(object_sets.load(source)[0], scale).load()
