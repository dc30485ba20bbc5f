"""An MJCF model of the core's hand, objects, walls, table and friction.

* The hand is mounted on a carriage that slides along the world's z; contact forces do not move it, because its armature
  is very large. A replay prescribes its position and velocity at every step; an exported scene has an actuator for it.
* The base and rigidly driven links are bodies without joints; their poses are those of one start, or set later.
* The table is an infinite plane: an object that falls off the edge of the core's table fails in both engines, and a box
  would cost collision tests at every step.
* A tendon is a fixed tendon with the moment arms, pulled by an actuator with the affine law ``k stretch + d rate``,
  clamped to ``[0, max_tension]``. A servo is a position actuator with limited force, and a mimic joint an equality
  constraint. A soft stop is a tendon of one joint with a spring that has the joint's range as its dead band. The limit
  of the joint itself, which other readers need, begins where the stop has yielded by `STOP_YIELD`.
* An exported model has the pose of the start without its keyframe: ``ref`` is the position at which bodies are written.
* The friction coefficient of a pair is the product of its two factors. For contacts of the object, whose geoms have
  `_LEAST_FRICTION`, MuJoCo's maximum of the two is the other surface's, which is the product. Several objects meet each
  other, too, with the square of their factor; where one meets something else, MuJoCo takes the coefficient of the geom
  with the higher priority, the other's. All other contacts are explicit pairs, which also define the self-collisions of
  the hand: links of different chains, and the palm with links not adjacent to it.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.hands.description import BASE, Array, HandDescription, Link, joint_motion
from graspbox.tools.scene_export.contents import (
    TABLE_SIDE,
    ObjectData,
    Start,
    WallData,
    object_names,
    object_title,
    quaternion,
    wall_names,
)
from graspbox.tools.scene_export.elements import add, number_text
from graspbox.tools.scene_export.mesh_files import MeshFiles, hull_faces

#: Inertia of the carriage, kg: 100 N of contact force change its speed by 1e-5 m/s in a step.
CARRIAGE_INERTIA = 1e4
#: How far a soft stop yields before MuJoCo's own limit of the joint acts, rad or share of a slider's range. This limit
#: is no spring: at the stop it would change its stiffness.
STOP_YIELD = 0.5
#: Friction of objects, which that of the other surface exceeds: MuJoCo takes 1e-5 at least; mujoco_warp warns of less.
_LEAST_FRICTION = 2e-5
#: Name of the keyframe at which a trial begins, and of the actuator that lifts the carriage.
KEYFRAME, LIFT = "start", "lift"
#: MuJoCo's group of the actuator that lifts, apart from the hand's (0), so that a replay can disable it.
LIFT_GROUP = 1
#: Natural frequency of the carriage's critically damped position actuator, rad/s.
_LIFT_FREQUENCY = 50.0
#: Colours of objects, the table, walls, the hand's pads and its other shapes.
_OBJECT_RGBA, _TABLE_RGBA, _WALL_RGBA = "0.85 0.55 0.25 1", "0.9 0.87 0.8 1", "0.62 0.6 0.56 1"
_PAD_RGBA, _BARE_RGBA = "0.1 0.33 0.4 1", "0.78 0.8 0.84 1"
#: Beginnings of the names of geoms that are not the hand's.
_RESERVED = ("object_", "wall_")
#: MuJoCo's groups of geoms: visible and hidden by default.
_SHOWN, _HIDDEN = "1", "3"


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


@dataclass(frozen=True)
class ExportedParts:
    """Parts of an exported model that one for replays lacks; it also has colours and a lift."""

    start: Start | None
    #: Of each object.
    files: Sequence[MeshFiles]
    comments: Sequence[str]


def _placed(pose: Array) -> dict[str, Array]:
    return {"pos": pose[:3, 3], "quat": quaternion(pose[:3, :3])}


def _add_inertial(body: ET.Element, mass: float, center: Array, inertia: Array) -> None:
    if mass == 0.0:  # a frame: MuJoCo refuses zeros as fullinertia
        add(body, "inertial", pos=center, mass=mass, diaginertia=np.zeros(3))
        return
    i = inertia
    full = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    add(body, "inertial", pos=center, mass=mass, fullinertia=full)


class _Builder:
    """Builder of a model; one with a `start` has the hand there, and one that is `exported` has colours."""

    def __init__(
        self,
        name: str,
        physics: PhysicsConfig,
        numerics: Numerics,
        start: Start | None = None,
        exported: bool = False,
        several: bool = False,
    ):
        self.physics, self.numerics, self.start = physics, numerics, start
        self.exported, self.several = exported, several
        self.root = ET.Element("mujoco", model=name)
        add(self.root, "compiler", angle="radian", autolimits="false", boundmass="0")
        option = add(self.root, "option", integrator="implicitfast", cone="elliptic", solver="Newton")
        for setting in ("timestep", "impratio", "noslip_iterations", "iterations"):
            option.set(setting, number_text([getattr(numerics, setting)]))
        option.set("gravity", number_text([0, 0, -physics.gravity]))
        add(add(self.root, "default"), "geom", condim="3", solref=numerics.solref, solimp=numerics.solimp)
        self.world = add(self.root, "worldbody")
        #: Names of the geoms that neither move nor belong to the hand.
        self.scenery: list[str] = []

    def text(self, comments: Sequence[str] = ()) -> str:
        """Return the model; an exported one is indented, with comments at its top."""
        if comments:
            ET.indent(self.root)
        text = ET.tostring(self.root, encoding="unicode")
        return "".join(f"<!-- {comment.replace('--', '- -')} -->\n" for comment in comments) + text

    def add_looks(self) -> None:
        """Add lights and a sky to an exported scene."""
        headlight = {"ambient": "0.35 0.35 0.35", "diffuse": "0.3 0.3 0.3", "specular": "0 0 0"}
        add(add(self.root, "visual"), "headlight", **headlight)
        sky = {"rgb1": "1 1 1", "rgb2": "0.85 0.88 0.92", "width": "64", "height": "64"}
        add(add(self.root, "asset"), "texture", type="skybox", builtin="gradient", **sky)
        light = {"pos": "-0.5 -0.5 1.5", "dir": "0.33 0.33 -1", "diffuse": "0.6 0.6 0.6", "specular": "0.1 0.1 0.1"}
        add(self.world, "light", **light)

    def _add_fixed(
        self, parent: ET.Element, name: str, kind: str, size: ArrayLike, friction: float, rgba: str, **pose: Array
    ) -> None:
        """Add a geom of the scenery or the hand, which only objects collide with by default."""
        factors = (friction * self.physics.friction.object, 0, 0)
        color = rgba if self.exported else None
        geom = add(parent, "geom", name=name, type=kind, size=size, friction=factors, rgba=color, **pose)
        geom.set("contype", "0")
        geom.set("conaffinity", "1")
        if self.several:
            # MuJoCo takes this friction instead of that of an object.
            geom.set("priority", "1")

    def add_scenery(self, walls: Sequence[WallData]) -> None:
        """Add the table, and walls as fixed boxes with its friction."""
        friction = self.physics.friction.table
        size = (TABLE_SIDE / 2, TABLE_SIDE / 2, 1) if self.exported else (1, 1, 1)
        self._add_fixed(self.world, "table", "plane", size, friction, _TABLE_RGBA)
        names = wall_names(len(walls))
        for name, wall in zip(names, walls, strict=True):
            pose = _placed(wall.world_from_wall)
            self._add_fixed(self.world, name, "box", wall.half_extents, friction, _WALL_RGBA, **pose)
        self.scenery = ["table", *names]

    def add_objects(self, objects: Sequence[ObjectData], files: Sequence[MeshFiles] | None) -> None:
        """Add the objects of a scene; several meet each other."""
        friction = self.physics.friction.object**2 if self.several else _LEAST_FRICTION
        for number, (name, item) in enumerate(zip(object_names(len(objects)), objects, strict=True)):
            self.add_object(item, None if files is None else files[number], friction, name)

    def add_object(self, item: ObjectData, files: MeshFiles | None, friction: float, name: str) -> None:
        """Add a free body: its parts collide, its visual mesh does not."""
        assets = add(self.root, "asset")
        prefix = "" if name == "object" else f"{name}_"
        body = add(self.world, "body", name=name, **_placed(item.start))
        add(body, "freejoint", name=name)
        _add_inertial(body, item.mass, item.center, item.inertia)
        for i, points in enumerate(item.parts):
            # The inertia of a part is not used, but it defines the frame of the geom.
            mesh = add(assets, "mesh", name=f"{prefix}part_{i}", inertia="convex")
            geom = add(body, "geom", name=f"{name}_{i}", type="mesh", mesh=f"{prefix}part_{i}", contype="1")
            geom.set("conaffinity", str(int(self.several)))
            geom.set("friction", number_text([friction, 0, 0]))
            if files is None:
                # The same vertices and faces as in a file, so that both models step with the same bits.
                mesh.set("vertex", number_text(np.ravel(np.asarray(points, dtype=np.float32))))
                mesh.set("face", number_text(np.ravel(hull_faces(np.asarray(points)))))
            else:
                mesh.set("file", files.parts[i])
                geom.set("group", _SHOWN if files.visual is None else _HIDDEN)
                geom.set("rgba", _OBJECT_RGBA)
        if files is not None and files.visual is not None:
            # The mesh may enclose no volume.
            add(assets, "mesh", name=f"{prefix}visual", file=files.visual, inertia="shell")
            looks = {"mesh": f"{prefix}visual", "rgba": _OBJECT_RGBA, "group": _SHOWN}
            add(body, "geom", name=f"{name}_visual", type="mesh", contype="0", conaffinity="0", mass="0", **looks)

    def add_hand(self, hand: HandDescription, objects: Sequence[str]) -> None:
        """Add the hand on its carriage; `objects` are the names of the objects."""
        _check_names(hand, {*objects, "carriage"})
        carriage = add(self.world, "body", name="carriage")
        _add_inertial(carriage, 1.0, np.zeros(3), np.eye(3))
        add(carriage, "joint", name="carriage", type="slide", axis="0 0 1", armature=CARRIAGE_INERTIA)
        bodies: list[ET.Element] = []
        for link in hand.links:
            bodies.append(self._add_link(bodies[link.parent] if bodies else carriage, link, link.index in hand.free()))
        self._add_pairs(hand)
        self._add_actuators(hand)

    def _link_pose(self, link: Link) -> Array:
        """Return ``parent_from_link`` at the position of the start, if there is one."""
        if self.start is None:
            return link.parent_from_link
        if link.index == BASE:
            return self.start.world_from_base
        return np.asarray(link.parent_from_link @ joint_motion(link, self.start.joints.get(link.index, 0.0)))

    def _reference(self, index: int) -> float:
        """Return the position, rad or m, of a joint at which the bodies are written."""
        return 0.0 if self.start is None else self.start.joints.get(index, 0.0)

    def _add_link(self, parent: ET.Element, link: Link, free: bool) -> ET.Element:
        body = add(parent, "body", name=link.name, **_placed(self._link_pose(link)))
        _add_inertial(body, link.mass, link.center, link.inertia)
        if free:
            self._add_joint(body, link)
        for shape in link.shapes:
            rgba = _BARE_RGBA if shape.friction < 1.0 else _PAD_RGBA
            pose = _placed(shape.link_from_shape)
            self._add_fixed(body, shape.name, shape.kind, shape.size, shape.friction, rgba, **pose)
        return body

    def _add_joint(self, body: ET.Element, link: Link) -> None:
        slides, spring = link.kind == "prismatic", link.spring
        kind, reference = "slide" if slides else "hinge", self._reference(link.index)
        yields = STOP_YIELD * ((link.limits[1] - link.limits[0]) if slides else 1.0)
        joint = add(body, "joint", name=link.joint, type=kind, axis=link.axis, limited="true", range=link.limits)
        joint.set("margin", number_text([-yields]))
        for name in ("damping", "armature", "stiffness"):
            joint.set(name, number_text([getattr(spring, name)]))
        joint.set("springref", number_text([spring.reference]))
        if reference:
            joint.set("ref", number_text([reference]))

    def _add_pairs(self, hand: HandDescription) -> None:
        contact, numerics = add(self.root, "contact"), self.numerics

        def pair(one: str, two: str, friction: float) -> None:
            solver = {"solref": numerics.solref, "solimp": numerics.solimp}
            add(contact, "pair", geom1=one, geom2=two, condim="3", friction=(friction, friction, 0, 0, 0), **solver)

        for shape in shape_groups(hand):
            for name in self.scenery:
                # The carriage does not feel the palm on the table; a wall can be beside it.
                if shape.part != "palm" or name != "table":
                    pair(shape.name, name, shape.friction * self.physics.friction.table)
        for one, two in colliding_shapes(hand):
            pair(one.name, two.name, one.friction * two.friction)

    def _add_actuators(self, hand: HandDescription) -> None:
        """Add tendons, actuators, soft stops and mimic joints."""
        tendons, actuators, equality = (add(self.root, tag) for tag in ("tendon", "actuator", "equality"))
        for tendon in hand.tendons:
            fixed = add(tendons, "fixed", name=tendon.name)
            for pulled, arm in tendon.arms:
                add(fixed, "joint", joint=hand.links[pulled].joint, coef=arm)
        for index, actuator in enumerate(hand.actuators):
            names = mujoco_actuators(hand, index)
            if actuator.spool is not None:
                # ctrl is the length of tendon wound onto the spool.
                tendon = hand.tendons[actuator.spool[0]]
                law, force = (tendon.stiffness, tendon.damping), (0.0, tendon.max_tension)
                _add_actuator(actuators, names[0], law, force, tendon=tendon.name)
            elif actuator.servo is not None:
                limit = (-actuator.load_limit, actuator.load_limit)
                for name, (driven, _, _) in zip(names, actuator.joints, strict=True):
                    _add_actuator(actuators, name, actuator.servo, limit, joint=hand.links[driven].joint)
        for link in (hand.links[index] for index in hand.free()):
            stiffness = link.spring.stop_stiffness
            if stiffness > 0.0:
                stop = add(tendons, "fixed", name=f"{link.joint} stop", stiffness=stiffness, springlength=link.limits)
                add(stop, "joint", joint=link.joint, coef="1")
            if link.mimic is not None:
                leader, ratio, offset = link.mimic
                joints = {"joint1": link.joint, "joint2": hand.links[leader].joint}
                # MuJoCo's polynomial is that of the differences from `ref`.
                offset += ratio * self._reference(leader) - self._reference(link.index)
                # As stiff as the step allows: MuJoCo scales a constraint's stiffness by the small inertia of a link.
                solver = {"solref": (2.0 * self.numerics.timestep, 1.0), "solimp": (0.99, 0.999, 0.001)}
                add(equality, "joint", **joints, polycoef=(offset, ratio, 0, 0, 0), **solver)

    def add_lift(self) -> None:
        """Add a position actuator for the carriage; ctrl is the hand's height above its start, metres."""
        actuators = self.root.find("actuator")
        if actuators is not None:
            law = (CARRIAGE_INERTIA * _LIFT_FREQUENCY**2, 2.0 * CARRIAGE_INERTIA * _LIFT_FREQUENCY)
            _add_actuator(actuators, LIFT, law, None, joint="carriage", group=str(LIFT_GROUP))

    def add_keyframe(self, objects: Sequence[ObjectData]) -> None:
        """Add the state at which a trial begins: MuJoCo orders the joints as their bodies are in the file."""
        qpos: list[float] = []
        controls: list[float] | None = None
        for pose in (item.start for item in objects):
            qpos += [*pose[:3, 3], *quaternion(pose[:3, :3])]
        if self.start is not None:
            hand, joints = self.start.hand, self.start.joints
            qpos += [0.0, *(joints[index] for index in hand.free())]
            positions, controls = hand.open_positions(self.start.preshape), []
            for actuator, position in zip(hand.actuators, positions, strict=True):
                if actuator.spool is not None:
                    controls.append(actuator.spool[1] * position)
                elif actuator.servo is not None:
                    controls += [ratio * position + offset for _, ratio, offset in actuator.joints]
            controls.append(0.0)
        add(add(self.root, "keyframe"), "key", name=KEYFRAME, qpos=qpos, ctrl=controls)


