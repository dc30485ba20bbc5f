"""Training of heads on grasp trials: losses, validation in simulation, and how a trained head is stored.

A run's folder is that of `graspbox.perception.training`, and ``head.json``, which says which head it is.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.arguments import config_of
from graspbox.errors import ConfigError
from graspbox.files import write_text
from graspbox.perception.anchor_net import AnchorNet, AnchorSamples
from graspbox.perception.anchors import AnchorConfig, Anchors
from graspbox.perception.configs import CropConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.head_batches import HeadBatch, HeadSampler
from graspbox.perception.head_configs import HeadConfig
from graspbox.perception.heads import ConstantNet, HeadNet, PoseNet, head_of
from graspbox.perception.scenes import SceneConfig
from graspbox.perception.scorer_training import auc
from graspbox.perception.training import TrainConfig, Trained, Trainer, TrainProgress, load_weights, save_atomic
from graspbox.perception.trials import GraspTrials
from graspbox.simulation import Scene

__all__ = [
    "HeadData",
    "Validation",
    "anchor_losses",
    "choose_constant",
    "head_losses",
    "load_head",
    "pose_losses",
    "train_head",
]

#: Trials of each scene in a batch.
_PER_SCENE = 112
#: Share of a batch that are scenes without trials, if there are any: they teach where the hand can go.
_UNTRIED_SCENES = 0.3
#: Scenes of a batch in which the reach of the network's own choices is looked up.
_LOOKED_UP = 5
#: Views of each scene that are made for training.
_VIEWS = 8
#: Heights over the table among which that of the head ``constant`` is chosen, metres.
_HEIGHTS = (0.08, 0.095, 0.11)
#: Scenes that validate.
_VALIDATION_SCENES = 192
#: Weights of the losses beside that of success.
_SECURE, _RESIDUAL = 0.5, 0.3
#: Metres that cost as much as a rotation of which one matrix entry differs by 1.
_LENGTH = 0.05
#: Weight of the preshape, and of all poses of a set beside the nearest.
_PRESHAPE, _OTHERS = 0.3, 0.05
#: A trial tells whether a pose succeeds that is this near: metres, and a sum of squared differences of the rotations.
_NEAR = 0.025, 0.3
#: Weight of a pose near which nothing was tried, which then counts as a failure.
_UNTRIED = 0.25


def anchor_losses(net: AnchorNet, batch: HeadBatch, look_up: HeadSampler | None = None) -> dict[str, Tensor]:
    """Give the cross-entropies of reach, success and security, and the residuals' error, of successes alone.

    With `look_up`, the reach of what the network itself finds best is looked up in some scenes, and counts too: a head
    that chooses among so many anchors finds those about which it is wrong.
    """
    features = net.seen(batch.volumes)
    kept = batch.inside
    tried = net.values(features, batch.trials)
    looked_up = net.values(features, batch.probes)[:, 0]
    entropy = functional.binary_cross_entropy_with_logits
    found = {"reached": entropy(looked_up, batch.reached)}
    if kept.any():
        found["success"] = entropy(tried[:, 1], batch.success[kept])
        found["secure"] = _SECURE * entropy(tried[:, 2], batch.secure[kept])
    if look_up is not None:
        found["chosen"] = _chosen_loss(net, features, batch, look_up)
    good = kept & (batch.success > 0.5)
    if good.any():
        offsets = net.residuals_at(features, batch.sample_of[good], batch.nearest[good])
        error = functional.smooth_l1_loss(offsets, batch.residuals[good], beta=0.2)
        found["residual"] = _RESIDUAL * error
    return found


def _chosen_loss(net: AnchorNet, features: Tensor, batch: HeadBatch, look_up: HeadSampler) -> Tensor:
    """Give the cross-entropy of reach for the best anchors of the first scenes of a batch."""
    place, preshape, reached = [], [], []
    scenes = range(min(_LOOKED_UP, len(batch.solids)))
    for i in scenes:
        index = net.best_of_each(features[i : i + 1]).numpy()
        poses, shape = net.anchors.decode(index)
        place.append(net.anchors.places(poses).place)
        preshape.append(shape)
        reached.append(look_up.reached(batch.solids[i], poses, shape))
    sample_of = np.repeat(np.array(scenes), [len(one) for one in reached])
    samples = AnchorSamples.of(sample_of, np.concatenate(place), np.concatenate(preshape))
    wanted = torch.from_numpy(np.concatenate(reached)).float()
    return functional.binary_cross_entropy_with_logits(net.values(features, samples)[:, 0], wanted)


def pose_losses(net: PoseNet, batch: HeadBatch) -> dict[str, Tensor]:
    """Give the error of the pose nearest to each success, and the cross-entropy of the confidences."""
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
    """Give the losses of a head by name, as its kind has them; `look_up` as for `anchor_losses`."""
    return anchor_losses(net, batch, look_up) if isinstance(net, AnchorNet) else pose_losses(net, batch)


@dataclass(frozen=True, eq=False)
class HeadData:
    """What heads learn from: made once, for all heads with the same anchors, so that no scene is rendered again.

    Attributes
    ----------
    sampler : HeadSampler
        Draws batches.
    validation : Validation
        Measures heads.
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
        """Take trials to learn from, and others, of other objects, to validate with.

        Scenes without trials are learned from too: they show where the open hand can go.

        The hand is simulated to validate, which only the ReFlex can be; `seed` is that of the views of the former.
        """
        made = Anchors(len(grid.preshapes), anchors)
        held_out = HeadSampler(validation, grid, made, scenes, 0, 1)
        return cls(HeadSampler(trials, grid, made, scenes, seed, _VIEWS), Validation(held_out))


