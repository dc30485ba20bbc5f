"""From one depth image to ranked grasps: `grasps` lists the stages; a `Finder` has the parts that they use.

`GraspFinder` scores the grasps that geometry and a head propose. Other finders differ in what proposes and scores:
`graspbox.perception.HeadFinder`, `graspbox.perception.PlannedFinder` and
`graspbox.learn.models.nearest_finder.NearestFinder`.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.anchors import Candidates
from graspbox.perception.configs import CropConfig, FinderConfig
from graspbox.perception.crops import OCCUPIED
from graspbox.perception.depth_views import DepthView, Seen
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.outputs import Judged
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.reachability import Reachability, belonging
from graspbox.perception.scoring import Ranked, Score, Scoring, TrainedScore

__all__ = [
    "LOOKED_AT",
    "Complete",
    "Finder",
    "FoundGrasp",
    "GraspFinder",
    "Head",
    "Proposed",
    "Query",
    "SearchResult",
    "grasps",
    "observed_only",
    "sure",
]

#: From channels (n, 3, N, N, N) of crops to occupancies (n, N, N, N), all uint8.
Complete = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
#: Best grasps among which one is looked for that an arm can carry out.
_CARRIED = 100
#: Candidates of a head that are checked, for each that may be added.
LOOKED_AT = 4
#: Occupancy, of 255, that noise does not make; surface, of 255, of voxels in whose middle a pixel sees something.
_SURE, _SEEN = 170, 128


class Head(Protocol):
    """Predicts grasps, as `graspbox.policies.published.runtimes.AnchorHead` does."""

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Return the best grasps of one crop (2 or more, N, N, N) uint8."""


