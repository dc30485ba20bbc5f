"""Limits of the formats, as sentences: in every exported ``scene.json`` and in the guide."""

from typing import Literal, TypeAlias

__all__ = ["FORMATS", "NOT_EXPRESSED", "Format", "not_expressed"]

#: Formats of exported scenes.
Format: TypeAlias = Literal["mjcf", "usd", "urdf"]
FORMATS: tuple[Format, ...] = ("mjcf", "usd", "urdf")

_LOCKED = "Self-locking drives (the swivels of the ReFlex) are fixed; export again for another preshape."
_SENSORS = "Tactile sensors and joint encoders of the hand are left out."
_INFINITE = "The table is an infinite plane; that of graspbox has sides of 1.2 m."
_FRICTION_OF_ONE = (
    "MuJoCo's friction is the larger coefficient of two geoms: the object has 2e-5, so that the other surface's "
    "applies, which is the product of both factors; objects that you add need explicit pairs."
)
_FRICTION_OF_SEVERAL = (
    "Several objects have the square of their friction factor, which applies where two of them meet; table, walls and "
    "hand have a higher priority and the products of both factors."
)
_COMBINATION = (
    "UsdPhysics does not define how two frictions combine: graspbox multiplies them, as PhysX does for these "
    "files; other readers may average."
)
_FILES = "A URDF contains one articulated body: object, table and hand are separate files; scene.json has their poses."
_CONTACT = (
    "Friction of object and table is the element contact, which Bullet reads (and multiplies with the other "
    "body's); other readers ignore it."
)

#: Properties of a scene that a file of each format cannot express.
NOT_EXPRESSED: dict[Format, tuple[str, ...]] = {
    "mjcf": (
        "Actuators do not move by themselves: ctrl of a tendon is spool_radius x position, ctrl of a servo is ratio x "
        "position + offset; positions grow by 'speed' until the load reaches 'load_limit' (actuators in scene.json).",
        "The damper of a drive acts between drive and joints, MuJoCo's only on the joints: add damping / stiffness x "
        "the rate of ctrl to ctrl while the drive moves.",
        "At its force limit a tendon or servo keeps a fifth of its damping on the joints; MuJoCo drops all of it.",
        "A slack tendon does not pull; MuJoCo's can pull for a moment, by its damping, while a joint opens.",
        "Soft stops are tendons; limits of joints are for other readers, and act in MuJoCo where a stop has yielded by "
        "0.5 rad, or half the range of a slider (margin).",
        _LOCKED,
        _INFINITE,
        _FRICTION_OF_ONE,
        _FRICTION_OF_SEVERAL,
        _SENSORS,
    ),
    "usd": (
        "UsdPhysics has no tendons: each is a prim below tendons with joints, moment arms, stiffness, damping and "
        "greatest tension; apply moment arm x tension to its joints.",
        "Drives of tendon-driven joints are their springs; drives of servos are the servos, and the damping of their "
        "joints is the attribute graspbox:damping.",
        "Soft stops are hard limits; their stiffness is the attribute graspbox:stopStiffness.",
        "Rotor inertia is the attribute graspbox:armature.",
        "A spring whose rest is outside of the joint's limits has its drive's target at the limit, and the rest of its "
        "force as stiffness x distance / damping in the target velocity; Newton reads that with "
        "force_position_velocity_actuation=True.",
        "Couplings are NewtonMimicAPI and PhysxMimicJointAPI, positions at the start PhysicsJointStateAPI: UsdPhysics "
        "has neither, and a reader without them has free joints at zero.",
        _LOCKED,
        _COMBINATION,
        _SENSORS,
    ),
    "urdf": (
        _FILES,
        "hand.urdf is the hand's own file, with visual shapes and transmissions; tendons, springs, damping, armature, "
        "soft stops, servos and friction are in hand.toml next to it.",
        "Bullet ignores the element mimic, so that such joints are free.",
        _CONTACT,
        "Self-locking drives are ordinary joints: hold them at the positions in scene.json.",
        "URDF does not define which links of the hand may collide with each other.",
        _SENSORS,
    ),
}

#: Those that are not about the hand.
_WITHOUT_HAND = frozenset((_INFINITE, _FRICTION_OF_ONE, _FRICTION_OF_SEVERAL, _COMBINATION, _FILES, _CONTACT))


def not_expressed(to: Format, *, several: bool = False, hand: bool = True) -> tuple[str, ...]:
    """Return the points that concern a scene of one or several objects, with or without a hand."""
    other = _FRICTION_OF_ONE if several else _FRICTION_OF_SEVERAL
    return tuple(point for point in NOT_EXPRESSED[to] if point != other and (hand or point in _WITHOUT_HAND))
