"""Physics engines and their settings, as frozen dataclasses; `graspbox.configs` holds all other settings."""

from dataclasses import dataclass, field
from typing import Literal

__all__ = ["FrictionConfig", "ImplicitConfig", "PhysicsConfig", "RapierConfig"]


@dataclass(frozen=True)
class FrictionConfig:
    """Friction factors of table and object; the hand's are set in its ``hand.toml``.

    The coefficient of a pair is the product of its two factors.

    Attributes
    ----------
    table : float
        Table top and ground.
    object : float
        At 1 the coefficient equals the factor of the other surface; other values scale friction against hand and table
        alike.
    """

    table: float = 0.5
    object: float = 1.0


@dataclass(frozen=True)
class RapierConfig:
    """Settings of the engine ``rapier``, which takes several solver sub-steps per step.

    Attributes
    ----------
    prediction : float
        Distance at which contacts are predicted, metres, 0.0001 to 0.05.
    contact_drift : float
        Contacts of a pair are searched again once it has moved by this distance since the last search, metres, 0 to
        0.001; 0 searches at every step.
    solver_iterations : int
        Solver sub-steps per step, 1 to 64.
    idle_iterations : int
        Solver sub-steps while no joint of the hand moves, the hand touches nothing and the object does not tumble, 1 to
        64.
    contact_frequency, static_contact_frequency : float
        Natural frequency of contacts, and of those with hand root and table, Hz, 1 to 10,000.
    contact_damping_ratio : float
        Damping ratio of contacts, 0.01 to 100.
    allowed_penetration : float
        Penetration that is not corrected, metres, 0 to 0.005.
    """

    prediction: float = 0.002
    contact_drift: float = 5e-5
    solver_iterations: int = 4
    idle_iterations: int = 1
    contact_frequency: float = 240.0
    contact_damping_ratio: float = 2.0
    static_contact_frequency: float = 480.0
    allowed_penetration: float = 0.0005


@dataclass(frozen=True)
class ImplicitConfig:
    """Settings of the engine ``implicit``, which solves all contacts of a step together.

    Attributes
    ----------
    prediction : float
        Gap up to which a point counts as a contact, beyond the distance that the bodies cover in a step, metres, 0.0001
        to 0.05.
    contact_drift : float
        Contacts of a pair are searched again once it has moved by this distance since the last search, metres, 0 to
        0.001; 0 searches at every step.
    contact_stiffness : float
        Stiffness of a contact point, N/m, 1000 to 1e7.
    contact_relaxation : float
        Relaxation time of a contact that penetrates, seconds, 0 to 0.1: its damping is its stiffness times this.
    support_stiffness : float
        Least stiffness of a contact that supports the object on table or palm, per kg of the object, N/(m kg), 0 to
        1e7.
    penetration_cap : float
        Penetration up to which the whole depth pushes back, metres, 1e-5 to 0.01; beyond it a fifth of the excess does.
    stick_speed : float
        Sliding speed at which friction reaches its Coulomb bound, m/s, 1e-7 to 0.01.
    tolerance : float
        The iteration ends once a Newton step changes no velocity by more than this, m/s, 1e-12 to 0.001.
    max_iterations : int
        Most Newton iterations per step and attempt, 1 to 1000.
    """

    prediction: float = 0.001
    contact_drift: float = 5e-5
    contact_stiffness: float = 1.2e5
    contact_relaxation: float = 0.008
    support_stiffness: float = 1e5
    penetration_cap: float = 5e-4
    stick_speed: float = 2e-5
    tolerance: float = 2e-6
    max_iterations: int = 50


@dataclass(frozen=True)
class PhysicsConfig:
    """The physics engine and its settings. The project's hold and label tests validated the defaults together.

    Attributes
    ----------
    engine : str
        ``"implicit"`` (f64, all contacts of a step solved together by Newton's method) or ``"rapier"`` (f32, contacts
        solved in sub-steps).
    dt : float
        Time step, seconds, 1e-5 to 0.02.
    gravity : float
        m/s2, along -z of the world, 0 to 100.
    friction : FrictionConfig
        Friction factors of table and object.
    implicit : ImplicitConfig
        Settings of the engine ``implicit``; other engines ignore them.
    rapier : RapierConfig
        Settings of the engine ``rapier``; other engines ignore them.
    """

    engine: Literal["implicit", "rapier"] = "implicit"
    dt: float = 0.002
    gravity: float = 9.81
    friction: FrictionConfig = field(default_factory=FrictionConfig)
    implicit: ImplicitConfig = field(default_factory=ImplicitConfig)
    rapier: RapierConfig = field(default_factory=RapierConfig)
