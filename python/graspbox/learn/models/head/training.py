"""Training of heads on grasp trials: losses, validation in simulation, and storage of trained heads.

A run's folder has the layout of `graspbox.learn.training.trainer`, and ``head.json``, which describes the head.
"""

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from graspbox._common.arguments import config_of
from graspbox._common.files import dumps, write_text
from graspbox._common.runs import refuse_changes
from graspbox.errors import ConfigError
from graspbox.learn.models.head.batches import HeadBatch, HeadSampler
from graspbox.learn.models.head.network import REACHED, SECURE, SUCCESS, AnchorNet, AnchorSamples
from graspbox.learn.models.scenes import SceneConfig
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.metrics import auc
from graspbox.learn.training.trainer import Trained, Trainer, TrainProgress, device_of, load_weights, moved, save_atomic
from graspbox.perception.anchors import AnchorConfig, Anchors
from graspbox.perception.configs import CropConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies.published.head_configs import HeadConfig
from graspbox.simulation import Scene

__all__ = [
    "HeadData",
    "Validation",
    "anchor_losses",
    "load_head",
    "save_head",
    "train_head",
]

#: File that describes the head in the folder of its training.
_HEAD = "head.json"

#: Trials of each scene in a batch.
_PER_SCENE = 112
#: Share of a batch that are scenes without trials, if there are any; their only labels are reachability.
_UNTRIED_SCENES = 0.3
#: Scenes of a batch in which the reachability of the network's own choices is checked.
_LOOKED_UP = 5
#: Views rendered per training scene.
_VIEWS = 8
#: Number of validation scenes, evenly spread.
_VALIDATION_SCENES = 192
#: Weights of the losses relative to that of success.
_SECURE, _RESIDUAL = 0.5, 0.3


def anchor_losses(net: AnchorNet, batch: HeadBatch, look_up: HeadSampler | None = None) -> dict[str, Tensor]:
    """Return the cross-entropies of reach, success and security, and the error of the residuals of successes.

    With `look_up`, the loss includes the reachability of the network's best anchors in some scenes: a maximum over many
    anchors selects overestimated ones.
    """
    features = net.seen(batch.volumes)
    kept = batch.inside
    tried = net.values(features, batch.trials)
    looked_up = net.values(features, batch.probes)[:, REACHED]
    entropy = functional.binary_cross_entropy_with_logits
    losses = {"reached": entropy(looked_up, batch.reached)}
    if kept.any():
        losses["success"] = entropy(tried[:, SUCCESS], batch.success[kept])
        losses["secure"] = _SECURE * entropy(tried[:, SECURE], batch.secure[kept])
    if look_up is not None:
        losses["chosen"] = _chosen_loss(net, features, batch, look_up)
    good = kept & (batch.success > 0.5)
    if good.any():
        offsets = net.residuals_at(features, batch.sample_of[good], batch.nearest[good])
        error = functional.smooth_l1_loss(offsets, batch.residuals[good], beta=0.2)
        losses["residual"] = _RESIDUAL * error
    return losses


def _chosen_loss(net: AnchorNet, features: Tensor, batch: HeadBatch, look_up: HeadSampler) -> Tensor:
    """Return the cross-entropy of reach for the best anchors of the first scenes of a batch."""
    place, preshape, reached = [], [], []
    scenes = range(min(_LOOKED_UP, len(batch.solids)))
    for i in scenes:
        index = net.best_of_each(features[i : i + 1]).cpu().numpy()
        poses, shape = net.anchors.decode(index)
        place.append(net.anchors.places(poses).place)
        preshape.append(shape)
        reached.append(look_up.reached(batch.solids[i], poses, shape))
    sample_of = np.repeat(np.array(scenes), [len(one) for one in reached])
    samples = AnchorSamples.of(sample_of, np.concatenate(place), np.concatenate(preshape))
    wanted = torch.from_numpy(np.concatenate(reached)).float().to(features.device)
    samples = moved(samples, features.device)
    return functional.binary_cross_entropy_with_logits(net.values(features, samples)[:, REACHED], wanted)


