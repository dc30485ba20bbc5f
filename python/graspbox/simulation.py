"""Grasp trials: an object at rest on a table, hand poses, and what came of each.

The trial: the open hand stands at the pose, closes its tendons, lifts, and holds. One judge decides:

- ``success``: over the last 0.5 s the object's centre of mass is at least 0.15 m above its resting height, the object
  touches neither table nor ground, and in the hand's frame it moves slower than 5 mm/s (`SuccessCriterion`).
- ``secure``: success, and since it left the table it has moved less than 5 cm and 15 degrees in the hand's frame.
- ``legacy_success``, ``kindness``: the reference study's measures, read 2.5 s after closing starts.
"""

import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._core import Hand, Mesh
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.meshes import floats, to_json

__all__ = ["Body", "Hand", "Outcomes", "Scene", "Trace", "cache_folder", "load_hand", "simulate"]


def cache_folder() -> Path | None:
    """Folder where convex parts are kept: ``GRASPBOX_CACHE`` (empty: keep nothing), else the user's cache folder."""
    chosen = os.environ.get("GRASPBOX_CACHE")
    if chosen is not None:
        return Path(chosen).expanduser() if chosen else None
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "graspbox"


def load_hand(hand: str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]] = "reflex") -> Hand:
    """Find a hand: ``"reflex"``, or the two files that describe another one.

    Parameters
    ----------
    hand : str, Hand, or pair of paths
        A name, or (URDF, ``hand.toml``).

    Raises
    ------
    HandError
        If the files do not describe a hand; the message names every line.
    ConfigError
        If there is no hand of that name.
    """
    if isinstance(hand, Hand):
        return hand
    if isinstance(hand, tuple):
        urdf, toml = hand
        return Hand.load(Path(urdf), Path(toml))
    if hand == "reflex":
        return Hand.reflex()
    raise ConfigError(f"there is no hand {hand!r}; use 'reflex', or give the paths of a URDF and a hand.toml")


@dataclass(frozen=True)
class Outcomes:
    """What came of n trials; arrays of length n.

    Attributes
    ----------
    success, secure : (n,) bool
        As the module says.
    failure : (n,) str
        ``infeasible``, ``no_contact``, ``slipped``, ``dropped``, ``unstable``; empty for a success.
    lift : (n,) float64
        Rise of the object's centre of mass at the end, metres.
    kindness_rate : (n,) float64
        Mean of |d distance/dt| between hand and object since lifting began, m/s.
    legacy_success : (n,) bool
        The study's success; False where it was not read (see `kindness`).
    kindness : (n,) float64
        The study's kindness; NaN where an early stop cut it off (``TrialConfig(legacy=True)`` reads it always).
    time : (n,) float64
        Simulated seconds.
    """

    success: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    failure: NDArray[np.str_]
    lift: NDArray[np.float64]
    kindness_rate: NDArray[np.float64]
    legacy_success: NDArray[np.bool_]
    kindness: NDArray[np.float64]
    time: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.success)

    @property
    def rate(self) -> float:
        """Share of successes; 0 without a trial."""
        return float(self.success.mean()) if len(self) else 0.0

    @classmethod
    def _from_core(cls, arrays: "_core.OutcomeArrays") -> "Outcomes":
        failure = np.array(arrays["failure"], dtype=np.str_)
        rest = {f.name: arrays[f.name] for f in fields(cls) if f.name != "failure"}  # type: ignore[literal-required]
        return cls(failure=failure, **rest)


