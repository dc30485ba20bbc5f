"""Training of the scorer on grasp trials, each seen by a new noisy camera whenever it is drawn."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.errors import ConfigError
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.finder import Complete
from graspbox.perception.scenes import SceneConfig, look
from graspbox.perception.scorer import TARGETS, ScorerBatch, ScorerInputs, ScorerNet, scorer_losses
from graspbox.perception.training import TrainConfig, Trained, Trainer
from graspbox.perception.trials import GraspTrials

__all__ = ["TrialSampler", "auc", "train_scorer"]

#: Trials of one scene in a batch: a view of the scene costs as much as some of them.
_PER_SCENE = 16
#: Scenes that validate, and the number of the first.
_VALIDATION_SCENES = 128
_VALIDATION_FROM = 1 << 40
#: Meshes that are kept, ready to render.
_MESHES = 512


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
    scenes : SceneConfig
        How scenes are seen.
    complete : callable, optional
        Tells the object's occupancy; by default it is the true one.
    seed : int
        Seed of all batches.

    Raises
    ------
    ConfigError
        If there are no trials.
    """

    def __init__(
        self, trials: GraspTrials, inputs: ScorerInputs, scenes: SceneConfig, complete: Complete | None, seed: int
    ) -> None:
        if not len(trials):
            raise ConfigError("there are no trials to learn from; collect some first")
        self._trials, self._inputs, self._scenes = trials, inputs, scenes
        self._complete, self._seed = complete, seed
        order = np.argsort(trials.scene_of, kind="stable")
        starts = np.searchsorted(trials.scene_of[order], np.arange(len(trials.source) + 1))
        self._rows = [order[a:b] for a, b in pairwise(starts)]
        #: Scenes with trials.
        self.scenes = np.array([scene for scene, rows in enumerate(self._rows) if len(rows)])

        @lru_cache(_MESHES)
        def mesh(source: str) -> Mesh:
            return object_sets.load(source)[0].load()

        self._mesh = mesh

    def draw(self, number: int, scenes: NDArray[np.int64], per_scene: int) -> _Drawn:
        """Draw up to `per_scene` trials of each scene, seen once; scenes whose object is not found are left out."""
        rng = np.random.default_rng([self._seed, number])
        volumes: list[NDArray[np.uint8]] = []
        poses, rows, crop_of = [], [], []
        for place, scene in enumerate(scenes.tolist()):
            seen = self._volume(scene, [self._seed, number, place])
            chosen = rng.permutation(self._rows[scene])[:per_scene]
            if seen is None:
                continue
            volume, world_from_crop = seen
            poses.append(np.linalg.inv(world_from_crop) @ self._trials.world_from_hand[chosen])
            crop_of.append(np.full(len(chosen), len(volumes)))
            volumes.append(volume)
            rows.append(chosen)
        if not rows:
            raise ConfigError("no camera found an object in any scene of a batch; widen `fov` or come nearer")
        picked = np.concatenate(rows)
        made = self._inputs.make(
            self._completed(np.stack(volumes)),
            np.concatenate(crop_of),
            np.concatenate(poses),
            self._trials.preshape[picked],
        )
        columns = [getattr(self._trials, name)[picked] for name in TARGETS]
        targets = torch.from_numpy(np.stack(columns, axis=1)).float()
        return _Drawn(ScorerBatch(*made, targets), self._trials.scene_of[picked])

    def _volume(self, scene: int, seed: list[int]) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        """Look at a scene: completed, surface and unseen, and ``world_from_crop``."""
        mesh = self._mesh(str(self._trials.source[scene]))
        pose = self._trials.world_from_object[scene]
        crops = look(mesh, pose, self._scenes, seed, 1)
        if not crops.found[0]:
            return None
        volume = crops.channels[0].copy()
        if self._complete is None:
            at = np.linalg.inv(crops.world_from_crop) @ pose
            # The table's channel makes room: it is known everywhere.
            volume = np.concatenate([solid_occupancy([mesh], [0], at, config=self._scenes.crop), volume[:2]])
        return volume, crops.world_from_crop[0]

    def _completed(self, volumes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self._complete is None:
            return volumes
        return np.concatenate([self._complete(volumes)[:, None], volumes[:, :2]], axis=1)


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
    config: TrainConfig = TrainConfig(batch_size=256, max_steps=10_000, validate_every=250),  # noqa: B008 (frozen)
    scenes: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    complete: Complete | None = None,
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
    config : TrainConfig
        How it is trained; members of an ensemble differ by its seed.
    scenes : SceneConfig
        How scenes are seen.
    complete : callable, optional
        Tells the object's occupancy from the channels of crops; by default it is the true one.
    """
    torch.manual_seed(config.seed)
    sampler = TrialSampler(trials, inputs, scenes, complete, config.seed)
    held_out = TrialSampler(validation, inputs, scenes, complete, 0)
    per_batch = max(1, config.batch_size // _PER_SCENE)
    kept: list[_Drawn] = []

    def batch(step: int) -> ScorerBatch:
        chosen = np.random.default_rng([config.seed, step, 1]).choice(sampler.scenes, per_batch)
        return sampler.draw(step, chosen, _PER_SCENE).batch

    def validate(net: nn.Module) -> dict[str, float]:
        if not kept:
            chosen = held_out.scenes[:: max(1, len(held_out.scenes) // _VALIDATION_SCENES)]
            parts = np.array_split(chosen, max(1, len(chosen) // 16))
            kept.extend(held_out.draw(_VALIDATION_FROM + i, part, 64) for i, part in enumerate(parts))
        return _measures(net, kept)

    net = ScorerNet(inputs.grid.swept)
    trainer = Trainer(net, Path(folder), config, batch=batch, losses=scorer_losses, validate=validate)
    return trainer.run()


def _measures(net: nn.Module, kept: list[_Drawn]) -> dict[str, float]:
    """Give AUC, mean cross-entropy, and the shares of successes: of each scene's best-scored trial, and of all."""
    logits = torch.cat([net(d.batch.cells, d.batch.scalars, d.batch.preshape)[:, 0] for d in kept]).double()
    targets: Tensor = torch.cat([d.batch.targets[:, 0] for d in kept])
    scene_of = np.concatenate([d.scene_of for d in kept])
    scores, success = logits.numpy(), targets.numpy() > 0.5
    entropy = nn.functional.binary_cross_entropy_with_logits(logits, targets.double())
    best = [success[rows][scores[rows].argmax()] for scene in np.unique(scene_of) for rows in [scene_of == scene]]
    return {
        "auc": auc(scores, success),
        "entropy": float(entropy),
        "chosen": float(np.mean(best)),
        "all": float(success.mean()),
    }
