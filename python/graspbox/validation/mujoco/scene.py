"""An MJCF model of the core's hand, object, table and friction.

* The hand is mounted on a carriage that slides along the world's z; contact forces do not move it, because its armature
  is very large. Its position and velocity are prescribed at every step, so contacts use the palm's true velocity.
* The base and rigidly driven links are bodies without joints, whose poses are set when a trial begins.
* The table is an infinite plane: an object that falls off the edge of the core's table fails in both engines, and a box
  would cost collision tests at every step.
* A tendon is a fixed tendon with the moment arms, pulled by an actuator with the affine law ``k stretch + d rate``,
  clamped to ``[0, max_tension]``; `replay` moves the spool. A servo is a position actuator with limited force, and a
  mimic joint an equality constraint.
* The friction coefficient of a pair is the product of its two factors. For contacts of the object, whose own factor is
  set to 0, MuJoCo's maximum of the two gives this product. All others are explicit pairs, which also define the
  self-collisions of the hand: links of different chains, and the palm with links that are not adjacent to it.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.validation.mujoco.description import BASE, Array, HandDescription, Link

#: Inertia of the carriage, kg: 100 N of contact force change its speed by 1e-5 m/s in a step; the next one resets it.
CARRIAGE_INERTIA = 1e4


@dataclass(frozen=True)
class ObjectData:
    """An object to simulate, in its own frame; metres, kilograms."""

    name: str
    #: Convex parts, each (n, 3) points.
    parts: Sequence[Array]
    mass: float
    #: Centre of mass (3,), and inertia about it (3, 3).
    center: Array
    inertia: Array
    #: Resting pose on the table, (4, 4).
    world_from_object: Array


@dataclass(frozen=True)
class Numerics:
    """MuJoCo's numerical settings, as opposed to physical ones.

    They are chosen so that a firmly held object creeps by less than 0.1 mm/s.
    """

    #: Time step, s. At 1 ms some objects that are held firmly at 0.5 and 0.25 ms wobble faster than success allows.
    timestep: float = 0.0005
    #: Ratio of the impedances of friction and normal constraints; prevents creep of MuJoCo's regularized friction.
    impratio: float = 10.0
    #: Time constant (s) and damping ratio of contacts; MuJoCo needs a time constant of at least two steps.
    solref: tuple[float, float] = (0.004, 1.0)
    #: Impedance at zero and at full depth, and that depth (m).
    solimp: tuple[float, float, float] = (0.95, 0.99, 0.0005)
    noslip_iterations: int = 5
    iterations: int = 100


@dataclass
class Scene:
    """A compiled model and the indices of its parts."""

    model: mujoco.MjModel
    hand: HandDescription
    object: ObjectData
    numerics: Numerics
    #: Masks over geoms.
    is_object: NDArray[np.bool_]
    is_scenery: NDArray[np.bool_]
    is_hand: NDArray[np.bool_]
    base_body: int
    object_body: int
    #: Address in ``qpos`` and index in ``qvel`` of each dynamic joint, by the index of its link.
    joints: dict[int, tuple[int, int]] = field(default_factory=dict)
    #: MuJoCo's actuators for each of the hand's actuators: one per tendon or driven joint, none for a rigid drive.
    actuators: list[list[int]] = field(default_factory=list)


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a (3, 3) rotation."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation, dtype=np.float64).reshape(9))
    return quat


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(x):.17g}" for x in values)


def _add_pose(element: ET.Element, pose: Array) -> None:
    element.set("pos", _text(pose[:3, 3]))
    element.set("quat", _text(quaternion(pose[:3, :3])))


def _add_inertial(body: ET.Element, mass: float, center: Array, inertia: Array) -> None:
    i = inertia
    full = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    ET.SubElement(body, "inertial", pos=_text(center), mass=_text([mass]), fullinertia=_text(full))


def _add_link(parent: ET.Element, hand: HandDescription, index: int, free: Sequence[int]) -> ET.Element:
    link: Link = hand.links[index]
    body = ET.SubElement(parent, "body", name=link.name)
    _add_pose(body, link.parent_from_link)
    _add_inertial(body, link.mass, link.center, link.inertia)
    if index in free:
        kind = "slide" if link.kind == "prismatic" else "hinge"
        joint = ET.SubElement(body, "joint", name=link.joint, type=kind, axis=_text(link.axis))
        joint.set("damping", _text([link.spring.damping]))
        joint.set("armature", _text([link.spring.armature]))
        joint.set("stiffness", _text([link.spring.stiffness]))
        joint.set("springref", _text([link.spring.reference]))
    for shape in link.shapes:
        geom = ET.SubElement(body, "geom", name=shape.name, type=shape.kind, size=_text(shape.size))
        geom.set("friction", _text([shape.friction, 0, 0]))
        geom.set("contype", "0")
        geom.set("conaffinity", "1")
        _add_pose(geom, shape.link_from_shape)
    for child, below in enumerate(hand.links):
        if child != BASE and below.parent == index:
            _add_link(body, hand, child, free)
    return body


def _add_table(world: ET.Element, physics: PhysicsConfig) -> None:
    geom = ET.SubElement(world, "geom", name="table", type="plane", contype="0", conaffinity="1")
    geom.set("size", _text([1, 1, 1]))
    geom.set("friction", _text([physics.friction.table, 0, 0]))


def _add_object(root: ET.Element, world: ET.Element, item: ObjectData) -> None:
    assets = ET.SubElement(root, "asset")
    body = ET.SubElement(world, "body", name="object")
    ET.SubElement(body, "freejoint", name="object")
    _add_inertial(body, item.mass, item.center, item.inertia)
    for i, points in enumerate(item.parts):
        # The inertia of a part is not used; "convex" computes it from the hull, which any point cloud has.
        ET.SubElement(assets, "mesh", name=f"part_{i}", vertex=_text(np.ravel(points)), inertia="convex")
        geom = ET.SubElement(body, "geom", name=f"object_{i}", type="mesh", mesh=f"part_{i}")
        geom.set("contype", "1")
        geom.set("conaffinity", "0")
        geom.set("friction", "0 0 0")


def _groups(hand: HandDescription, free: Sequence[int]) -> list[tuple[str, int, str, float]]:
    """List the hand's shapes as (part, chain, name, friction); a part is ``palm``, ``near`` (adjacent) or ``far``."""
    part_of, chain_of, shaped, found, chains = {BASE: "palm"}, {BASE: -1}, {BASE: False}, [], 0
    for index, link in enumerate(hand.links):
        if index != BASE:
            above = link.parent
            part_of[index], chain_of[index], shaped[index] = part_of[above], chain_of[above], shaped[above]
            if index in free:
                if chain_of[above] < 0:
                    chain_of[index], chains = chains, chains + 1
                part_of[index] = "far" if shaped[above] else "near"
            shaped[index] = shaped[index] or (part_of[index] != "palm" and bool(link.shapes))
        found += [(part_of[index], chain_of[index], shape.name, shape.friction) for shape in link.shapes]
    return found


