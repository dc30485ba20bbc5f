"""One decision: from a depth image to the grasp to try.

The steps, each of which can be replaced: crop the object, complete its occupancy, propose grasps, score them, refine
the best. Grasps are proposed by geometry, and by a head (`graspbox.perception.heads`) if there is one. `GraspFinder`
makes the steps and measures their time.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.arguments import floats
from graspbox.perception.anchors import Candidates
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops, crop
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.leveling import level
from graspbox.perception.perturbations import PoseNoise, perturbed

__all__ = [
    "LOOKED_AT",
    "Complete",
    "Finder",
    "FoundGrasp",
    "GraspFinder",
    "Head",
    "Score",
    "observed_only",
]

#: From channels (n, 3, N, N, N) of crops to occupancies (n, N, N, N), all uint8.
Complete = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
#: From a volume (3, N, N, N) uint8 (completed, surface, unseen), poses ``crop_from_hand`` (m, 4, 4) and preshapes (m,)
#: to scores (m,); greater is better.
Score = Callable[[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
#: Candidates of a head that are checked, for each that may be added.
LOOKED_AT = 4


class Head(Protocol):
    """What predicts grasps: a network of `graspbox.perception.heads`, or `graspbox.perception.runtimes.AnchorHead`."""

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Give the best grasps of one crop (2 or more, N, N, N) uint8."""


@runtime_checkable
class Ensemble(Protocol):
    """A `Score` of several networks, all of which judge only the best grasps of a call."""

    each: Score  # by all networks for every grasp


@dataclass(frozen=True, eq=False)
class FoundGrasp:
    """A grasp, and how it was found.

    Attributes
    ----------
    world_from_hand : (4, 4) float64
        Where the hand goes, metres.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    score : float
        What the scorer gives it.
    world_from_crop : (4, 4) float64
        The crop frame.
    object : (H, W) bool
        Pixels of the object.
    volume : (3, N, N, N) uint8
        Completed, surface, unseen.
    poses, preshapes, scores
        All grasps that were scored: ``crop_from_hand`` (m, 4, 4), (m,), (m,); refined ones last. With an error of the
        hand, those alone that were compared by their mean.
    seconds : dict of str to float
        Time that each step took: ``crop``, ``complete``, ``propose``, ``score``, ``refine``, ``average``.
    """

    world_from_hand: NDArray[np.float64]
    preshape: float
    score: float
    world_from_crop: NDArray[np.float64]
    object: NDArray[np.bool_]
    volume: NDArray[np.uint8]
    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    scores: NDArray[np.float64]
    seconds: dict[str, float]

    @property
    def occupancy(self) -> NDArray[np.uint8]:
        """The completed occupancy (N, N, N), 0 to 255 for 0 to 1."""
        return np.asarray(self.volume[0])

    def other(self, index: int) -> "FoundGrasp":
        """Take another of the grasps that were scored, by its index."""
        return replace(
            self,
            world_from_hand=self.world_from_crop @ self.poses[index],
            preshape=float(self.preshapes[index]),
            score=float(self.scores[index]),
        )

    def best(self) -> tuple[NDArray[np.float64], float]:
        """Give the grasp in the crop frame: ``crop_from_hand`` (4, 4) and preshape."""
        index = int(np.argmax(self.scores))
        return self.poses[index], float(self.preshapes[index])


