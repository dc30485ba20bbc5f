"""Settings of a decision: from a depth image to the grasp to try (`graspbox.perception.finder`)."""

from dataclasses import dataclass, field, replace

from graspbox._common.arguments import check_range
from graspbox.perception.configs import ProposalConfig
from graspbox.perception.perturbations import PoseNoise

__all__ = ["FinderConfig"]

#: Ranges of the numbers of `FinderConfig`; more than these take minutes for one decision.
_RANGES = (
    ("predicted", 0, 1024),
    ("refinements", 0, 64),
    ("parents", 1, 256),
    ("children", 1, 256),
    ("position", 0.0, 0.1),
    ("rotation", 0.0, 1.0),
    ("finalists", 1, 256),
    ("neighbours", 0, 256),
)


@dataclass(frozen=True)
class FinderConfig:
    """How a grasp is found.

    Attributes
    ----------
    proposals : ProposalConfig
        How grasps are proposed by geometry.
    predicted : int
        Most grasps of a head, its best, that are added; 0 for none. Those that the open hand does not reach are left
        out.
    refinements : int
        Steps of refinement: each tries neighbours of the best grasps.
    parents, children : int
        In each step, how many of the best grasps are varied, and how often each.
    position, rotation : float
        Standard deviation of the first step along and about each axis of the hand, metres and radians; half of it in
        each step after.
    hand_error : PoseNoise, optional
        How far the hand may go from where it is sent. Where it is given, the best grasps are compared by their mean
        score over such errors and refined by it once more. By default the hand does not err.
    finalists : int
        How many of the best grasps are compared by that mean.
    neighbours : int
        Errors that the mean is of, besides none. A grasp that the open hand does not reach then counts as 0.
    """

    proposals: ProposalConfig = field(default_factory=ProposalConfig)
    predicted: int = 32
    refinements: int = 2
    parents: int = 4
    children: int = 8
    position: float = 0.006
    rotation: float = 0.10
    hand_error: PoseNoise | None = None
    finalists: int = 16
    neighbours: int = 32

    def __post_init__(self) -> None:
        for name, least, most in _RANGES:
            check_range(self, name, least, most)

    def tolerating(self, error: PoseNoise) -> "FinderConfig":
        """Give these settings for a hand with such errors; its grasps are refined at least twice."""
        return replace(self, hand_error=error, refinements=max(self.refinements, 2))
