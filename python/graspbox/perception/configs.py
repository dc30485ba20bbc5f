"""Settings of perception, as frozen dataclasses; all but those of finder and rehearsal mirror structs of the core."""

from dataclasses import dataclass, field, replace

from graspbox._common.arguments import check_range
from graspbox.errors import ConfigError
from graspbox.perception.perturbations import PoseNoise

__all__ = [
    "EVERYTHING",
    "MANY_FINGERS",
    "CropConfig",
    "DepthNoise",
    "FinderConfig",
    "HandGridConfig",
    "ProposalConfig",
    "RehearsalConfig",
    "SeenConfig",
]


#: Ranges of the numbers of `FinderConfig`; more than these take minutes for one decision.
_RANGES = (
    ("predicted", 0, 1024),
    ("enough", 0, 1024),
    ("lever_penalty", 0.0, 100.0),
    ("refinements", 0, 64),
    ("parents", 1, 256),
    ("children", 1, 256),
    ("position", 0.0, 0.1),
    ("rotation", 0.0, 1.0),
    ("finalists", 1, 256),
    ("neighbours", 0, 256),
)


#: From so many fingers on a hand holds more with a rehearsal; jaws do not.
MANY_FINGERS = 3
#: Ranges of the numbers of `RehearsalConfig`.
_REHEARSAL_RANGES = (
    ("grasps", 1, 256),
    ("trials", 1, 64),
    ("position", 0.0, 0.05),
    ("rotation", 0.0, 0.5),
    ("offset", -100.0, 100.0),
    ("slope", 0.0, 100.0),
    ("gain", 0.0, 100.0),
    ("density", 10.0, 20_000.0),
    ("heavy", 0.0, 10.0),
)


@dataclass(frozen=True)
class DepthNoise:
    """Noise of a depth camera, after Nguyen et al. (edges and dropout: our choice).

    A pixel at depth z, on a surface whose normal is turned by the angle a away from the ray, has axial noise of
    standard deviation ``axial_floor + axial_growth (z - axial_near)^2 + axial_grazing / sqrt(z) * (a / (pi/2 - a))^2``,
    where the growth begins at ``axial_near``.

    Attributes
    ----------
    axial_floor, axial_growth, axial_near, axial_grazing : float
        Metres, 1/m, metres and m^1.5.
    lateral : float
        Standard deviation of the direction of a pixel's ray, radians: 0.8 pixels of a lens of 585 pixels.
    edge_step : float
        A pixel is at an edge if the depth of a neighbour differs by more than this, metres.
    edge_dropout, grazing_dropout, dropout : float
        Probability that a pixel at an edge, one beyond `grazing_angle`, and any pixel has no depth.
    grazing_angle : float
        Angle between ray and normal from which a pixel may have no depth, radians; measured up to 1.4.
    quantum : float
        Step of the camera's numbers, metres.
    correlated_growth : float
        Standard deviation of noise that neighbours share, divided by the square of the depth, 1/m. On tables that real
        cameras see it is 0.001 to 0.004.
    correlation : float
        Extent of what neighbours share, and of holes, radians.
    holes : float
        Share of the image that is lost in holes.

    References
    ----------
    C. Nguyen, S. Izadi, D. Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking",
    3DIMPVT 2012.
    """

    axial_floor: float = 0.0012
    axial_growth: float = 0.0019
    axial_near: float = 0.4
    axial_grazing: float = 0.0001
    lateral: float = 0.0014
    edge_step: float = 0.02
    edge_dropout: float = 0.5
    grazing_angle: float = 1.4
    grazing_dropout: float = 0.7
    dropout: float = 0.002
    quantum: float = 0.001
    correlated_growth: float = 0.0
    correlation: float = 0.03
    holes: float = 0.0

    @classmethod
    def none(cls) -> "DepthNoise":
        """Describe a camera that only rounds to millimetres."""
        return cls(
            axial_floor=0.0,
            axial_growth=0.0,
            axial_grazing=0.0,
            lateral=0.0,
            edge_dropout=0.0,
            grazing_dropout=0.0,
            dropout=0.0,
        )