@dataclass(frozen=True)
class ShapeGroup:
    """A shape of a link of the hand; its part is ``palm``, ``near`` (adjacent to the palm) or ``far``."""

    part: str
    #: Index of the chain of joints, -1 for the palm.
    chain: int
    name: str
    friction: float
    link: int


def shape_groups(hand: HandDescription) -> list[ShapeGroup]:
    """List the hand's shapes with the parts and chains that they belong to."""
    free = hand.free()
    part_of, chain_of, shaped, chains = {BASE: "palm"}, {BASE: -1}, {BASE: False}, 0
    groups: list[ShapeGroup] = []
    for index, link in enumerate(hand.links):
        if index != BASE:
            above = link.parent
            part_of[index], chain_of[index], shaped[index] = part_of[above], chain_of[above], shaped[above]
            if index in free:
                if chain_of[above] < 0:
                    chain_of[index], chains = chains, chains + 1
                part_of[index] = "far" if shaped[above] else "near"
            shaped[index] = shaped[index] or (part_of[index] != "palm" and bool(link.shapes))
        groups += [ShapeGroup(part_of[index], chain_of[index], s.name, s.friction, index) for s in link.shapes]
    return groups


def colliding_shapes(hand: HandDescription) -> list[tuple[ShapeGroup, ShapeGroup]]:
    """List the pairs of the hand's own shapes that collide."""
    pairs = []
    for one, two in itertools.combinations(shape_groups(hand), 2):
        crosses = one.chain != two.chain and "palm" not in (one.part, two.part)
        meet = crosses or {one.part, two.part} == {"palm", "far"}
        if meet and frozenset((one.name, two.name)) not in hand.no_contact:
            pairs.append((one, two))
    return pairs


