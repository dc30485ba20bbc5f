"""Prims of USD that object, table and hand have in common: transforms, mass properties, colliders with friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt

from graspbox.hands.description import Array
from graspbox.tools.scene_export.contents import quaternion

__all__ = ["Materials", "add_collision", "add_mass", "color", "quat", "set_pose", "vec"]


def vec(values: Sequence[float] | Array) -> Gf.Vec3f:
    """Return three numbers as Gf.Vec3f."""
    return Gf.Vec3f(*map(float, values))


def color(prim: UsdGeom.Gprim, rgb: Sequence[float]) -> None:
    """Set the colour of a prim."""
    prim.CreateDisplayColorAttr(Vt.Vec3fArray([vec(rgb)]))


def quat(rotation: Array, kind: Any = None) -> Any:
    """Return a rotation (3, 3) as Gf.Quatf, or as another type of quaternion."""
    w, x, y, z = (float(v) for v in quaternion(rotation))
    return (kind or Gf.Quatf)(w, x, y, z)


def set_pose(prim: UsdGeom.Xformable, pose: Array, scale: Sequence[float] | None = None) -> None:
    """Set the transform of a prim: translation, orientation and scale, in double precision."""
    prim.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*map(float, pose[:3, 3])))
    prim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(quat(pose[:3, :3], Gf.Quatd))
    if scale is not None:
        prim.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*map(float, scale)))


def add_mass(prim: Usd.Prim, mass: float, center: Array, inertia: Array) -> None:
    """Make a prim a rigid body with its mass, centre of mass and principal moments of inertia."""
    UsdPhysics.RigidBodyAPI.Apply(prim)
    api = UsdPhysics.MassAPI.Apply(prim)
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] = -axes[:, 2]
    api.CreateMassAttr(float(mass))
    api.CreateCenterOfMassAttr(vec(center))
    api.CreateDiagonalInertiaAttr(vec(moments))
    api.CreatePrincipalAxesAttr(quat(axes))


class Materials:
    """Physics materials of a stage, one per friction factor."""

    def __init__(self, stage: Usd.Stage, path: str):
        self._stage, self._path = stage, path
        self._made: dict[float, UsdShade.Material] = {}
        UsdGeom.Scope.Define(stage, path)

    def bind(self, prim: Usd.Prim, friction: float) -> None:
        """Bind the physics material of a friction factor to a collider."""
        if friction not in self._made:
            self._made[friction] = self._make(friction)
        api = UsdShade.MaterialBindingAPI.Apply(prim)
        api.Bind(self._made[friction], UsdShade.Tokens.weakerThanDescendants, "physics")

    def _make(self, friction: float) -> UsdShade.Material:
        material = UsdShade.Material.Define(self._stage, f"{self._path}/friction_{len(self._made)}")
        prim = material.GetPrim()
        api = UsdPhysics.MaterialAPI.Apply(prim)
        api.CreateStaticFrictionAttr(float(friction))
        api.CreateDynamicFrictionAttr(float(friction))
        api.CreateRestitutionAttr(0.0)
        # Read by PhysX: the coefficient of a pair is the product of both factors.
        prim.AddAppliedSchema("PhysxMaterialAPI")
        combine = prim.CreateAttribute("physxMaterial:frictionCombineMode", Sdf.ValueTypeNames.Token, custom=False)
        combine.Set("multiply")
        return material


def add_collision(prim: Usd.Prim, materials: Materials, friction: float) -> None:
    """Make a prim a collider with a friction factor."""
    UsdPhysics.CollisionAPI.Apply(prim)
    materials.bind(prim, friction)
