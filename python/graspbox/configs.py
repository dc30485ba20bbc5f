"""Settings of the core as frozen dataclasses: the same fields, defaults and meaning as in Rust.

The core checks every value when it is used, and names the first one that is out of range.
"""

from dataclasses import dataclass, field
from typing import Literal, Self

__all__ = [
    "AgentConfig",
    "CameraConfig",
    "CamerasConfig",
    "CleanConfig",
    "DecomposeConfig",
    "FrictionConfig",
    "LoadConfig",
    "PhysicsConfig",
    "PictureConfig",
    "PlanConfig",
    "PoseConfig",
    "Randomization",
    "SuccessCriterion",
    "TrialConfig",
]


@dataclass(frozen=True)
class LoadConfig:
    """How large a mesh file may be.

    Attributes
    ----------
    scale : float
        Metres in one unit of the file.
    max_bytes, max_vertices, max_faces : int
        Limits; a file beyond them is refused before memory is taken for it.
    """

    scale: float = 1.0
    max_bytes: int = 256 << 20
    max_vertices: int = 4_000_000
    max_faces: int = 4_000_000


@dataclass(frozen=True)
class CleanConfig:
    """How a mesh is repaired, without inventing surface.

    Attributes
    ----------
    weld : float
        Vertices nearer than this share of the longest side become one, in [0, 1).
    min_component_area : float
        Components with less than this share of the surface are dropped, in [0, 1).
    orient : bool
        Turn faces outward.
    """

    weld: float = 1e-6
    min_component_area: float = 0.0
    orient: bool = True


