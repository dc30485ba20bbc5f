"""Settings of a data set: number of trials, candidates, and variation between trials."""

import math
from dataclasses import dataclass, field, fields

from graspbox._common.arguments import check_range, natural
from graspbox.configs import PhysicsConfig, PlanConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.meshes.views import ViewPlan
from graspbox.simulation.layouts import SceneLayout, scene_layout_named

__all__ = ["CandidateShares", "DatasetConfig"]

#: Anywhere above the table but near its plane.
_CAMERAS = ViewPlan("random", (0.0, 0.0, 1.0), cap=1.2, distance=(0.5, 0.8), shift=0.02)
#: Bounds of numbers; a larger one is a mistake.
_COUNTS = {"poses": (1, 100_000), "rests": (1, 1_000), "views": (0, 1_000), "seed": (0, 2**64 - 1)}
_COUNTS |= {"replays": (0, 1_000), "shard_trials": (1, 1_000_000)}
_BOUNDS = {**_COUNTS, "spread": (0.25, 2.0), "hand_position": (0.0, 0.1), "hand_rotation": (0.0, math.pi)}
_MOST_OBJECTS = 40


@dataclass(frozen=True)
class CandidateShares:
    """Share of a scene's trials for each source of candidate poses; they sum to 1.

    The trials of a source that finds too few poses go to ``planner``, ``normal`` and ``random``, in this order.

    Attributes
    ----------
    planner : float
        `graspbox.plan`: half of them its best-ranked poses, half at random from the others.
    normal : float
        At surface points, along the inward normal or straight down, closing along the least local extent, with all
        preshapes of the hand.
    low : float
        From above, with the lowest point of the hand 1 to 2 mm above the table: for flat objects.
    jitter : float
        Poses near those that succeeded in the same scene.
    random : float
        From any direction, at a point of the surface.
    """

    planner: float = 0.40
    normal: float = 0.20
    low: float = 0.15
    jitter: float = 0.15
    random: float = 0.10


@dataclass(frozen=True)
class DatasetConfig:
    """Settings that determine the rows of a data set, together with its objects and the hand.

    Attributes
    ----------
    poses : int
        Trials per scene, 1 to 100,000.
    rests : int
        Scenes per object, each with its own resting pose and yaw, 1 to 1,000. Resting poses are sampled by their
        probability.
    layout : {"single", "packed", "pile", "bin"}
        How objects lie. In each scene of several objects, one is the target of all trials; the others are drawn from
        the same split, and all have a random scale (`graspbox.simulation.layouts`).
    objects_per_scene : (int, int)
        Least and greatest number of objects in scenes of several, 1 to 40.
    bin_size : three float
        Sides of the floor of a bin along x and y, and height of its walls, metres.
    spread : float
        Distance of the objects from the middle, times that of VGN, 0.25 to 2 (`graspbox.arrange`).
    views : int
        Cameras per scene, 0 to 1,000.
    seed : int
        Seed of the data set, 0 to 2^64 - 1.
    replays : int
        Further trials of each pose of the splits validation and test, each with its own disturbance, 0 to 1,000.
    images : bool
        Store the images of the views; otherwise they are rendered from the rows on demand.
    image_size : pair of int
        Rows and columns of these images.
    fov : float
        Vertical field of view of the cameras, radians.
    cameras : ViewPlan
        Placement of the cameras around the middle of the object's bounds.
    candidates : CandidateShares
        Sources of the poses.
    hand_position, hand_rotation : float
        Bounds of the pose error of the hand along and about each of its axes, metres and radians.
    friction, mass : pair of float
        Bounds of the factors on the object's friction and mass.
    shard_trials : int
        Trials per shard, the unit of work; scenes are not divided. 1 to 1,000,000.
    """

    poses: int = 128
    rests: int = 1
    layout: SceneLayout = "single"
    objects_per_scene: tuple[int, int] = (5, 5)
    bin_size: tuple[float, float, float] = (0.3, 0.25, 0.12)
    spread: float = 1.0
    views: int = 4
    seed: int = 0
    replays: int = 0
    images: bool = False
    image_size: tuple[int, int] = (64, 64)
    fov: float = 0.6
    cameras: ViewPlan = _CAMERAS
    candidates: CandidateShares = field(default_factory=CandidateShares)
    hand_position: float = 0.005
    hand_rotation: float = math.radians(5.0)
    friction: tuple[float, float] = (0.7, 1.3)
    mass: tuple[float, float] = (0.75, 1.25)
    shard_trials: int = 1024
    planning: PlanConfig = field(default_factory=PlanConfig)
    trial: TrialConfig = field(default_factory=TrialConfig)
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)

    def check(self) -> None:
        """Refuse the first invalid field; the core checks planner, trial, engine and cameras."""
        for name in _COUNTS:
            natural(getattr(self, name), name, bits=64)
        for name, bounds in _BOUNDS.items():
            check_range(self, name, *bounds)
        scene_layout_named(self.layout)
        fewest, most = self.objects_per_scene
        if not (isinstance(fewest, int) and isinstance(most, int) and 1 <= fewest <= most <= _MOST_OBJECTS):
            raise ConfigError(
                f"objects_per_scene is {self.objects_per_scene}; it must be the least and the greatest number, from 1 "
                f"to {_MOST_OBJECTS}"
            )
        if self.layout == "single" and self.spread != 1.0:
            raise ConfigError(f"spread is {self.spread!r}, but layout 'single' has one object; choose another")
        for name in ("friction", "mass"):
            low, high = getattr(self, name)
            if not 0.01 <= low <= high <= 100.0:
                raise ConfigError(f"{name} is {(low, high)}; the least and greatest factor must be in 0.01 to 100")
        shares = [getattr(self.candidates, f.name) for f in fields(self.candidates)]
        if not all(share >= 0.0 for share in shares) or not math.isclose(sum(shares), 1.0, abs_tol=1e-9):
            raise ConfigError(f"candidates has the shares {shares}; they must be from 0 to 1 and sum to 1")
        if self.images and not self.views:
            raise ConfigError("images is True, but views is 0; set it to the number of views to store")
