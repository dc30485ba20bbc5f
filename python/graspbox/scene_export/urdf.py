"""URDF files of objects, of the table and of walls; the hand's URDF is copied from its own file."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from graspbox.configs import PhysicsConfig
from graspbox.scene_export.contents import TABLE_SIDE, TABLE_THICKNESS, ObjectData, WallData, number_text

__all__ = ["object_urdf", "table_urdf", "wall_urdf"]


def _add_friction(link: ET.Element, friction: float) -> None:
    """Add Bullet's element for friction; Bullet multiplies the coefficients of two bodies."""
    contact = ET.SubElement(link, "contact")
    ET.SubElement(contact, "lateral_friction", value=number_text([friction]))


def _written(robot: ET.Element) -> str:
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def object_urdf(item: ObjectData, parts: list[str], visual: str | None, physics: PhysicsConfig) -> str:
    """Return the URDF of an object: one link with inertial, visual mesh and convex parts.

    Parameters
    ----------
    item : ObjectData
        The object.
    parts : list of str
        File of each convex part, relative to the URDF.
    visual : str or None
        File of the visual mesh.
    physics : PhysicsConfig
        Its friction factor is the object's.
    """
    robot = ET.Element("robot", name=item.name)
    link = ET.SubElement(robot, "link", name="object")
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=number_text(item.center), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number_text([item.mass]))
    moments = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {name: number_text([item.inertia[at]]) for name, at in moments.items()})
    shapes = [("collision", f"part_{i}", file) for i, file in enumerate(parts)]
    for kind, name, file in ([("visual", "visual", visual)] if visual else []) + shapes:
        element = ET.SubElement(link, kind, name=name)
        ET.SubElement(element, "origin", xyz="0 0 0", rpy="0 0 0")
        ET.SubElement(ET.SubElement(element, "geometry"), "mesh", filename=file)
    _add_friction(link, physics.friction.object)
    return _written(robot)


def table_urdf(physics: PhysicsConfig) -> str:
    """Return the URDF of the table top, whose upper face is the plane z = 0; it has no mass and is to be fixed."""
    size = (TABLE_SIDE, TABLE_SIDE, TABLE_THICKNESS)
    return _fixed_box("table", (0, 0, -TABLE_THICKNESS / 2), size, physics.friction.table)


def wall_urdf(name: str, wall: WallData, physics: PhysicsConfig) -> str:
    """Return the URDF of a wall in its own frame; it has no mass and is to be fixed at its pose."""
    x, y, z = (2.0 * float(half) for half in wall.half_extents)
    return _fixed_box(name, (0, 0, 0), (x, y, z), physics.friction.table)


def _fixed_box(
    name: str, center: tuple[float, float, float], sides: tuple[float, float, float], friction: float
) -> str:
    robot = ET.Element("robot", name=name)
    link = ET.SubElement(robot, "link", name=name)
    for kind in ("visual", "collision"):
        element = ET.SubElement(link, kind, name=f"{name}_{kind}")
        ET.SubElement(element, "origin", xyz=number_text(center), rpy="0 0 0")
        ET.SubElement(ET.SubElement(element, "geometry"), "box", size=number_text(sides))
    _add_friction(link, friction)
    return _written(robot)
