"""Small hands for tests, as text of URDFs: boxes on joints, made of a few words each."""

from dataclasses import dataclass

__all__ = ["Box", "Joint", "urdf"]

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """A collision box of a link: centre and size, metres; its name, if it has one."""

    center: Vector
    size: Vector
    name: str = ""


@dataclass(frozen=True)
class Joint:
    """A joint from one link to another: where, its axis and limits, its kind, and the joint that it follows."""

    parent: str
    child: str
    at: Vector
    axis: Vector
    limits: tuple[float, float]
    kind: str = "revolute"
    follows: str = ""
    ratio: float = 1.0


def _text(values: Vector) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _link(name: str, boxes: list[Box]) -> str:
    shapes = "".join(
        f'<collision{f" name={box.name!r}" if box.name else ""}><origin xyz="{_text(box.center)}"/>'
        f'<geometry><box size="{_text(box.size)}"/></geometry></collision>'
        for box in boxes
    )
    center = boxes[0].center if boxes else (0.0, 0.0, 0.0)
    moments = " ".join(f'{axis}="4e-5"' for axis in ("ixx", "iyy", "izz")) + ' ixy="0" ixz="0" iyz="0"'
    inertial = f'<inertial><origin xyz="{_text(center)}"/><mass value="0.1"/><inertia {moments}/></inertial>'
    return f'<link name="{name}">{inertial}{shapes}</link>'


def urdf(links: dict[str, list[Box]], joints: dict[str, Joint]) -> str:
    """Write a URDF of links with their boxes, and of joints by their names; each turns or slides at 2 per second."""
    lines = [_link(name, boxes) for name, boxes in links.items()]
    for name, joint in joints.items():
        mimic = f'<mimic joint="{joint.follows}" multiplier="{joint.ratio}"/>' if joint.follows else ""
        effort = 30 if joint.kind == "prismatic" else 2
        low, high = joint.limits
        lines.append(
            f'<joint name="{name}" type="{joint.kind}"><parent link="{joint.parent}"/><child link="{joint.child}"/>'
            f'<origin xyz="{_text(joint.at)}"/><axis xyz="{_text(joint.axis)}"/>'
            f'<limit lower="{low}" upper="{high}" effort="{effort}" velocity="2"/>{mimic}</joint>'
        )
    return '<robot name="made">\n' + "\n".join(lines) + "\n</robot>\n"
