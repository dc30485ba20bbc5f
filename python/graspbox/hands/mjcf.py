"""MJCF hands as URDFs: MuJoCo's own compiler reads the model, and every body with a joint becomes a link.

Bodies without a joint are part of their parent. Equalities between two joints, and tendons of two joints whose length
an equality holds, become mimic joints, and so do the joints of closed loops (`graspbox.hands.mjcf_loops`). A model that
no tree of such links can represent is refused. Needs ``mujoco``, from the extra ``mjcf``.
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
from graspbox.hands.mesh_fits import MeshFit, Primitive, fit_mesh
from graspbox.hands.mjcf_loops import Coupling, LoopFit, couple_loops, name_of
from graspbox.hands.urdf_meshes import FittedUrdf, add_origin, collisions, numbers_text
from graspbox.meshes import mesh_from_arrays

__all__ = ["urdf_of_mjcf"]

Array = NDArray[np.float64]

#: Mass of a link whose file gives none, kilograms, and its inertia, kg m2.
_LEAST_MASS, _LEAST_INERTIA = 1e-3, 1e-7
#: Range of a joint without limits, radians or metres.
_RANGE = 3.0
#: Greatest force and speed of a joint whose file gives none: N m or N, rad/s or m/s.
_EFFORT, _SPEED = 1.0, 2.0


@dataclass(eq=False)
class _Link:
    """A body with a joint, or the root, with the bodies fixed to it."""

    name: str
    body: int
    #: World pose of its frame, whose origin is on the joint's axis, (4, 4).
    pose: Array
    #: Name, pose in the link's frame, and primitives of each geometry.
    shapes: list[tuple[str, Array, tuple[Primitive, ...]]] = field(default_factory=list)
    #: Mass, centre of mass and inertia about it, in the link's frame, of each body.
    masses: list[tuple[float, Array, Array]] = field(default_factory=list)


def urdf_of_mjcf(path: str | os.PathLike[str]) -> FittedUrdf:
    """Convert an MJCF hand, one tree of bodies, to a URDF with primitives.

    The result has the fits of collision meshes, by the name of their collider, and those of closed loops.

    Raises
    ------
    HandError
        If MuJoCo does not read it, or it has something that a hand cannot have: several trees, a joint of another kind
        than hinge and slide, several joints of one body, a loop that mimic joints cannot follow, a geometry other than
        box, cylinder, capsule, sphere and mesh.
    MissingExtraError
        Without mujoco.
    """
    mujoco = imported("mujoco", "reading MJCF hands needs the package mujoco", "mjcf")
    path = Path(path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise HandError(f"{path}: {' '.join(str(error).split())}") from None
    try:
        return _Converted(mujoco, model, path.stem).urdf()
    except HandError as error:
        raise HandError(f"{path}: {error}") from None


class _Converted:
    """The links of a compiled model."""

    def __init__(self, mujoco: Any, model: Any, name: str) -> None:
        self._mujoco, self._model, self._name = mujoco, model, name
        self._data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
        if len(roots) != 1:
            raise HandError(f"has {len(roots)} bodies in the world; a hand is one tree")
        self._links: list[_Link] = []
        #: The link that each body is part of.
        self._link_of: dict[int, _Link] = {}
        self.fits: dict[str, MeshFit] = {}
        self.loops: dict[str, LoopFit] = {}
        for body in range(1, model.nbody):
            self._add(body, body == roots[0])

    def urdf(self) -> FittedUrdf:
        robot = ElementTree.Element("robot", name=self._name)
        mimics = self._mimics()
        for link in self._links:
            self._write_link(robot, link)
        for link in self._links:
            if (joint := self._joint(link.body)) is not None:
                self._write_joint(robot, link, joint, mimics)
        ElementTree.indent(robot)
        return FittedUrdf(ElementTree.tostring(robot, encoding="unicode") + "\n", self.fits, self.loops)

    def _joint(self, body: int) -> int | None:
        """Return the joint of a body; None without one, or if it is free."""
        kinds, model = self._mujoco.mjtJoint, self._model
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = [j for j in range(first, first + count) if model.jnt_type[j] != kinds.mjJNT_FREE]
        if len(joints) > 1:
            names = ", ".join(name_of(model, "joint", j) for j in joints)
            raise HandError(
                f"body {name_of(model, 'body', body)!r} has several joints ({names}); put a body between them"
            )
        if joints and int(model.jnt_type[joints[0]]) not in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE):
            raise HandError(f"joint {name_of(model, 'joint', joints[0])!r} is a ball; use hinges and slides")
        return joints[0] if joints else None

    def _add(self, body: int, is_root: bool) -> None:
        """Make a link of a body, or add it to its parent's."""
        model, data = self._model, self._data
        joint, name = self._joint(body), name_of(model, "body", body)
        if joint is not None and is_root:
            raise HandError(f"body {name!r} is the base and has a joint; put it on a fixed body")
        if joint is not None or is_root:
            pose = _pose(data.xpos[body], data.xmat[body])
            if joint is not None:
                pose[:3, 3] += pose[:3, :3] @ model.jnt_pos[joint]
            link = _Link(name, body, pose)
            self._links.append(link)
        else:
            link = self._link_of[int(model.body_parentid[body])]
        self._link_of[body] = link
        link_from_world = np.linalg.inv(link.pose)
        if (mass := float(model.body_mass[body])) > 0.0:
            principal = link_from_world @ _pose(data.xipos[body], data.ximat[body])
            inertia = principal[:3, :3] @ np.diag(model.body_inertia[body]) @ principal[:3, :3].T
            link.masses.append((mass, principal[:3, 3], inertia))
        for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                at = link_from_world @ _pose(data.geom_xpos[geom], data.geom_xmat[geom])
                link.shapes.append((name_of(model, "geom", geom), at, self._primitives(geom)))

    def _primitives(self, geom: int) -> tuple[Primitive, ...]:
        """Return the primitives of a geometry, in its frame."""
        kinds, size, name = self._mujoco.mjtGeom, self._model.geom_size[geom], name_of(self._model, "geom", geom)
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
        model, kinds = self._model, self._mujoco.mjtEq
        followers: dict[int, Coupling] = {}
        closed: list[int] = []
        for number in np.flatnonzero(model.eq_active0).tolist():
            name, data, kind = name_of(model, "equality", number), model.eq_data[number], model.eq_type[number]
            first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            if kind == kinds.mjEQ_JOINT and second >= 0:
                if np.any(data[2:5]):
                    raise HandError(f"equality {name!r} is not linear; leave two coefficients of polycoef")
                rest = model.qpos0[model.jnt_qposadr[[first, second]]]
                followers[first] = (second, float(data[1]), float(rest[0] + data[0] - data[1] * rest[1]))
            elif kind == kinds.mjEQ_TENDON and second < 0:
                follower, coupling = self._along(first, name)
                followers[follower] = coupling
            elif kind == kinds.mjEQ_CONNECT:
                closed.append(number)
            else:
                raise HandError(f"equality {name!r} fixes two bodies, or holds one joint; a hand is a tree of links")
        led = {joint: _led(joint, followers) for joint in followers}
        further, self.loops = couple_loops(self._mujoco, model, closed, led)
        return {**led, **further}

    def _along(self, tendon: int, equality: str) -> tuple[int, Coupling]:
        """Return the follower of two joints along a tendon of constant length, with its leader, ratio and offset."""
        model = self._model
        first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        wraps = slice(first, first + count)
        if count != 2 or any(model.wrap_type[wraps] != self._mujoco.mjtWrap.mjWRAP_JOINT):
            raise HandError(f"equality {equality!r} holds a tendon of other than two joints; a joint follows one other")
        leader, follower = model.wrap_objid[wraps].tolist()
        of_leader, of_follower = model.wrap_prm[wraps].tolist()
        return follower, (leader, -of_leader / of_follower, float(model.tendon_length0[tendon]) / of_follower)

    def _write_link(self, robot: ElementTree.Element, link: _Link) -> None:
        element = ElementTree.SubElement(robot, "link", name=link.name)
        least = (_LEAST_MASS, np.zeros(3), np.eye(3) * _LEAST_INERTIA)
        heavy = sum(mass for mass, _, _ in link.masses) >= _LEAST_MASS
        mass, center, inertia = combined_mass(link.masses) if heavy else least
        inertial = ElementTree.SubElement(element, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=numbers_text(center), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=numbers_text([mass]))
        pairs = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))
        ElementTree.SubElement(inertial, "inertia", {f"i{axes}": numbers_text([inertia[a, b]]) for axes, a, b in pairs})
        for shape in link.shapes:
            element.extend(collisions(*shape))

    def _write_joint(self, robot: ElementTree.Element, link: _Link, joint: int, mimics: dict[int, Coupling]) -> None:
        model, parent = self._model, self._link_of[int(self._model.body_parentid[link.body])]
        kind = "prismatic" if model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
        element = ElementTree.SubElement(robot, "joint", name=name_of(model, "joint", joint), type=kind)
        add_origin(element, np.linalg.inv(parent.pose) @ link.pose)
        ElementTree.SubElement(element, "parent", link=parent.name)
        ElementTree.SubElement(element, "child", link=link.name)
        ElementTree.SubElement(element, "axis", xyz=numbers_text(model.jnt_axis[joint]))
        low, high = self._limits(joint, mimics)
        limits = {"lower": low, "upper": high, "effort": self._effort(joint), "velocity": _SPEED}
        ElementTree.SubElement(element, "limit", {name: numbers_text([value]) for name, value in limits.items()})
        if joint in mimics:
            leader, ratio, offset = mimics[joint]
            law = {"multiplier": numbers_text([ratio]), "offset": numbers_text([offset])}
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
        return low, high

    def _effort(self, joint: int) -> float:
        """Return the greatest force of the actuators of a joint, N m or N."""
        model = self._model
        of_joint = model.actuator_trntype == self._mujoco.mjtTrn.mjTRN_JOINT
        own = np.flatnonzero(of_joint & (model.actuator_trnid[:, 0] == joint))
        limits = np.abs(model.actuator_forcerange[own]).max(axis=1)
        commanded = np.abs(model.actuator_gainprm[own, 0]) * np.abs(model.actuator_ctrlrange[own]).max(axis=1)
        forces = np.where(model.actuator_forcelimited[own], limits, commanded)
        return float(forces.max(initial=0.0)) or _EFFORT


def _led(joint: int, followers: dict[int, Coupling]) -> Coupling:
    """Follow a chain of followers to the joint that leads all of them."""
    leader, ratio, offset = followers[joint]
    for _ in followers:
        if leader not in followers:
            return leader, ratio, offset
        next_leader, next_ratio, next_offset = followers[leader]
        leader, ratio, offset = next_leader, ratio * next_ratio, ratio * next_offset + offset
    raise HandError("equalities of joints form a cycle; leave one of them out")


def _pose(position: Array, rotation: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), position
    return pose
