"""MJCF hands as URDFs: MuJoCo's own compiler reads the model, and every body with a joint becomes a link.

Bodies without a joint are part of their parent. Equalities of joints and of tendons along joints become mimic joints,
and so do the joints of closed loops. A model that no tree of such links can represent is refused. Needs ``mujoco``,
from the extra ``mjcf``.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox.errors import GraspboxError, HandError
from graspbox.hands.geometry import combined_mass
from graspbox.hands.loop_fits import LoopFit
from graspbox.hands.mesh_fits import MeshFit, Primitive, fit_mesh
from graspbox.hands.mjcf import contacts
from graspbox.hands.mjcf.couplings import couple
from graspbox.hands.mjcf.forces import Force, forces
from graspbox.hands.mjcf.lines import Lines
from graspbox.hands.mjcf.loops import Coupling, actuated_joints, couple_loops, name_of
from graspbox.hands.mjcf.tree import select
from graspbox.hands.urdf_meshes import FittedUrdf, add_origin, collisions, numbers_text
from graspbox.meshes import mesh_from_arrays

__all__ = ["urdf_of_mjcf"]

Array = NDArray[np.float64]

#: Least mass of a link, kilograms, and its inertia where the file gives none, kg m2.
_LEAST_MASS, _LEAST_INERTIA = 1e-3, 1e-7
#: Range of a joint without limits, radians or metres.
_RANGE = 3.0
#: Hinges that all have ranges below this look like radians that were read as degrees, radians.
_TINY_RANGE = np.radians(7.0)
#: Most assumptions that are listed.
_MOST_ASSUMPTIONS = 200


@dataclass(eq=False)
class _Link:
    """A body with a joint, or the root, with the bodies fixed to it."""

    name: str
    body: int
    #: Its joint; None for the root.
    joint: int | None
    #: World pose of its frame with all joints at 0, (4, 4); the origin is on the joint's axis.
    pose: Array
    #: Geoms that collide, by their names.
    geoms: list[tuple[int, str]] = field(default_factory=list)
    #: Name, pose in the link's frame, and primitives of each geometry.
    shapes: list[tuple[str, Array, tuple[Primitive, ...]]] = field(default_factory=list)
    #: Mass, centre of mass and inertia about it, in the link's frame, of each body.
    masses: list[tuple[float, Array, Array]] = field(default_factory=list)


def urdf_of_mjcf(path: str | os.PathLike[str], base: str | None = None) -> FittedUrdf:
    """Convert an MJCF hand to a URDF with primitives.

    Parameters
    ----------
    path : str or PathLike
        The MJCF file.
    base : str, optional
        The body that becomes the root link, such as the palm of a hand on an arm; all that is not below it is left out.
        By default it is the body in the world that has the fingers, or the world where fingers stand in it.

    Returns
    -------
    FittedUrdf
        The URDF; the fits of collision meshes, by the name of their collider, and those of closed loops; what was
        assumed; links and colliders that do not touch each other. Position 0 of each joint is MuJoCo's. A joint whose
        force the file leaves open has the effort 0.

    Raises
    ------
    HandError
        If MuJoCo does not read it, or it has something that a hand cannot have: a joint of another kind than hinge and
        slide, several joints of one body, a loop that mimic joints cannot follow, a geometry other than box, cylinder,
        capsule, sphere and mesh.
    MissingExtraError
        Without mujoco.
    """
    mujoco = imported("mujoco", "reading MJCF hands needs the package mujoco", "mjcf")
    path = Path(path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
        lines = Lines(path)
        assumed = None if lines.states_angle else _radians(mujoco, model, path)
        if assumed is not None:
            spec = mujoco.MjSpec.from_file(str(path))
            spec.compiler.degree = False
            model = spec.compile()
    except ValueError as error:
        raise HandError(f"{path}: {' '.join(str(error).split())}") from None
    try:
        converted = _Converted(mujoco, model, path, lines, base)
        if assumed is not None:
            converted.assumptions.insert(0, assumed)
        return converted.urdf()
    except HandError as error:
        raise HandError(f"{path}: {error}") from None


def _radians(mujoco: Any, model: Any, path: Path) -> str | None:
    """Return the assumption that angles are radians, where hinges hardly move if they are degrees, MuJoCo's default.

    Files that are made to be included in others leave the unit to those.
    """
    limited = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    most = float(np.abs(model.jnt_range[limited]).max(initial=0.0))
    if not 0.0 < most < _TINY_RANGE:
        return None
    return (
        f"{path}: no <compiler angle=...>: angles are read as radians, since as degrees, MuJoCo's default, all hinges "
        f'move within {np.degrees(most):.2g} degrees of 0; write <compiler angle="degree"/> if they do'
    )


class _Converted:
    """The links of a compiled model."""

    def __init__(self, mujoco: Any, model: Any, path: Path, lines: Lines, base: str | None) -> None:
        self._mujoco, self._model, self._path, self._lines = mujoco, model, path, lines
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._selected = select(mujoco, model, data, self._lines, base)
        self.assumptions = self._selected.assumptions
        self._data = self._at_zero()
        self._links: list[_Link] = []
        #: The link that each body is part of.
        self._link_of: dict[int, _Link] = {}
        self.fits: dict[str, MeshFit] = {}
        self.loops: dict[str, LoopFit] = {}
        root = self._selected.root
        self._add_link(root, None)
        if base is None:
            self._link_of[0] = self._links[0]
        for body in self._selected.bodies:
            self._add(body)
        self._add_shapes(self._links[0], self._selected.geoms)

    def _at_zero(self) -> Any:
        """Return the model with all joints of the hand at 0: a joint with `ref` begins elsewhere."""
        data, kinds = self._mujoco.MjData(self._model), self._mujoco.mjtJoint
        for body in set(self._selected.bodies) - self._selected.fixed:
            for joint in self._joints(body):
                if int(self._model.jnt_type[joint]) in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE):
                    data.qpos[self._model.jnt_qposadr[joint]] = 0.0
        self._mujoco.mj_kinematics(self._model, data)
        return data

    def urdf(self) -> FittedUrdf:
        robot = ElementTree.Element("robot", name=self._path.stem)
        mimics = self._mimics()
        joints = [link.joint for link in self._links if link.joint is not None]
        ranges = {joint: self._limits(joint, mimics) for joint in joints}
        found = forces(self._mujoco, self._model, ranges, mimics)
        for link in self._links:
            self._write_link(robot, link)
        for link in self._links:
            if link.joint is not None:
                self._write_joint(robot, link, link.joint, mimics, ranges[link.joint], found[link.joint])
        ElementTree.indent(robot)
        text = ElementTree.tostring(robot, encoding="unicode") + "\n"
        return FittedUrdf(text, self.fits, self.loops, self._listed(), no_contact=self._apart())

    def _listed(self) -> tuple[str, ...]:
        """Return the assumptions, and how many more there are."""
        more = len(self.assumptions) - _MOST_ASSUMPTIONS
        rest = (f"{self._path}: {more} more assumptions of these kinds",) if more > 0 else ()
        return (*self.assumptions[:_MOST_ASSUMPTIONS], *rest)

    def _note(self, kind: str, index: int, text: str) -> None:
        name = name_of(self._model, kind, index)
        others = [("body", name_of(self._model, "body", int(self._model.jnt_bodyid[index])))] if kind == "joint" else []
        self.assumptions.append(f"{self._lines.of(kind, name, *others)}: {kind} {name!r}: {text}")

    def _joints(self, body: int) -> range:
        first = int(self._model.body_jntadr[body])
        return range(first, first + int(self._model.body_jntnum[body]))

    def _joint(self, body: int) -> int | None:
        """Return the joint of a body that is not part of the base; None without one."""
        kinds, model, joints = self._mujoco.mjtJoint, self._model, self._joints(body)
        if body in self._selected.fixed or not joints:
            return None
        if len(joints) > 1:
            names = ", ".join(name_of(model, "joint", j) for j in joints)
            raise HandError(
                f"body {name_of(model, 'body', body)!r} has several joints ({names}); put a body between them, or "
                "cut the hand out of what moves it (`--base`)"
            )
        if int(model.jnt_type[joints[0]]) not in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE):
            raise HandError(f"joint {name_of(model, 'joint', joints[0])!r} is a ball; use hinges and slides")
        return joints[0]

    def _add_link(self, body: int, joint: int | None) -> None:
        model, data = self._model, self._data
        pose = _pose(data.xpos[body], data.xmat[body])
        if joint is not None:
            pose[:3, 3] += pose[:3, :3] @ model.jnt_pos[joint]
        name = name_of(model, "body", body) if body else self._free_name("base")
        self._links.append(_Link(name, body, joint, pose))

    def _free_name(self, name: str) -> str:
        taken = {name_of(self._model, "body", body) for body in range(1, self._model.nbody)}
        while name in taken:
            name += "_"
        return name

    def _add(self, body: int) -> None:
        """Make a link of a body, or add it to its parent's."""
        model, data, joint = self._model, self._data, self._joint(body)
        if joint is not None:
            self._add_link(body, joint)
            link = self._links[-1]
        else:
            fixed = body in self._selected.fixed
            link = self._links[0] if fixed else self._link_of[int(model.body_parentid[body])]
        self._link_of[body] = link
        if (mass := float(model.body_mass[body])) > 0.0:
            principal = np.linalg.inv(link.pose) @ _pose(data.xipos[body], data.ximat[body])
            inertia = principal[:3, :3] @ np.diag(model.body_inertia[body]) @ principal[:3, :3].T
            link.masses.append((mass, principal[:3, 3], inertia))
        self._add_shapes(link, np.flatnonzero(model.geom_bodyid == body).tolist())

    def _add_shapes(self, link: _Link, geoms: Any) -> None:
        named, bodies = contacts.named_pairs(self._model), {link.name for link in self._links}
        bodies |= {name_of(self._model, "body", body) for body in self._selected.bodies}
        for geom in geoms:
            if contacts.collides(self._model, geom, named):
                name = name_of(self._model, "geom", geom)
                # Links and colliders share the names of `no_contact`.
                name = f"{name}_geom" if name in bodies else name
                at = np.linalg.inv(link.pose) @ _pose(self._data.geom_xpos[geom], self._data.geom_xmat[geom])
                link.geoms.append((geom, name))
                link.shapes.append((name, at, self._primitives(geom, name)))

    def _primitives(self, geom: int, name: str) -> tuple[Primitive, ...]:
        """Return the primitives of a geometry, in its frame."""
        kinds, size = self._mujoco.mjtGeom, self._model.geom_size[geom]
        kind, radius = int(self._model.geom_type[geom]), float(size[0])
        if kind == kinds.mjGEOM_BOX:
            return (Primitive("box", np.eye(4), tuple((2.0 * size).tolist())),)
        if kind == kinds.mjGEOM_SPHERE:
            return (Primitive("sphere", np.eye(4), (radius,)),)
        if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
            ends = (-1.0, 1.0) if kind == kinds.mjGEOM_CAPSULE else ()
            spheres = [_pose(np.array([0.0, 0.0, end * size[1]]), np.eye(3)) for end in ends]
            cylinder = Primitive("cylinder", np.eye(4), (radius, float(2.0 * size[1])))
            return (cylinder, *(Primitive("sphere", pose, (radius,)) for pose in spheres))
        if kind != kinds.mjGEOM_MESH:
            known = "box, sphere, cylinder, capsule and mesh"
            raise HandError(f"geom {name!r} is none of {known}; replace it, or set contype and conaffinity to 0")
        mesh = self._model.mesh(int(self._model.geom_dataid[geom]))
        vertices = self._model.mesh_vert[int(mesh.vertadr[0]) :][: int(mesh.vertnum[0])]
        faces = self._model.mesh_face[int(mesh.faceadr[0]) :][: int(mesh.facenum[0])]
        try:
            self.fits[name] = fit_mesh(mesh_from_arrays(vertices.astype(np.float64), faces, name=name))
        except GraspboxError as error:
            raise HandError(f"geom {name!r}: {error}") from None
        return self.fits[name].primitives

    def _mimics(self) -> dict[int, Coupling]:
        """Return the leader, ratio and offset of each joint that follows another."""
        model = self._model
        joints = [link.joint for link in self._links if link.joint is not None]
        numbers = {id(link): number for number, link in enumerate(self._links)}
        links = {body: numbers[id(link)] for body, link in self._link_of.items()}
        found = couple(self._mujoco, model, joints, links, actuated_joints(self._mujoco, model))
        for number in found.ignored:
            self._note("equality", number, "is not between moving parts of the hand; it is left out")
        further, self.loops = couple_loops(self._mujoco, model, found.closed, found.of)
        return {**found.of, **further}

    def _apart(self) -> tuple[tuple[str, ...], ...]:
        """List the links and shapes that do not touch each other, of links that could."""
        parents = {id(link): self._link_of[int(self._model.body_parentid[link.body])] for link in self._links[1:]}
        base = self._links[0]

        def chain(link: _Link) -> list[_Link]:
            links = [link]
            while links[-1] is not base:
                links.append(parents[id(links[-1])])
            return links

        pairs, shaped = [], [link for link in self._links if link.shapes]
        for number, first in enumerate(shaped):
            for second in shaped[number + 1 :]:
                one, two = chain(first), chain(second)
                of_palm = first is base and any(between.shapes for between in two[1:-1])
                if of_palm or (first is not base and one[-2] is not two[-2]):
                    pairs.append((first.name, second.name))
        return contacts.apart(self._model, pairs, {link.name: link.geoms for link in shaped})

    def _write_link(self, robot: ElementTree.Element, link: _Link) -> None:
        element = ElementTree.SubElement(robot, "link", name=link.name)
        least = (_LEAST_MASS, np.zeros(3), np.eye(3) * _LEAST_INERTIA)
        heavy = sum(mass for mass, _, _ in link.masses) >= _LEAST_MASS
        mass, center, inertia = combined_mass(link.masses) if heavy else least
        if not heavy and link.body:
            self._note("body", link.body, f"has less than {_LEAST_MASS:g} kg; it gets this mass")
        inertial = ElementTree.SubElement(element, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=numbers_text(center), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=numbers_text([mass]))
        pairs = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))
        ElementTree.SubElement(inertial, "inertia", {f"i{axes}": numbers_text([inertia[a, b]]) for axes, a, b in pairs})
        for shape in link.shapes:
            element.extend(collisions(*shape))

    def _write_joint(
        self,
        robot: ElementTree.Element,
        link: _Link,
        joint: int,
        mimics: dict[int, Coupling],
        limits: tuple[float, float],
        force: Force,
    ) -> None:
        model, parent = self._model, self._link_of[int(self._model.body_parentid[link.body])]
        kind = "prismatic" if model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
        element = ElementTree.SubElement(robot, "joint", name=name_of(model, "joint", joint), type=kind)
        add_origin(element, np.linalg.inv(parent.pose) @ link.pose)
        ElementTree.SubElement(element, "parent", link=parent.name)
        ElementTree.SubElement(element, "child", link=link.name)
        ElementTree.SubElement(element, "axis", xyz=numbers_text(model.jnt_axis[joint]))
        known = "effort: " if force.value else "effort unknown: "
        element.append(ElementTree.Comment(f" {known}{force.source.replace('--', '- -')}; MJCF has no speed "))
        if not force.value and joint not in mimics:
            unknown = f"its greatest force is unknown ({force.source}); effort is 0, and load_limit a guess"
            self._note("joint", joint, unknown)
        # Every digit: a follower stays within the range that follows from its leader's.
        bounds = dict(zip(("lower", "upper"), map(_exact, limits), strict=True))
        ElementTree.SubElement(element, "limit", {**bounds, "effort": numbers_text([force.value]), "velocity": "0"})
        if joint in mimics:
            leader, ratio, offset = mimics[joint]
            law = {"multiplier": _exact(ratio), "offset": _exact(offset)}
            ElementTree.SubElement(element, "mimic", {"joint": name_of(model, "joint", leader), **law})

    def _limits(self, joint: int, mimics: dict[int, Coupling]) -> tuple[float, float]:
        """Return the range of a joint in the URDF, whose position 0 is MuJoCo's; that of a follower is its leader's."""
        if joint in mimics:
            leader, ratio, offset = mimics[joint]
            low, high = sorted(ratio * end + offset for end in self._limits(leader, {}))
        elif self._model.jnt_limited[joint]:
            low, high = self._model.jnt_range[joint].tolist()
        else:
            low, high = -_RANGE, _RANGE
            text = f"has no range; it gets {-_RANGE:g} to {_RANGE:g}"
            if not any(
                text in note and f"joint {name_of(self._model, 'joint', joint)!r}" in note for note in self.assumptions
            ):
                self._note("joint", joint, text)
        return low, high


def _exact(value: float) -> str:
    """Write a number with all its digits."""
    return repr(float(value) + 0.0).removesuffix(".0")


def _pose(position: Array, rotation: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), position
    return pose
