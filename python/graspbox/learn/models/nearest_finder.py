"""Grasp retrieval: the grasp that held in the most similar known scene (extra ``data``)."""

import os
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox.data.trials.learned import of_datasets
from graspbox.errors import ConfigError
from graspbox.learn.models.scene_views import SceneViews
from graspbox.learn.models.scenes import SceneConfig
from graspbox.learn.models.trials import GraspTrials
from graspbox.perception.configs import CropConfig, DepthNoise
from graspbox.perception.depth_views import Seen
from graspbox.perception.finder import Finder, Proposed, Query, observed_only
from graspbox.policies import DepthPolicy, Observer

__all__ = ["Memory", "NearestFinder", "NearestGrasp", "nearest", "remember"]

#: Voxels along each side of the blocks whose means form a scene's descriptor.
_BLOCK = 4
#: Greatest number of scenes that are kept.
_MOST = 4000


@dataclass(frozen=True, eq=False)
class Memory:
    """Known scenes of object sets: one view of each, and a grasp that held.

    Attributes
    ----------
    descriptions : (n, d) float32
        The channels ``surface`` and ``unseen`` of the crop, averaged over blocks of voxels.
    poses, preshapes : (n, 4, 4) float64, (n,) float64
        The grasp, ``crop_from_hand``, metres.
    """

    descriptions: NDArray[np.float32]
    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    learned_from: tuple[str, ...] = ()


def remember(data: str | os.PathLike[str], *, seed: int = 0) -> Memory:
    """Render once each scene of split ``train`` of a data set in which a grasp held, and store its most secure grasp.

    The seed determines the sample of scenes, if these are many, the cameras and their noise. Raises ConfigError if no
    grasp held.
    """
    trials = GraspTrials.from_dataset(data, "train")
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(trials))
    ranked = order[np.argsort(-(trials.success[order] * 1 + trials.secure[order]), kind="stable")]
    held, first = np.unique(trials.scene_of[ranked], return_index=True)
    chosen = ranked[first]
    kept = trials.success[chosen]
    held, chosen = held[kept], chosen[kept]
    sample = rng.permutation(len(held))[:_MOST]
    views = SceneViews(SceneConfig(), observed_only, seed, count=1)
    rows = []
    for scene, trial in zip(held[sample].tolist(), chosen[sample].tolist(), strict=True):
        if (view := views.get(str(trials.source[scene]), trials.world_from_object[scene], 0)) is not None:
            volume, world_from_crop = view
            pose = np.linalg.inv(world_from_crop) @ trials.world_from_hand[trial]
            rows.append((_description(volume[1:]), pose, trials.preshape[trial]))
    if not rows:
        raise ConfigError(f"no grasp in the split 'train' of {os.fspath(data)!r} held; name a larger data set")
    descriptions, poses, preshapes = zip(*rows, strict=True)
    return Memory(np.stack(descriptions), np.stack(poses), np.array(preshapes))


def _description(channels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Compute the descriptor (d,) of a crop (2, N, N, N) uint8."""
    n = channels.shape[1] // _BLOCK
    blocks = channels[:, : n * _BLOCK, : n * _BLOCK, : n * _BLOCK].reshape(2, n, _BLOCK, n, _BLOCK, n, _BLOCK)
    return np.asarray(blocks.mean(axis=(2, 4, 6)) / 255.0, dtype=np.float32).ravel()


class NearestFinder(Finder):
    """Finds one grasp in depth images, by retrieval.

    Its score is minus the distance between the descriptors of the two scenes.
    """

    def __init__(self, memory: Memory) -> None:
        super().__init__(CropConfig())
        self._memory = memory

    def propose(self, volume: NDArray[np.uint8], seen: Seen, query: Query) -> Proposed:
        """Return the grasp of the nearest scene: see `Finder.propose`."""
        del seen, query
        memory = self._memory
        distances = np.linalg.norm(memory.descriptions - _description(volume[1:]), axis=1)
        best = [int(np.argmin(distances))]
        return Proposed(memory.poses[best], memory.preshapes[best], -distances[best].astype(np.float64))


class NearestGrasp(DepthPolicy):
    """Repeats the grasp that held in the most similar known scene; `remember` makes the memory from a data set."""

    name = "nearest"

    def __init__(self, memory: Memory) -> None:
        super().__init__(partial(Observer, noise=DepthNoise()), lambda hand: NearestFinder(memory))
        self.learned_from = memory.learned_from


def nearest(data: Path) -> NearestGrasp:
    """Make the policy of a data set: the variant ``nearest=DATA`` of evaluations; raises as `remember`."""
    return NearestGrasp(replace(remember(data), learned_from=tuple(of_datasets([data]))))
