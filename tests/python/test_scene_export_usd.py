"""Exported USD stages, read back with usd-core: values, frames of joints, and the validators of USD."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pxr", reason="USD needs usd-core, from the extra 'usd'")
pytest.importorskip("scipy", reason="exported scenes need scipy, from the extra 'scenes'")

from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade

import graspbox
from graspbox.configs import FrictionConfig, PhysicsConfig
from graspbox.errors import MissingExtraError
from graspbox.hands.conventions import mechanism_of
from graspbox.hands.description import HandDescription, describe
from graspbox.tools import scene_export
from graspbox.tools.scene_export.mjcf import colliding_shapes
from graspbox.tools.scene_export.usd_hand import identifiers

HANDS = graspbox.Hand.names()
PHYSICS = PhysicsConfig(gravity=3.71, friction=FrictionConfig(table=0.45, object=0.8))


class Exported:
    """A scene, its hand and its stage."""

    def __init__(self, hand: str, folder: Path):
        mesh = graspbox.object_sets.load("procedural:mug:2")[0].load()
        self.scene = graspbox.Scene(mesh, hand=hand, physics=PHYSICS)
        plan = graspbox.plan(mesh, hand=hand, world_from_object=self.scene.world_from_object).best()
        self.grasp = plan[0]
        done = scene_export.export_scene(self.scene, folder, "usd", self.grasp)
        self.stage = Usd.Stage.Open(str(done.files[0]))
        self.hand: HandDescription = describe(self.scene.hand)
        names = [link.name for link in self.hand.links]
        self.links = [f"/World/hand/links/{name}" for name in identifiers(names)]

    def prim(self, path: str) -> Any:
        """Return an existing prim."""
        prim = self.stage.GetPrimAtPath(path)
        assert prim.IsValid(), path
        return prim

    def pose(self, path: str) -> np.ndarray:
        """Pose (4, 4) of a prim in the world, without its scale."""
        world = UsdGeom.Xformable(self.prim(path)).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
        return np.array(world.RemoveScaleShear()).T

    def joint(self, link: int) -> Any:
        """Return the joint of a link."""
        return self.prim(f"/World/hand/joints/{self.hand.links[link].joint}")


@pytest.fixture(scope="module", params=HANDS)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return Exported(request.param, tmp_path_factory.mktemp(request.param) / "out")


def mass_of(prim: Any) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass, and inertia (3, 3) in the frame of a body."""
    assert prim.HasAPI(UsdPhysics.RigidBodyAPI)
    api = UsdPhysics.MassAPI(prim)
    axes = np.array(Gf.Matrix3d(Gf.Quatd(api.GetPrincipalAxesAttr().Get()))).T
    moments = np.array(api.GetDiagonalInertiaAttr().Get())
    return api.GetMassAttr().Get(), np.array(api.GetCenterOfMassAttr().Get()), axes @ np.diag(moments) @ axes.T


def test_the_stage_has_its_units(exported: Exported) -> None:
    stage = exported.stage
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1.0
    assert stage.GetDefaultPrim().GetPath() == "/World"
    scene = UsdPhysics.Scene(exported.prim("/World/physics"))
    assert scene.GetGravityMagnitudeAttr().Get() == pytest.approx(3.71)
    assert list(scene.GetGravityDirectionAttr().Get()) == [0, 0, -1]