def _add_pairs(root: ET.Element, hand: HandDescription, physics: PhysicsConfig, numerics: Numerics) -> None:
    contact = ET.SubElement(root, "contact")

    def pair(one: str, two: str, friction: float) -> None:
        element = ET.SubElement(contact, "pair", geom1=one, geom2=two, condim="3")
        element.set("friction", _text([friction, friction, 0, 0, 0]))
        element.set("solref", _text(numerics.solref))
        element.set("solimp", _text(numerics.solimp))

    groups = _groups(hand, hand.free())
    for part, _, name, friction in groups:
        if part != "palm":
            pair(name, "table", friction * physics.friction.table)
    for (part, chain, name, friction), (part2, chain2, name2, friction2) in itertools.combinations(groups, 2):
        crosses = chain != chain2 and "palm" not in (part, part2)
        if crosses or {part, part2} == {"palm", "far"}:
            pair(name, name2, friction * friction2)


def _add_actuator(
    actuators: ET.Element, name: str, target: dict[str, str], law: tuple[float, float], force: tuple[float, float]
) -> None:
    """Add an actuator with force = k ctrl - k length - d length', clamped to an interval."""
    stiffness, damping = law
    found = ET.SubElement(actuators, "general", {"name": name, **target}, biastype="affine", forcelimited="true")
    found.set("gainprm", _text([stiffness]))
    found.set("biasprm", _text([0, -stiffness, -damping]))
    found.set("forcerange", _text(force))


