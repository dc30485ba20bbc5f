"""Training of heads on grasp trials: losses, validation in simulation, and storage of trained heads.

A run's folder has the layout of `graspbox.training.trainer`, and ``head.json``, which describes the head.
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
from torch import Tensor, nn
from torch.nn import functional

from graspbox._common.arguments import config_of
from graspbox._common.files import dumps, write_text
from graspbox.errors import ConfigError
from graspbox.models.head.batches import HeadBatch, HeadSampler
from graspbox.models.head.configs import HeadConfig
from graspbox.models.head.heads import ConstantNet, HeadNet, PoseNet, head_of
from graspbox.models.head.network import REACHED, SECURE, SUCCESS, AnchorNet, AnchorSamples
from graspbox.models.scenes import SceneConfig
from graspbox.models.scorer.training import auc
from graspbox.models.trials import GraspTrials
from graspbox.perception.anchors import AnchorConfig, Anchors
from graspbox.perception.configs import CropConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.simulation import Scene
from graspbox.training.configs import TrainConfig
from graspbox.training.runs import refuse_changes
from graspbox.training.trainer import Trained, Trainer, TrainProgress, device_of, load_weights, moved, save_atomic

__all__ = [
    "HeadData",
    "Validation",
    "anchor_losses",
    "choose_constant",
    "head_losses",
    "load_head",
    "pose_losses",
    "save_head",
    "train_head",
]

#: Trials of each scene in a batch.
_PER_SCENE = 112
#: Share of a batch that are scenes without trials, if there are any; their labels are reachability alone.
_UNTRIED_SCENES = 0.3
#: Scenes of a batch in which the reachability of the network's own choices is checked.
_LOOKED_UP = 5
#: Views rendered per training scene.
_VIEWS = 8
#: Candidate heights of the head ``constant`` over the table, metres.
_HEIGHTS = (0.08, 0.095, 0.11)
#: Number of validation scenes.
_VALIDATION_SCENES = 192
#: Weights of the losses relative to that of success.
_SECURE, _RESIDUAL = 0.5, 0.3
#: Position error that costs as much as a difference of 1 in one entry of the rotation matrix, metres.
_LENGTH = 0.05
#: Weight of the preshape, and of the poses of a set other than the nearest.
_PRESHAPE, _OTHERS = 0.3, 0.05
#: A trial labels poses within these distances: metres, and a sum of squared differences of the rotations.
_NEAR = 0.025, 0.3
#: Weight of a pose far from all trials, which counts as a failure.
_UNTRIED = 0.25


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
    found = {"reached": entropy(looked_up, batch.reached)}
    if kept.any():
        found["success"] = entropy(tried[:, SUCCESS], batch.success[kept])
        found["secure"] = _SECURE * entropy(tried[:, SECURE], batch.secure[kept])
    if look_up is not None:
        found["chosen"] = _chosen_loss(net, features, batch, look_up)
    good = kept & (batch.success > 0.5)
    if good.any():
        offsets = net.residuals_at(features, batch.sample_of[good], batch.nearest[good])
        error = functional.smooth_l1_loss(offsets, batch.residuals[good], beta=0.2)
        found["residual"] = _RESIDUAL * error
    return found


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


def pose_losses(net: PoseNet, batch: HeadBatch) -> dict[str, Tensor]:
    """Return the error of the pose nearest to each success, and the cross-entropy of the confidences."""
    position, rotation, preshape, confidence = net(batch.volumes)
    of = batch.sample_of
    away = position[of] - batch.poses[:, None, :3, 3]
    turned = rotation[of] - batch.poses[:, None, :3, :3]
    chosen = batch.preshape[:, None].expand(-1, net.count)
    other = functional.cross_entropy(preshape[of].flatten(0, 1), chosen.flatten(), reduction="none").unflatten(
        0, (-1, net.count)
    )
    cost = away.abs().sum(2) / _LENGTH + turned.flatten(2).norm(dim=2) + _PRESHAPE * other
    good = batch.success > 0.5
    zero = cost.sum() * 0.0
    losses = {"pose": zero, "confidence": zero}
    if good.any():
        nearest = cost[good].min(1).values
        losses["pose"] = ((1.0 - _OTHERS) * nearest + _OTHERS * cost[good].mean(1)).mean()
    same = preshape.argmax(2)[of] == chosen
    near = (away.norm(dim=2) < _NEAR[0]) & (turned.square().sum((2, 3)) < _NEAR[1]) & same
    near = near.detach()
    wanted = batch.success[:, None].expand(-1, net.count)
    entropy = functional.binary_cross_entropy_with_logits
    told = entropy(confidence[of], wanted, reduction="none")[near]
    untried = torch.zeros_like(confidence).index_add(0, of, near.float()) == 0
    unknown = functional.softplus(confidence[untried])
    total = len(told) + _UNTRIED * len(unknown)
    losses["confidence"] = (told.sum() + _UNTRIED * unknown.sum()) / max(total, 1.0)
    return losses


def head_losses(net: nn.Module, batch: HeadBatch, look_up: HeadSampler | None = None) -> dict[str, Tensor]:
    """Return the losses of a head by name, according to its kind; `look_up` as for `anchor_losses`."""
    return anchor_losses(net, batch, look_up) if isinstance(net, AnchorNet) else pose_losses(net, batch)


@dataclass(frozen=True, eq=False)
class HeadData:
    """Training data shared by all heads with the same anchors, so that scenes are rendered once.

    Attributes
    ----------
    sampler : HeadSampler
        Samples batches.
    validation : Validation
        Evaluates heads.
    """

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

        Training also uses scenes without trials, which show where the open hand can go.

        The hand of `grid` is simulated for validation; `seed` determines the views of the training scenes.
        """
        made = Anchors(len(grid.preshapes), anchors)
        held_out = HeadSampler(validation, grid, made, scenes, 0, 1)
        return cls(HeadSampler(trials, grid, made, scenes, seed, _VIEWS), Validation(held_out))