def mujoco_actuators(hand: HandDescription, index: int) -> list[str]:
    """Name MuJoCo's actuators for one of the hand's: one per tendon or driven joint, none for a rigid drive."""
    actuator = hand.actuators[index]
    if actuator.spool is not None:
        return [actuator.name]
    driven = actuator.joints if actuator.servo else ()
    return [f"{actuator.name} {hand.links[link].joint}" for link, _, _ in driven]


def _check_names(hand: HandDescription, others: set[str]) -> None:
    """Refuse a hand with names that the model needs: for `others`, its bodies and their joints, or other parts."""
    own = {
        "link": ([link.name for link in hand.links], {"world", *others}),
        "joint": ([link.joint for link in hand.links], others),
        "collision": ([shape.name for link in hand.links for shape in link.shapes], {"table"}),
        "actuator": ([actuator.name for actuator in hand.actuators], {LIFT}),
    }
    for kind, (names, taken) in own.items():
        for name in names:
            if name in taken or (kind == "collision" and name.startswith(_RESERVED)):
                raise ConfigError(
                    f"the hand {hand.name!r} has the {kind} {name!r}, which the model needs for something else; rename "
                    "it in the hand's files"
                )


def _add_actuator(
    actuators: ET.Element, name: str, law: tuple[float, float], force: tuple[float, float] | None, **target: str
) -> None:
    """Add an actuator with force = k ctrl - k length - d length', clamped to an interval if there is one."""
    limits = {"forcelimited": None if force is None else "true", "forcerange": force}
    bias = (0, -law[0], -law[1])
    add(actuators, "general", name=name, biastype="affine", gainprm=law[0], biasprm=bias, **limits, **target)


