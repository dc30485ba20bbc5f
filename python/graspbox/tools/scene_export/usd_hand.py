"""The hand in a USD stage: an articulation with links, joints, drives, and its tendons as data.

| prim | contents |
|---|---|
| ``carriage``, ``mount``, ``lift`` | a body fixed to the world, and the joint along which the base slides up |
| ``links`` | rigid bodies with their collision shapes, at the poses of the start; named as in the URDF |
| ``joints`` | free joints with limits, drives, starts and couplings, all others fixed; named as in the URDF |
| ``tendons``, ``actuators`` | moment arms, laws and speeds as attributes ``graspbox:...``, in SI units |

Pairs of links that do not collide in graspbox are filtered.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics, Vt

from graspbox.hands.description import BASE, Array, HandDescription, Link, Shape, joint_motion
from graspbox.tools.scene_export.contents import Start
from graspbox.tools.scene_export.mjcf import colliding_shapes
from graspbox.tools.scene_export.usd_prims import Materials, add_collision, add_mass, color, quat, set_pose, vec

#: Stiffness (N/m) and damping (N s/m) of the drive that carries the hand: an arm that yields 0.1 mm to 10 N.
LIFT_DRIVE = (1e5, 1e3)
#: How far the hand can be lifted, metres.
LIFT_RANGE = 1.0
#: Mass (kg) and moments of inertia (kg m2) of a frame without mass.
_FRAME_MASS, _FRAME_INERTIA = 1e-6, 1e-10
_PAD_COLOR, _BARE_COLOR = (0.1, 0.33, 0.4), (0.78, 0.8, 0.84)


def identifiers(names: Iterable[str]) -> list[str]:
    """Return names of USD for names of URDF; they differ from each other."""
    unique: list[str] = []
    for name in names:
        valid = candidate = str(Tf.MakeValidIdentifier(name))
        number = 2
        while candidate in unique:
            candidate, number = f"{valid}_{number}", number + 1
        unique.append(candidate)
    return unique


class _Paths:
    """Paths of the prims of a hand: of links and joints by the index of the link; the base's joint is empty."""

    def __init__(self, hand: HandDescription, root: str) -> None:
        def paths(folder: str, names: Iterable[str]) -> list[str]:
            return [f"{root}/{folder}/{name}" for name in identifiers(names)]

        self.links = paths("links", (link.name for link in hand.links))
        self.joints = ["", *paths("joints", (link.joint for link in hand.links[BASE + 1 :]))]
        self.tendons = paths("tendons", (tendon.name for tendon in hand.tendons))
        self.actuators = paths("actuators", (actuator.name for actuator in hand.actuators))


def add_hand(stage: Usd.Stage, path: str, start: Start, materials: Materials) -> None:
    """Add the hand at a start."""
    hand = start.hand
    root = UsdGeom.Xform.Define(stage, path)
    root.GetPrim().SetDisplayName(hand.name)
    UsdPhysics.ArticulationRootAPI.Apply(root.GetPrim())
    paths = _Paths(hand, path)
    for folder in ("links", "joints", "tendons", "actuators"):
        UsdGeom.Scope.Define(stage, f"{path}/{folder}")
    for link, where, pose in zip(hand.links, paths.links, start.world_from_links, strict=True):
        _add_link(stage, where, link, pose, materials)
    _filter_pairs(stage, hand, paths.links)
    _add_carriage(stage, path, paths.links[BASE], start)
    for index in range(BASE + 1, len(hand.links)):
        _add_joint(stage, paths, index, start)
    _add_tendons(stage, paths, hand)


def _add_link(stage: Usd.Stage, path: str, link: Link, pose: Array, materials: Materials) -> None:
    body = UsdGeom.Xform.Define(stage, path)
    set_pose(body, pose)
    # A mass of 0 means "unknown" in USD.
    mass, inertia = (link.mass, link.inertia) if link.mass > 0.0 else (_FRAME_MASS, np.eye(3) * _FRAME_INERTIA)
    add_mass(body.GetPrim(), mass, link.center, inertia)
    for name, shape in zip(identifiers(shape.name for shape in link.shapes), link.shapes, strict=True):
        prim = _add_shape(stage, f"{path}/{name}", shape)
        color(prim, _PAD_COLOR if shape.friction >= 1.0 else _BARE_COLOR)
        add_collision(prim.GetPrim(), materials, shape.friction)