def train_head(
    folder: Path,
    data: HeadData,
    head: HeadConfig = HeadConfig(),  # noqa: B008 (frozen)
    config: TrainConfig = TrainConfig(batch_size=16, max_steps=4000, validate_every=250, patience=1000),  # noqa: B008
    progress: Callable[[TrainProgress], None] = lambda _: None,
    start: nn.Module | None = None,
) -> Trained:
    """Train a head, or resume it; `folder` and `progress` as in `graspbox.training.trainer`.

    Parameters
    ----------
    data : HeadData
        Training data, and the validation that selects the best weights: how many of the head's first choices succeed,
        and are secure, in simulation.
    head : HeadConfig
        The head; its anchors are those of the data.
    config : TrainConfig
        Training hyperparameters; `batch_size` counts scenes.
    start : nn.Module, optional
        A trained head of the same kind, which learns further, and is kept where that makes it no better.

    Raises
    ------
    ConfigError
        If the folder holds another head or a run with other settings, if the anchors are not those of the data, or if
        the head is not trainable.
    """
    sampler = data.sampler
    if head.kind == "constant":
        raise ConfigError("the head 'constant' has nothing to train; choose_constant chooses its pose")
    if head.anchors != sampler.anchors.config:
        raise ConfigError(f"the head has {head.anchors}, the data {sampler.anchors.config}; give both the same")
    torch.manual_seed(config.seed)
    net = head_of(sampler.anchors.shape[0], head, sampler.config.crop) if start is None else deepcopy(start)
    _describe(Path(folder), head)

    def batch(step: int) -> HeadBatch:
        rng = np.random.default_rng([config.seed, step, 1])
        free = len(sampler.untried) if head.kind == "anchor" else 0
        others = min(free, int(_UNTRIED_SCENES * config.batch_size))
        chosen = np.concatenate(
            [rng.choice(sampler.scenes, config.batch_size - others), rng.choice(sampler.untried, others)]
        )
        chosen = rng.permutation(chosen)
        return sampler.sample(step, chosen, _PER_SCENE, augment=True)

    def losses(net: nn.Module, batch: HeadBatch) -> dict[str, Tensor]:
        return head_losses(net, batch, sampler)

    settings: dict[str, Any] = {"hand": sampler.grid.hand.name, "head": asdict(head), "scenes": asdict(sampler.config)}
    settings |= {"trials": [len(sampler.scenes), len(sampler.untried), len(sampler.trials)]}
    made: dict[str, Any] = {"settings": settings, "trained": start is not None}
    return Trainer(net, folder, config, batch=batch, losses=losses, validate=data.validation, **made).run(progress)


