"""Training of the scorer on grasp trials, seen by noisy cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.perception.grasp_inputs import ScorerInputs
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.perception.scene_views import SceneViews
from graspbox.perception.scorer import TARGETS, ScorerBatch, ScorerNet, scorer_losses
from graspbox.perception.training import TrainConfig, Trained, Trainer, TrainProgress, load_weights
from graspbox.perception.trials import GraspTrials

__all__ = ["TrialSampler", "auc", "train_scorer"]

#: Trials of one scene in a batch: a view of the scene costs as much as some of them.
_PER_SCENE = 16
#: Scenes of each validation set that validate.
_VALIDATION_SCENES = 128


@dataclass(frozen=True, eq=False)
class _Drawn:
    """A batch, with the scene of each sample."""

    batch: ScorerBatch
    scene_of: NDArray[np.int64]


class TrialSampler:
    """Draws batches of trials, as the scorer sees them.

    Parameters
    ----------
    trials : GraspTrials
        What is drawn from.
    inputs : ScorerInputs
        The hand.
    views : SceneViews
        The scenes as cameras see them.
    seed : int
        Seed of all batches.
    error : PoseNoise
        The scorer sees each trial as far from where the hand went: what it learns is how likely a grasp holds if the
        hand errs so.

    Raises
    ------
    ConfigError
        If there are no trials.
    """

    def __init__(
        self,
        trials: GraspTrials,
        inputs: ScorerInputs,
        views: SceneViews,
        seed: int,
        error: PoseNoise = PoseNoise(),  # noqa: B008 (frozen)
    ) -> None:
        if not len(trials):
            raise ConfigError("there are no trials to learn from; collect some first")
        self._trials, self._inputs, self._seed, self._error = trials, inputs, seed, error
        order = np.argsort(trials.scene_of, kind="stable")
        starts = np.searchsorted(trials.scene_of[order], np.arange(len(trials.source) + 1))
        self._rows = [order[a:b] for a, b in pairwise(starts)]
        #: Scenes with trials.
        self.scenes = np.array([scene for scene, rows in enumerate(self._rows) if len(rows)])
        self._views = views

    def draw(self, number: int, scenes: NDArray[np.int64], per_scene: int) -> _Drawn:
        """Draw up to `per_scene` trials of each scene, seen once; scenes whose object is not found are left out."""
        rng = np.random.default_rng([self._seed, number])
        volumes: list[NDArray[np.uint8]] = []
        poses, rows, crop_of = [], [], []
        for scene in scenes.tolist():
            chosen = rng.permutation(self._rows[scene])[:per_scene]
            source, pose = str(self._trials.source[scene]), self._trials.world_from_object[scene]
            seen = self._views.get(source, pose, int(rng.integers(self._views.count)))
            if seen is None:
                continue
            volume, world_from_crop = seen
            sent = perturbed(self._trials.world_from_hand[chosen], rng, self._error.position, self._error.rotation)
            poses.append(np.linalg.inv(world_from_crop) @ sent)
            crop_of.append(np.full(len(chosen), len(volumes)))
            volumes.append(volume)
            rows.append(chosen)
        if not rows:
            raise ConfigError("no camera found an object in any scene of a batch; widen `fov` or come nearer")
        picked = np.concatenate(rows)
        preshape = self._trials.preshape[picked]
        made = self._inputs.make(np.stack(volumes), np.concatenate(crop_of), np.concatenate(poses), preshape)
        columns = [getattr(self._trials, name)[picked] for name in TARGETS]
        targets = np.stack(columns, axis=1).astype(np.float32)
        return _Drawn(ScorerBatch.of(made, targets), self._trials.scene_of[picked])


def auc(scores: NDArray[np.float64], success: NDArray[np.bool_]) -> float:
    """Give the share of pairs of a success and a failure in which the success has the greater score; ties count half.

    1/2 where all trials ended alike.
    """
    order = np.sort(scores)
    ranks = 0.5 * (np.searchsorted(order, scores, "left") + np.searchsorted(order, scores, "right"))
    good, bad = int(success.sum()), int((~success).sum())
    if not good or not bad:
        return 0.5
    return float((ranks[success].sum() - good * good / 2) / (good * bad))


def train_scorer(
    folder: Path,
    trials: GraspTrials,
    validation: GraspTrials,
    inputs: ScorerInputs,
    views: SceneViews,
    config: TrainConfig = TrainConfig(batch_size=256, max_steps=10_000, validate_every=250),  # noqa: B008 (frozen)
    *,
    on_policy: GraspTrials | None = None,
    error: PoseNoise = PoseNoise(),  # noqa: B008 (frozen)
    start: Path | None = None,
    width: int = 48,
    progress: Callable[[TrainProgress], None] | None = None,
) -> Trained:
    """Train one member of a scorer in a folder, or continue there; see `graspbox.perception.training`.

    Parameters
    ----------
    folder : Path
        The member's folder.
    trials, validation : GraspTrials
        What it learns from, and what the best weights are chosen by: how well it tells successes from failures (AUC).
    inputs : ScorerInputs
        The hand.
    views : SceneViews
        The scenes as cameras see them.
    config : TrainConfig
        How it is trained; members of an ensemble differ by its seed.
    on_policy : GraspTrials, optional
        Trials of what the proposals give (`graspbox.perception.collect`): half of each batch.
    error : PoseNoise
        See `TrialSampler`.
    start : Path, optional
        A file of weights with which training begins.
    width : int
        See `ScorerNet`.
    progress : callable, optional
        Called after each step.

    Raises
    ------
    ConfigError
        If there are no trials, or `start` holds another network.
    """
    torch.manual_seed(config.seed)
    given = [some for some in (trials, on_policy) if some is not None]
    samplers = [TrialSampler(some, inputs, views, config.seed, error) for some in given]
    held_out = TrialSampler(validation, inputs, views, 0, error)
    per_batch = max(1, config.batch_size // _PER_SCENE // len(samplers))
    kept: list[_Drawn] = []

    def batch(step: int) -> ScorerBatch:
        parts = []
        for number, sampler in enumerate(samplers):
            chosen = np.random.default_rng([config.seed, step, number + 1]).choice(sampler.scenes, per_batch)
            parts.append(sampler.draw(step, chosen, _PER_SCENE).batch)
        names = ScorerBatch.__dataclass_fields__
        return ScorerBatch(*(torch.cat([getattr(part, name) for part in parts]) for name in names))

    def validate(net: nn.Module) -> dict[str, float]:
        if not kept:
            chosen = held_out.scenes[:: max(1, len(held_out.scenes) // _VALIDATION_SCENES)]
            groups = np.array_split(chosen, max(1, len(chosen) // 16))
            kept.extend(held_out.draw(i, group, 64) for i, group in enumerate(groups))
        return _measures(net, kept)

    net = ScorerNet(inputs.grid, width)
    if start is not None:
        load_weights(net, start)
    trainer = Trainer(net, Path(folder), config, batch=batch, losses=scorer_losses, validate=validate)
    return trainer.run(progress)


def _measures(net: nn.Module, kept: list[_Drawn]) -> dict[str, float]:
    """Give AUC, mean cross-entropy, and the shares of successes: of each scene's best-scored trial, and of all."""
    logits = torch.cat([net(d.batch.cells, d.batch.poses, d.batch.preshape)[:, :2] for d in kept]).double()
    targets: Tensor = torch.cat([d.batch.targets[:, :2] for d in kept])
    scene_of = np.concatenate([d.scene_of for d in kept])
    (scores, firm), (success, secure) = logits.numpy().T, targets.numpy().T > 0.5
    entropy = nn.functional.binary_cross_entropy_with_logits(logits[:, 0], targets[:, 0].double())
    best = [success[rows][scores[rows].argmax()] for scene in np.unique(scene_of) for rows in [scene_of == scene]]
    return {
        "auc": auc(scores, success),
        "auc_secure": auc(firm, secure),
        "entropy": float(entropy),
        "chosen": float(np.mean(best)),
        "all": float(success.mean()),
    }