class Finder(ABC):
    """Finds the grasp to try in a depth image.

    Parameters
    ----------
    crop : CropConfig
        The crop.
    num_threads : int, optional
        Threads of the crop; by default one per core.
    """

    def __init__(self, crop: CropConfig, num_threads: int | None = None) -> None:
        self._crop, self._num_threads = crop, num_threads

    @abstractmethod
    def decide(
        self, crops: Crops, *, seed: int = 0, complete: Complete | None = None, score: Score | None = None
    ) -> FoundGrasp | None:
        """Find the grasp to try in a single crop; arguments and result as `find`."""

    def find(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        world_from_camera: ArrayLike,
        *,
        seed: int = 0,
        complete: Complete | None = None,
        score: Score | None = None,
        on_crop: Callable[[NDArray[np.float64]], None] | None = None,
    ) -> FoundGrasp | None:
        """Find the grasp to try.

        Parameters
        ----------
        depth : (H, W) array
            Metres, or millimetres if the dtype is uint16; 0 where nothing was measured.
        intrinsics : (3, 3) array
            Pixels.
        world_from_camera : (4, 4) array
            Pose of the camera; the table is the plane z = 0. Small errors of height and tilt are corrected
            (`graspbox.perception.leveling.level`).
        seed : int
            Seed of the refinement.
        complete, score : callable, optional
            Replace those of the finder for this decision.
        on_crop : callable, optional
            Called with ``world_from_crop`` (4, 4) before `complete` is.

        Returns
        -------
        FoundGrasp or None
            None where no object is seen, or no grasp of it is feasible.

        Raises
        ------
        ConfigError
            For arrays of another shape or type.
        """
        began = time.perf_counter()
        image, lens = np.asarray(depth), floats(intrinsics, "intrinsics")
        metres = 0.001 * image if image.dtype == np.uint16 else image
        poses = level(metres, lens, floats(world_from_camera, "world_from_camera"))[None]
        crops = crop(image[None], lens, poses, config=self._crop, num_threads=self._num_threads)
        taken = time.perf_counter() - began
        if crops.found[0] and on_crop is not None:
            on_crop(crops.world_from_crop[0])
        found = self.decide(crops, seed=seed, complete=complete, score=score)
        return None if found is None else replace(found, seconds={"crop": taken, **found.seconds})