def scene_model(
    objects: Sequence[ObjectData],
    walls: Sequence[WallData],
    hand: HandDescription | None,
    physics: PhysicsConfig,
    numerics: Numerics | None = None,
    *,
    exported: ExportedParts | None = None,
) -> str:
    """Return the model of a scene: table, walls, one or more objects, and perhaps a hand.

    An exported model has its meshes in files, its start as a keyframe, and an actuator that lifts the hand. Another one
    contains its meshes; the hand is in the frame of its base, for replays that place it.
    """
    start, files = (None, None) if exported is None else (exported.start, exported.files)
    title = object_title(objects) if hand is None else f"{hand.name} and {object_title(objects)}"
    builder = _Builder(title, physics, numerics or Numerics(), start, exported is not None, len(objects) > 1)
    if exported is not None:
        builder.add_looks()
    builder.add_scenery(walls)
    builder.add_objects(objects, files)
    if hand is not None:
        builder.add_hand(hand, object_names(len(objects)))
    if exported is not None:
        builder.add_lift()
        builder.add_keyframe(objects)
    return builder.text(() if exported is None else exported.comments)


def object_model(item: ObjectData, files: MeshFiles, physics: PhysicsConfig, comments: Sequence[str]) -> str:
    """Return the model of a single object; its friction is that of the object on the table."""
    builder = _Builder(item.name, physics, Numerics())
    builder.add_object(item, files, physics.friction.table * physics.friction.object, "object")
    return builder.text(comments)
