"""Grasp trials: an object at rest on a table, hand poses, and the outcome of each.

The trial: the open hand starts at the pose, closes, lifts, and holds; with ``TrialConfig(shake=ShakeConfig())`` it then
shakes what it holds. One judge decides:

- ``success``: over the last 0.5 s the object's centre of mass is at least 0.15 m above its resting height, the object
  touches neither table nor ground, and in the hand's frame it moves slower than 5 mm/s, measured from where it was
  0.1 s before (`SuccessCriterion`).
- ``secure``: success, and since it left the table it has moved less than 5 cm and 15 degrees in the hand's frame.
- ``survives_shake``: success, and success again after the hand has shaken the object along and about its axes, with 2 g
  by default, and held it still for another second. False where there was no shake.
- ``legacy_success``, ``kindness``: the reference study's measures, read 2.5 s after closing starts.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._core import Hand, Mesh
from graspbox.arguments import floats, to_json
from graspbox.configs import PhysicsConfig, PlanConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, cache_folder, load_hand
from graspbox.meshes import MeshLike, as_mesh
from graspbox.outcomes import Outcome, Outcomes, Trace
from graspbox.plan_files import mesh_hash
from graspbox.planning import Grasp, Plan

__all__ = ["Body", "Hand", "Outcome", "Outcomes", "Scene", "Trace", "cache_folder", "load_hand", "simulate"]


@dataclass(frozen=True, eq=False)
class Body:
    """An object as the engine simulates it, in the object frame.

    Attributes
    ----------
    parts : tuple of (n, 3) float64
        Convex parts, each by points that span it, metres.
    mass : float
        kg.
    center_of_mass : (3,) float64
        Metres.
    inertia : (3, 3) float64
        About the centre of mass, kg m2.
    """

    parts: tuple[NDArray[np.float64], ...]
    mass: float
    center_of_mass: NDArray[np.float64]
    inertia: NDArray[np.float64]


class Scene:
    """An object that has come to rest on the table, with a hand to grasp it.

    Preparing a scene takes milliseconds to seconds (convex parts are cached on disk); its trials share it. Scenes are
    immutable. One that is pickled is prepared again where it is loaded, and comes to rest as it did before.

    Parameters
    ----------
    mesh : Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`).
    hand : str, Hand or pair of paths
        See `load_hand`.
    world_from_object : (4, 4) array_like, optional
        Pose to settle from; by default the file's +z is up, and the object stands over the table's origin.
    physics : PhysicsConfig
        Settings of the physics engine.
    cache : Path or None
        Folder for convex parts.

    Raises
    ------
    SimulationError
        If the object cannot be simulated or does not come to rest.
    """

    def __init__(
        self,
        mesh: MeshLike,
        *,
        hand: HandLike = "reflex",
        world_from_object: ArrayLike | None = None,
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        cache: Path | None = None,
    ) -> None:
        start = None if world_from_object is None else floats(world_from_object, "world_from_object").copy()
        given, self._hand = as_mesh(mesh), load_hand(hand)
        settings = to_json(physics, PhysicsConfig, "physics")
        self._core = _core.Scene(given, self._hand, settings, start, cache or cache_folder())
        self._made_from = (given, self._hand, start, physics, cache)

    def __reduce__(self) -> tuple[Any, ...]:
        return _scene, self._made_from

    def __copy__(self) -> "Scene":
        return self

    def __deepcopy__(self, memo: object) -> "Scene":
        return self

    def __repr__(self) -> str:
        x, y, z = (float(v) for v in self.world_from_object[:3, 3])
        return f"Scene({self.name!r}, {self.mesh.mass:.4g} kg, at rest at ({x:.3f}, {y:.3f}, {z:.3f}) m, {self.hand!r})"

    @property
    def name(self) -> str:
        """Name of the object."""
        return self._core.name

    @property
    def mesh(self) -> Mesh:
        """The object's mesh."""
        return self._core.mesh

    @property
    def hand(self) -> Hand:
        """The hand."""
        return self._hand

    @property
    def world_from_object(self) -> NDArray[np.float64]:
        """The object at rest, (4, 4)."""
        return self._core.world_from_object

    @property
    def center_of_mass(self) -> NDArray[np.float64]:
        """Centre of mass in the object's frame, (3,), metres."""
        return self._core.center_of_mass

    @property
    def body(self) -> Body:
        """The object as the engine simulates it."""
        parts, mass, center, inertia = self._core.body()
        return Body(tuple(parts), mass, center, inertia)

    def simulate(
        self,
        poses: ArrayLike | Plan | Grasp,
        preshape: ArrayLike | None = None,
        *,
        friction: ArrayLike = 1.0,
        mass: ArrayLike = 1.0,
        config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
    ) -> Outcomes:
        """Try every pose, every grasp of a plan, or one grasp of it; see `graspbox.simulate`.

        Parameters
        ----------
        poses, preshape, config, num_threads
            As `graspbox.simulate`.
        friction, mass : (n,) array_like, or float
            Factors on the friction and the mass of the object, for each trial, 0.01 to 100.
        """
        if isinstance(poses, Plan):
            self._check_plan(poses)
            given, preshape = poses.poses, _own(preshape, poses.preshape)
        elif isinstance(poses, Grasp):
            given, preshape = poses.pose[None], _own(preshape, poses.preshape)
        else:
            given = floats(poses, "poses")
        if preshape is None:
            raise ConfigError("preshape is missing; give one for each pose, or a plan instead of poses")
        angles = floats(preshape, "preshape")
        if given.ndim == 3 and angles.ndim == 0:
            angles = np.full(len(given), angles)
        count = len(given) if given.ndim == 3 else 0
        factors = np.stack([_for_each(friction, "friction", count), _for_each(mass, "mass", count)], axis=1)
        text = to_json(config, TrialConfig)
        return Outcomes._from_core(self._core.simulate(given, angles, factors, text, num_threads))

    def check(
        self,
        poses: ArrayLike,
        preshape: ArrayLike,
        *,
        clearance: float = PlanConfig.clearance,
        standoff: float = PlanConfig.standoff,
        num_threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """Pass poses through the planner's collision filter.

        Parameters
        ----------
        poses : (n, 4, 4) array_like
            ``object_from_hand``, metres.
        preshape : (n,) array_like
            See `graspbox.simulate`.
        clearance : float
            Room that the open hand must have on every side, metres, 0 to 0.05; trials refuse poses without any (0).
        standoff : float
            The hand comes from this far behind, along its -z, metres, 0 to 1.
        num_threads : int, optional
            As in `graspbox.simulate`.

        Returns
        -------
        (n,) bool
            Whether the open hand collides with nothing, at the pose and on the way there.

        Raises
        ------
        ConfigError
            For arrays of another shape, poses that are no rigid motions, and distances out of range.
        """
        given, values = floats(poses, "poses"), floats(preshape, "preshape")
        return self._core.check(given, values, clearance, standoff, num_threads)

    def _check_plan(self, plan: Plan) -> None:
        """Refuse a plan for another object or hand; one that was put together by hand names none."""
        way_out = "give its poses and preshape to try them anyway"
        if plan.hand_name and plan.hand_name != self.hand.name:
            raise ConfigError(f"the plan is for the hand {plan.hand_name!r}, not {self.hand.name!r}; {way_out}")
        if plan.mesh_sha256 and plan.mesh_sha256 != mesh_hash(self.mesh):
            raise ConfigError(f"the plan is for another mesh, {plan.name!r}, than {self.name!r}; {way_out}")

    def trace(
        self,
        pose: ArrayLike | Grasp,
        preshape: float | None = None,
        *,
        config: TrialConfig = TrialConfig(legacy=True),  # noqa: B008 (frozen)
    ) -> tuple[Outcomes, Trace]:
        """Run one trial as `simulate` does, and record it every 10 ms.

        Parameters
        ----------
        pose : (4, 4) array_like, or Grasp
            ``object_from_hand``; a grasp of a plan brings its preshape.
        preshape : float
            See `graspbox.simulate`.
        config : TrialConfig
            By default the study's measures are read too, so that the trial runs to its end.

        Returns
        -------
        Outcomes
            Of length 1.
        Trace
            What happened; empty where the outcome is ``infeasible``.

        Raises
        ------
        ConfigError
            As `graspbox.simulate`.
        """
        if isinstance(pose, Grasp):
            given, preshape = pose.pose, _own(preshape, pose.preshape)
        else:
            given = floats(pose, "pose")
        if preshape is None:
            raise ConfigError("preshape is missing; give one, or a grasp of a plan instead of a pose")
        angle = floats(preshape, "preshape")
        if angle.size != 1:
            raise ConfigError(f"preshape has shape {list(angle.shape)}; give one number")
        outcome, samples = self._core.trace(given, float(angle.item()), to_json(config, TrialConfig))
        return Outcomes._from_core(outcome), Trace(**samples)


def _for_each(factor: ArrayLike, name: str, count: int) -> NDArray[np.float64]:
    """Give each of `count` trials its factor."""
    found = floats(factor, name)
    if found.shape not in ((), (count,)):
        raise ConfigError(f"{name} has shape {list(found.shape)}; give one factor, or one for each of {count} poses")
    return np.broadcast_to(found, (count,))


T = TypeVar("T")


def _own(given: object, own: T) -> T:
    """Take the preshape that a plan or a grasp holds; it may not be given a second time."""
    if given is not None:
        raise ConfigError("preshape is given twice; a plan or a grasp holds its own")
    return own


def _scene(
    mesh: Mesh, hand: Hand, start: NDArray[np.float64] | None, physics: PhysicsConfig, cache: Path | None
) -> Scene:
    """Prepare a scene that was pickled."""
    return Scene(mesh, hand=hand, world_from_object=start, physics=physics, cache=cache)


def simulate(
    mesh: MeshLike,
    poses: ArrayLike | Plan,
    preshape: ArrayLike | None = None,
    *,
    hand: HandLike = "reflex",
    world_from_object: ArrayLike | None = None,
    config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> Outcomes:
    """Try to grasp an object at each of n poses.

    Parameters
    ----------
    mesh : Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`).
    poses : (n, 4, 4) array_like, or Plan
        ``object_from_hand``: the hand's grasp frame in the object's frame, metres. A plan (``plan``, ``plan[:5]``)
        brings its preshapes, and the pose that its object rests in.
    preshape : (n,) array_like, or float
        Within `graspbox.Hand.preshape_limits`: the position of the preshape's actuator (of the ReFlex: 0 for a power
        grasp, pi/2 for a pinch), or the number of a named preshape; not with a plan.
    hand : str, Hand or pair of paths
        See `load_hand`.
    world_from_object : (4, 4) array_like, optional
        Pose from which the object settles on the table (top at z = 0); that of the plan, if one is given.
    config : TrialConfig
        The trial.
    physics : PhysicsConfig
        The engine.
    num_threads : int, optional
        Threads to use, 1 to 1024; by default ``GRASPBOX_THREADS``, else all. The result does not depend on it.

    Returns
    -------
    Outcomes
        In the order of the poses. A pose at which, or on the way to which, the hand collides is ``infeasible``.

    Raises
    ------
    ConfigError
        If an array has the wrong shape, a pose is not a rigid motion, a setting is out of range, or the plan is for
        another object or hand.
    SimulationError
        If the object cannot be simulated or does not come to rest.
    """
    if world_from_object is None and isinstance(poses, Plan):
        world_from_object = poses.world_from_object
    scene = Scene(mesh, hand=hand, world_from_object=world_from_object, physics=physics)
    return scene.simulate(poses, preshape, config=config, num_threads=num_threads)