def _add_actuators(root: ET.Element, hand: HandDescription, numerics: Numerics) -> None:
    tendons, actuators = ET.SubElement(root, "tendon"), ET.SubElement(root, "actuator")
    for tendon in hand.tendons:
        fixed = ET.SubElement(tendons, "fixed", name=tendon.name)
        for link, arm in tendon.arms:
            ET.SubElement(fixed, "joint", joint=hand.links[link].joint, coef=_text([arm]))
    for actuator in hand.actuators:
        if actuator.spool is not None:
            # ctrl is the length of tendon wound onto the spool.
            tendon = hand.tendons[actuator.spool[0]]
            law, force = (tendon.stiffness, tendon.damping), (0.0, tendon.max_tension)
            _add_actuator(actuators, actuator.name, {"tendon": tendon.name}, law, force)
        elif actuator.servo is not None:
            limit = (-actuator.load_limit, actuator.load_limit)
            for link, _, _ in actuator.joints:
                joint = hand.links[link].joint
                _add_actuator(actuators, f"{actuator.name} {joint}", {"joint": joint}, actuator.servo, limit)
    equality = ET.SubElement(root, "equality")
    for link in hand.free():
        follows = hand.links[link].mimic
        if follows is not None:
            leader, ratio, offset = follows
            constraint = ET.SubElement(equality, "joint", joint1=hand.links[link].joint, joint2=leader)
            constraint.set("polycoef", _text([offset, ratio, 0, 0, 0]))
            # As stiff as the step allows: MuJoCo scales a constraint's stiffness by the small inertia of a link.
            constraint.set("solref", _text([2.0 * numerics.timestep, 1.0]))
            constraint.set("solimp", _text([0.99, 0.999, 0.001]))


def mjcf(hand: HandDescription, item: ObjectData, physics: PhysicsConfig, numerics: Numerics) -> str:
    """Return the model of one object and the hand as MJCF."""
    root = ET.Element("mujoco", model=f"{hand.name} and {item.name}")
    ET.SubElement(root, "compiler", angle="radian", autolimits="false", boundmass="0")
    option = ET.SubElement(root, "option", integrator="implicitfast", cone="elliptic", solver="Newton")
    option.set("timestep", _text([numerics.timestep]))
    option.set("gravity", _text([0, 0, -physics.gravity]))
    option.set("impratio", _text([numerics.impratio]))
    option.set("noslip_iterations", str(numerics.noslip_iterations))
    option.set("iterations", str(numerics.iterations))
    default = ET.SubElement(root, "default")
    ET.SubElement(default, "geom", condim="3", solref=_text(numerics.solref), solimp=_text(numerics.solimp))
    world = ET.SubElement(root, "worldbody")
    _add_table(world, physics)
    _add_object(root, world, item)
    carriage = ET.SubElement(world, "body", name="carriage")
    _add_inertial(carriage, 1.0, np.zeros(3), np.eye(3))
    joint = ET.SubElement(carriage, "joint", name="carriage", type="slide", axis="0 0 1")
    joint.set("armature", _text([CARRIAGE_INERTIA]))
    _add_link(carriage, hand, BASE, hand.free())
    _add_pairs(root, hand, physics, numerics)
    _add_actuators(root, hand, numerics)
    return ET.tostring(root, encoding="unicode")


def build(
    hand: HandDescription, item: ObjectData, physics: PhysicsConfig | None = None, numerics: Numerics | None = None
) -> Scene:
    """Compile the model of one object and the hand; gravity and friction are those of `physics`."""
    physics, numerics = physics or PhysicsConfig(), numerics or Numerics()
    if physics.friction.object != 1.0:
        # Only then does the factor of the other surface equal the coefficient.
        raise ConfigError(f"friction.object is {physics.friction.object}; the MuJoCo model needs 1")
    model = mujoco.MjModel.from_xml_string(mjcf(hand, item, physics, numerics))
    names = [model.geom(i).name for i in range(model.ngeom)]
    is_object = np.array([n.startswith("object_") for n in names])
    is_scenery = np.array([n == "table" for n in names])
    scene = Scene(
        model=model,
        hand=hand,
        object=item,
        numerics=numerics,
        is_object=is_object,
        is_scenery=is_scenery,
        is_hand=~(is_object | is_scenery),
        base_body=model.body(hand.links[BASE].name).id,
        object_body=model.body("object").id,
    )
    for link in hand.free():
        joint = model.joint(hand.links[link].joint)
        scene.joints[link] = (int(joint.qposadr[0]), int(joint.dofadr[0]))
    for actuator in hand.actuators:
        driven = actuator.joints if actuator.servo else ()
        names = [f"{actuator.name} {hand.links[link].joint}" for link, _, _ in driven]
        names = [actuator.name] if actuator.spool is not None else names
        scene.actuators.append([model.actuator(name).id for name in names])
    return scene