def _add_shape(stage: Usd.Stage, path: str, shape: Shape) -> UsdGeom.Gprim:
    scale: tuple[float, ...] | None = None
    prim: UsdGeom.Gprim
    if shape.kind == "box":
        prim = UsdGeom.Cube.Define(stage, path)
        prim.CreateSizeAttr(2.0)
        scale, extent = shape.size, (1.0, 1.0, 1.0)
    elif shape.kind == "cylinder":
        radius, half = shape.size
        prim = UsdGeom.Cylinder.Define(stage, path)
        prim.CreateRadiusAttr(radius)
        prim.CreateHeightAttr(2.0 * half)
        prim.CreateAxisAttr(UsdGeom.Tokens.z)
        extent = (radius, radius, half)
    else:
        (radius,) = shape.size
        prim = UsdGeom.Sphere.Define(stage, path)
        prim.CreateRadiusAttr(radius)
        extent = (radius, radius, radius)
    prim.CreateExtentAttr(Vt.Vec3fArray([-vec(extent), vec(extent)]))
    set_pose(prim, shape.link_from_shape, scale)
    return prim


def _filter_pairs(stage: Usd.Stage, hand: HandDescription, links: list[str]) -> None:
    """Filter the pairs of links with shapes that do not collide; each pair once."""
    collide = {frozenset((one.link, two.link)) for one, two in colliding_shapes(hand)}
    shaped = [index for index, link in enumerate(hand.links) if link.shapes]
    for one in shaped:
        others = [two for two in shaped if two > one and frozenset((one, two)) not in collide]
        if others:
            pairs = UsdPhysics.FilteredPairsAPI.Apply(stage.GetPrimAtPath(links[one])).CreateFilteredPairsRel()
            for two in others:
                pairs.AddTarget(links[two])


def _set_bodies(joint: Any, parent: str | None, child: str, parent_frame: Array, child_frame: Array) -> None:
    """Set the bodies of a joint, and its frame in either of them."""
    if parent is not None:
        joint.CreateBody0Rel().SetTargets([parent])
    joint.CreateBody1Rel().SetTargets([child])
    joint.CreateLocalPos0Attr(vec(parent_frame[:3, 3]))
    joint.CreateLocalRot0Attr(quat(parent_frame[:3, :3]))
    joint.CreateLocalPos1Attr(vec(child_frame[:3, 3]))
    joint.CreateLocalRot1Attr(quat(child_frame[:3, :3]))


def _add_carriage(stage: Usd.Stage, root: str, base: str, start: Start) -> None:
    path = f"{root}/carriage"
    carriage = UsdGeom.Xform.Define(stage, path)
    set_pose(carriage, start.world_from_base)
    add_mass(carriage.GetPrim(), 1.0, np.zeros(3), np.eye(3))
    mount = UsdPhysics.FixedJoint.Define(stage, f"{root}/mount")
    _set_bodies(mount, None, path, start.world_from_base, np.eye(4))
    # The axis is the world's z in the frames of both bodies.
    upright = np.eye(4)
    upright[:3, :3] = start.world_from_base[:3, :3].T
    lift = UsdPhysics.PrismaticJoint.Define(stage, f"{root}/lift")
    _set_bodies(lift, path, base, upright, upright)
    lift.CreateAxisAttr(UsdPhysics.Tokens.z)
    lift.CreateLowerLimitAttr(0.0)
    lift.CreateUpperLimitAttr(LIFT_RANGE)
    _add_drive(lift, "linear", LIFT_DRIVE, 0.0)


def _unit(kind: str) -> float:
    """Return a unit of joints in USD, degree or metre, in SI units."""
    return math.radians(1.0) if kind == "angular" else 1.0


