"""MJCF hands as URDFs: MuJoCo's own compiler reads the model, and every body with a joint becomes a link.

Bodies without a joint are part of their parent. Equalities between two joints, and tendons of two joints whose length
an equality holds, become mimic joints, and so do the joints of closed loops (`graspbox.hands.mjcf_loops`). What a tree
of such links cannot say is refused, by name. Needs ``mujoco``, from the extra ``mjcf``.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from graspbox._common.extras import imported
from graspbox._common.rotations import euler_from_rotation
from graspbox.errors import GraspboxError, HandError
from graspbox.hands.mesh_fits import MeshFit, Primitive, fit_mesh
from graspbox.hands.mjcf_loops import Coupling, LoopFit, couple_loops
from graspbox.hands.urdf_meshes import FittedUrdf, element_of
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
    shapes: list[tuple[str, Primitive]] = field(default_factory=list)
    #: Mass, centre of mass and inertia about it, in the link's frame, of each body.
    masses: list[tuple[float, Array, Array]] = field(default_factory=list)


def urdf_of_mjcf(path: str | os.PathLike[str]) -> FittedUrdf:
    """Convert an MJCF hand to a URDF with primitives.

    Parameters
    ----------
    path : str or PathLike
        The MJCF file, with one tree of bodies; its meshes are where it says.

    Returns
    -------
    FittedUrdf
        The URDF, the fits of the collision meshes by the name of their collider, and those of closed loops.

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
        self._links: dict[int, _Link] = {}
        #: The link that each body is part of.
        self._link_of: dict[int, _Link] = {}
        self.fits: dict[str, MeshFit] = {}
        self.loops: dict[str, LoopFit] = {}
        for body in range(1, model.nbody):
            self._add(body, body == roots[0])

    def urdf(self) -> FittedUrdf:
        """Write the URDF."""
        robot = ElementTree.Element("robot", name=self._name)
        mimics = self._mimics()
        for link in self._links.values():
            self._write_link(robot, link)
        for link in self._links.values():
            if (joint := self._joint(link.body)) is not None:
                self._write_joint(robot, link, joint, mimics)
        ElementTree.indent(robot)
        return FittedUrdf(ElementTree.tostring(robot, encoding="unicode") + "\n", self.fits, self.loops)

    def _name_of(self, kind: str, index: int) -> str:
        """Name an element of the model; unnamed ones by their number."""
        found = self._mujoco.mj_id2name(self._model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), index)
        return str(found or f"{kind}_{index}")

    def _joint(self, body: int) -> int | None:
        """Find the joint of a body; None without one, or if it is free."""
        kinds = self._mujoco.mjtJoint
        first, count = int(self._model.body_jntadr[body]), int(self._model.body_jntnum[body])
        joints = [j for j in range(first, first + count) if self._model.jnt_type[j] != int(kinds.mjJNT_FREE)]
        if len(joints) > 1:
            names = ", ".join(self._name_of("joint", j) for j in joints)
            called = self._name_of("body", body)
            raise HandError(f"body {called!r} has several joints ({names}); put a body between them")
        if joints and self._model.jnt_type[joints[0]] not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
            raise HandError(f"joint {self._name_of('joint', joints[0])!r} is a ball; use hinges and slides")
        return joints[0] if joints else None

    def _add(self, body: int, is_root: bool) -> None:
        """Make a link of a body, or add it to its parent's."""
        pose = _pose(self._data.xpos[body], self._data.xmat[body].reshape(3, 3))
        joint = self._joint(body)
        if joint is not None and is_root:
            raise HandError(f"body {self._name_of('body', body)!r} is the base and has a joint; put it on a fixed body")
        if joint is not None or is_root:
            if joint is not None:
                pose[:3, 3] += pose[:3, :3] @ self._model.jnt_pos[joint]
            self._links[body] = _Link(self._name_of("body", body), body, pose)
            link = self._links[body]
        else:
            link = self._link_of[int(self._model.body_parentid[body])]
        self._link_of[body] = link
        link_from_world = np.linalg.inv(link.pose)
        if (mass := float(self._model.body_mass[body])) > 0.0:
            principal = link_from_world @ _pose(self._data.xipos[body], self._axes_of_inertia(body))
            inertia = principal[:3, :3] @ np.diag(self._model.body_inertia[body]) @ principal[:3, :3].T
            link.masses.append((mass, principal[:3, 3], inertia))
        for geom in np.flatnonzero(self._model.geom_bodyid == body).tolist():
            if self._model.geom_contype[geom] or self._model.geom_conaffinity[geom]:
                at = link_from_world @ self._geom_pose(geom)
                link.shapes += [(name, _moved(at, shape)) for name, shape in self._shapes(geom)]

    def _axes_of_inertia(self, body: int) -> Array:
        """Return the axes of a body's inertia in the world, (3, 3)."""
        found = np.zeros(9)
        self._mujoco.mju_quat2Mat(found, self._model.body_iquat[body])
        return np.asarray(self._data.xmat[body].reshape(3, 3) @ found.reshape(3, 3))

    def _geom_pose(self, geom: int) -> Array:
        """Return the pose of a geometry in the world."""
        turn = np.zeros(9)
        self._mujoco.mju_quat2Mat(turn, self._model.geom_quat[geom])
        body = int(self._model.geom_bodyid[geom])
        world_from_body = _pose(self._data.xpos[body], self._data.xmat[body].reshape(3, 3))
        return np.asarray(world_from_body @ _pose(self._model.geom_pos[geom], turn.reshape(3, 3)))

    def _shapes(self, geom: int) -> list[tuple[str, Primitive]]:
        """Make the primitives of a geometry, in its frame, with their names."""
        kinds, size, name = self._mujoco.mjtGeom, self._model.geom_size[geom], self._name_of("geom", geom)
        kind = self._model.geom_type[geom]
        if kind == int(kinds.mjGEOM_BOX):
            return [(name, Primitive("box", np.eye(4), tuple((2.0 * size).tolist())))]
        if kind == int(kinds.mjGEOM_SPHERE):
            return [(name, Primitive("sphere", np.eye(4), (float(size[0]),)))]
        if kind == int(kinds.mjGEOM_CYLINDER):
            return [(name, Primitive("cylinder", np.eye(4), (float(size[0]), float(2.0 * size[1]))))]
        if kind == int(kinds.mjGEOM_CAPSULE):
            ends = [_pose(np.array([0.0, 0.0, end * size[1]]), np.eye(3)) for end in (-1.0, 1.0)]
            parts = [Primitive("cylinder", np.eye(4), (float(size[0]), float(2.0 * size[1])))]
            parts += [Primitive("sphere", end, (float(size[0]),)) for end in ends]
            return [(f"{name}.{number}", part) for number, part in enumerate(parts)]
        if kind != int(kinds.mjGEOM_MESH):
            known = "box, sphere, cylinder, capsule and mesh"
            raise HandError(f"geom {name!r} is none of {known}; replace it, or set contype and conaffinity to 0")
        fit = self.fits[name] = self._fit(geom, name)
        if len(fit.primitives) == 1:
            return [(name, fit.primitives[0])]
        return [(f"{name}.{number}", part) for number, part in enumerate(fit.primitives)]

    def _fit(self, geom: int, name: str) -> MeshFit:
        """Fit primitives to a mesh."""
        model, mesh = self._model, int(self._model.geom_dataid[geom])
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        try:
            return fit_mesh(mesh_from_arrays(vertices.astype(np.float64), faces, name=name))
        except GraspboxError as error:
            raise HandError(f"geom {name!r}: {error}") from None

    def _mimics(self) -> dict[int, Coupling]:
        """Find the joints that follow others: the leader, ratio and offset of each."""
        model, kinds = self._model, self._mujoco.mjtEq
        found: dict[int, Coupling] = {}
        closed: list[int] = []
        for number in np.flatnonzero(model.eq_active0).tolist():
            name, data = self._name_of("equality", number), model.eq_data[number]
            first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            if model.eq_type[number] == int(kinds.mjEQ_JOINT) and second >= 0:
                if np.any(data[2:5]):
                    raise HandError(f"equality {name!r} is not linear; leave two coefficients of polycoef")
                rest = model.qpos0[model.jnt_qposadr[[first, second]]]
                offset = float(rest[0] + data[0] - data[1] * rest[1])
                found[first] = (second, float(data[1]), offset)
            elif model.eq_type[number] == int(kinds.mjEQ_TENDON) and second < 0:
                follower, *follows = self._along(first, name)
                found[follower] = (int(follows[0]), float(follows[1]), float(follows[2]))
            elif model.eq_type[number] == int(kinds.mjEQ_CONNECT):
                closed.append(number)
            else:
                raise HandError(f"equality {name!r} fixes two bodies, or holds one joint; a hand is a tree of links")
        led = {joint: self._led(joint, found) for joint in found}
        further, self.loops = couple_loops(self._mujoco, model, closed, led)
        return {**led, **further}

    def _along(self, tendon: int, equality: str) -> tuple[int, int, float, float]:
        """Find the follower, leader, ratio and offset of two joints along a tendon of constant length."""
        model = self._model
        wraps = range(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
        if len(wraps) != 2 or any(model.wrap_type[w] != int(self._mujoco.mjtWrap.mjWRAP_JOINT) for w in wraps):
            raise HandError(f"equality {equality!r} holds a tendon of other than two joints; a joint follows one other")
        leader, follower = (int(model.wrap_objid[w]) for w in wraps)
        of_leader, of_follower = (float(model.wrap_prm[w]) for w in wraps)
        rest = float(model.tendon_length0[tendon])
        return follower, leader, -of_leader / of_follower, rest / of_follower

    @staticmethod
    def _led(joint: int, found: dict[int, Coupling]) -> Coupling:
        """Follow a chain of followers to the joint that leads all of them."""
        leader, ratio, offset = found[joint]
        for _ in found:
            if leader not in found:
                return leader, ratio, offset
            next_leader, next_ratio, next_offset = found[leader]
            leader, ratio, offset = next_leader, ratio * next_ratio, ratio * next_offset + offset
        raise HandError("equalities of joints form a cycle; leave one of them out")

    def _write_link(self, robot: ElementTree.Element, link: _Link) -> None:
        element = ElementTree.SubElement(robot, "link", name=link.name)
        mass, center, inertia = _together(link.masses)
        inertial = ElementTree.SubElement(element, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=_text(center), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=f"{mass:.9g}")
        pairs = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))
        entries = {f"i{axes}": f"{inertia[a, b]:.9g}" for axes, a, b in pairs}
        ElementTree.SubElement(inertial, "inertia", entries)
        for name, shape in link.shapes:
            element.append(element_of(name, shape.pose, shape))

    def _write_joint(self, robot: ElementTree.Element, link: _Link, joint: int, mimics: dict[int, Coupling]) -> None:
        model, parent = self._model, self._link_of[int(self._model.body_parentid[link.body])]
        kind = "prismatic" if model.jnt_type[joint] == int(self._mujoco.mjtJoint.mjJNT_SLIDE) else "revolute"
        name = self._name_of("joint", joint)
        element = ElementTree.SubElement(robot, "joint", name=name, type=kind)
        at = np.linalg.inv(parent.pose) @ link.pose
        (angles,) = euler_from_rotation(at[None, :3, :3])
        ElementTree.SubElement(element, "origin", xyz=_text(at[:3, 3]), rpy=_text(angles))
        ElementTree.SubElement(element, "parent", link=parent.name)
        ElementTree.SubElement(element, "child", link=link.name)
        ElementTree.SubElement(element, "axis", xyz=_text(model.jnt_axis[joint]))
        low, high = self._limits(joint, mimics)
        limits = {"lower": f"{low:.9g}", "upper": f"{high:.9g}", "effort": f"{self._effort(joint):.9g}"}
        ElementTree.SubElement(element, "limit", {**limits, "velocity": f"{_SPEED:.9g}"})
        if joint in mimics:
            leader, ratio, offset = mimics[joint]
            words = {"multiplier": f"{ratio:.9g}", "offset": f"{offset:.9g}"}
            ElementTree.SubElement(element, "mimic", {"joint": self._name_of("joint", leader), **words})

    def _limits(self, joint: int, mimics: dict[int, Coupling]) -> tuple[float, float]:
        """Return the range of a joint in the URDF, whose position 0 is MuJoCo's; that of a follower is its leader's."""
        if joint in mimics:
            leader, ratio, offset = mimics[joint]
            ends = sorted(ratio * end + offset for end in self._limits(leader, {}))
            return ends[0], ends[1]
        if not self._model.jnt_limited[joint]:
            return -_RANGE, _RANGE
        low, high = self._model.jnt_range[joint]
        return float(low), float(high)

    def _effort(self, joint: int) -> float:
        """Return the greatest force of the actuators of a joint, N m or N."""
        model = self._model
        drives = (model.actuator_trntype == int(self._mujoco.mjtTrn.mjTRN_JOINT)) & (
            model.actuator_trnid[:, 0] == joint
        )
        forces = [
            max(np.abs(model.actuator_forcerange[a]).max(), 0.0) if model.actuator_forcelimited[a]
            else abs(model.actuator_gainprm[a, 0]) * np.abs(model.actuator_ctrlrange[a]).max()
            for a in np.flatnonzero(drives).tolist()
        ]  # fmt: skip
        found = max(map(float, forces), default=0.0)
        return found if found > 0.0 else _EFFORT


def _pose(position: Array, rotation: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def _moved(pose: Array, shape: Primitive) -> Primitive:
    return Primitive(shape.kind, pose @ shape.pose, shape.size)


def _together(masses: list[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Return mass, centre of mass, and inertia about it, of bodies together."""
    total = sum(mass for mass, _, _ in masses)
    if total < _LEAST_MASS:
        return _LEAST_MASS, np.zeros(3), np.eye(3) * _LEAST_INERTIA
    center = np.sum([mass * at for mass, at, _ in masses], axis=0) / total
    inertia = np.zeros((3, 3))
    for mass, at, own in masses:
        away = at - center
        inertia += own + mass * (away @ away * np.eye(3) - np.outer(away, away))
    return total, center, inertia


def _text(values: Array) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