def choose_constant(folder: Path, data: HeadData) -> dict[str, float]:
    """Choose the pose of the head ``constant`` by validation and store it; returns its metrics."""
    tried = []
    for height in _HEIGHTS:
        for preshape in range(data.sampler.anchors.shape[0]):
            net = ConstantNet(height, preshape)
            tried.append((data.validation(net), net))
    measures, best = max(tried, key=lambda one: one[0]["held"])
    save_head(Path(folder), best, HeadConfig(kind="constant"))
    return measures


class Validation:
    """Evaluates a head on held-out scenes: on their trials, and on a simulation of its first choice.

    Parameters
    ----------
    sampler : HeadSampler
        The scenes.
    count : int
        Number of scenes, evenly spread.
    """

    def __init__(self, sampler: HeadSampler, count: int = _VALIDATION_SCENES) -> None:
        self._sampler = sampler
        places = np.linspace(0, len(sampler.scenes) - 1, min(count, len(sampler.scenes)))
        self._scenes = sampler.scenes[np.rint(places).astype(np.int64)]
        self._batches: list[HeadBatch] = []
        self._simulated: dict[int, Scene] = {}

    def __call__(self, net: HeadNet) -> dict[str, float]:
        """Return metrics by name, as shares; the first is the mean of success and security."""
        success, secure, infeasible = np.array([self._attempt(net, scene) for scene in self._scenes.tolist()]).mean(0)
        found = {
            "held": 0.5 * (success + secure),
            "success": success,
            "secure": secure,
            "infeasible": infeasible,
        }
        if isinstance(net, AnchorNet):
            found |= self._judged(net)
        return {name: float(value) for name, value in found.items()}

    def _attempt(self, net: HeadNet, scene: int) -> tuple[bool, bool, bool]:
        """Try the first choice: success, secure, infeasible. Without a visible object, nothing succeeds."""
        view = self._sampler.view(scene, 0)
        if view is None:
            return False, False, False
        if scene not in self._simulated:
            mesh = self._sampler.mesh(str(self._sampler.trials.source[scene]))
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
            tried.append(net.values(features, batch.trials).cpu())
            looked_up.append(net.values(features, batch.probes)[:, REACHED].cpu())
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
    path, now = folder / "head.json", json.loads(json.dumps(asdict(head)))
    if path.exists():
        refuse_changes(folder, json.loads(path.read_text()), now)
    write_text(path, dumps(now) + "\n")


def save_head(folder: Path, net: HeadNet, head: HeadConfig) -> None:
    """Write a head as a training does; `load_head` reads it."""
    _describe(folder, head)
    save_atomic(net.state_dict(), folder / "weights.pt")


def load_head(folder: Path, preshapes: int, crop: CropConfig = CropConfig()) -> HeadNet:  # noqa: B008 (frozen)
    """Load a trained head, for a hand with that number of preshapes.

    Raises
    ------
    ConfigError
        If the folder holds no head, or one that was trained for another hand or crop.
    """
    path = Path(folder) / "head.json"
    if not path.exists():
        raise ConfigError(
            f"{folder} has no file named head.json; run graspbox train head, or give the folder of a trained head"
        )
    try:
        net = head_of(preshapes, config_of(HeadConfig, json.loads(path.read_text()), "head.json"), crop)
    except (ValueError, TypeError, AttributeError) as error:
        raise ConfigError(
            f"{path} does not describe a head ({error}); remove the folder, and train the head again"
        ) from None
    load_weights(net, Path(folder) / "weights.pt")
    return net