def train_head(
    folder: Path,
    data: HeadData,
    head: HeadConfig = HeadConfig(),  # noqa: B008 (frozen)
    config: TrainConfig = TrainConfig(batch_size=16, max_steps=4000, validate_every=250, patience=1000),  # noqa: B008
    progress: Callable[[TrainProgress], None] | None = None,
) -> Trained:
    """Train a head in a folder, or continue there; see `graspbox.perception.training`.

    Parameters
    ----------
    folder : Path
        The run's folder.
    data : HeadData
        What it learns from, and what the best weights are chosen by: how many of its first choices succeed, and are
        secure, in simulation.
    head : HeadConfig
        The head; its anchors are those of the data.
    config : TrainConfig
        How it is trained; `batch_size` counts scenes.
    progress : callable, optional
        Called after each step.

    Raises
    ------
    ConfigError
        If the folder holds another head, or a run with other settings, the anchors are not those of the data, or the
        head does not learn.
    """
    sampler = data.sampler
    if head.kind == "constant":
        raise ConfigError("the head 'constant' has nothing to train; choose_constant chooses its pose")
    if head.anchors != sampler.anchors.config:
        raise ConfigError(f"the head has {head.anchors}, the data {sampler.anchors.config}; give both the same")
    torch.manual_seed(config.seed)
    net = head_of(sampler.anchors.shape[0], head, sampler.config.crop)
    _describe(Path(folder), head)

    def batch(step: int) -> HeadBatch:
        rng = np.random.default_rng([config.seed, step, 1])
        free = len(sampler.untried) if head.kind == "anchor" else 0
        others = min(free, int(_UNTRIED_SCENES * config.batch_size))
        chosen = np.concatenate(
            [rng.choice(sampler.scenes, config.batch_size - others), rng.choice(sampler.untried, others)]
        )
        chosen = rng.permutation(chosen)
        return sampler.draw(step, chosen, _PER_SCENE, augment=True)

    def losses(net: nn.Module, batch: HeadBatch) -> dict[str, Tensor]:
        return head_losses(net, batch, sampler)

    trainer = Trainer(net, Path(folder), config, batch=batch, losses=losses, validate=data.validation)
    return trainer.run(progress)


def choose_constant(folder: Path, data: HeadData) -> dict[str, float]:
    """Choose the pose of the head ``constant`` by what validates heads, and store it; gives its measures."""
    tried = []
    for height in _HEIGHTS:
        for preshape in range(data.sampler.anchors.shape[0]):
            net = ConstantNet(height, preshape)
            tried.append((data.validation(net), net))
    measures, best = max(tried, key=lambda one: one[0]["held"])
    _describe(Path(folder), HeadConfig(kind="constant"))
    save_atomic(best.state_dict(), Path(folder) / "weights.pt")
    return measures