#: Gap (`CropConfig.gap`) with which everything on the table is one object, metres.
EVERYTHING = 0.5


@dataclass(frozen=True)
class CropConfig:
    """The cube around the observed object, and the criteria that separate its pixels from the table's.

    Attributes
    ----------
    side : float
        Side of the cube, metres.
    resolution : int
        Voxels along each side.
    below : float
        Depth of the cube below the table, metres.
    min_height : float
        Pixels higher than this above the table, after smoothing, are not the table's, metres.
    gap : float
        Widest gap between pixels of one object in plan view, metres.
    min_pixels : int
        Fewer pixels are no object.
    """

    side: float = 0.30
    resolution: int = 48
    below: float = 0.0125
    min_height: float = 0.004
    gap: float = 0.03
    min_pixels: int = 8

    @property
    def voxel_size(self) -> float:
        """Side of a voxel, metres."""
        return self.side / self.resolution

    def has_voxels_of(self, other: "CropConfig") -> bool:
        """Whether the voxels of another crop mean the same; only its `gap` may differ."""
        return replace(self, gap=other.gap) == other

    @property
    def origin(self) -> tuple[float, float, float]:
        """Least corner of the cube in the crop frame, metres."""
        return (-self.side / 2, -self.side / 2, -self.below)


@dataclass(frozen=True)
class HandGridConfig:
    """The grid of cells around a hand, and how collisions are looked up.

    Attributes
    ----------
    cell : float
        Side of a cell, metres; with `shape` the least side.
    shape : tuple of int, optional
        Numbers of cells along x, y and z, multiples of 8; cells are then enlarged to the volume that the fingers sweep.
        By default there are as many cells as it needs.
    clearance : float
        Room around the open hand on every side, metres.
    standoff : float
        The hand approaches from this far behind, along its -z, metres.
    """

    cell: float = 0.01
    shape: tuple[int, int, int] | None = None
    clearance: float = 0.002
    standoff: float = 0.1


@dataclass(frozen=True)
class ProposalConfig:
    """How candidate grasps are made.

    Attributes
    ----------
    seeds : int
        Surface points that are approached, spread as far apart as possible.
    standoffs : tuple of float
        Distances of the palm from the top of the surface, metres.
    radius : float
        Radius of the surface around a point along whose least extent the hand closes, metres.
    boxes : int
        Boxes of the planner's decomposition whose faces are approached as well; 0 for none.
    fingers : int
        Fewest chains that must meet the object as they close; hands with fewer need all.
    points : int
        Points of the surface with which collisions are searched.
    most : int
        Most candidates.
    """

    seeds: int = 32
    standoffs: tuple[float, ...] = (0.005, 0.02, 0.035, 0.05, 0.065)
    radius: float = 0.05
    boxes: int = 4
    fingers: int = 2
    points: int = 1000
    most: int = 128


@dataclass(frozen=True)
class RehearsalConfig:
    """How grasps are tried in simulation on the completed shape (`graspbox.perception.shapes.Rehearsal`).

    Attributes
    ----------
    grasps : int
        How many of the best grasps are tried.
    fingers : int, optional
        Hands with fewer chains of joints try none; by default every hand does.
    thresholds : tuple of int
        Least values of a voxel that a shape fills, 1 to 255. Each makes a shape, since a completion is uncertain.
    trials : int
        Trials of each grasp with each shape: one at the pose itself, the others with errors of the hand's pose. With a
        stated error of the hand there are at least 4.
    position, rotation : float
        Standard deviations of these errors along and about each axis of the hand, metres and radians.
    offset, slope, gain : float
        A grasp of score s of whose trials a share h succeeds then scores sigmoid(offset + slope logit(s) + gain h).
    density : float
        Mass over the completed volume, kg/m3.
    heavy : float
        Each lift is repeated with this mass, kg, if it is greater: metal and wood look alike in depth.

    Raises
    ------
    ConfigError
        For a number out of range.
    """

    grasps: int = 8
    fingers: int | None = None
    thresholds: tuple[int, ...] = (96,)
    trials: int = 1
    position: float = 0.003
    rotation: float = 0.05
    offset: float = -0.3
    slope: float = 0.55
    gain: float = 1.65
    density: float = 500.0
    heavy: float = 0.3

    def __post_init__(self) -> None:
        for name, least, most in _REHEARSAL_RANGES:
            check_range(self, name, least, most)
        if self.fingers is not None:
            check_range(self, "fingers", 1, 64)
        if not 1 <= len(self.thresholds) <= 16 or not all(1 <= value <= 255 for value in self.thresholds):
            raise ConfigError(f"thresholds is {self.thresholds}; pass 1 to 16 numbers of 1 to 255")