def sure(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Keep the voxels (N, N, N) of an occupancy that are occupied with a probability of two thirds or more."""
    return np.where(occupancy >= _SURE, occupancy, np.uint8(0))


def observed_only(channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Take the observed surface for the object: no completion."""
    return np.ascontiguousarray(channels[:, 0])


@dataclass(frozen=True, eq=False)
class FoundGrasp:
    """A grasp, and the image and the other grasps from which it was chosen.

    Attributes
    ----------
    chosen : int
        Index of the grasp.
    crop : CropConfig
        The crop.
    world_from_crop : (4, 4) float64
        Its frame, metres.
    object : (H, W) bool
        Pixels of the object.
    volume : (3, N, N, N) uint8
        The completed occupancy, and the channels ``surface`` and ``unseen`` of `Crops`.
    poses, preshapes, scores
        All grasps that were scored: ``crop_from_hand`` (m, 4, 4), (m,), (m,); refined ones last. With an error of the
        hand, only those that were compared by their mean.
    seconds : dict of str to float
        Duration of each stage of `graspbox.perception.finder.grasps`: ``crop``, ``complete``, ``propose``, ``score``,
        ``refine``, ``average``, ``rehearse``.
    rehearsed : (m,) float64, optional
        Share of the trials on the completed shape that succeed (`Rehearsal.shares`), NaN for grasps without trials;
        None without a rehearsal.
    judged : Judged, optional
        The outputs of a trained scorer; for a hand without error, with ``success`` after the rehearsal.
    """

    chosen: int
    crop: CropConfig
    world_from_crop: NDArray[np.float64]
    object: NDArray[np.bool_]
    volume: NDArray[np.uint8]
    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    scores: NDArray[np.float64]
    seconds: dict[str, float]
    rehearsed: NDArray[np.float64] | None = None
    judged: Judged | None = None

    @property
    def world_from_hand(self) -> NDArray[np.float64]:
        """Pose of the hand, (4, 4), metres."""
        return np.asarray(self.world_from_crop @ self.poses[self.chosen])

    @property
    def preshape(self) -> float:
        """See `graspbox.Hand.preshape_limits`."""
        return float(self.preshapes[self.chosen])

    @property
    def score(self) -> float:
        """Its score; greater is better."""
        return float(self.scores[self.chosen])

    @property
    def success(self) -> float | None:
        """Probability that it succeeds; None if the finder states none."""
        return None if self.judged is None else float(self.judged.success[self.chosen])

    @property
    def occupancy(self) -> NDArray[np.uint8]:
        """The completed occupancy (N, N, N), 0 to 255 for 0 to 1."""
        return np.asarray(self.volume[0])

    @property
    def top(self) -> float:
        """Height of the completed object over the table, metres."""
        filled = np.flatnonzero((self.occupancy >= OCCUPIED).any(axis=(0, 1)))
        return float(self.crop.origin[2] + (filled[-1] + 1) * self.crop.voxel_size) if len(filled) else 0.0

    def other(self, index: int) -> Self:
        """Choose another of the scored grasps, by index."""
        return replace(self, chosen=index)


@dataclass(frozen=True, eq=False)
class Query:
    """What to grasp in one depth image, and how. Only `GraspFinder` reads what follows `keep_off`, but for `carried`.

    Attributes
    ----------
    seed : int
        Seed of the refinement.
    target : (H, W) bool, optional
        Pixels of the object to grasp, among several; by default any of them.
    keep_off : (k, 3) float64, optional
        Points of known obstacles, such as the walls of a bin, close together, world frame, metres.
    failed : tuple of FoundGrasp
        Earlier failures; grasps score lower the nearer they are to them.
    hand_error : PoseNoise, optional
        As `FinderConfig.tolerating`; by default as the finder is configured.
    rehearsed : int, optional
        As `FinderConfig.rehearsing`; by default as the finder is configured, but none of a target among other objects.
    order : bool
        The order of all grasps matters: without it, a rehearsal ends once no other grasp can become the best.
    known : (k, 4, 4) and (k,) float64, optional
        ``world_from_hand``, metres, and preshapes of grasps that are scored too where the open hand is free.
    carried : callable, optional
        Of the best grasps, ``world_from_hand`` (m, 4, 4) and preshapes (m,), returns the index of the first that an arm
        can carry out, or None: `Finder.find` returns that one.
    """

    seed: int = 0
    target: NDArray[np.bool_] | None = None
    keep_off: NDArray[np.float64] | None = None
    failed: tuple[FoundGrasp, ...] = ()
    hand_error: PoseNoise | None = None
    rehearsed: int | None = None
    order: bool = False
    known: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    carried: Callable[[NDArray[np.float64], NDArray[np.float64]], int | None] | None = None

    def settings(self, config: FinderConfig) -> FinderConfig:
        """Return a finder's settings with those of the query."""
        if self.hand_error is not None:
            config = config.tolerating(self.hand_error)
        return config if self.rehearsed is None else config.rehearsing(self.rehearsed)


class Proposed(NamedTuple):
    """m proposals in a crop: ``crop_from_hand`` (m, 4, 4), metres, preshapes (m,), scores (m,) or a scoring."""

    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    scores: NDArray[np.float64] = np.zeros(0)
    scoring: Scoring | None = None


class SearchResult(NamedTuple):
    """The crop of a depth image, its scored grasps (None if it shows no object), and the seconds of each stage."""

    seen: Seen
    ranked: Ranked | None
    seconds: dict[str, float]


def grasps(image: DepthView | Seen, query: Query, finder: "Finder") -> SearchResult:
    """Find grasps: depth image, levelled view and its crop, completed shape, proposals, scored grasps.

    A `Seen` is a crop that was made before; the pixels of the query are then not read. Raises as `Finder.find`.
    """
    seconds: dict[str, float] = {}
    last = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal last
        now = time.perf_counter()
        seconds[stage], last = now - last, now

    if isinstance(image, DepthView):
        image = image.seen(finder.crop, query.target, num_threads=finder.num_threads)
    seen = image
    lap("crop")
    if seen.target is not None and not finder.targets:
        raise ConfigError(f"a {type(finder).__name__} grasps any object; it cannot take a target")
    if not seen.crops.found[0]:
        return SearchResult(seen, None, seconds)
    channels = seen.crops.channels
    volume = np.concatenate([finder.complete(channels), channels[0, :2]])
    lap("complete")
    poses, preshapes, scores, scoring = finder.propose(volume, seen, query)
    lap("propose")
    if scoring is None or not len(poses):
        return SearchResult(seen, Ranked(volume, poses, preshapes, scores), seconds)
    config, rng = scoring.config, np.random.default_rng(query.seed)
    ranked = scoring.plain(poses, preshapes)
    lap("score")
    ranked = scoring.refined(ranked, rng)
    lap("refine")
    if config.hand_error is not None:
        ranked = scoring.averaged(ranked, config.hand_error, rng)
        lap("average")
    if config.rehearsal is not None:
        ranked = scoring.rehearsed(ranked, config.rehearsal, query.order or query.carried is not None)
        lap("rehearse")
    return SearchResult(seen, ranked, seconds)


class Finder(ABC):
    """The parts of `grasps` that complete shapes and propose grasps.

    Parameters
    ----------
    crop : CropConfig
        The crop.
    num_threads : int, optional
        Threads of the crop; by default one per core.
    complete : callable
        Predicts the occupancy of crops; by default it is the observed surface.
    """

    #: Whether it can grasp one of several objects.
    targets = False
    #: Whether `FoundGrasp.success` is a probability.
    states_success = False

    def __init__(self, crop: CropConfig, num_threads: int | None = None, complete: Complete = observed_only) -> None:
        self.crop, self.complete, self.num_threads = crop, complete, num_threads

    @abstractmethod
    def propose(self, volume: NDArray[np.uint8], seen: Seen, query: Query) -> Proposed:
        """Propose grasps, perhaps none, in a completed crop (3, N, N, N): `FoundGrasp.volume`; raises as `find`."""

    def find(self, image: DepthView | Seen, query: Query = Query()) -> FoundGrasp | None:
        """Find the grasp to try.

        Parameters
        ----------
        image : DepthView or Seen
            The image, whose small errors of the camera's height and tilt are corrected
            (`graspbox.perception.leveling.level`); or its crop.
        query : Query
            What to grasp.

        Returns
        -------
        FoundGrasp or None
            None if no object is seen, or no grasp of it is feasible.

        Raises
        ------
        ConfigError
            For arrays of another shape or type, a query that this finder cannot answer, and networks whose outputs are
            not finite.
        """
        seen, ranked, seconds = grasps(image, query, self)
        if ranked is None or not len(ranked.scores):
            return None
        best, crops = int(np.argmax(ranked.scores)), seen.crops
        if query.carried is not None:
            first = ranked.best(_CARRIED)
            carried = query.carried(crops.world_from_crop[0] @ ranked.poses[first], ranked.preshapes[first])
            if carried is None:
                return None
            best = int(first[carried])
        return FoundGrasp(
            best, self.crop, crops.world_from_crop[0], crops.object[0], seconds=seconds, **ranked._asdict()
        )


class GraspFinder(Finder):
    """Finds grasps in depth images: completes the object, proposes grasps, scores them, refines the best.

    Parameters
    ----------
    grid : HandGrid
        The hand, with the settings of the crop.
    complete : callable
        Predicts the occupancy of crops: `graspbox.policies.published.runtimes.Completion`, or `observed_only`.
    score : callable
        Scores grasps: `graspbox.policies.published.runtimes.Scorer`.
    config : FinderConfig
        How a grasp is found.
    head : Head, optional
        Predicts grasps that are added to the proposals.
    """

    targets = True

    def __init__(
        self,
        grid: HandGrid,
        complete: Complete,
        score: Score,
        config: FinderConfig = FinderConfig(),  # noqa: B008 (frozen)
        *,
        head: Head | None = None,
    ) -> None:
        super().__init__(grid.crop, grid.num_threads, complete)
        self.grid, self.score, self.config, self.head = grid, score, config, head
        self.states_success = isinstance(score, TrainedScore)

    def propose(self, volume: NDArray[np.uint8], seen: Seen, query: Query) -> Proposed:
        """Propose grasps of geometry, then of the head, off obstacles where any can be: see `Finder.propose`."""
        config, frame = query.settings(self.config), seen.crops.world_from_crop[0]
        if seen.target is not None and query.rehearsed is None:
            config = config.rehearsing(0)
        if seen.target is not None and config.rehearsal is not None:
            raise ConfigError("a rehearsal takes all that is seen for one object; rehearse none, or pass no target")
        # A grasp that touches a wall may still succeed: the hand stops only where a wall resists.
        obstacles = [np.zeros((0, 3))]
        if query.keep_off is not None and len(query.keep_off):
            obstacles.insert(0, (query.keep_off - frame[:3, 3]) @ frame[:3, :3])
        predicted = cache(lambda: self._predicted(seen, config))
        shown = None
        if config.seen is not None and seen.target is None:
            shown = config.seen.surface_for(len(self.grid.hand.chains))
        tries = ((points, *shape) for points in obstacles for shape in _shapes(volume, seen, shown))
        for points, occupancy, target in tries:
            reach = Reachability(self.grid, config.proposals, occupancy, target, points)
            poses, preshapes = self._candidates(reach, predicted, config)
            if len(poses):
                break
        if query.known is not None:
            again, known = np.linalg.inv(frame) @ query.known[0], query.known[1]
            # Noise must not end what was free: only what is surely occupied counts.
            kept = replace(reach, occupancy=sure(volume[0]), obstacles=obstacles[0]).free(again, known)
            poses, preshapes = np.concatenate([poses, again[kept]]), np.concatenate([preshapes, known[kept]])
        failed = [(grasp.world_from_hand, grasp.preshape) for grasp in query.failed]
        return Proposed(poses, preshapes, scoring=Scoring(self.score, volume, reach, config, failed, frame))

    def _predicted(self, seen: Seen, config: FinderConfig) -> Candidates:
        """Return the grasps of the head."""
        assert self.head is not None
        return self.head.candidates(seen.crops.channels[0], LOOKED_AT * config.predicted)

    def _candidates(
        self, reach: Reachability, predicted: Callable[[], Candidates], config: FinderConfig
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return feasible grasps of geometry, then of the head: poses (m, 4, 4) in the crop, and preshapes (m,)."""
        own = reach.propose()
        if self.head is None or not config.predicted or (config.enough is not None and len(own) >= config.enough):
            return own.poses, own.preshape
        others = predicted()
        preshapes = self.grid.preshapes[others.preshape]
        free = np.flatnonzero(reach.feasible(others.poses, preshapes))[: config.predicted]
        return np.concatenate([own.poses, others.poses[free]]), np.concatenate([own.preshape, preshapes[free]])


def _shapes(
    volume: NDArray[np.uint8], seen: Seen, shown: int | None
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8] | None]]:
    """Yield what is occupied and, of it, the target, (N, N, N): as completed, then with what is seen.

    The completion may lack what is seen. With `shown`, a surface of 255, that comes first; noise may hide grasps then.
    """
    for least in (None, _SEEN) if shown is None else (shown, None):
        occupancy = np.asarray(volume[0])
        if least is not None:
            occupancy = np.where(volume[1] >= least, np.uint8(255), occupancy)
        target = None
        if seen.target is not None:
            assert seen.others is not None
            target = belonging(occupancy, seen.others, seen.target)
        yield occupancy, target
