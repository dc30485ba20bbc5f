"""From one depth image to ranked grasps; values go forward only.

A `Finder` levels the camera of a `DepthView` by the table, crops the object, ranks grasps in the crop and takes the
best as a `FoundGrasp`. `GraspFinder` scores the grasps that geometry and a head propose. Other finders differ in how
they rank: `graspbox.perception.HeadFinder`, `graspbox.perception.PlannedFinder` and
`graspbox.models.nearest_finder.NearestFinder`.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.anchors import Candidates
from graspbox.perception.configs import CropConfig, FinderConfig, RehearsalConfig
from graspbox.perception.crops import OCCUPIED, Crops
from graspbox.perception.depth_views import DepthView
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.outputs import check_finite
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.perception.reachability import Reachability, belonging
from graspbox.perception.shapes import Rehearsal, rehearsed_score, rehearsed_success

__all__ = [
    "LOOKED_AT",
    "Clock",
    "Complete",
    "Finder",
    "FoundGrasp",
    "GraspFinder",
    "Head",
    "Ranked",
    "Score",
    "TrainedScore",
    "observed_only",
    "volume_of",
]

#: From channels (n, 3, N, N, N) of crops to occupancies (n, N, N, N), all uint8.
Complete = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
#: From a volume (3, N, N, N) uint8 (completed, surface, unseen), poses ``crop_from_hand`` (m, 4, 4) and preshapes (m,)
#: to scores (m,); greater is better.
Score = Callable[[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
#: Candidates of a head that are checked, for each that may be added.
LOOKED_AT = 4
#: Scale on which a grasp resembles one that failed, metres and radians.
_MOVED, _TURNED = 0.03, 0.5


class Head(Protocol):
    """Predicts grasps: a network of `graspbox.models.head.heads`, or `graspbox.artifacts.runtimes.AnchorHead`."""

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Give the best grasps of one crop (2 or more, N, N, N) uint8."""


@runtime_checkable
class TrainedScore(Protocol):
    """A `Score` of trained networks, which also states probabilities: `graspbox.artifacts.runtimes.Scorer`."""

    #: A score by all networks for every grasp; the object itself asks all of them only for the best grasps of a call.
    each: Score
    #: The probabilities of grasps, as `graspbox.artifacts.runtimes.Judged`; arguments as of a `Score`.
    judge: Callable[[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]], Any]


class Ranked(NamedTuple):
    """m grasps in one crop, in any order.

    Attributes
    ----------
    volume : (3, N, N, N) uint8
        Completed, surface, unseen: see `volume_of`.
    poses : (m, 4, 4) float64
        ``crop_from_hand``, metres.
    preshapes : (m,) float64
        See `graspbox.Hand.preshape_limits`.
    scores : (m,) float64
        Greater is better.
    rehearsed : (m,) float64, optional
        Share of the trials on the completed shape that succeed (`Rehearsal.shares`), NaN for grasps without trials;
        None without a rehearsal.
    """

    volume: NDArray[np.uint8]
    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    scores: NDArray[np.float64]
    rehearsed: NDArray[np.float64] | None = None

    def kept(self, rows: NDArray[np.int64]) -> "Ranked":
        """Keep some of the grasps, by index."""
        rehearsed = None if self.rehearsed is None else self.rehearsed[rows]
        return Ranked(self.volume, self.poses[rows], self.preshapes[rows], self.scores[rows], rehearsed)

    def best(self, count: int) -> NDArray[np.int64]:
        """Give the indices of the best grasps, the best first."""
        return np.argsort(-self.scores, kind="stable")[:count]


