"""Training of the scorer on grasp trials, rendered by noisy cameras."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.models.scene_views import SceneViews
from graspbox.models.scorer.inputs import ScorerInputs
from graspbox.models.scorer.network import TARGETS, ScorerBatch, ScorerNet, deciding, scorer_losses
from graspbox.models.trials import GraspTrials
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.training.configs import TrainConfig
from graspbox.training.trainer import Trained, Trainer, TrainProgress, device_of, load_weights, moved

__all__ = ["JoinedSampler", "TrialSampler", "auc", "fit_scorer", "train_scorer"]

#: Trials per scene in a batch: a view of the scene costs as much as several of them.
_PER_SCENE = 16
#: Scenes of each validation set that are evaluated.
_VALIDATION_SCENES = 128


@dataclass(frozen=True, eq=False)
class _Sampled:
    """A batch, with the scene of each sample."""

    batch: ScorerBatch
    scene_of: NDArray[np.int64]


class TrialSampler:
    """Samples batches of trials as inputs of the scorer.

    Parameters
    ----------
    trials : GraspTrials
        The trials to sample from.
    inputs : ScorerInputs
        Inputs of the hand.
    views : SceneViews
        Rendered views of the scenes.
    seed : int
        Seed of all batches.
    error : PoseNoise
        Pose noise added to each trial's inputs: the scorer learns the probability that a grasp holds under this
        execution error.

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

    def sample(self, number: int, scenes: NDArray[np.int64], per_scene: int, *, augment: bool = False) -> _Sampled:
        """Sample up to `per_scene` trials of each scene in one view; leaves out scenes whose object is not visible.

        With `augment`, trials are reflected at random by the symmetries of the hand.

        Raises
        ------
        ConfigError
            If no object is visible.
        """
        return _seen(self.find(number, scenes, per_scene, augment=augment))

    def find(self, number: int, scenes: NDArray[np.int64], per_scene: int, *, augment: bool = False) -> _Sampled | None:
        """Sample as `sample` does; None if no object is visible."""
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
            return None
        picked = np.concatenate(rows)
        preshape = self._trials.preshape[picked]
        made = self._inputs.make(np.stack(volumes), np.concatenate(crop_of), np.concatenate(poses), preshape)
        if augment:
            made = self._inputs.reflected(made, rng)
        columns = [getattr(self._trials, name)[picked] for name in TARGETS]
        targets = np.stack(columns, axis=1).astype(np.float32)
        return _Sampled(ScorerBatch.of(made, targets), self._trials.scene_of[picked])


class JoinedSampler:
    """Samples batches from several samplers, such as one per hand; scenes are numbered one sampler after the other.

    Parameters
    ----------
    samplers : sequence of TrialSampler
        At least one.
    """

    def __init__(self, samplers: Sequence[TrialSampler]) -> None:
        self._samplers = samplers
        self._ends = np.cumsum([len(sampler.scenes) for sampler in samplers])
        #: Numbers of all scenes with trials.
        self.scenes = np.arange(self._ends[-1])

    def sample(self, number: int, scenes: NDArray[np.int64], per_scene: int, *, augment: bool = False) -> _Sampled:
        """Sample trials of scenes: see `TrialSampler.sample`."""
        owners = np.searchsorted(self._ends, scenes, side="right")
        parts, scene_of = [], []
        for owner in np.unique(owners).tolist():
            sampler, before = self._samplers[owner], int(self._ends[owner]) - len(self._samplers[owner].scenes)
            own = sampler.scenes[scenes[owners == owner] - before]
            found = sampler.find(number, own, per_scene, augment=augment)
            if found is not None:
                parts.append(found.batch)
                # Scenes of different samplers keep different numbers.
                scene_of.append(before + np.searchsorted(sampler.scenes, found.scene_of))
        return _seen(_Sampled(joined(parts), np.concatenate(scene_of)) if parts else None)


def _seen(found: _Sampled | None) -> _Sampled:
    """Refuse a batch without a visible object."""
    if found is None:
        raise ConfigError("no camera found an object in any scene of a batch; widen `fov` or come nearer")
    return found


def joined(batches: Sequence[ScorerBatch]) -> ScorerBatch:
    """Put batches together."""
    names = ScorerBatch.__dataclass_fields__
    return ScorerBatch(*(torch.cat([getattr(batch, name) for batch in batches]) for name in names))