def observed_only(channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Take what is seen of the surface for the object: no completion."""
    return np.ascontiguousarray(channels[:, 0])


class GraspFinder(Finder):
    """Finds grasps in depth images.

    Parameters
    ----------
    grid : HandGrid
        The hand.
    complete : callable
        Tells the occupancy of crops: `graspbox.perception.runtimes.Completion`, or `observed_only`.
    score : callable
        Scores grasps: `graspbox.perception.runtimes.Scorer`.
    config : FinderConfig
        How a grasp is found.
    crop : CropConfig
        The crop; that of `grid`.
    head : Head, optional
        Predicts grasps that are added to the proposals.
    num_threads : int, optional
        Threads of the crop; by default one per core.
    """

    def __init__(
        self,
        grid: HandGrid,
        complete: Complete,
        score: Score,
        config: FinderConfig = FinderConfig(),  # noqa: B008 (frozen)
        *,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
        head: Head | None = None,
        num_threads: int | None = None,
    ) -> None:
        super().__init__(crop, num_threads)
        self._grid, self._complete, self._score, self._config = grid, complete, score, config
        self._head = head

    def decide(
        self, crops: Crops, *, seed: int = 0, complete: Complete | None = None, score: Score | None = None
    ) -> FoundGrasp | None:
        """Find the grasp to try in a single crop; arguments and result as `find`."""
        if not crops.found[0]:
            return None
        clock = _Clock()
        occupancy = (complete or self._complete)(crops.channels)[0]
        clock.lap("complete")
        poses, preshapes = self._proposed(occupancy, crops.channels[0])
        clock.lap("propose")
        if not len(poses):
            return None
        volume = np.concatenate([occupancy[None], crops.channels[0, :2]])
        judge = score or self._score
        scored = _Scored(poses, preshapes, judge(volume, poses, preshapes))
        clock.lap("score")
        rng = np.random.default_rng(seed)
        scored = self._refined(scored, volume, judge, rng)
        clock.lap("refine")
        if self._config.hand_error is not None:
            tolerant = _Tolerant(judge, self._grid, self._config, self._config.hand_error)
            scored = self._refined(self._finalists(scored, volume, tolerant), volume, tolerant, rng)
            clock.lap("average")
        best = int(np.argmax(scored.scores))
        return FoundGrasp(
            world_from_hand=crops.world_from_crop[0] @ scored.poses[best],
            preshape=float(scored.preshapes[best]),
            score=float(scored.scores[best]),
            world_from_crop=crops.world_from_crop[0],
            object=crops.object[0],
            volume=volume,
            poses=scored.poses,
            preshapes=scored.preshapes,
            scores=scored.scores,
            seconds=clock.seconds,
        )

    def _proposed(
        self, occupancy: NDArray[np.uint8], channels: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Propose feasible grasps: poses (m, 4, 4) and preshapes (m,), those of the head last."""
        config = self._config
        found = self._grid.propose(occupancy, config.proposals)
        if self._head is None or not config.predicted:
            return found.poses, found.preshape
        predicted = self._head.candidates(channels, LOOKED_AT * config.predicted)
        preshapes = self._grid.preshapes[predicted.preshape]
        kept = np.flatnonzero(self._feasible(occupancy, predicted.poses, preshapes))[: config.predicted]
        return (
            np.concatenate([found.poses, predicted.poses[kept]]),
            np.concatenate([found.preshape, preshapes[kept]]),
        )

    def _feasible(
        self, occupancy: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Tell where the open hand gets and enough fingers meet the object."""
        config = self._config.proposals
        free, fingers = self._grid.meets(occupancy, poses, preshapes, points=config.points)
        return free & (fingers >= min(config.fingers, 2))

    def _refined(
        self, scored: "_Scored", volume: NDArray[np.uint8], judge: Score, rng: np.random.Generator
    ) -> "_Scored":
        """Add feasible neighbours of the best grasps, nearer ones in each step."""
        config = self._config
        for step in range(config.refinements):
            best = np.argsort(-scored.scores, kind="stable")[: config.parents]
            parents = np.repeat(best, config.children)
            scale = 0.5**step
            poses = perturbed(scored.poses[parents], rng, config.position * scale, config.rotation * scale)
            preshapes = scored.preshapes[parents]
            kept = self._feasible(volume[0], poses, preshapes)
            if not kept.any():
                continue
            scores = judge(volume, poses[kept], preshapes[kept])
            scored = _Scored(
                np.concatenate([scored.poses, poses[kept]]),
                np.concatenate([scored.preshapes, preshapes[kept]]),
                np.concatenate([scored.scores, scores]),
            )
        return scored

    def _finalists(self, scored: "_Scored", volume: NDArray[np.uint8], judge: Score) -> "_Scored":
        """Keep the best grasps alone, and score them anew."""
        best = np.argsort(-scored.scores, kind="stable")[: self._config.finalists]
        poses, preshapes = scored.poses[best], scored.preshapes[best]
        return _Scored(poses, preshapes, judge(volume, poses, preshapes))


class _Tolerant:
    """Scores grasps by the mean over the errors of a hand.

    All grasps have the same errors, so that chance does not decide between them.
    """

    def __init__(self, judge: Score, grid: HandGrid, config: FinderConfig, error: PoseNoise) -> None:
        still, rng = np.tile(np.eye(4), (config.neighbours, 1, 1)), np.random.default_rng(0)
        moved = perturbed(still, rng, error.position, error.rotation)
        self._judge: Score = judge.each if isinstance(judge, Ensemble) else judge
        self._grid, self._points = grid, config.proposals.points
        self._errors = np.concatenate([np.eye(4)[None], moved])

    def __call__(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        around = (poses[:, None] @ self._errors).reshape(-1, 4, 4)
        repeated = np.repeat(preshapes, len(self._errors))
        free, _ = self._grid.meets(volume[0], around, repeated, points=self._points)
        scores = np.zeros(len(around))
        scores[free] = self._judge(volume, around[free], repeated[free])
        return np.asarray(scores.reshape(len(poses), -1).mean(axis=1))


@dataclass(frozen=True, eq=False)
class _Scored:
    """Grasps with their scores."""

    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    scores: NDArray[np.float64]


class _Clock:
    """Measures the time of steps."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.seconds[step], self._last = now - self._last, now