@dataclass(frozen=True, eq=False)
class FoundGrasp:
    """A grasp, and how it was found.

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
        Completed, surface, unseen.
    poses, preshapes, scores
        All grasps that were scored: ``crop_from_hand`` (m, 4, 4), (m,), (m,); refined ones last. With an error of the
        hand, those alone that were compared by their mean.
    seconds : dict of str to float
        Time that each step took: ``crop``, ``complete``, ``propose``, ``score``, ``refine``, ``average``, ``rehearse``.
    rehearsed : (m,) float64, optional
        Shares of their trials on the completed shape that succeed: see `Ranked`.
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

    @property
    def world_from_hand(self) -> NDArray[np.float64]:
        """Where the hand goes, (4, 4), metres."""
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
    def occupancy(self) -> NDArray[np.uint8]:
        """The completed occupancy (N, N, N), 0 to 255 for 0 to 1."""
        return np.asarray(self.volume[0])

    @property
    def top(self) -> float:
        """Height of the object over the table as the camera sees it and the completion adds to it, metres."""
        filled = np.flatnonzero((self.occupancy >= OCCUPIED).any(axis=(0, 1)))
        return float(self.crop.origin[2] + (filled[-1] + 1) * self.crop.voxel_size) if len(filled) else 0.0

    def other(self, index: int) -> Self:
        """Choose another of the grasps that were scored, by its index."""
        return replace(self, chosen=index)


class Clock:
    """Measures the time of steps."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        """End a step."""
        now = time.perf_counter()
        self.seconds[step], self._last = now - self._last, now


class Finder(ABC):
    """Finds the grasp to try in a depth image.

    Parameters
    ----------
    crop : CropConfig
        The crop.
    num_threads : int, optional
        Threads of the crop; by default one per core.

    Attributes
    ----------
    crop
        The same.
    """

    def __init__(self, crop: CropConfig, num_threads: int | None = None) -> None:
        self.crop, self._num_threads = crop, num_threads

    @abstractmethod
    def rank(self, crops: Crops, seed: int, clock: Clock) -> Ranked | None:
        """Score grasps in a single crop, which shows an object.

        Parameters
        ----------
        crops : Crops
            The crop.
        seed : int
            Seed of the refinement.
        clock : Clock
            Measures the steps.

        Returns
        -------
        Ranked or None
            The grasps; None, or none of them, where there are no feasible ones.
        """

    def targeting(self, visible: NDArray[np.bool_]) -> Self:
        """Give a finder for one of several objects.

        Parameters
        ----------
        visible : (N, N, N) bool
            Voxels of the crop in which the object is seen.

        Raises
        ------
        ConfigError
            If grasps of this finder are for any object.
        """
        del visible
        raise ConfigError(f"a {type(self).__name__} grasps any object; it cannot be told which one")

    def keeping_off(self, points: NDArray[np.float64]) -> Self:
        """Give a finder whose grasps keep off what is known to stand there, such as the walls of a bin.

        Parameters
        ----------
        points : (k, 3) float64
            Points of it, close together, world frame, metres.

        Returns
        -------
        Finder
            By default the same finder, which knows nothing of them: `GraspFinder` alone keeps off.
        """
        del points
        return self

    def find(self, view: DepthView, *, seed: int = 0, target: NDArray[np.bool_] | None = None) -> FoundGrasp | None:
        """Find the grasp to try.

        Parameters
        ----------
        view : DepthView
            The image. Small errors of the camera's height and tilt are corrected
            (`graspbox.perception.leveling.level`).
        seed : int
            Seed of the refinement.
        target : (H, W) bool, optional
            Pixels of the object to grasp, among several; by default any of them.

        Returns
        -------
        FoundGrasp or None
            None where no object is seen, or no grasp of it is feasible.

        Raises
        ------
        ConfigError
            For arrays of another shape or type, and networks that give numbers that are not finite.
        """
        clock = Clock()
        leveled = view.leveled()
        crops = leveled.crops(self.crop, num_threads=self._num_threads)
        clock.lap("crop")
        if target is None or not crops.found[0]:
            finder = self
        else:
            finder = self.targeting(leveled.voxels(target, crops.world_from_crop[0], self.crop))
        found = finder.decide(crops, seed=seed)
        return None if found is None else replace(found, seconds={**clock.seconds, **found.seconds})

    def decide(self, crops: Crops, *, seed: int = 0) -> FoundGrasp | None:
        """Find the grasp to try in a single crop; result and errors as `find`."""
        clock = Clock()
        ranked = self.rank(crops, seed, clock) if crops.found[0] else None
        if ranked is None or not len(ranked.scores):
            return None
        best = int(np.argmax(ranked.scores))
        frame, seen, rehearsed = crops.world_from_crop[0], crops.object[0], ranked.rehearsed
        return FoundGrasp(best, self.crop, frame, seen, *ranked[:4], clock.seconds, rehearsed)

    def confidence(self, found: FoundGrasp | None) -> float | None:
        """Give the probability that a grasp succeeds; None where the finder states none."""
        del found
        return None


def observed_only(channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Take the observed surface for the object: no completion."""
    return np.ascontiguousarray(channels[:, 0])


