"""URDF files of objects, of the table and of walls."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from graspbox.configs import PhysicsConfig
from graspbox.hands.description import Array
from graspbox.tools.scene_export.contents import TABLE_SIDE, TABLE_THICKNESS, ObjectData, WallData
from graspbox.tools.scene_export.elements import add
from graspbox.tools.scene_export.mesh_files import MeshFiles

__all__ = ["object_urdf", "table_urdf", "wall_urdf"]


def _written(robot: ET.Element, link: ET.Element, friction: float) -> str:
    """Return the text of a URDF, with Bullet's element for friction; Bullet multiplies those of two bodies."""
    add(add(link, "contact"), "lateral_friction", value=friction)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def object_urdf(item: ObjectData, files: MeshFiles, physics: PhysicsConfig) -> str:
    """Return the URDF of an object: one link with inertial, visual mesh and convex parts."""
    robot = ET.Element("robot", name=item.name)
    link = add(robot, "link", name="object")
    _add_inertial(link, item.center, item.mass, item.inertia)
    shapes = [("collision", f"part_{i}", file) for i, file in enumerate(files.parts)]
    for kind, name, file in ([("visual", "visual", files.visual)] if files.visual else []) + shapes:
        element = add(link, kind, name=name)
        add(element, "origin", xyz="0 0 0", rpy="0 0 0")
        add(add(element, "geometry"), "mesh", filename=file)
    return _written(robot, link, physics.friction.object)


def _add_inertial(link: ET.Element, center: Array, mass: float, inertia: Array) -> None:
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=center, rpy="0 0 0")
    add(inertial, "mass", value=mass)
    moments = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    add(inertial, "inertia", **{name: inertia[at] for name, at in moments.items()})


def table_urdf(physics: PhysicsConfig) -> str:
    """Return the URDF of the table top, whose upper face is the plane z = 0; it is to be fixed."""
    size = (TABLE_SIDE, TABLE_SIDE, TABLE_THICKNESS)
    return _fixed_box("table", (0, 0, -TABLE_THICKNESS / 2), size, physics.friction.table)


def wall_urdf(name: str, wall: WallData, physics: PhysicsConfig) -> str:
    """Return the URDF of a wall in its own frame; it is to be fixed at its pose."""
    x, y, z = (2.0 * float(half) for half in wall.half_extents)
    return _fixed_box(name, (0, 0, 0), (x, y, z), physics.friction.table)


def _fixed_box(
    name: str, center: tuple[float, float, float], sides: tuple[float, float, float], friction: float
) -> str:
    robot = ET.Element("robot", name=name)
    link = add(robot, "link", name=name)
    # Bullet holds a body of mass 0 in place, and gives 1 kg to one without; others derive it from a density.
    _add_inertial(link, np.zeros(3), 0.0, np.zeros((3, 3)))
    for kind in ("visual", "collision"):
        element = add(link, kind, name=f"{name}_{kind}")
        add(element, "origin", xyz=center, rpy="0 0 0")
        add(add(element, "geometry"), "box", size=sides)
    return _written(robot, link, friction)