def _add_drive(
    joint: Any, kind: str, law: tuple[float, float], target: float, limit: float | None = None, speed: float = 0.0
) -> None:
    """Add a drive: stiffness and damping per metre or radian, targets and greatest force in SI units."""
    unit = _unit(kind)
    drive = UsdPhysics.DriveAPI.Apply(joint.GetPrim(), kind)
    drive.CreateTypeAttr("force")
    drive.CreateStiffnessAttr(law[0] * unit)
    drive.CreateDampingAttr(law[1] * unit)
    drive.CreateTargetPositionAttr(target / unit)
    if speed:
        drive.CreateTargetVelocityAttr(speed / unit)
    if limit is not None:
        drive.CreateMaxForceAttr(limit)


def _axis_frame(axis: Array) -> Array:
    """Return a frame (4, 4) whose x axis is `axis`."""
    x = np.asarray(axis) / np.linalg.norm(axis)
    y = np.cross(np.eye(3)[int(np.argmin(np.abs(x)))], x)
    y /= np.linalg.norm(y)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    return frame


def _add_joint(stage: Usd.Stage, paths: _Paths, index: int, start: Start) -> None:
    """Add the joint of a link; one that is not free is fixed at the position of the start."""
    hand = start.hand
    link, path = hand.links[index], paths.joints[index]
    parent, child = paths.links[link.parent], paths.links[index]
    position = start.joints.get(index, 0.0)
    if index not in hand.free():
        fixed = UsdPhysics.FixedJoint.Define(stage, path)
        _set_bodies(fixed, parent, child, link.parent_from_link @ joint_motion(link, position), np.eye(4))
        if link.kind != "fixed":
            _set(fixed.GetPrim(), lockedPosition=float(position))
        return
    prismatic = link.kind == "prismatic"
    joint = (UsdPhysics.PrismaticJoint if prismatic else UsdPhysics.RevoluteJoint).Define(stage, path)
    frame = _axis_frame(link.axis)
    _set_bodies(joint, parent, child, link.parent_from_link @ frame, frame)
    joint.CreateAxisAttr(UsdPhysics.Tokens.x)
    kind = "linear" if prismatic else "angular"
    joint.CreateLowerLimitAttr(link.limits[0] / _unit(kind))
    joint.CreateUpperLimitAttr(link.limits[1] / _unit(kind))
    _add_joint_drive(joint, kind, hand, index, start)
    # Properties that UsdPhysics lacks.
    prim, spring = joint.GetPrim(), link.spring
    _add_state(prim, kind, position)
    _set(prim, springStiffness=spring.stiffness, springReference=spring.reference, damping=spring.damping)
    _set(prim, armature=spring.armature, stopStiffness=spring.stop_stiffness)
    if link.mimic is not None:
        leader, ratio, offset = link.mimic
        _add_mimic(prim, kind, paths.joints[leader], ratio, offset)


def _add_state(prim: Usd.Prim, kind: str, position: float) -> None:
    """Set the position of a joint at the start; of the schemas of Omniverse, which usd-core lacks."""
    prim.AddAppliedSchema(f"PhysicsJointStateAPI:{kind}")
    for name, value in (("position", position / _unit(kind)), ("velocity", 0.0)):
        prim.CreateAttribute(f"state:{kind}:physics:{name}", Sdf.ValueTypeNames.Float, custom=False).Set(value)


def _add_mimic(prim: Usd.Prim, kind: str, leader: str, ratio: float, offset: float) -> None:
    """Couple a joint to its leader, for Newton and Isaac Sim from 6.0, and for earlier ones, which read PhysX's schema.

    PhysX looks for the instances rotX, rotY and rotZ alone, whatever the kind of joint. Offsets are in units of USD.
    """
    number, own = Sdf.ValueTypeNames.Float, offset / _unit(kind)
    prim.AddAppliedSchema("NewtonMimicAPI")
    prim.AddAppliedSchema("PhysxMimicJointAPI:rotX")
    for name, value in (
        ("newton:mimicCoef0", own),
        ("newton:mimicCoef1", ratio),
        ("physxMimicJoint:rotX:gearing", -ratio),
        ("physxMimicJoint:rotX:offset", -own),
    ):
        prim.CreateAttribute(name, number, custom=False).Set(value)
    for name in ("newton:mimicJoint", "physxMimicJoint:rotX:referenceJoint"):
        prim.CreateRelationship(name, custom=False).SetTargets([leader])