class Validation:
    """Measures a head on scenes that it does not learn from: by their trials, and by what it would try first.

    Parameters
    ----------
    sampler : HeadSampler
        The scenes.
    count : int
        Scenes that are taken, evenly spread.
    """

    def __init__(self, sampler: HeadSampler, count: int = _VALIDATION_SCENES) -> None:
        self._sampler = sampler
        places = np.linspace(0, len(sampler.scenes) - 1, min(count, len(sampler.scenes)))
        self._scenes = sampler.scenes[np.rint(places).astype(np.int64)]
        self._batches: list[HeadBatch] = []
        self._simulated: dict[int, Scene] = {}

    def __call__(self, net: HeadNet) -> dict[str, float]:
        """Give measures by name, in shares: the first is the mean of what succeeds and what is secure."""
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
        """Try the first choice: success, secure, infeasible. Where no object is seen, nothing succeeds."""
        view = self._sampler.view(scene, 0)
        if view is None:
            return False, False, False
        if scene not in self._simulated:
            mesh = self._sampler.mesh(str(self._sampler.trials.source[scene]))
            self._simulated[scene] = Scene(mesh, world_from_object=self._sampler.trials.world_from_object[scene])
        simulated = self._simulated[scene]
        best = net.candidates(view.volume)
        poses = np.linalg.inv(simulated.world_from_object) @ view.world_from_crop @ best.poses[:1]
        outcome = simulated.simulate(poses, self._sampler.grid.preshapes[best.preshape[:1]])[0]
        return outcome.success, outcome.secure, outcome.failure == "infeasible"

    def _judged(self, net: AnchorNet) -> dict[str, float]:
        """Measure how well anchors tell successes from failures, secure grasps from others, and reach."""
        if not self._batches:
            parts = np.array_split(self._scenes, max(1, len(self._scenes) // 16))
            self._batches.extend(self._sampler.draw(i, part, _PER_SCENE) for i, part in enumerate(parts))
        tried, looked_up = [], []
        for batch in self._batches:
            features = net.seen(batch.volumes)
            tried.append(net.values(features, batch.trials))
            looked_up.append(net.values(features, batch.probes)[:, 0])
        values = torch.cat(tried).double().numpy()
        targets = [torch.cat([getattr(b, n)[b.inside] for b in self._batches]) for n in ("success", "secure")]
        reached = torch.cat([b.reached for b in self._batches])
        return {
            "auc": auc(values[:, 1], _flags(targets[0])),
            "auc_secure": auc(values[:, 2], _flags(targets[1])),
            "auc_reached": auc(torch.cat(looked_up).double().numpy(), _flags(reached)),
        }


def _flags(values: Tensor) -> NDArray[np.bool_]:
    return np.asarray(values.numpy() > 0.5)


def _describe(folder: Path, head: HeadConfig) -> None:
    """Write ``head.json``, or check that it is there already."""
    path, text = folder / "head.json", json.dumps(asdict(head), indent=1) + "\n"
    if path.exists() and path.read_text() != text:
        raise ConfigError(f"{folder} holds another head; name another folder, or delete it")
    folder.mkdir(parents=True, exist_ok=True)
    write_text(path, text)


def load_head(folder: Path, preshapes: int, crop: CropConfig = CropConfig()) -> HeadNet:  # noqa: B008 (frozen)
    """Load a trained head, for a hand with so many preshapes.

    Raises
    ------
    ConfigError
        If the folder holds none, or one that was trained for another hand or crop.
    """
    path = Path(folder) / "head.json"
    if not path.exists():
        raise ConfigError(f"{folder} holds no head.json; train a head there first")
    try:
        net = head_of(preshapes, config_of(HeadConfig, json.loads(path.read_text()), "head.json"), crop)
    except (ValueError, TypeError, AttributeError) as error:
        raise ConfigError(f"{path} describes no head: {error}") from None
    load_weights(net, Path(folder) / "weights.pt")
    return net
