"""Scores of grasps in one completed crop: by a scorer, with refinement, under errors of the hand, and after trials."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspbox.perception.configs import FinderConfig, RehearsalConfig
from graspbox.perception.outputs import Judged, check_finite
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.perception.reachability import Reachability
from graspbox.perception.shapes import Rehearsal, rehearsed_score, rehearsed_success

__all__ = ["Ranked", "Score", "Scoring", "TrainedScore"]

#: From a volume (3, N, N, N) uint8 (completed, surface, unseen), poses ``crop_from_hand`` (m, 4, 4) and preshapes (m,)
#: to scores (m,); greater is better.
Score = Callable[[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
#: Grasps that are rehearsed together: enough to occupy some cores.
_AT_ONCE = 4
#: Distances over which the penalty of an earlier failure decays, metres and radians.
_NEAR_FAILURE, _LIKE_FAILURE = 0.03, 0.5


@runtime_checkable
class TrainedScore(Protocol):
    """A `Score` of trained networks, which also states probabilities: `graspbox.policies.published.runtimes.Scorer`.

    In an ensemble, all members score only the best grasps of a call of `judge`, and every grasp of `judge_each`.
    """

    #: Arguments as of a `Score`.
    judge: Callable[[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]], Judged]
    judge_each: Callable[[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]], Judged]


class Ranked(NamedTuple):
    """m scored grasps in one crop, in any order; the other fields are those of `graspbox.perception.FoundGrasp`."""

    volume: NDArray[np.uint8]
    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    scores: NDArray[np.float64]
    rehearsed: NDArray[np.float64] | None = None
    judged: Judged | None = None

    def kept(self, rows: NDArray[np.int64]) -> "Ranked":
        """Select grasps by index."""
        rehearsed = None if self.rehearsed is None else self.rehearsed[rows]
        judged = None if self.judged is None else self.judged.rows(rows)
        return Ranked(self.volume, self.poses[rows], self.preshapes[rows], self.scores[rows], rehearsed, judged)

    def extended(self, other: "Ranked") -> "Ranked":
        """Append grasps of the same crop, before any is rehearsed."""
        judged = None
        if self.judged is not None and other.judged is not None:
            judged = Judged.joined([self.judged, other.judged])
        poses, preshapes, scores = (np.concatenate(pair) for pair in zip(self[1:4], other[1:4], strict=True))
        return Ranked(self.volume, poses, preshapes, scores, judged=judged)

    def best(self, count: int) -> NDArray[np.int64]:
        """Return the indices of the best grasps, the best first."""
        return np.argsort(-self.scores, kind="stable")[:count]


@dataclass(frozen=True, eq=False)
class Scoring:
    """Scores grasps (m, 4, 4) with preshapes (m,) in one completed volume; raises as `check_finite`.

    `failed` are ``world_from_hand`` (4, 4) and preshape of earlier failures.
    """

    score: Score
    volume: NDArray[np.uint8]
    reach: Reachability
    config: FinderConfig
    failed: Sequence[tuple[NDArray[np.float64], float]]
    world_from_crop: NDArray[np.float64]

    def plain(self, poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> Ranked:
        """Score grasps of a hand without error."""
        judged = None
        if isinstance(self.score, TrainedScore):
            judged = self.score.judge(self.volume, poses, preshapes)
        scores = self.score(self.volume, poses, preshapes) if judged is None else judged.choice
        return self._ranked(poses, preshapes, scores * self._unlike_failures(poses, preshapes), judged)

    def refined(
        self,
        ranked: Ranked,
        rng: np.random.Generator,
        score: Callable[[NDArray[np.float64], NDArray[np.float64]], Ranked] | None = None,
    ) -> Ranked:
        """Add feasible neighbours of the best grasps, nearer ones in each step, scored by `plain` or another score."""
        config = self.config
        for step in range(config.refinements):
            parents = np.repeat(ranked.best(config.parents), config.children)
            scale = 0.5**step
            poses = perturbed(ranked.poses[parents], rng, config.position * scale, config.rotation * scale)
            preshapes = ranked.preshapes[parents]
            kept = self.reach.feasible(poses, preshapes)
            if kept.any():
                ranked = ranked.extended((score or self.plain)(poses[kept], preshapes[kept]))
        return ranked

    def averaged(self, ranked: Ranked, error: PoseNoise, rng: np.random.Generator) -> Ranked:
        """Compare the best grasps by their mean score over errors of the hand, and refine them by it.

        They are scored again: all members of an ensemble score each pose, which they did not before.
        """
        # All grasps have the same errors, none first: chance must not decide between them.
        still = np.tile(np.eye(4), (self.config.neighbours, 1, 1))
        moved = perturbed(still, np.random.default_rng(0), error.position, error.rotation)
        mean = partial(self._mean, np.concatenate([np.eye(4)[None], moved]))
        finalists = ranked.kept(ranked.best(self.config.finalists))
        compared = mean(finalists.poses, finalists.preshapes)._replace(judged=finalists.judged)
        return self.refined(compared, rng, mean)

    def rehearsed(self, ranked: Ranked, config: RehearsalConfig, order: bool) -> Ranked:
        """Try the best grasps in simulation on the completed shape, and join their scores with the outcomes.

        Unless the `order` of all matters, the trials end once no other grasp can become the best.
        """
        grid, error = self.reach.grid, self.config.hand_error
        rehearsal = Rehearsal.of(
            ranked.volume[0], grid.crop, grid.hand, config, error=error, num_threads=grid.num_threads
        )
        if rehearsal is None:
            return ranked
        best = ranked.best(config.grasps)
        shares = np.full(len(ranked.scores), np.nan)
        sure = rehearsed_score(ranked.scores[best], np.ones(len(best)), config)
        at_once = len(best) if order else _AT_ONCE
        for first in range(0, len(best), at_once):
            tried, now = best[:first], best[first : first + at_once]
            if not order and (rehearsed_score(ranked.scores[tried], shares[tried], config) > sure[first]).any():
                break
            shares[now] = rehearsal.shares(ranked.poses[now], ranked.preshapes[now])
        # Grasps without a trial count as if none of theirs succeeded: they rank behind those before them.
        scores = rehearsed_score(ranked.scores, np.nan_to_num(shares), config)
        judged = ranked.judged
        if judged is not None:
            judged = judged._replace(success=rehearsed_success(judged.success, shares, config))
        return ranked._replace(scores=scores, rehearsed=shares, judged=judged)

    def _mean(self, errors: NDArray[np.float64], poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> Ranked:
        """Score grasps by the mean over errors (k, 4, 4), 0 where the hand is not free; judged without error."""
        around = (poses[:, None] @ errors).reshape(-1, 4, 4)
        repeated = np.repeat(preshapes, len(errors))
        free = self.reach.free(around, repeated)
        scores, judged = np.zeros(len(around)), None
        if isinstance(self.score, TrainedScore):
            judged = self.score.judge_each(self.volume, around[free], repeated[free])
        plain = self.score(self.volume, around[free], repeated[free]) if judged is None else judged.choice
        scores[free] = plain * self._unlike_failures(around[free], repeated[free])
        own = free[:: len(errors)]
        if judged is not None:
            # The first error is none, and a grasp of a refinement is free without error.
            judged = judged.rows((np.cumsum(free) - 1)[:: len(errors)]) if own.all() else None
        return self._ranked(poses, preshapes, scores.reshape(len(poses), -1).mean(axis=1), judged)

    def _unlike_failures(self, poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return factors (m,) that penalise grasps near earlier failures."""
        hands, kept = self.world_from_crop @ poses, np.ones(len(poses))
        for place, preshape in self.failed:
            way = np.linalg.norm(hands[:, :3, 3] - place[:3, 3], axis=1)
            traces = np.einsum("nij,ij->n", hands[:, :3, :3], place[:3, :3])
            turn = np.arccos(np.clip((traces - 1.0) / 2.0, -1.0, 1.0))
            near = np.exp(-0.5 * ((way / _NEAR_FAILURE) ** 2 + (turn / _LIKE_FAILURE) ** 2))
            kept *= 1.0 - near * (preshapes == preshape)
        return kept

    def _ranked(
        self,
        poses: NDArray[np.float64],
        preshapes: NDArray[np.float64],
        scores: NDArray[np.float64],
        judged: Judged | None,
    ) -> Ranked:
        """Penalise grasps far from the middle of the object."""
        if self.config.lever_penalty:
            scores = scores - self.config.lever_penalty * self.reach.levers(poses, preshapes)
        check_finite(scores, "scorer")
        return Ranked(self.volume, poses, preshapes, np.asarray(scores), judged=judged)
