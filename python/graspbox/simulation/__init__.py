"""Grasp trials: hand poses for an object at rest on a table, and their outcomes.

In a trial the open hand starts at the pose, closes, lifts and holds; with ``TrialConfig(shake=ShakeConfig())`` it then
shakes the object. The labels are defined as follows:

- ``success``: for the last 0.5 s the object's centre of mass is at least 0.15 m above its resting height, the object
  touches neither table nor ground, and its speed in the hand's frame, averaged over 0.1 s, is below 5 mm/s
  (`SuccessCriterion`).
- ``secure``: success, and the object has moved less than 5 cm and 15 degrees in the hand's frame since it left the
  table.
- ``survives_shake``: success, and success again after the hand has shaken the object along and about the hand's axes
  (2 g by default) and held it still for another second. False without a shake.
- ``legacy_success``, ``kindness``: the reference study's measures, taken 2.5 s after closing starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict, floats, natural
from graspbox._core import Hand, Mesh
from graspbox.configs import PhysicsConfig, PlanConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, cache_folder, load_hand
from graspbox.meshes import MeshLike, Surroundings, as_mesh, placed
from graspbox.planning import Grasp, Plan
from graspbox.planning.plan_files import mesh_hash
from graspbox.simulation.layouts import Layout, arrange
from graspbox.simulation.outcomes import Outcome, Outcomes, Trace

__all__ = ["Body", "Hand", "Outcome", "Outcomes", "Scene", "Trace", "cache_folder", "load_hand", "simulate"]


@dataclass(frozen=True, eq=False)
class Body:
    """An object as the engine simulates it, in the object frame.

    Attributes
    ----------
    parts : tuple of (n, 3) float64
        Convex parts, each given by points whose convex hull it is, metres.
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
    """An object that has come to rest on the table, or several, with a hand to grasp it.

    Preparing a scene takes milliseconds to seconds (convex parts are cached on disk); all of its trials share it.
    Scenes are immutable. Unpickling prepares a scene again, with the same resting pose.

    Parameters
    ----------
    mesh : Mesh or sequence of Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`). 1 to 64 meshes come to rest in a
        layout: ``Scene([cup, box])`` is ``Scene.of(graspbox.arrange([cup, box], "packed"))``, without those that fall
        off the table.
    hand : str, Hand or pair of paths
        See `load_hand`.
    world_from_object : (4, 4) array_like, optional
        Pose from which the object settles; by default the file's +z is up, and the object is above the table's origin.
        Not for a list.
    layout : str, optional
        Of a list: ``packed``, the default, ``pile`` or ``bin``.
    seed : int
        Of a list: seed of places and orientations.
    physics : PhysicsConfig
        Settings of the physics engine.
    cache : Path or None
        Folder for cached convex parts; by default that of `cache_folder`.

    Raises
    ------
    ConfigError
        For a pose of a list, or a layout of a single mesh.
    SimulationError
        If an object cannot be simulated or does not come to rest.
    """

    def __init__(
        self,
        mesh: MeshLike | Sequence[MeshLike],
        *,
        hand: HandLike = "reflex",
        world_from_object: ArrayLike | None = None,
        layout: Layout | None = None,
        seed: int = 0,
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        cache: Path | None = None,
    ) -> None:
        if isinstance(mesh, Sequence) and not isinstance(mesh, str):
            if world_from_object is not None:
                raise ConfigError("world_from_object is the pose of one mesh; give Scene.of several meshes with poses")
            heap = arrange(mesh, layout or "packed", seed=seed, hand=hand, physics=physics)
            self.__dict__.update(Scene.of(heap, hand=hand, physics=physics).__dict__)
            return
        if layout is not None:
            raise ConfigError(f"layout is {layout!r} for a single mesh; give a list of meshes")
        start = None if world_from_object is None else floats(world_from_object, "world_from_object").copy()
        object_mesh, self._hand = as_mesh(mesh), load_hand(hand)
        settings = config_dict(physics, PhysicsConfig, "physics")
        self._core = _core.SettledScene(object_mesh, self._hand, settings, start, cache or cache_folder())
        self._made_from = (object_mesh, self._hand, start, physics, cache)
        self._around: tuple[Surroundings, int | None] | None = None
        self._meshes: tuple[Mesh, ...] = (object_mesh,)
        self._walls = placed(None)[1]

    @classmethod
    def of(
        cls,
        scene: Surroundings,
        *,
        target: int | None = None,
        hand: HandLike = "reflex",
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        cached: bool = True,
    ) -> Self:
        """Make a scene of several objects and walls, all of them at rest, such as `graspbox.arrange` returns.

        Parameters
        ----------
        scene : Surroundings
            Objects and walls with their poses.
        target : int, optional
            Index of "the object" of the other methods: poses are given in its frame, and only a trial that lifts it
            succeeds. By default a trial may grasp any object, and is about the one on which the closed hand presses
            most; poses are then given in the frame of the one that reaches highest.
        hand, physics
            As for `Scene`.
        cached : bool
            Keep convex parts on disk, in `cache_folder`; False for shapes that never come again.

        Raises
        ------
        SimulationError
            If there is no object, too many of them, or one that cannot be simulated.
        ConfigError
            If there is no object of the target's index.
        """
        objects, walls = placed(scene)
        poses = np.stack([pose for _, pose in objects]) if objects else np.zeros((0, 4, 4))
        chosen = None if target is None else natural(target, "target")
        made, settings = cls.__new__(cls), config_dict(physics, PhysicsConfig, "physics")
        made._hand = load_hand(hand)
        made._meshes, made._walls = tuple(mesh for mesh, _ in objects), walls
        folder = cache_folder() if cached else None
        made._core = _core.SettledScene.of_objects(made._meshes, poses, walls, chosen, made._hand, settings, folder)
        made._made_from, made._around = (made._core.mesh, made._hand, None, physics, None), (scene, chosen)
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        if self._around is not None:
            around, target = self._around
            return partial(Scene.of, target=target, hand=self._hand, physics=self.physics), (around,)
        mesh, hand, start, physics, cache = self._made_from
        return partial(Scene, hand=hand, world_from_object=start, physics=physics, cache=cache), (mesh,)

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
    def physics(self) -> PhysicsConfig:
        """Settings of the physics engine."""
        return self._made_from[3]

    @property
    def world_from_object(self) -> NDArray[np.float64]:
        """Resting pose of the object, (4, 4)."""
        return self._core.world_from_object

    @property
    def target(self) -> int:
        """Index of the object among all objects of the scene, as `of` takes them; 0 for a single one."""
        return self._core.target

    @property
    def any_target(self) -> bool:
        """Whether a trial may grasp any of several objects, since `of` has no target."""
        return self._around is not None and self._around[1] is None and len(self._meshes) > 1

    @property
    def others(self) -> tuple[Mesh, ...]:
        """Meshes of the k objects beside it: those that `of` takes, in their order, without `target`."""
        return tuple(mesh for index, mesh in enumerate(self._meshes) if index != self.target)

    @property
    def world_from_others(self) -> NDArray[np.float64]:
        """Resting poses of `others`, (k, 4, 4)."""
        return self._core.world_from_others

    @property
    def world_from_walls(self) -> NDArray[np.float64]:
        """Poses of the walls, (w, 4, 4)."""
        return np.array([pose for pose, _ in self._walls], dtype=np.float64).reshape(-1, 4, 4)

    @property
    def wall_half_extents(self) -> NDArray[np.float64]:
        """Half extents of the walls, (w, 3), metres."""
        return np.array([half for _, half in self._walls], dtype=np.float64).reshape(-1, 3)

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
        """Run a trial at every pose, for every grasp of a plan, or for one grasp; see `graspbox.simulate`.

        Parameters
        ----------
        poses, preshape, config, num_threads
            As `graspbox.simulate`.
        friction, mass : (n,) array_like, or float
            Factors on the friction and the mass of every object, per trial or for all, 0.01 to 100.
        """
        if isinstance(poses, Plan):
            self.check_plan(poses)
            matrices, preshape = poses.poses, _included(preshape, poses.preshape)
        elif isinstance(poses, Grasp):
            matrices, preshape = poses.pose[None], _included(preshape, poses.preshape)
        else:
            matrices = floats(poses, "poses")
        if preshape is None:
            raise ConfigError("preshape is missing; give one for each pose, or a plan instead of poses")
        angles = floats(preshape, "preshape")
        if matrices.ndim == 3 and angles.ndim == 0:
            angles = np.full(len(matrices), angles)
        count = len(matrices) if matrices.ndim == 3 else 0
        factors = np.stack([_for_each(friction, "friction", count), _for_each(mass, "mass", count)], axis=1)
        fields = config_dict(config, TrialConfig)
        return Outcomes._from_core(self._core.simulate(matrices, angles, factors, fields, num_threads))

    def simulate_masses(
        self,
        poses: ArrayLike,
        preshape: ArrayLike,
        masses: ArrayLike,
        *,
        config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Find which masses grasps hold: the hand closes once at each pose, and lifts each mass in a copy of the world.

        Closing takes most of the time of a trial, so that this costs little more than one trial for each pose.

        Parameters
        ----------
        poses : (n, 4, 4) array_like
            ``object_from_hand``, metres.
        preshape : (n,) array_like
            See `graspbox.simulate`.
        masses : (k,) array_like
            1 to 64 factors on the mass of every object, 0.01 to 100, the lightest first. The hand closes on the first;
            once one is not held, those after it count as not held.
        config, num_threads
            As `graspbox.simulate`.

        Returns
        -------
        (n, k) bool, (n, k) bool
            ``success`` and ``secure``; False where the hand collides at the pose or on the approach.

        Raises
        ------
        ConfigError
            As `graspbox.simulate`, and for no mass, more than 64, or masses that do not rise.
        """
        matrices, values, factors = (
            floats(array, name) for array, name in ((poses, "poses"), (preshape, "preshape"), (masses, "masses"))
        )
        if (np.diff(factors) < 0.0).any():
            raise ConfigError(f"masses are {factors.tolist()}; pass the lightest first")
        fields = config_dict(config, TrialConfig)
        return self._core.simulate_masses(matrices, values, factors, fields, num_threads)

    def check(
        self,
        poses: ArrayLike,
        preshape: ArrayLike,
        *,
        clearance: float = PlanConfig.clearance,
        standoff: float = PlanConfig.standoff,
        num_threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """Apply the planner's collision filter to poses.

        Parameters
        ----------
        poses : (n, 4, 4) array_like
            ``object_from_hand``, metres.
        preshape : (n,) array_like
            See `graspbox.simulate`.
        clearance : float
            Clearance that the open hand needs on every side, metres, 0 to 0.05; trials use 0.
        standoff : float
            Length of the straight approach along the hand's z, metres, 0 to 1.
        num_threads : int, optional
            As in `graspbox.simulate`.

        Returns
        -------
        (n,) bool
            Whether the open hand is free of collisions at the pose and on the approach.

        Raises
        ------
        ConfigError
            For arrays of another shape, poses that are not rigid motions, or distances out of range.
        """
        matrices, values = floats(poses, "poses"), floats(preshape, "preshape")
        return self._core.check(matrices, values, clearance, standoff, num_threads)

    def check_plan(self, plan: Plan) -> None:
        """Refuse a plan for another object or hand (ConfigError); plans made without names are accepted."""
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
        friction: float = 1.0,
        mass: float = 1.0,
        config: TrialConfig = TrialConfig(legacy=True),  # noqa: B008 (frozen)
    ) -> tuple[Outcomes, Trace]:
        """Run one trial as `simulate` does, and record a sample every 10 ms: hand, object and `others`.

        Parameters
        ----------
        pose : (4, 4) array_like, or Grasp
            ``object_from_hand``; a grasp of a plan includes its preshape.
        preshape : float
            See `graspbox.simulate`; not with a grasp of a plan.
        friction, mass : float
            Factors on the friction and the mass of every object, 0.01 to 100.
        config : TrialConfig
            The trial; by default with the reference study's measures, which delay early stops.

        Returns
        -------
        Outcomes
            Of length 1.
        Trace
            The recording; empty if the outcome is ``infeasible``.

        Raises
        ------
        ConfigError
            As `graspbox.simulate`.
        """
        if isinstance(pose, Grasp):
            matrix, preshape = pose.pose, _included(preshape, pose.preshape)
        else:
            matrix = floats(pose, "pose")
        if preshape is None:
            raise ConfigError("preshape is missing; give one, or a grasp of a plan instead of a pose")
        angle = floats(preshape, "preshape")
        if angle.size != 1:
            raise ConfigError(f"preshape has shape {list(angle.shape)}; give one number")
        factors = [float(_for_each(factor, name, 1)[0]) for name, factor in (("friction", friction), ("mass", mass))]
        outcome, samples = self._core.trace(matrix, float(angle.item()), factors, config_dict(config, TrialConfig))
        return Outcomes._from_core(outcome), Trace(**samples)


def _for_each(factor: ArrayLike, name: str, count: int) -> NDArray[np.float64]:
    """Return one factor for each of `count` trials."""
    found = floats(factor, name)
    if found.shape not in ((), (count,)):
        raise ConfigError(f"{name} has shape {list(found.shape)}; give one factor, or one for each of {count} poses")
    return np.broadcast_to(found, (count,))


T = TypeVar("T")


def _included(argument: object, own: T) -> T:
    """Return the preshape of a plan or a grasp; it must not also be given as an argument."""
    if argument is not None:
        raise ConfigError("preshape is given twice; leave it out, since a plan or a grasp includes it")
    return own


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
    """Run a grasp trial at each of n poses of the hand.

    Parameters
    ----------
    mesh : Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`).
    poses : (n, 4, 4) array_like, or Plan
        ``object_from_hand``: the hand's grasp frame in the object's frame, metres. A plan (``plan``, ``plan[:5]``)
        includes its preshapes and the resting pose of its object.
    preshape : (n,) array_like, or float
        Within `graspbox.Hand.preshape_limits`: the position of the preshape's actuator (ReFlex: 0 for a power grasp,
        pi/2 for a pinch), or the index of a named preshape; not with a plan.
    hand : str, Hand or pair of paths
        See `load_hand`.
    world_from_object : (4, 4) array_like, optional
        Pose from which the object settles on the table (top at z = 0); by default that of the plan, if there is one.
    config : TrialConfig
        The trial.
    physics : PhysicsConfig
        Settings of the physics engine.
    num_threads : int, optional
        Number of threads, 1 to 1024; by default ``GRASPBOX_THREADS``, else all cores. Results do not depend on it.

    Returns
    -------
    Outcomes
        In the order of the poses. A pose is ``infeasible`` if the hand collides there or on the approach.

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
