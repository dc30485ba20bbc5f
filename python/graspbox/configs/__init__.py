"""Settings as frozen dataclasses, with the same fields, defaults and meanings as in the Rust core.

The core checks values when it uses them; errors name the field, its value and the valid range. numpy's scalars and
arrays are accepted as numbers and lists.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Self

from graspbox.configs.cameras import FRONT, OVERHEAD, PALM, VIEWER, CameraConfig, CamerasConfig, PictureConfig
from graspbox.configs.physics import FrictionConfig, ImplicitConfig, PhysicsConfig, RapierConfig

__all__ = [
    "FRONT",
    "OVERHEAD",
    "PALM",
    "VIEWER",
    "CameraConfig",
    "CamerasConfig",
    "CleanConfig",
    "ClutterConfig",
    "DecomposeConfig",
    "EnvConfig",
    "FrictionConfig",
    "ImplicitConfig",
    "LoadConfig",
    "PathConfig",
    "PhysicsConfig",
    "PictureConfig",
    "PlanConfig",
    "PoseConfig",
    "Randomization",
    "RapierConfig",
    "ReachConfig",
    "ShakeConfig",
    "SuccessCriterion",
    "TrialConfig",
]


@dataclass(frozen=True)
class LoadConfig:
    """Unit and size limits of mesh files.

    Attributes
    ----------
    scale : float
        Metres per unit of the file.
    max_bytes, max_vertices, max_faces : int
        Limits; larger files are refused before memory is allocated for them.
    """

    scale: float = 1.0
    max_bytes: int = 256 << 20
    max_vertices: int = 4_000_000
    max_faces: int = 4_000_000


@dataclass(frozen=True)
class CleanConfig:
    """Repair of meshes, without adding surface.

    Attributes
    ----------
    weld : float
        Vertices closer than this share of the longest side of the bounds are merged, in [0, 1).
    min_component_area : float
        Components with less than this share of the surface area are dropped, in [0, 1).
    orient : bool
        Whether to orient faces outward.
    """

    weld: float = 1e-6
    min_component_area: float = 0.0
    orient: bool = True


@dataclass(frozen=True)
class DecomposeConfig:
    """Settings of the box decomposition.

    Attributes
    ----------
    fit : {"minimum", "pca"}
        Boxes of minimum volume, or along the principal axes.
    area_gain : float
        A cut is accepted only if its two rectangles cover less than this share of their face, in (0, 1].
    min_volume : float
        Least volume of each child's box, m3.
    volume_gain : float or None
        If given, the children's boxes together must have less than this share of the parent's volume, in (0, 2].
    max_boxes : int
        Greatest number of leaves.
    split_cost : {"share", "area"}
        Compare cuts by their share of the face, or by area across faces as in the reference study's program.
    samples : int
        Number of surface points that the search for cuts uses.
    seed : int
        Seed of these points.
    """

    fit: Literal["minimum", "pca"] = "minimum"
    area_gain: float = 0.9
    min_volume: float = 5e-7
    volume_gain: float | None = None
    max_boxes: int = 16
    split_cost: Literal["share", "area"] = "share"
    samples: int = 2000
    seed: int = 0


@dataclass(frozen=True)
class PoseConfig:
    """Generation of candidate poses from boxes.

    Attributes
    ----------
    offset : float
        Distance between the palm and the box, metres.
    standoffs : tuple of float
        Additional distances to try, added to `offset`, metres; at most 1,000. For a hand whose grasp centre is deeper
        than 60 mm they grow in proportion.
    variation : {"random", "grid"}
        Random variations along and about the long axis, or the reference study's grid.
    variations : int
        Random variations per face and orientation, at most 10,000; as many again for each of `closing_range`,
        `side_range`, `max_roll` and `max_lean` that the hand defines. No plan has more than 200,000 candidates.
    max_shift : float
        Greatest shift along the long side, as a share of it.
    max_tilt : float
        Greatest rotation about the long axis, radians.
    square : float
        Faces whose short side is at least this share of their long side are also tried with the hand rotated by 90
        degrees.
    whole : bool
        Also generate poses from the box around the whole object.
    pairs : int
        Pairs of opposite surface points (on walls, rims and handles) to grasp across, for hands that define their
        opening, at most 1,000.
    """

    offset: float = 0.005
    standoffs: tuple[float, ...] = (0.015, 0.03, 0.045, 0.06)
    variation: Literal["random", "grid"] = "random"
    variations: int = 8
    max_shift: float = 0.4
    max_tilt: float = 0.5
    square: float = 0.6
    whole: bool = True
    pairs: int = 60


@dataclass(frozen=True)
class PlanConfig:
    """Settings of the planner.

    Attributes
    ----------
    decompose : DecomposeConfig
        Settings of the box decomposition.
    poses : PoseConfig
        Generation of candidate poses.
    clearance : float
        Clearance that the open hand needs on every side, metres.
    standoff : float
        Length of the straight approach along the hand's z, metres.
    max_press : float
        Greatest ``press`` (`graspbox.Plan`) of a feasible grasp on its neighbours, metres, 0 to 0.05. By default 0:
        every touch is refused, as by `graspbox.Scene.simulate` with a target; ``scene_planner`` and ``planner`` take
        0.005.
    press_penalty : float
        Score that a grasp loses for each metre of its press, 1/m, 0 to 1e6.
    seed : int
        Seed of the random variations.
    """

    decompose: DecomposeConfig = field(default_factory=lambda: DecomposeConfig(max_boxes=8))
    poses: PoseConfig = field(default_factory=PoseConfig)
    clearance: float = 0.001
    standoff: float = 0.10
    max_press: float = 0.0
    press_penalty: float = 2000.0
    seed: int = 0


@dataclass(frozen=True)
class ReachConfig:
    """Settings of what an arm reaches.

    Attributes
    ----------
    starts : int
        Postures from which each pose is searched, 1 to 4096: with more, fewer poses are missed, and those that cannot
        be reached take longer.
    solutions : int
        Most postures returned per pose, 1 to 64.
    max_angle : float
        Greatest angle to the rotation of a pose for an arm with fewer than six joints, which cannot meet most of them,
        rad.
    clearance : float
        Distance that links keep from the table and from objects, metres.
    point_radius : float
        Distance that links keep from measured points, metres: at least half of their spacing.
    """

    starts: int = 32
    solutions: int = 4
    max_angle: float = 0.2
    clearance: float = 0.005
    point_radius: float = 0.01


@dataclass(frozen=True)
class PathConfig:
    """Settings of the paths of an arm.

    Attributes
    ----------
    reach : ReachConfig
        Inverse kinematics, and the distances that arm, hand and carried object keep: at least 0.001 m here; on the way
        half of them. `ReachConfig.solutions` has no effect.
    standoff : float
        Length of the straight approach and of the retreat, along the hand's z, metres, 0.001 to 1.
    lift : float
        Height of the straight lift, and of the lowering to a place, metres, 0.001 to 1.
    iterations : int
        Most samples of a search for a way around obstacles, at most a million; half as many for the grasps after one
        to which none was found.
    seed : int
        Seed of the samples.
    """

    reach: ReachConfig = field(default_factory=ReachConfig)
    standoff: float = 0.10
    lift: float = 0.10
    iterations: int = 1000
    seed: int = 0


@dataclass(frozen=True)
class SuccessCriterion:
    """Success: the object is held lifted, free of table and ground, and still for a time without interruption.

    Attributes
    ----------
    lift_height : float
        Least rise of the object's centre of mass above its resting height, metres, 0.01 to 1.
    hold_time : float
        Time for which all conditions hold, seconds, 0 to 60.
    rest_speed : float
        Greatest speed of the object's centre of mass in the hand's frame, averaged over the last 0.1 s, m/s, 0.0001 to
        1.
    """

    lift_height: float = 0.15
    hold_time: float = 0.5
    rest_speed: float = 0.005


@dataclass(frozen=True)
class ShakeConfig:
    """Shake of the held object: translation along, then rotation about, each axis of the hand frame in turn.

    Every motion is a sine that fades in and out over two cycles each. Rotations are about the grasp centre. The default
    is 2 g with strokes of 20 mm and 0.2 rad, and takes 7.2 s for all axes.

    Attributes
    ----------
    acceleration : float
        Amplitude of the acceleration along each axis, m/s2, 0.1 to 100.
    lever : float
        Distance from the axis at which a rotation has the same amplitude of acceleration, metres: the angular
        acceleration is ``acceleration / lever``, 196 rad/s2 by default. At most 1, and large enough that the rotation
        stays below 0.5 rad.
    frequency : float
        Cycles per second, Hz: high enough that the stroke, ``acceleration / (2 pi frequency)**2``, stays below half of
        the lift height, and at most one cycle per 20 time steps.
    cycles : int
        Cycles at full amplitude on each axis, 1 to 1000.
    """

    acceleration: float = 2.0 * 9.80665
    lever: float = 0.1
    frequency: float = 5.0
    cycles: int = 2


@dataclass(frozen=True)
class TrialConfig:
    """A grasp trial: approach, close, lift, hold, and optionally shake.

    Attributes
    ----------
    standoff : float
        Length of the straight approach along the hand's z, metres, 0 to 0.5.
    close_time, lift_time, hold_time : float
        Durations of the three phases, seconds, 0.1 to 10; the last one from ``success.hold_time`` to 60.
    lift_height : float
        Height to lift, metres, from ``success.lift_height`` to 1.
    early_stop : bool
        Stop as soon as success is impossible.
    legacy : bool
        Also record the reference study's measures; an early stop then waits for them.
    shake : ShakeConfig or None
        If given, a success is followed by a shake and another hold, for ``survives_shake``. The other labels are those
        of the first hold.
    success : SuccessCriterion
        Criterion of success.
    """

    standoff: float = 0.10
    close_time: float = 1.3
    lift_height: float = 0.20
    lift_time: float = 1.0
    hold_time: float = 1.0
    early_stop: bool = True
    legacy: bool = False
    shake: ShakeConfig | None = None
    success: SuccessCriterion = field(default_factory=SuccessCriterion)


@dataclass(frozen=True)
class Randomization:
    """Randomization per episode in addition to the object and its initial state; none by default.

    Attributes
    ----------
    friction, mass : pair of float
        Least and greatest factor on the object's friction and mass.
    object_position : float
        Additional variation of the object's position in x and y, metres.
    hand_position, hand_rotation : float
        Bounds of the calibration error of the hand's pose, constant within an episode, along and about each axis,
        metres and radians.
    camera_position, camera_rotation : float
        Greatest translation and rotation of a camera along and about each of its axes, metres and radians.
    light : float
        Variation of the light, in [0, 1]: at 1 its direction rotates by up to 0.7 rad about each axis and its intensity
        changes by up to half.
    """

    friction: tuple[float, float] = (1.0, 1.0)
    mass: tuple[float, float] = (1.0, 1.0)
    object_position: float = 0.0
    hand_position: float = 0.0
    hand_rotation: float = 0.0
    camera_position: float = 0.0
    camera_rotation: float = 0.0
    light: float = 0.0

    @classmethod
    def standard(cls) -> Self:
        """Return the preset ``"standard"``: typical uncertainty of a calibrated robot and of household objects."""
        return cls(
            (0.7, 1.3),
            (0.75, 1.25),
            object_position=0.03,
            hand_position=0.005,
            hand_rotation=0.03,
            camera_position=0.01,
            camera_rotation=0.02,
            light=0.5,
        )


@dataclass(frozen=True)
class ClutterConfig:
    """Scenes of several objects.

    Attributes
    ----------
    layout : {"packed", "pile"} or mapping, optional
        How the objects lie; a bin is ``{"bin": {"inside": [x, y, z]}}``, with the sides of its floor and the height of
        its walls in metres. None: a single object, in one of its resting poses.
    objects_per_scene : (int, int)
        Least and greatest number of objects.
    scale : (float, float)
        Least and greatest scale of an object.
    spread : float
        Distance of the objects from the middle: see `graspbox.arrange`.
    max_failures : int
        Failed attempts in a row after which an episode of ``clear`` ends.
    """

    layout: str | Mapping[str, Mapping[str, Sequence[float]]] | None = None
    objects_per_scene: tuple[int, int] = (5, 5)
    scale: tuple[float, float] = (1.0, 1.0)
    spread: float = 1.0
    max_failures: int = 2

    @property
    def most_objects(self) -> int:
        """The greatest number of objects in a scene."""
        return 1 if self.layout is None else self.objects_per_scene[1]


@dataclass(frozen=True)
class GoalConfig:
    """Goals of environments.

    Attributes
    ----------
    task : {"reach", "place"}
        What is to reach the goal: the grasp centre of the hand, or the object's centre of mass.
    threshold : float
        Greatest distance from the goal at success, metres.
    ends : bool
        Whether an episode ends at success.
    """

    task: Literal["reach", "place"]
    threshold: float
    ends: bool


@dataclass(frozen=True)
class EnvConfig:
    """Settings of environments.

    Attributes
    ----------
    control : {"twist", "delta_pose", "target_pose", "top_down", "joint_velocity", "grasp_pose", "grasp_point", "clear"}
        Control mode: how an action moves the hand; ``grasp_pose`` and ``grasp_point`` are one decision per episode,
        ``clear`` several of them.
    fingers : {"synergy", "each"}
        How an action moves the fingers in closed-loop control.
    control_freq : float
        Actions per second in closed-loop control, Hz, 5 to 100.
    autoreset : {"next_step", "same_step", "disabled"}
        When the next episode begins after an end.
    max_episode_steps : int or None
        Steps after which an episode is truncated.
    observations : tuple of str
        Names of the observations, in order.
    randomization : Randomization
        Randomization per episode.
    clutter : ClutterConfig
        How objects lie: ``clear`` clears all of them, in the other modes one of several is the target.
    cameras : CamerasConfig
        Cameras and images.
    goal : GoalConfig, optional
        Goals, in closed-loop control of a single object.
    success : SuccessCriterion
        Criterion of success in every control mode, without goals.
    trial : TrialConfig
        The trial that follows a decision; do not set its own `success`.
    """

    control: Literal[
        "twist", "delta_pose", "target_pose", "top_down", "joint_velocity", "grasp_pose", "grasp_point", "clear"
    ] = "twist"
    fingers: Literal["synergy", "each"] = "synergy"
    control_freq: float = 5.0
    autoreset: Literal["next_step", "same_step", "disabled"] = "next_step"
    max_episode_steps: int | None = None
    observations: tuple[str, ...] = ("proprio", "tactile", "state")
    randomization: Randomization = field(default_factory=Randomization)
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    cameras: CamerasConfig = field(default_factory=CamerasConfig)
    goal: GoalConfig | None = None
    success: SuccessCriterion = field(default_factory=SuccessCriterion)
    trial: TrialConfig = field(default_factory=TrialConfig)