@dataclass(frozen=True)
class Trace:
    """One trial every 10 ms: t samples, f fingers. An infeasible pose has none (t = 0): nothing moved.

    Attributes
    ----------
    time : (t,) float64
        Seconds since closing began.
    distance : (t,) float64
        Between hand frame and the study's object frame, metres.
    world_from_hand, world_from_object : (t, 4, 4) float64
        Poses.
    fingers : (t, f, 2) float64
        Proximal and distal angle, radians.
    tensions : (t, f) float64
        Tendon tensions, N.
    hand_force : (t,) float64
        Sum of the normal forces between hand and object, N.
    """

    time: NDArray[np.float64]
    distance: NDArray[np.float64]
    world_from_hand: NDArray[np.float64]
    world_from_object: NDArray[np.float64]
    fingers: NDArray[np.float64]
    tensions: NDArray[np.float64]
    hand_force: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """What the engine takes for an object; object frame.

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

    Preparing one takes from milliseconds to seconds (convex parts are cached on disk); its trials share it.

    Parameters
    ----------
    mesh : Mesh
        The object.
    hand : str, Hand or pair of paths
        See `load_hand`.
    world_from_object : (4, 4) array_like, optional
        Pose to settle from; by default the file's +z is up, and the object stands over the table's origin.
    physics : PhysicsConfig
        Settings of the engine.
    cache : Path or None
        Folder for convex parts.

    Raises
    ------
    SimulationError
        If the object cannot be simulated or does not come to rest.
    """

    def __init__(
        self,
        mesh: Mesh,
        *,
        hand: str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]] = "reflex",
        world_from_object: ArrayLike | None = None,
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        cache: Path | None = None,
    ) -> None:
        start = None if world_from_object is None else floats(world_from_object)
        self._hand = load_hand(hand)
        self._core = _core.Scene(mesh, self._hand, to_json(physics), start, cache or cache_folder())

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
        """The object as the engine takes it."""
        parts, mass, center, inertia = self._core.body()
        return Body(tuple(parts), mass, center, inertia)

    def simulate(
        self,
        poses: ArrayLike,
        preshape: ArrayLike,
        *,
        config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
    ) -> Outcomes:
        """Try every pose; see `graspbox.simulate`."""
        poses, preshape = floats(poses), floats(preshape)
        if poses.ndim == 3 and preshape.ndim == 0:
            preshape = np.full(len(poses), preshape)
        return Outcomes._from_core(self._core.simulate(poses, preshape, to_json(config), num_threads))

    def trace(
        self,
        pose: ArrayLike,
        preshape: float,
        *,
        config: TrialConfig = TrialConfig(legacy=True),  # noqa: B008 (frozen)
    ) -> tuple[Outcomes, Trace]:
        """Run one trial as `simulate` does, and record it every 10 ms.

        Parameters
        ----------
        pose : (4, 4) array_like
            ``object_from_hand``.
        preshape : float
            Radians.
        config : TrialConfig
            By default the study's measures are read too, so that the trial runs to its end.

        Returns
        -------
        Outcomes
            Of length 1.
        Trace
            What happened; empty where the outcome is ``infeasible``.
        """
        outcome, samples = self._core.trace(floats(pose), float(preshape), to_json(config))
        return Outcomes._from_core(outcome), Trace(**samples)


def simulate(
    mesh: Mesh,
    poses: ArrayLike,
    preshape: ArrayLike,
    *,
    hand: str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]] = "reflex",
    world_from_object: ArrayLike | None = None,
    config: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> Outcomes:
    """Try to grasp an object at each of n poses.

    Parameters
    ----------
    mesh : Mesh
        The object.
    poses : (n, 4, 4) array_like
        ``object_from_hand``: the hand's grasp frame in the object's frame, metres.
    preshape : (n,) array_like, or float
        Radians: 0 for a power grasp, pi/2 for a pinch.
    hand : str, Hand or pair of paths
        See `load_hand`.
    world_from_object : (4, 4) array_like, optional
        Pose from which the object settles on the table (top at z = 0); a plan carries the one that it was made for.
    config : TrialConfig
        The trial.
    physics : PhysicsConfig
        The engine.
    num_threads : int, optional
        Threads to use; by default ``GRASPBOX_THREADS``, else all. The result does not depend on it.

    Returns
    -------
    Outcomes
        In the order of the poses. A pose at which, or on the way to which, the hand collides is ``infeasible``.

    Raises
    ------
    ConfigError
        If an array has the wrong shape, a pose is not a rigid motion, or a setting is out of range.
    SimulationError
        If the object cannot be simulated or does not come to rest.
    """
    scene = Scene(mesh, hand=hand, world_from_object=world_from_object, physics=physics)
    return scene.simulate(poses, preshape, config=config, num_threads=num_threads)
