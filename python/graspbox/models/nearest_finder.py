"""Grasp retrieval: the grasp that held in the most similar known scene (extra ``data``)."""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.models.scene_views import SceneViews
from graspbox.models.scenes import SceneConfig
from graspbox.models.trials import GraspTrials
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.perception.finder import Clock, Finder, Ranked, observed_only, volume_of

__all__ = ["Memory", "NearestFinder", "remember"]

#: Voxels along each side of the blocks whose means form a scene's descriptor.
_BLOCK = 4


@dataclass(frozen=True, eq=False)
class Memory:
    """Known scenes.

    Attributes
    ----------
    descriptions : (n, d) float32
        One view of each scene: the channels ``surface`` and ``unseen`` of its crop, averaged over blocks of voxels.
    poses : (n, 4, 4) float64
        A grasp that held, ``crop_from_hand``, metres.
    preshapes : (n,) float64
        Preshape of that grasp.
    learned_from : tuple of str
        The object sets of the scenes.
    """

    descriptions: NDArray[np.float32]
    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]
    learned_from: tuple[str, ...] = ()


def remember(
    data: str | os.PathLike[str],
    *,
    scenes: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    most: int = 4000,
    seed: int = 0,
) -> Memory:
    """Render once each scene of split ``train`` in which a grasp held, and store its most secure grasp.

    Parameters
    ----------
    data : str or PathLike
        A data set (``graspbox dataset``).
    scenes : SceneConfig
        How scenes are rendered.
    most : int
        Greatest number of scenes, sampled at random.
    seed : int
        Seed of the sample, the cameras and their noise.

    Raises
    ------
    ConfigError
        If no grasp held.
    """
    trials = GraspTrials.from_dataset(data, "train")
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(trials))
    ranked = order[np.argsort(-(trials.success[order] * 1 + trials.secure[order]), kind="stable")]
    held, first = np.unique(trials.scene_of[ranked], return_index=True)
    chosen = ranked[first]
    kept = trials.success[chosen]
    held, chosen = held[kept], chosen[kept]
    sample = rng.permutation(len(held))[:most]
    views = SceneViews(scenes, observed_only, seed, count=1)
    found = []
    for scene, trial in zip(held[sample].tolist(), chosen[sample].tolist(), strict=True):
        if (view := views.get(str(trials.source[scene]), trials.world_from_object[scene], 0)) is not None:
            volume, world_from_crop = view
            pose = np.linalg.inv(world_from_crop) @ trials.world_from_hand[trial]
            found.append((_description(volume[1:]), pose, trials.preshape[trial]))
    if not found:
        raise ConfigError(f"no grasp in the split 'train' of {os.fspath(data)!r} held; give a larger data set")
    descriptions, poses, preshapes = zip(*found, strict=True)
    return Memory(np.stack(descriptions), np.stack(poses), np.array(preshapes))


def _description(channels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Compute the descriptor (d,) of a crop (2, N, N, N) uint8."""
    n = channels.shape[1] // _BLOCK
    blocks = channels[:, : n * _BLOCK, : n * _BLOCK, : n * _BLOCK].reshape(2, n, _BLOCK, n, _BLOCK, n, _BLOCK)
    return np.asarray(blocks.mean(axis=(2, 4, 6)) / 255.0, dtype=np.float32).ravel()


class NearestFinder(Finder):
    """Finds grasps in depth images by retrieval.

    Returns one grasp. Its score is minus the distance between the descriptors of the two scenes; its
    `FoundGrasp.seconds` are those of ``crop`` and ``search``.

    Parameters
    ----------
    memory : Memory
        Known scenes.
    crop : CropConfig
        The crop.
    """

    def __init__(self, memory: Memory, crop: CropConfig = CropConfig()) -> None:  # noqa: B008 (frozen)
        super().__init__(crop)
        self._memory = memory

    def rank(self, crops: Crops, seed: int, clock: Clock) -> Ranked:
        """Rank grasps: see `Finder.rank`."""
        del seed
        memory = self._memory
        distances = np.linalg.norm(memory.descriptions - _description(crops.channels[0, :2]), axis=1)
        best = [int(np.argmin(distances))]
        volume = volume_of(crops, observed_only)
        clock.lap("search")
        return Ranked(volume, memory.poses[best], memory.preshapes[best], -distances[best].astype(np.float64))