def volume_of(crops: Crops, complete: Complete) -> NDArray[np.uint8]:
    """Complete a single crop: (3, N, N, N) uint8, the occupancy and the channels ``surface`` and ``unseen``."""
    return np.concatenate([complete(crops.channels), crops.channels[0, :2]])


class GraspFinder(Finder):
    """Finds grasps in depth images: completes the object, proposes grasps, scores them, refines the best.

    Parameters
    ----------
    grid : HandGrid
        The hand, with the settings of the crop.
    complete : callable
        Predicts the occupancy of crops: `graspbox.artifacts.runtimes.Completion`, or `observed_only`.
    score : callable
        Scores grasps: `graspbox.artifacts.runtimes.Scorer`.
    config : FinderConfig
        How a grasp is found.
    head : Head, optional
        Predicts grasps that are added to the proposals.

    Attributes
    ----------
    grid, complete, score, config, head
        The same.
    """

    def __init__(
        self,
        grid: HandGrid,
        complete: Complete,
        score: Score,
        config: FinderConfig = FinderConfig(),  # noqa: B008 (frozen)
        *,
        head: Head | None = None,
    ) -> None:
        super().__init__(grid.crop, grid.num_threads)
        self.grid, self.complete, self.score, self.config, self.head = grid, complete, score, config, head
        self._failed: tuple[FoundGrasp, ...] = ()
        self._target: NDArray[np.bool_] | None = None
        self._obstacles = np.zeros((0, 3))

    def targeting(self, visible: NDArray[np.bool_]) -> Self:
        """Give a finder for one of several objects: see `Finder.targeting`; raises also if it rehearses grasps."""
        if self.config.rehearsal is not None:
            raise ConfigError("a rehearsal takes all that is seen for one object; rehearse none, or give no target")
        found = copy(self)
        found._target = visible
        return found

    def keeping_off(self, points: NDArray[np.float64]) -> Self:
        """Give a finder that keeps off points: see `Finder.keeping_off`."""
        found = copy(self)
        found._obstacles = points
        return found

    def tolerating(self, error: PoseNoise) -> Self:
        """Give a finder for a hand with such errors: see `FinderConfig.tolerating`."""
        found = copy(self)
        found.config = self.config.tolerating(error)
        return found

    def rehearsing(self, grasps: int) -> Self:
        """Give a finder that tries its best grasps in simulation: see `FinderConfig.rehearsing`."""
        found = copy(self)
        found.config = self.config.rehearsing(grasps)
        return found

    def avoiding(self, *failed: FoundGrasp) -> Self:
        """Give a finder in which grasps lose score the nearer they are to ones that failed."""
        found = copy(self)
        found._failed = failed
        return found

    def rank(self, crops: Crops, seed: int, clock: Clock) -> Ranked:
        """Score grasps: see `Finder.rank`. There may be none."""
        volume = volume_of(crops, self.complete)
        clock.lap("complete")
        reach = self._reachability(volume, crops.world_from_crop[0])
        poses, preshapes = self._proposed(reach, crops.channels[0])
        if not len(poses) and len(reach.obstacles):
            # A grasp that touches a wall may still succeed: the hand stops only where a wall resists.
            reach = reach.without_obstacles()
            poses, preshapes = self._proposed(reach, crops.channels[0])
        clock.lap("propose")
        if not len(poses):
            return Ranked(volume, poses, preshapes, np.zeros(0))
        avoid = partial(self._avoiding, world_from_crop=crops.world_from_crop[0])
        score = self._balanced(avoid(self.score), reach)
        ranked = _ranked(score, volume, poses, preshapes)
        clock.lap("score")
        rng = np.random.default_rng(seed)
        ranked = self._refined(ranked, reach, score, rng)
        clock.lap("refine")
        if self.config.hand_error is not None:
            each = self.score.each if isinstance(self.score, TrainedScore) else self.score
            tolerant = self._balanced(_Tolerant(avoid(each), reach, self.config, self.config.hand_error), reach)
            finalists = ranked.kept(ranked.best(self.config.finalists))
            compared = _ranked(tolerant, volume, finalists.poses, finalists.preshapes)
            ranked = self._refined(compared, reach, tolerant, rng)
            clock.lap("average")
        if self.config.rehearsal is not None:
            ranked = self._rehearsed(ranked, self.config.rehearsal)
            clock.lap("rehearse")
        return ranked

    def confidence(self, found: FoundGrasp | None) -> float | None:
        """Give the scorer's probability that a grasp succeeds; 0 without a grasp, None for a score of another kind.

        Raises
        ------
        ConfigError
            If it is not finite.
        """
        if not isinstance(self.score, TrainedScore):
            return None
        if found is None:
            return 0.0
        rows = [found.chosen]
        success = self.score.judge(found.volume, found.poses[rows], found.preshapes[rows]).success
        check_finite(success, "scorer")
        if found.rehearsed is not None and self.config.rehearsal is not None:
            success = rehearsed_success(success, found.rehearsed[rows], self.config.rehearsal)
        return float(success[0])

    def _avoiding(self, score: Score, world_from_crop: NDArray[np.float64]) -> Score:
        """Let grasps lose score that are near ones that failed."""
        return _Avoiding(score, self._failed, world_from_crop) if self._failed else score

    def _balanced(self, score: Score, reach: Reachability) -> Score:
        """Let grasps lose score far from the middle of the object."""
        return _Balanced(score, reach, self.config.lever_penalty) if self.config.lever_penalty else score

    def _reachability(self, volume: NDArray[np.uint8], world_from_crop: NDArray[np.float64]) -> Reachability:
        """Tell what is to be grasped in a completed volume (3, N, N, N), and what the open hand keeps off."""
        occupancy, surface = np.asarray(volume[0]), np.asarray(volume[1])
        target = None if self._target is None else belonging(occupancy, surface, self._target)
        obstacles = (self._obstacles - world_from_crop[:3, 3]) @ world_from_crop[:3, :3]
        return Reachability(self.grid, self.config.proposals, occupancy, target, obstacles)

    def _proposed(
        self, reach: Reachability, channels: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Propose feasible grasps: poses (m, 4, 4) and preshapes (m,), those of the head last."""
        found, predicted, enough = reach.propose(), self.config.predicted, self.config.enough
        if self.head is None or not predicted or (enough is not None and len(found) >= enough):
            return found.poses, found.preshape
        candidates = self.head.candidates(channels, LOOKED_AT * predicted)
        preshapes = self.grid.preshapes[candidates.preshape]
        near = np.flatnonzero(reach.feasible(candidates.poses, preshapes))[:predicted]
        poses = np.concatenate([found.poses, candidates.poses[near]])
        return poses, np.concatenate([found.preshape, preshapes[near]])

    def _refined(self, ranked: Ranked, reach: Reachability, score: Score, rng: np.random.Generator) -> Ranked:
        """Add feasible neighbours of the best grasps, nearer ones in each step."""
        config = self.config
        for step in range(config.refinements):
            parents = np.repeat(ranked.best(config.parents), config.children)
            scale = 0.5**step
            poses = perturbed(ranked.poses[parents], rng, config.position * scale, config.rotation * scale)
            preshapes = ranked.preshapes[parents]
            kept = reach.feasible(poses, preshapes)
            if not kept.any():
                continue
            added = _ranked(score, ranked.volume, poses[kept], preshapes[kept])
            joined = (np.concatenate(pair) for pair in zip(ranked[1:4], added[1:4], strict=True))
            ranked = Ranked(ranked.volume, *joined)
        return ranked

    def _rehearsed(self, ranked: Ranked, config: RehearsalConfig) -> Ranked:
        """Try the best grasps on the completed shape, and score them anew."""
        error, grid = self.config.hand_error, self.grid
        occupancy = ranked.volume[0]
        rehearsal = Rehearsal.of(occupancy, self.crop, grid.hand, config, error=error, num_threads=grid.num_threads)
        if rehearsal is None:
            return ranked
        best = ranked.best(config.grasps)
        shares = np.full(len(ranked.scores), np.nan)
        shares[best] = rehearsal.shares(ranked.poses[best], ranked.preshapes[best])
        # Grasps without a trial count as if none of theirs succeeded: they stay behind those before them.
        scores = rehearsed_score(ranked.scores, np.nan_to_num(shares), config)
        return ranked._replace(scores=scores, rehearsed=shares)


def _ranked(
    score: Score, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> Ranked:
    """Score grasps; raises as `check_finite`."""
    scores = score(volume, poses, preshapes)
    check_finite(scores, "scorer")
    return Ranked(volume, poses, preshapes, scores)


class _Balanced:
    """Scores grasps; they lose by how far the hand is from the middle of the object."""

    def __init__(self, score: Score, reach: Reachability, penalty: float) -> None:
        self._score, self._reach, self._penalty = score, reach, penalty

    def __call__(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return np.asarray(self._score(volume, poses, preshapes) - self._penalty * self._reach.levers(poses, preshapes))


class _Avoiding:
    """Scores grasps; those near ones that failed lose by their nearness."""

    def __init__(self, score: Score, failed: Sequence[FoundGrasp], world_from_crop: NDArray[np.float64]) -> None:
        self._score, self._failed, self._world_from_crop = score, failed, world_from_crop

    def __call__(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        hands = self._world_from_crop @ poses
        kept = np.ones(len(poses))
        for failed in self._failed:
            place = failed.world_from_hand
            way = np.linalg.norm(hands[:, :3, 3] - place[:3, 3], axis=1)
            traces = np.einsum("nij,ij->n", hands[:, :3, :3], place[:3, :3])
            turn = np.arccos(np.clip((traces - 1.0) / 2.0, -1.0, 1.0))
            near = np.exp(-0.5 * ((way / _MOVED) ** 2 + (turn / _TURNED) ** 2))
            kept *= 1.0 - near * (preshapes == failed.preshape)
        return np.asarray(self._score(volume, poses, preshapes) * kept)


class _Tolerant:
    """Scores grasps by the mean over the errors of a hand.

    All grasps have the same errors: chance must not decide between them.
    """

    def __init__(self, score: Score, reach: Reachability, config: FinderConfig, error: PoseNoise) -> None:
        still, rng = np.tile(np.eye(4), (config.neighbours, 1, 1)), np.random.default_rng(0)
        moved = perturbed(still, rng, error.position, error.rotation)
        self._score, self._reach = score, reach
        self._errors = np.concatenate([np.eye(4)[None], moved])

    def __call__(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        around = (poses[:, None] @ self._errors).reshape(-1, 4, 4)
        repeated = np.repeat(preshapes, len(self._errors))
        free = self._reach.free(around, repeated)
        scores = np.zeros(len(around))
        scores[free] = self._score(volume, around[free], repeated[free])
        return np.asarray(scores.reshape(len(poses), -1).mean(axis=1))
