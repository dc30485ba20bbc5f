"""Training of the scorer on grasp trials, rendered by noisy cameras."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.learn.models.scene_views import SceneViews
from graspbox.learn.models.scorer.network import TARGETS, ScorerBatch, ScorerNet, deciding, scorer_losses
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.metrics import auc
from graspbox.learn.training.trainer import Trained, Trainer, TrainProgress, device_of, load_weights, moved
from graspbox.perception.inputs.scorer import ScorerInputs
from graspbox.perception.perturbations import PoseNoise, perturbed

__all__ = ["JoinedSampler", "TrialSampler", "fit_scorer", "train_scorer"]

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
    error : PoseNoise
        Pose noise added to each trial's inputs: the scorer learns the probability that a grasp holds under this
        execution error.

    Raises ConfigError without trials.
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
        self._rows = trials.rows_of_scenes()
        #: Scenes with trials.
        self.scenes = np.array([scene for scene, rows in enumerate(self._rows) if len(rows)])
        self._views = views

    def sample(self, number: int, scenes: NDArray[np.int64], per_scene: int, *, augment: bool = False) -> _Sampled:
        """Sample up to `per_scene` trials of each scene in one view; leaves out scenes whose object is not visible.

        With `augment`, trials are reflected at random by the symmetries of the hand. Raises ConfigError if no object
        is visible.
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
        inputs = self._inputs.make(np.stack(volumes), np.concatenate(crop_of), np.concatenate(poses), preshape)
        if augment:
            inputs = self._inputs.reflected(inputs, rng)
        columns = [getattr(self._trials, name)[picked] for name in TARGETS]
        targets = np.stack(columns, axis=1).astype(np.float32)
        return _Sampled(ScorerBatch.of(inputs, targets), self._trials.scene_of[picked])


class JoinedSampler:
    """Samples batches from samplers, such as one per hand; scenes are numbered one sampler after the other."""

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
            sampled = sampler.find(number, own, per_scene, augment=augment)
            if sampled is not None:
                parts.append(sampled.batch)
                # Scenes of different samplers keep different numbers.
                scene_of.append(before + np.searchsorted(sampler.scenes, sampled.scene_of))
        return _seen(_Sampled(joined(parts), np.concatenate(scene_of)) if parts else None)


def _seen(sampled: _Sampled | None) -> _Sampled:
    """Refuse a batch without a visible object."""
    if sampled is None:
        raise ConfigError("no camera found an object in any scene of a batch; widen `fov` or come nearer")
    return sampled


def joined(batches: Sequence[ScorerBatch]) -> ScorerBatch:
    """Put batches together."""
    names = ScorerBatch.__dataclass_fields__
    return ScorerBatch(*(torch.cat([getattr(batch, name) for batch in batches]) for name in names))


def train_scorer(
    folder: Path,
    trials: GraspTrials,
    validation: GraspTrials,
    inputs: ScorerInputs,
    views: SceneViews,
    config: TrainConfig = TrainConfig(batch_size=256, max_steps=10_000, validate_every=250),  # noqa: B008 (frozen)
    *,
    on_policy: GraspTrials | None = None,
    start: Path | None = None,
    width: int = 48,
    progress: Callable[[TrainProgress], None] = lambda _: None,
) -> Trained:
    """Train one member of a scorer, or resume it; `folder` and `progress` as in `graspbox.learn.training.trainer`.

    Parameters
    ----------
    trials, validation : GraspTrials
        Training trials, and validation trials whose separation of successes from failures (AUC) selects the weights.
    config : TrainConfig
        Members of an ensemble differ in its seed.
    on_policy : GraspTrials, optional
        Trials of grasps that the proposals chose (`graspbox.learn.recipes.collection`): half of each batch.
    start : Path, optional
        A file of weights of a trained scorer, which is trained further, and kept where no step improves on it.

    Raises ConfigError if there are no trials, or `start` holds another network.
    """
    torch.manual_seed(config.seed)
    sources = [some for some in (trials, on_policy) if some is not None]
    samplers = [TrialSampler(some, inputs, views, config.seed) for some in sources]
    held_out = TrialSampler(validation, inputs, views, 0)
    net = ScorerNet(inputs.grid, width)
    if start is not None:
        load_weights(net, start)
    settings = {"hand": inputs.grid.hand.name, "width": width, "error": asdict(PoseNoise()), "start": start is not None}
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
    """Train a scorer with its initial weights, or resume it; other arguments as in `graspbox.learn.training.trainer`.

    The samplers have equal shares of every batch; the AUC of `held_out` selects the weights.
    """
    per_batch = max(1, config.batch_size // _PER_SCENE // len(samplers))

    @cache
    def validation_batches() -> list[_Sampled]:
        chosen = held_out.scenes[:: max(1, len(held_out.scenes) // _VALIDATION_SCENES)]
        groups = np.array_split(chosen, max(1, len(chosen) // 16))
        return [held_out.sample(number, group, 64) for number, group in enumerate(groups)]

    def batch(step: int) -> ScorerBatch:
        parts = []
        for number, sampler in enumerate(samplers):
            chosen = np.random.default_rng([config.seed, step, number + 1]).choice(sampler.scenes, per_batch)
            parts.append(sampler.sample(step, chosen, _PER_SCENE, augment=True).batch)
        return joined(parts)

    def validate(net: nn.Module) -> dict[str, float]:
        return _measures(net, validation_batches())

    work: dict[str, Any] = {"batch": batch, "losses": scorer_losses, "validate": validate}
    return Trainer(net, folder, config, **work, settings=settings, trained=trained).run(progress)


def _measures(net: nn.Module, sampled: list[_Sampled]) -> dict[str, float]:
    """Return AUC, mean cross-entropy, and success rates: of each scene's best-scored trial, and of all trials."""
    batches = [moved(each.batch, device_of(net)) for each in sampled]
    logits = torch.cat([deciding(net(b.cells, b.poses, b.preshape)).cpu() for b in batches]).double()
    targets: Tensor = torch.cat([deciding(each.batch.targets) for each in sampled])
    scene_of = np.concatenate([each.scene_of for each in sampled])
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