@dataclass(frozen=True, eq=False)
class HeadData:
    """Training data of a head, and its validation."""

    sampler: HeadSampler
    validation: "Validation"

    @classmethod
    def of(
        cls,
        trials: GraspTrials,
        validation: GraspTrials,
        grid: HandGrid,
        anchors: AnchorConfig = AnchorConfig(),  # noqa: B008 (frozen)
        scenes: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
        seed: int = 0,
    ) -> Self:
        """Build the data from training trials, and validation trials of other objects.

        Training also uses scenes without trials, which show where the open hand can go. The hand of `grid` is simulated
        for validation; `seed` determines the views of the training scenes.
        """
        poses = Anchors(len(grid.preshapes), anchors)
        held_out = HeadSampler(validation, grid, poses, scenes, 0, 1)
        return cls(HeadSampler(trials, grid, poses, scenes, seed, _VIEWS), Validation(held_out))


def train_head(
    folder: Path,
    data: HeadData,
    head: HeadConfig = HeadConfig(),  # noqa: B008 (frozen)
    config: TrainConfig = TrainConfig(batch_size=16, max_steps=4000, validate_every=250, patience=1000),  # noqa: B008
    progress: Callable[[TrainProgress], None] = lambda _: None,
    start: AnchorNet | None = None,
) -> Trained:
    """Train a head, or resume it; `folder` and `progress` as in `graspbox.learn.training.trainer`.

    Parameters
    ----------
    data : HeadData
        Training data, and the validation that selects the best weights: how many of the head's first choices succeed,
        and are secure, in simulation.
    head : HeadConfig
        The head; its anchors are those of the data.
    config : TrainConfig
        Its `batch_size` counts scenes.
    start : AnchorNet, optional
        A trained head, which learns further, and is kept where that makes it no better.

    Raises ConfigError if the folder holds another head or a run with other settings, or if the anchors are not those of
    the data.
    """
    sampler = data.sampler
    if head.anchors != sampler.anchors.config:
        raise ConfigError(f"the head has {head.anchors}, the data {sampler.anchors.config}; pass both the same")
    torch.manual_seed(config.seed)
    net = AnchorNet(sampler.anchors.shape[0], head, sampler.config.crop) if start is None else deepcopy(start)
    _describe(Path(folder), head)

    def batch(step: int) -> HeadBatch:
        rng = np.random.default_rng([config.seed, step, 1])
        others = min(len(sampler.untried), int(_UNTRIED_SCENES * config.batch_size))
        chosen = np.concatenate(
            [rng.choice(sampler.scenes, config.batch_size - others), rng.choice(sampler.untried, others)]
        )
        chosen = rng.permutation(chosen)
        return sampler.sample(step, chosen, _PER_SCENE, augment=True)

    def losses(net: AnchorNet, batch: HeadBatch) -> dict[str, Tensor]:
        return anchor_losses(net, batch, sampler)

    settings: dict[str, Any] = {"hand": sampler.grid.hand.name, "head": asdict(head), "scenes": asdict(sampler.config)}
    settings |= {"trials": [len(sampler.scenes), len(sampler.untried), len(sampler.trials)]}
    work: dict[str, Any] = {"batch": batch, "losses": losses, "validate": data.validation}
    return Trainer(net, folder, config, **work, settings=settings, trained=start is not None).run(progress)