@dataclass(frozen=True)
class DecomposeConfig:
    """How an object is cut into boxes.

    Attributes
    ----------
    fit : {"minimum", "pca"}
        Boxes of least volume, or along the principal axes.
    area_gain : float
        A cut is made only if its two rectangles cover less than this share of their face, in (0, 1].
    min_volume : float
        Each child's box must be larger than this, m3.
    volume_gain : float or None
        If given, the children's boxes together must have less than this share of the parent's volume, in (0, 2].
    max_boxes : int
        Greatest number of leaves.
    split_cost : {"share", "area"}
        Compare cuts by the share of their own face, or (the study's program) by area across faces.
    samples : int
        Surface points that cuts are searched on.
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
    """How candidate poses are made from boxes.

    Attributes
    ----------
    frame : {"reflex", "soft_hand"}
        Which hand axis lies along the longest side of a box: y for the ReFlex, x for the SoftHand.
    offset : float
        The palm stands this far outside the box, metres.
    standoffs : tuple of float
        Further distances that are tried, added to `offset`, metres.
    variation : {"random", "grid"}
        Random variations along and about the long axis, or the reference study's grid.
    variations : int
        Random variations a face and turn.
    max_shift : float
        Greatest shift along the long side, as a share of it.
    max_tilt : float
        Greatest turn about the long axis, radians.
    square : float
        A face whose short side is at least this share of its long one is also tried with the hand turned by a quarter.
    whole : bool
        Try the box around the whole object like the leaves.
    """

    frame: Literal["reflex", "soft_hand"] = "reflex"
    offset: float = 0.005
    standoffs: tuple[float, ...] = (0.015, 0.03, 0.045, 0.06)
    variation: Literal["random", "grid"] = "random"
    variations: int = 8
    max_shift: float = 0.4
    max_tilt: float = 0.5
    square: float = 0.6
    whole: bool = True


@dataclass(frozen=True)
class PlanConfig:
    """Everything that steers the planner.

    Attributes
    ----------
    decompose : DecomposeConfig
        How the object is cut into boxes.
    poses : PoseConfig
        How candidates are made.
    clearance : float
        Room that the open hand must have on every side, metres.
    standoff : float
        The hand comes from this far behind, along its -z, metres.
    seed : int
        Seed of the random variations.
    """

    decompose: DecomposeConfig = field(default_factory=lambda: DecomposeConfig(max_boxes=8))
    poses: PoseConfig = field(default_factory=PoseConfig)
    clearance: float = 0.001
    standoff: float = 0.10
    seed: int = 0


@dataclass(frozen=True)
class FrictionConfig:
    """Friction factors of table and object; the hand's own stand in its ``hand.toml``.

    The coefficient of a pair is the product of its two factors.

    Attributes
    ----------
    table : float
        Table top and ground.
    object : float
        1 leaves the other surface's factor as the coefficient; another value scales the object's grip in hand and on
        table alike.
    """

    table: float = 0.5
    object: float = 1.0


@dataclass(frozen=True)
class PhysicsConfig:
    """Integrator and contacts. The defaults pass the project's checks of hold and labels; change all or none.

    Attributes
    ----------
    dt : float
        Time step, seconds.
    solver_iterations : int
        Solver sub-steps in a step.
    idle_iterations : int
        The same while nothing in the hand moves, it is in contact with nothing and the object does not tumble.
    contact_frequency, static_contact_frequency : float
        Natural frequency of contacts, and of those with hand root and table, Hz.
    contact_damping_ratio : float
        Damping ratio of contacts.
    prediction : float
        Distance at which contacts are predicted, metres.
    contact_drift : float
        A pair is searched for contacts anew once it has moved by this since the last search, metres; 0 searches at
        every step.
    allowed_penetration : float
        Penetration that is left alone, metres.
    gravity : float
        m/s2, along -z of the world.
    friction : FrictionConfig
        Friction factors of table and object.
    """

    dt: float = 0.002
    solver_iterations: int = 4
    idle_iterations: int = 1
    contact_frequency: float = 240.0
    contact_damping_ratio: float = 2.0
    static_contact_frequency: float = 480.0
    prediction: float = 0.002
    contact_drift: float = 5e-5
    allowed_penetration: float = 0.0005
    gravity: float = 9.81
    friction: FrictionConfig = field(default_factory=FrictionConfig)


@dataclass(frozen=True)
class CameraConfig:
    """One camera; lengths in metres, in the frame of what carries it.

    Attributes
    ----------
    name : str
        Small letters and digits.
    mount : {"world", "hand"}
        What carries it: the world, or the palm (the grasp frame, z out of the palm).
    eye, target, up : tuple of float
        Where it is, what is in the middle of its image, what is upward in it.
    fov : float
        Angle from the upper to the lower border of its image, radians.
    near, far : float
        Least and greatest depth that it sees, metres.
    """

    name: str = "front"
    mount: Literal["world", "hand"] = "world"
    eye: tuple[float, float, float] = (-0.421, 0.0, 0.413)
    target: tuple[float, float, float] = (0.0, 0.0, 0.06)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float = 0.5
    near: float = 0.02
    far: float = 2.0


#: In front of the workspace, 0.55 m from its middle, looking down at 40 degrees.
FRONT = CameraConfig()
#: On a bracket beside the palm, looking between the fingers at what they hold.
PALM = CameraConfig("palm", "hand", eye=(0.0, 0.075, 0.0), target=(0.0, 0.0, 0.09), up=(-1.0, 0.0, 0.0), fov=1.3)
#: For pictures: from the side, with the whole workspace of the hand (0.7 x 0.7 x 0.75 m) and its body above.
VIEWER = CameraConfig("viewer", eye=(-1.125, -1.5, 1.0), target=(0.0, 0.0, 0.34375), fov=0.6, far=30.0)


@dataclass(frozen=True)
class CamerasConfig:
    """What environments see.

    Attributes
    ----------
    images : tuple of str
        Names of images, ``kind`` (from the first camera) or ``kind_camera``; the kinds are ``rgb``, ``depth``,
        ``rgbd``, ``segmentation``, ``points`` and ``voxels``. ``voxels`` alone is made of what all cameras see.
    image_size : pair of int
        Rows and columns of every image.
    cameras : tuple of CameraConfig
        The cameras.
    shadows : bool
        Whether hand and object throw shadows in colour images.
    voxels : int
        Voxels along each side of the cube of ``voxels``.
    voxel_side : float
        Side of that cube, metres. It stands over the table's middle; the table's top is in the middle of its lowest
        layer.
    """

    images: tuple[str, ...] = ()
    image_size: tuple[int, int] = (64, 64)
    cameras: tuple[CameraConfig, ...] = (FRONT, PALM)
    shadows: bool = True
    voxels: int = 32
    voxel_side: float = 0.4


@dataclass(frozen=True)
class PictureConfig:
    """A picture to look at.

    Attributes
    ----------
    image_size : pair of int
        Rows and columns.
    samples : int
        Samples along each side of a pixel, 1 to 8.
    camera : CameraConfig
        Who looks.
    """

    image_size: tuple[int, int] = (480, 640)
    samples: int = 3
    camera: CameraConfig = VIEWER


@dataclass(frozen=True)
class SuccessCriterion:
    """What counts as success: the object is held high, free of table and ground, and still, without a break.

    Attributes
    ----------
    lift_height : float
        The object's centre of mass is at least this far above its resting height, metres, 0.01 to 1.
    hold_time : float
        All of it holds for this long, seconds, 0 to 60.
    rest_speed : float
        In the hand's frame the object moves slower than this, m/s, 0.0001 to 1.
    """

    lift_height: float = 0.15
    hold_time: float = 0.5
    rest_speed: float = 0.005


@dataclass(frozen=True)
class TrialConfig:
    """A grasp trial: approach, close, lift, hold.

    Attributes
    ----------
    standoff : float
        The hand approaches from this far back along its -z, metres, 0 to 0.5.
    close_time, lift_time, hold_time : float
        Durations of the three phases, seconds, 0.1 to 10; the last one from ``success.hold_time`` to 60.
    lift_height : float
        Height to lift, metres, from ``success.lift_height`` to 1.
    early_stop : bool
        Stop as soon as success is out of reach.
    legacy : bool
        Read the reference study's own measures as well; early stops then wait until these are read.
    success : SuccessCriterion
        What counts as success.
    """

    standoff: float = 0.10
    close_time: float = 1.3
    lift_height: float = 0.20
    lift_time: float = 1.0
    hold_time: float = 1.0
    early_stop: bool = True
    legacy: bool = False
    success: SuccessCriterion = field(default_factory=SuccessCriterion)


@dataclass(frozen=True)
class Randomization:
    """What varies from episode to episode beside object and start; by default nothing.

    Attributes
    ----------
    friction, mass : pair of float
        Least and greatest factor on the object's friction and mass.
    object_position : float
        The object's place varies by so much more in x and y, metres.
    hand_position, hand_rotation : float
        Greatest constant error of the hand's pose in an episode, along and about each axis, metres and radians: the
        arm believes that the hand is elsewhere than it is.
    camera_position, camera_rotation : float
        Greatest shift and turn of a camera along and about each of its axes, metres and radians.
    light : float
        Variation of the light, in [0, 1]: at 1 the lamp turns by up to 0.7 rad about each axis and grows or fades by
        half.
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
        """Make the preset ``"standard"``: what a calibrated robot and a household leave open."""
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
class AgentConfig:
    """Everything that steers environments under an agent.

    Attributes
    ----------
    control : {"twist", "delta_pose", "target_pose", "grasp_pose"}
        How an action moves the hand; ``grasp_pose`` is one decision an episode.
    autoreset : {"next_step", "same_step", "disabled"}
        When a finished environment begins again.
    frame_skip : int
        Control periods of 0.05 s that a step lasts: its action holds for all of them.
    max_episode_steps : int or None
        An episode is cut off after so many steps.
    observations : tuple of str
        What is observed, in this order.
    randomization : Randomization
        What varies.
    cameras : CamerasConfig
        What is seen.
    success : SuccessCriterion
        What counts as success, in every control mode.
    trial : TrialConfig
        The trial that follows a decision; leave its own `success` as it is.
    """

    control: Literal["twist", "delta_pose", "target_pose", "grasp_pose"] = "twist"
    autoreset: Literal["next_step", "same_step", "disabled"] = "next_step"
    frame_skip: int = 1
    max_episode_steps: int | None = None
    observations: tuple[str, ...] = ("proprio", "tactile", "state")
    randomization: Randomization = field(default_factory=Randomization)
    cameras: CamerasConfig = field(default_factory=CamerasConfig)
    success: SuccessCriterion = field(default_factory=SuccessCriterion)
    trial: TrialConfig = field(default_factory=TrialConfig)