def test_the_object_is_the_core_s(exported: Exported) -> None:
    body, prim = exported.scene.body, exported.prim("/World/object")
    mass, center, inertia = mass_of(prim)
    assert mass == pytest.approx(body.mass, rel=1e-6)
    np.testing.assert_allclose(center, body.center_of_mass, atol=1e-6)
    np.testing.assert_allclose(inertia, body.inertia, atol=1e-6 * np.abs(body.inertia).max())
    # The object is lifted out of the table by less than half a millimetre.
    np.testing.assert_allclose(exported.pose("/World/object"), exported.scene.world_from_object, atol=5e-4)
    parts = exported.prim("/World/object/parts").GetChildren()
    assert len(parts) == len(body.parts)
    for part, points in zip(parts, body.parts, strict=True):
        assert part.HasAPI(UsdPhysics.CollisionAPI)
        assert UsdPhysics.MeshCollisionAPI(part).GetApproximationAttr().Get() == "convexHull"
        np.testing.assert_allclose(np.array(UsdGeom.Mesh(part).GetPointsAttr().Get()), points, atol=1e-6)
    visual = UsdGeom.Mesh(exported.prim("/World/object/visual"))
    assert not visual.GetPrim().HasAPI(UsdPhysics.CollisionAPI)
    np.testing.assert_allclose(np.array(visual.GetPointsAttr().Get()), exported.scene.mesh.vertices, atol=1e-6)
    faces = np.array(visual.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    np.testing.assert_array_equal(faces, exported.scene.mesh.faces)


def test_links_have_the_masses_and_places_of_the_hand(exported: Exported) -> None:
    scene, grasp = exported.scene, exported.grasp
    for link, path in zip(exported.hand.links, exported.links, strict=True):
        mass, center, inertia = mass_of(exported.prim(path))
        assert mass == pytest.approx(link.mass, rel=1e-6)
        np.testing.assert_allclose(center, link.center, atol=1e-6)
        np.testing.assert_allclose(inertia, link.inertia, atol=1e-6 * np.abs(link.inertia).max())
    shapes, half, _, _ = scene.hand.shapes(scene.hand.open(grasp.preshape))
    expected = (scene.world_from_object @ grasp.pose @ shapes)[:, :3, 3]
    found = 0
    for path in exported.links:
        for child in exported.prim(path).GetChildren():
            place = exported.pose(str(child.GetPath()))[:3, 3]
            (index,) = np.flatnonzero(np.linalg.norm(expected - place, axis=1) < 1e-6)
            cube = UsdGeom.Cube(child)
            if cube:
                scale = next(op for op in cube.GetOrderedXformOps() if op.GetOpType() == UsdGeom.XformOp.TypeScale)
                size = 0.5 * cube.GetSizeAttr().Get() * np.array(scale.Get())
                np.testing.assert_allclose(np.sort(size), np.sort(half[index]), atol=1e-6)
            found += 1
    assert found == len(shapes)


def frames(exported: Exported, prim: Any) -> tuple[np.ndarray, np.ndarray]:
    """World poses (4, 4) of the frames of a joint on its two bodies."""
    joint = UsdPhysics.Joint(prim)
    found = []
    for bodies, where, turn in (
        (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
        (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
    ):
        local = np.eye(4)
        local[:3, :3] = np.array(Gf.Matrix3d(Gf.Quatd(turn.Get()))).T
        local[:3, 3] = where.Get()
        targets = bodies.GetTargets()
        found.append((exported.pose(str(targets[0])) if targets else np.eye(4)) @ local)
    return found[0], found[1]


def test_joints_have_limits_and_frames_that_meet(exported: Exported) -> None:
    """Both frames of a joint differ by its position alone, along or about the joint's axis x."""
    hand, free = exported.hand, exported.hand.free()
    mechanism = mechanism_of(exported.scene.hand)
    (joints,) = mechanism.all_positions(exported.scene.hand.open(exported.grasp.preshape)[None])
    open_at = dict(zip(mechanism.joints, joints, strict=True))
    for index, link in enumerate(hand.links[1:], start=1):
        prim = exported.joint(index)
        parent, child = frames(exported, prim)
        motion = np.linalg.inv(parent) @ child
        if index not in free:
            assert prim.IsA(UsdPhysics.FixedJoint)
            np.testing.assert_allclose(motion, np.eye(4), atol=1e-6)
            if link.kind != "fixed" and link.joint in open_at:
                assert prim.GetAttribute("graspbox:lockedPosition").Get() == pytest.approx(open_at[link.joint])
            continue
        prismatic = link.kind == "prismatic"
        joint = UsdPhysics.PrismaticJoint(prim) if prismatic else UsdPhysics.RevoluteJoint(prim)
        unit = 1.0 if prismatic else math.radians(1.0)
        assert joint.GetAxisAttr().Get() == "X"
        assert joint.GetLowerLimitAttr().Get() * unit == pytest.approx(link.limits[0], abs=1e-6)
        assert joint.GetUpperLimitAttr().Get() * unit == pytest.approx(link.limits[1], abs=1e-6)
        np.testing.assert_allclose(child[:3, 0], exported.pose(exported.links[index])[:3, :3] @ link.axis, atol=1e-6)
        expected, position = np.eye(4), open_at[link.joint]
        if prismatic:
            expected[0, 3] = position
        else:
            cosine, sine = math.cos(position), math.sin(position)
            expected[1:3, 1:3] = [[cosine, -sine], [sine, cosine]]
        np.testing.assert_allclose(motion, expected, atol=1e-6)


def test_the_hand_slides_up_the_world_s_z(exported: Exported) -> None:
    hand = exported.prim("/World/hand")
    assert hand.HasAPI(UsdPhysics.ArticulationRootAPI)
    lift = UsdPhysics.PrismaticJoint(exported.prim("/World/hand/lift"))
    assert lift.GetAxisAttr().Get() == "Z"
    for frame in frames(exported, lift.GetPrim()):
        np.testing.assert_allclose(frame[:3, 2], [0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(frame[:3, 3], exported.pose(exported.links[0])[:3, 3], atol=1e-6)
    mount = UsdPhysics.FixedJoint(exported.prim("/World/hand/mount"))
    assert not mount.GetBody0Rel().GetTargets()
    world, carriage = frames(exported, mount.GetPrim())
    np.testing.assert_allclose(world, carriage, atol=1e-6)


def test_drives_are_springs_and_servos(exported: Exported) -> None:
    hand = exported.hand
    servos = {link: a for a in hand.actuators if a.servo is not None for link, _, _ in a.joints}
    for index in hand.free():
        link, prim = hand.links[index], exported.joint(index)
        kind, unit = ("linear", 1.0) if link.kind == "prismatic" else ("angular", math.radians(1.0))
        drive = UsdPhysics.DriveAPI(prim, kind)
        law = np.array([drive.GetStiffnessAttr().Get() / unit, drive.GetDampingAttr().Get() / unit])
        # PhysX does not couple sliders: leader and followers share their servo.
        slides = link.kind == "prismatic"
        leader = link.mimic[0] if slides and link.mimic is not None else index
        servo = servos.get(leader)
        expected = (link.spring.stiffness, link.spring.damping) if servo is None else servo.servo
        assert expected is not None
        members = 1 + sum(other.mimic is not None and other.mimic[0] == leader for other in hand.moving if slides)
        np.testing.assert_allclose(law * members, expected, rtol=1e-6)
        if servo is not None:
            assert drive.GetMaxForceAttr().Get() * members == pytest.approx(servo.load_limit)
        assert prim.GetAttribute("graspbox:stopStiffness").Get() == link.spring.stop_stiffness
        assert prim.GetAttribute("graspbox:armature").Get() == link.spring.armature
    tendons = exported.prim("/World/hand/tendons").GetChildren()
    assert len(tendons) == len(hand.tendons)
    for prim, tendon in zip(tendons, hand.tendons, strict=True):
        assert list(prim.GetAttribute("graspbox:momentArms").Get()) == [arm for _, arm in tendon.arms]
        targets = [path.name for path in prim.GetRelationship("graspbox:joints").GetTargets()]
        assert targets == [hand.links[link].joint for link, _ in tendon.arms]
        assert prim.GetAttribute("graspbox:maxTension").Get() == tendon.max_tension


def test_a_preload_beyond_the_limits_is_exact(exported: Exported) -> None:
    """Newton moves a target outside of a joint's limits to their middle (findings/newton_drive_target.sh)."""
    hand = exported.hand
    servos = {link for a in hand.actuators if a.servo is not None for link, _, _ in a.joints}
    for index in (index for index in hand.free() if index not in servos and hand.links[index].mimic is None):
        link, prim, unit = hand.links[index], exported.joint(index), math.radians(1.0)
        drive, joint = UsdPhysics.DriveAPI(prim, "angular"), UsdPhysics.RevoluteJoint(prim)
        target = drive.GetTargetPositionAttr().Get()
        assert joint.GetLowerLimitAttr().Get() <= target <= joint.GetUpperLimitAttr().Get()
        for position, speed in ((0.1, 0.0), (0.7, -1.5)):
            force = drive.GetStiffnessAttr().Get() * (target - position / unit)
            force += drive.GetDampingAttr().Get() * ((drive.GetTargetVelocityAttr().Get() or 0.0) - speed / unit)
            spring = link.spring
            expected = spring.stiffness * (spring.reference - position) - spring.damping * speed
            assert force == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_couplings_and_starts_are_those_of_other_schemas(exported: Exported) -> None:
    hand, mechanism = exported.hand, mechanism_of(exported.scene.hand)
    (positions,) = mechanism.all_positions(exported.scene.hand.open(exported.grasp.preshape)[None])
    open_at = dict(zip(mechanism.joints, positions, strict=True))
    for index in hand.free():
        link, prim = hand.links[index], exported.joint(index)
        kind, unit = ("linear", 1.0) if link.kind == "prismatic" else ("angular", math.radians(1.0))
        schemas = prim.GetMetadata("apiSchemas").GetAppliedItems()
        assert f"PhysicsJointStateAPI:{kind}" in schemas
        position = prim.GetAttribute(f"state:{kind}:physics:position").Get() * unit
        assert position == pytest.approx(open_at[link.joint], abs=1e-6)
        for schema in ("NewtonMimicAPI", "PhysxMimicJointAPI:rotX"):
            assert (schema in schemas) == (link.mimic is not None)
        if link.mimic is None:
            continue
        leader, ratio, offset = link.mimic
        assert prim.GetAttribute("newton:mimicCoef1").Get() == pytest.approx(ratio)
        assert prim.GetAttribute("newton:mimicCoef0").Get() * unit == pytest.approx(offset)
        # PhysX: position + gearing x leader's position + offset = 0.
        assert prim.GetAttribute("physxMimicJoint:rotX:gearing").Get() == pytest.approx(-ratio)
        assert prim.GetAttribute("physxMimicJoint:rotX:offset").Get() * unit == pytest.approx(-offset)
        for name in ("newton:mimicJoint", "physxMimicJoint:rotX:referenceJoint"):
            assert prim.GetRelationship(name).GetTargets() == [exported.joint(leader).GetPath()]


def test_friction_and_filters_are_the_hand_s(exported: Exported) -> None:
    def friction(prim: Any) -> float:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
        assert material.GetPrim().GetAttribute("physxMaterial:frictionCombineMode").Get() == "multiply"
        api = UsdPhysics.MaterialAPI(material.GetPrim())
        assert api.GetStaticFrictionAttr().Get() == api.GetDynamicFrictionAttr().Get()
        return float(api.GetStaticFrictionAttr().Get())

    table = exported.prim("/World/table")
    assert not table.HasAPI(UsdPhysics.RigidBodyAPI)
    assert friction(table) == pytest.approx(0.45)
    assert friction(exported.prim("/World/object/parts/part_0")) == pytest.approx(0.8)
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(table).ComputeAlignedRange()
    np.testing.assert_allclose([bounds.GetMin(), bounds.GetMax()], [[-0.6, -0.6, -0.1], [0.6, 0.6, 0.0]], atol=1e-6)
    hand = exported.hand
    for link, path in zip(hand.links, exported.links, strict=True):
        for shape, prim in zip(link.shapes, exported.prim(path).GetChildren(), strict=True):
            assert friction(prim) == pytest.approx(shape.friction)
    filtered = set()
    for index, path in enumerate(exported.links):
        for target in UsdPhysics.FilteredPairsAPI(exported.prim(path)).GetFilteredPairsRel().GetTargets():
            filtered.add(frozenset((index, exported.links.index(str(target)))))
    collide = {frozenset((one.link, two.link)) for one, two in colliding_shapes(hand)}
    shaped = [i for i, link in enumerate(hand.links) if link.shapes]
    assert filtered == {frozenset((a, b)) for a in shaped for b in shaped if a < b} - collide


def check_validators(stage: Any) -> None:
    """Run the validators of USD on a stage."""
    validation = pytest.importorskip("pxr.UsdValidation")
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    names = {validator.GetMetadata().name for validator in validators}
    assert "usdPhysicsValidators:ArticulationChecker" in names
    found = validation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in found] == []


def test_usd_s_own_checks_pass(exported: Exported) -> None:
    check_validators(exported.stage)


@pytest.mark.parametrize("with_hand", [True, False])
def test_several_objects_and_walls_are_where_they_rest(with_hand: bool, tmp_path: Path) -> None:
    meshes = [spec.load() for spec in graspbox.object_sets.load("procedural:box:0-2")]
    heap = graspbox.arrange(meshes, "bin", seed=0)
    scene = graspbox.Scene.of(heap, physics=PHYSICS)
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3] = 0.5
    pose = (np.linalg.inv(scene.world_from_object) @ above, 0.0) if with_hand else (None, None)
    done = scene_export.export_scene(scene, tmp_path / "out", "usd", *pose)
    stage = Usd.Stage.Open(str(done.files[0]))
    check_validators(stage)
    assert bool(stage.GetPrimAtPath("/World/hand")) == with_hand
    names = [child.GetName() for child in stage.GetPrimAtPath("/World").GetChildren()]
    assert [name for name in names if name.startswith("object")] == ["object_0", "object_1", "object_2"]
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    for number, (mesh, rest) in enumerate(zip(heap.meshes, heap.world_from_objects, strict=True)):
        prim = stage.GetPrimAtPath(f"/World/object_{number}")
        assert mass_of(prim)[0] == pytest.approx(mesh.mass, rel=1e-6)
        corners = mesh.vertices @ rest[:3, :3].T + rest[:3, 3]
        box = cache.ComputeWorldBound(prim.GetChild("visual")).ComputeAlignedRange()
        assert (np.array(box.GetMin()) <= corners.min(axis=0) + 6e-4).all()
        assert (np.array(box.GetMax()) >= corners.max(axis=0) - 6e-4).all()
    for number, (rest, half) in enumerate(zip(heap.world_from_walls, heap.wall_half_extents, strict=True)):
        prim = stage.GetPrimAtPath(f"/World/wall_{number}")
        box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
        np.testing.assert_allclose(box.GetMidpoint(), rest[:3, 3], atol=1e-6)
        np.testing.assert_allclose(box.GetSize(), 2 * np.abs(rest[:3, :3]) @ half, atol=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
        assert UsdPhysics.MaterialAPI(material.GetPrim()).GetStaticFrictionAttr().Get() == pytest.approx(0.45)


def test_an_object_alone_is_the_default_prim(tmp_path: Path) -> None:
    done = scene_export.export_objects("procedural:can:0-1", tmp_path / "out", "usd")
    assert done.refused == {}
    for file in done.files.values():
        stage = Usd.Stage.Open(str(file))
        assert stage.GetDefaultPrim().HasAPI(UsdPhysics.RigidBodyAPI)
        scene = Usd.Stage.CreateInMemory()
        scene.OverridePrim("/copy").GetReferences().AddReference(str(file))
        part = scene.GetPrimAtPath("/copy/parts/part_0")
        material, _ = UsdShade.MaterialBindingAPI(part).ComputeBoundMaterial("physics")
        assert material.GetPath().HasPrefix("/copy")


def test_names_of_usd_differ() -> None:
    assert identifiers(["a-b", "a_b", "1", "a b"]) == ["a_b", "a_b_2", "_", "a_b_3"]


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = graspbox.object_sets.load("procedural:can:0")[0].load()
    for name in [name for name in sys.modules if name.split(".")[0] == "pxr" or "scene_export.usd" in name]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(scene_export, "usd", raising=False)
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'graspbox\[usd\]'"):
        scene_export.export_object(graspbox.Scene(mesh), tmp_path / "out", "usd")