class Validation:
    """Evaluates a head on held-out scenes: on their trials, and on a simulation of its first choice."""

    def __init__(self, sampler: HeadSampler) -> None:
        self._sampler = sampler
        places = np.linspace(0, len(sampler.scenes) - 1, min(_VALIDATION_SCENES, len(sampler.scenes)))
        self._scenes = sampler.scenes[np.rint(places).astype(np.int64)]
        self._batches: list[HeadBatch] = []
        self._simulated: dict[int, Scene] = {}

    def __call__(self, net: AnchorNet) -> dict[str, float]:
        """Return metrics by name, as shares; the first is the mean of success and security."""
        success, secure, infeasible = np.array([self._attempt(net, scene) for scene in self._scenes.tolist()]).mean(0)
        held = 0.5 * (success + secure)
        tried = {"held": held, "success": success, "secure": secure, "infeasible": infeasible}
        return {name: float(value) for name, value in (tried | self._judged(net)).items()}

    def _attempt(self, net: AnchorNet, scene: int) -> tuple[bool, bool, bool]:
        """Try the first choice: success, secure, infeasible. Without a visible object, nothing succeeds."""
        view = self._sampler.view(scene, 0)
        if view is None:
            return False, False, False
        if scene not in self._simulated:
            mesh = self._sampler.mesh(scene)
            pose, hand = self._sampler.trials.world_from_object[scene], self._sampler.grid.hand
            self._simulated[scene] = Scene(mesh, hand=hand, world_from_object=pose)
        simulated = self._simulated[scene]
        best = net.candidates(view.volume)
        poses = np.linalg.inv(simulated.world_from_object) @ view.world_from_crop @ best.poses[:1]
        outcome = simulated.simulate(poses, self._sampler.grid.preshapes[best.preshape[:1]])[0]
        return outcome.success, outcome.secure, outcome.failure == "infeasible"

    def _judged(self, net: AnchorNet) -> dict[str, float]:
        """Measure how well anchors separate successes from failures, secure from other grasps, and predict reach."""
        if not self._batches:
            parts = np.array_split(self._scenes, max(1, len(self._scenes) // 16))
            self._batches.extend(self._sampler.sample(i, part, _PER_SCENE) for i, part in enumerate(parts))
        tried, looked_up = [], []
        for batch in self._batches:
            batch = moved(batch, device_of(net))
            features = net.seen(batch.volumes)
            tried.append(net.values(features, batch.trials).detach().cpu())
            looked_up.append(net.values(features, batch.probes)[:, REACHED].detach().cpu())
        values = torch.cat(tried).double().numpy()
        targets = [torch.cat([getattr(b, n)[b.inside] for b in self._batches]) for n in ("success", "secure")]
        reached = torch.cat([b.reached for b in self._batches])
        return {
            "auc": auc(values[:, SUCCESS], _flags(targets[0])),
            "auc_secure": auc(values[:, SECURE], _flags(targets[1])),
            "auc_reached": auc(torch.cat(looked_up).double().numpy(), _flags(reached)),
        }


def _flags(values: Tensor) -> NDArray[np.bool_]:
    return np.asarray(values.numpy() > 0.5)


def _describe(folder: Path, head: HeadConfig) -> None:
    """Write ``head.json``; refuses a folder of another head."""
    path, now = folder / _HEAD, json.loads(json.dumps(asdict(head)))
    if path.exists():
        refuse_changes(folder, json.loads(path.read_text()), now)
    write_text(path, dumps(now) + "\n")


def save_head(folder: Path, net: AnchorNet, head: HeadConfig) -> None:
    """Write a head as a training does; `load_head` reads it."""
    _describe(folder, head)
    save_atomic(net.state_dict(), folder / "weights.pt")


def load_head(folder: Path, preshapes: int, crop: CropConfig = CropConfig()) -> AnchorNet:  # noqa: B008 (frozen)
    """Load a trained head, for a hand with that number of preshapes.

    Raises ConfigError if the folder holds no head, or one that was trained for another hand or crop.
    """
    path = Path(folder) / _HEAD
    if not path.exists():
        raise ConfigError(
            f"{folder} has no file named head.json; run graspbox train head, or name the folder of a trained head"
        )
    try:
        net = AnchorNet(preshapes, config_of(HeadConfig, json.loads(path.read_text()), _HEAD), crop)
    except (ValueError, TypeError, AttributeError) as error:
        raise ConfigError(
            f"{path} does not describe a head ({error}); remove the folder, and train the head again"
        ) from None
    load_weights(net, Path(folder) / "weights.pt")
    return net
