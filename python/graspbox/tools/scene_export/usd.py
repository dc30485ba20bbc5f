"""USD stages of scenes and objects: metres, kilograms, z up, with the physics of UsdPhysics (extra ``usd``).

| prim | contents |
|---|---|
| ``/World/physics`` | gravity |
| ``/World/table`` | static collider, its upper face at z = 0 |
| ``/World/object`` | rigid body: mass properties, visual mesh, convex parts as colliders; several: ``object_0``, ... |
| ``/World/wall_0``, ... | static colliders |
| ``/World/hand`` | articulation, if there is a hand: see `usd_hand` |
| ``/World/materials`` | one physics material per friction factor |

A stage of a single object has the same prim, with its materials below it, as default prim.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdPhysics, Vt

from graspbox.configs import PhysicsConfig
from graspbox.hands.description import Array
from graspbox.tools.scene_export.contents import (
    TABLE_SIDE,
    TABLE_THICKNESS,
    ObjectData,
    SceneData,
    object_names,
    wall_names,
)
from graspbox.tools.scene_export.mesh_files import hull_faces
from graspbox.tools.scene_export.usd_hand import add_hand
from graspbox.tools.scene_export.usd_prims import Materials, add_collision, add_mass, color, set_pose, vec

__all__ = ["object_stage", "scene_stage"]

#: Root of a scene.
WORLD = "/World"
_OBJECT_COLOR, _TABLE_COLOR, _WALL_COLOR = (0.85, 0.55, 0.25), (0.9, 0.87, 0.8), (0.62, 0.6, 0.56)


def _add_mesh(stage: Usd.Stage, path: str, points: NDArray[Any], faces: NDArray[Any]) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    corners = np.ascontiguousarray(points, dtype=np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(corners))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, dtype=np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces, dtype=np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([corners.min(axis=0), corners.max(axis=0)])))
    return mesh


def _new_stage(comments: Sequence[str]) -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory(".usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.GetRootLayer().documentation = "\n".join(comments)
    return stage


def _add_object(stage: Usd.Stage, path: str, item: ObjectData, pose: Array, friction: float) -> None:
    """Add the object: a rigid body with its visual mesh, and its convex parts as hidden colliders."""
    body = UsdGeom.Xform.Define(stage, path)
    set_pose(body, pose)
    body.GetPrim().SetDisplayName(item.name)
    add_mass(body.GetPrim(), item.mass, item.center, item.inertia)
    materials = Materials(stage, f"{path}/materials")
    if item.visual is not None:
        color(_add_mesh(stage, f"{path}/visual", item.visual.vertices, item.visual.faces), _OBJECT_COLOR)
    UsdGeom.Scope.Define(stage, f"{path}/parts")
    for index, points in enumerate(item.parts):
        part = _add_mesh(stage, f"{path}/parts/part_{index}", points, hull_faces(np.asarray(points)))
        if item.visual is not None:
            part.CreatePurposeAttr(UsdGeom.Tokens.guide)
        add_collision(part.GetPrim(), materials, friction)
        UsdPhysics.MeshCollisionAPI.Apply(part.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)


def scene_stage(data: SceneData, comments: Sequence[str]) -> str:
    """Return a scene as a USD text layer (``.usda``)."""
    stage, friction = _new_stage(comments), data.physics.friction
    world = UsdGeom.Xform.Define(stage, WORLD)
    stage.SetDefaultPrim(world.GetPrim())
    scene = UsdPhysics.Scene.Define(stage, f"{WORLD}/physics")
    scene.CreateGravityDirectionAttr(vec((0, 0, -1)))
    scene.CreateGravityMagnitudeAttr(float(data.physics.gravity))
    materials = Materials(stage, f"{WORLD}/materials")

    def add_box(name: str, pose: Array, sides: Sequence[float], rgb: Sequence[float]) -> None:
        box = UsdGeom.Cube.Define(stage, f"{WORLD}/{name}")
        box.CreateSizeAttr(1.0)
        box.CreateExtentAttr(Vt.Vec3fArray([Gf.Vec3f(-0.5), Gf.Vec3f(0.5)]))
        set_pose(box, pose, sides)
        color(box, rgb)
        add_collision(box.GetPrim(), materials, friction.table)

    below = np.eye(4)
    below[2, 3] = -TABLE_THICKNESS / 2
    add_box("table", below, (TABLE_SIDE, TABLE_SIDE, TABLE_THICKNESS), _TABLE_COLOR)
    for name, wall in zip(wall_names(len(data.walls)), data.walls, strict=True):
        add_box(name, wall.world_from_wall, [2.0 * half for half in wall.half_extents], _WALL_COLOR)
    for name, item in zip(object_names(len(data.objects)), data.objects, strict=True):
        _add_object(stage, f"{WORLD}/{name}", item, item.start, friction.object)
    if data.start is not None:
        add_hand(stage, f"{WORLD}/hand", data.start, materials)
    return str(stage.GetRootLayer().ExportToString())


def object_stage(item: ObjectData, physics: PhysicsConfig, comments: Sequence[str]) -> str:
    """Return a single object as a USD text layer (``.usda``), to be referenced at any pose."""
    stage = _new_stage(comments)
    _add_object(stage, "/object", item, np.eye(4), physics.friction.object)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/object"))
    return str(stage.GetRootLayer().ExportToString())