def _shares(link: Link) -> bool:
    """Whether a joint has its own share of the servo of the joint that it follows."""
    return link.kind == "prismatic" and link.mimic is not None and link.mimic[1] != 0.0


def _add_joint_drive(joint: Any, kind: str, hand: HandDescription, index: int, start: Start) -> None:
    """Add the servo that drives a joint, or else the joint's spring and damper.

    PhysX does not couple sliders: those that follow the joint of a servo have an equal share of it.
    """
    own = hand.links[index]
    leader, ratio, _ = own.mimic if own.mimic is not None and _shares(own) else (index, 1.0, 0.0)
    sliders = [link for link in hand.moving if link.mimic is not None and link.mimic[0] == leader and _shares(link)]
    for actuator in hand.actuators:
        if actuator.servo is not None and leader in [driven for driven, _, _ in actuator.joints]:
            share = 1.0 / (1 + len(sliders))
            law = (actuator.servo[0] * share / ratio**2, actuator.servo[1] * share / ratio**2)
            _add_drive(joint, kind, law, start.joints[index], actuator.load_limit * share / abs(ratio))
            return
    spring, (low, high) = own.spring, own.limits
    target = min(max(spring.reference, low), high) if spring.damping > 0.0 else spring.reference
    # A preload beyond the limits is the damper's: readers move a target outside of the limits, without a word.
    speed = spring.stiffness * (spring.reference - target) / spring.damping if spring.damping > 0.0 else 0.0
    _add_drive(joint, kind, (spring.stiffness, spring.damping), target, speed=speed)


def _set(prim: Usd.Prim, **values: Any) -> None:
    """Add properties as attributes ``graspbox:NAME``: flags, numbers, pairs (tuple) and lists of numbers."""
    for name, value in values.items():
        if isinstance(value, list):
            kind, value = Sdf.ValueTypeNames.DoubleArray, Vt.DoubleArray(value)
        elif isinstance(value, tuple):
            kind, value = Sdf.ValueTypeNames.Double2, Gf.Vec2d(*value)
        else:
            kind = Sdf.ValueTypeNames.Bool if isinstance(value, bool) else Sdf.ValueTypeNames.Double
        prim.CreateAttribute(f"graspbox:{name}", kind, custom=True).Set(value)


def _relate(prim: Usd.Prim, name: str, targets: list[str]) -> None:
    prim.CreateRelationship(f"graspbox:{name}", custom=True).SetTargets(targets)


def _add_tendons(stage: Usd.Stage, paths: _Paths, hand: HandDescription) -> None:
    """Add tendons and actuators as data."""
    for tendon, path in zip(hand.tendons, paths.tendons, strict=True):
        prim = UsdGeom.Scope.Define(stage, path).GetPrim()
        _relate(prim, "joints", [paths.joints[link] for link, _ in tendon.arms])
        _set(prim, momentArms=[arm for _, arm in tendon.arms], stiffness=tendon.stiffness)
        _set(prim, damping=tendon.damping, maxTension=tendon.max_tension)
    for actuator, path in zip(hand.actuators, paths.actuators, strict=True):
        prim = UsdGeom.Scope.Define(stage, path).GetPrim()
        _set(prim, speed=actuator.speed, travel=actuator.travel, loadLimit=actuator.load_limit, closes=actuator.closes)
        if actuator.spool is not None:
            _relate(prim, "tendon", [paths.tendons[actuator.spool[0]]])
            _set(prim, spoolRadius=actuator.spool[1])
        if actuator.joints:
            links, ratios, offsets = map(list, zip(*actuator.joints, strict=True))
            _relate(prim, "joints", [paths.joints[link] for link in links])
            _set(prim, ratios=ratios, offsets=offsets)