@dataclass(frozen=True)
class SeenConfig:
    """What an image shows of an object, though its completion lacks it (`FinderConfig.seen`).

    Attributes
    ----------
    surface : int
        Least surface of a voxel, of 255, that is occupied since the image shows it.
    fingers : int
        Hands with fewer chains of joints leave it out: between jaws a layer of voxels takes the room that they need.

    Raises
    ------
    ConfigError
        For a number out of range.
    """

    surface: int = 128
    fingers: int = 4

    def __post_init__(self) -> None:
        check_range(self, "surface", 1, 255)
        check_range(self, "fingers", 1, 64)

    def surface_for(self, chains: int) -> int | None:
        """Return the least surface for a hand with so many chains of joints; None if it leaves it out."""
        return self.surface if chains >= self.fingers else None


@dataclass(frozen=True)
class FinderConfig:
    """How a grasp is found.

    Attributes
    ----------
    proposals : ProposalConfig
        How grasps are proposed by geometry.
    seen : SeenConfig, optional
        A single object is also what the image shows of it, where the completion lacks that; by default, and of a target
        among others, only where geometry finds no grasp otherwise.
    predicted : int
        Most grasps of a head, its best that the open hand reaches, that are added; 0 for none.
    enough : int, optional
        The head is asked only if geometry proposes fewer grasps than this; by default always.
    lever_penalty : float, optional
        Penalty of a grasp's score per metre of its lever (`HandGrid.levers`), 1/m; by default none.
    refinements : int
        Steps of refinement: each tries neighbours of the best grasps.
    parents, children : int
        In each step, how many of the best grasps are varied, and how often each.
    position, rotation : float
        Standard deviation of the first step along and about each axis of the hand, metres and radians; half of it in
        each step after.
    hand_error : PoseNoise, optional
        Expected error of the hand's pose: the best grasps are then compared by their mean score over such errors, and
        refined by it once more. By default none.
    finalists : int
        How many of the best grasps are compared by that mean.
    neighbours : int
        Errors that the mean is of, besides none. A grasp that the open hand does not reach then counts as 0.
    rehearsal : RehearsalConfig, optional
        Try the best grasps in simulation on the completed shape, with errors of `hand_error` if it is set; by default
        not.
    """

    proposals: ProposalConfig = field(default_factory=ProposalConfig)
    seen: SeenConfig | None = None
    predicted: int = 32
    enough: int | None = None
    lever_penalty: float | None = None
    refinements: int = 2
    parents: int = 4
    children: int = 8
    position: float = 0.006
    rotation: float = 0.10
    hand_error: PoseNoise | None = None
    finalists: int = 16
    neighbours: int = 32
    rehearsal: RehearsalConfig | None = None

    def __post_init__(self) -> None:
        for name, least, most in _RANGES:
            if getattr(self, name) is not None:
                check_range(self, name, least, most)

    def tolerating(self, error: PoseNoise) -> "FinderConfig":
        """Return these settings for a hand with such errors; its grasps are refined at least twice."""
        return replace(self, hand_error=error, refinements=max(self.refinements, 2))

    def rehearsing(self, grasps: int) -> "FinderConfig":
        """Return these settings with trials of the best `grasps` on the completed shape, with any hand; 0 for none."""
        if grasps == 0:
            return replace(self, rehearsal=None)
        return replace(self, rehearsal=replace(self.rehearsal or RehearsalConfig(), grasps=grasps, fingers=None))