def auc(scores: NDArray[np.float64], success: NDArray[np.bool_]) -> float:
    """Return the area under the ROC curve: the probability that a success scores above a failure; ties count half.

    1/2 if all outcomes are alike.
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
    progress: Callable[[TrainProgress], None] = lambda _: None,
) -> Trained:
    """Train one member of a scorer, or resume it; `folder` and `progress` as in `graspbox.training.trainer`.

    Parameters
    ----------
    trials, validation : GraspTrials
        Training trials, and validation trials whose separation of successes from failures (AUC) selects the weights.
    inputs : ScorerInputs
        Inputs of the hand.
    views : SceneViews
        Rendered views of the scenes.
    config : TrainConfig
        Training hyperparameters; members of an ensemble differ in its seed.
    on_policy : GraspTrials, optional
        Trials of grasps that the proposals chose (`graspbox.recipes.collection`): half of each batch.
    error : PoseNoise
        See `TrialSampler`.
    start : Path, optional
        A file of weights of a trained scorer, with which the training begins, and which are kept where no step improves
        on them.
    width : int
        See `ScorerNet`.

    Raises
    ------
    ConfigError
        If there are no trials, or `start` holds another network.
    """
    torch.manual_seed(config.seed)
    sources = [some for some in (trials, on_policy) if some is not None]
    samplers = [TrialSampler(some, inputs, views, config.seed, error) for some in sources]
    held_out = TrialSampler(validation, inputs, views, 0, error)
    net = ScorerNet(inputs.grid, width)
    if start is not None:
        load_weights(net, start)
    settings = {"hand": inputs.grid.hand.name, "width": width, "error": asdict(error), "start": start is not None}
    settings |= {"trials": [len(some) for some in sources], "validation": len(validation)}
    return fit_scorer(folder, net, samplers, held_out, config, settings, progress, trained=start is not None)


def fit_scorer(
    folder: Path,
    net: ScorerNet,
    samplers: Sequence[TrialSampler | JoinedSampler],
    held_out: TrialSampler | JoinedSampler,
    config: TrainConfig,
    settings: dict[str, Any],
    progress: Callable[[TrainProgress], None] = lambda _: None,
    *,
    trained: bool = False,
) -> Trained:
    """Train a scorer from samplers, each with an equal share of every batch, or resume it.

    Parameters
    ----------
    folder, settings, progress, trained
        As in `graspbox.training.trainer`.
    net : ScorerNet
        The network, with its initial weights.
    samplers, held_out
        Samples for training, and those whose AUC selects the weights.
    config : TrainConfig
        Training hyperparameters.
    """
    per_batch = max(1, config.batch_size // _PER_SCENE // len(samplers))
    kept: list[_Sampled] = []

    def batch(step: int) -> ScorerBatch:
        parts = []
        for number, sampler in enumerate(samplers):
            chosen = np.random.default_rng([config.seed, step, number + 1]).choice(sampler.scenes, per_batch)
            parts.append(sampler.sample(step, chosen, _PER_SCENE, augment=True).batch)
        return joined(parts)

    def validate(net: nn.Module) -> dict[str, float]:
        if not kept:
            chosen = held_out.scenes[:: max(1, len(held_out.scenes) // _VALIDATION_SCENES)]
            groups = np.array_split(chosen, max(1, len(chosen) // 16))
            kept.extend(held_out.sample(i, group, 64) for i, group in enumerate(groups))
        return _measures(net, kept)

    trainer = Trainer(
        net,
        folder,
        config,
        batch=batch,
        losses=scorer_losses,
        validate=validate,
        settings=settings,
        trained=trained,
    )
    return trainer.run(progress)


def _measures(net: nn.Module, kept: list[_Sampled]) -> dict[str, float]:
    """Return AUC, mean cross-entropy, and success rates: of each scene's best-scored trial, and of all trials."""
    batches = [moved(sampled.batch, device_of(net)) for sampled in kept]
    logits = torch.cat([deciding(net(b.cells, b.poses, b.preshape)).cpu() for b in batches]).double()
    targets: Tensor = torch.cat([deciding(d.batch.targets) for d in kept])
    scene_of = np.concatenate([d.scene_of for d in kept])
    (scores, firm), (success, secure) = logits.numpy().T, targets.numpy().T > 0.5
    entropy = nn.functional.binary_cross_entropy_with_logits(
        torch.from_numpy(scores), torch.from_numpy(success).double()
    )
    best = [success[rows][scores[rows].argmax()] for scene in np.unique(scene_of) for rows in [scene_of == scene]]
    return {
        "auc": auc(scores, success),
        "auc_secure": auc(firm, secure),
        "entropy": float(entropy),
        "chosen": float(np.mean(best)),
        "all": float(success.mean()),
    }
