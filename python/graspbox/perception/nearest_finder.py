"""One decision by memory: the grasp that held in the known scene that looks most alike (extra ``data``)."""

import os
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.perception.finder import Complete, Finder, FoundGrasp, Score, observed_only
from graspbox.perception.scene_views import SceneViews
from graspbox.perception.scenes import SceneConfig
from graspbox.perception.trials import GraspTrials

__all__ = ["Memory", "NearestFinder", "remember"]

#: Voxels along each side of a block whose mean is one number of a scene's description.
_BLOCK = 4


@dataclass(frozen=True, eq=False)
class Memory:
    """Known scenes.

    Attributes
    ----------
    descriptions : (n, d) float32
        What a camera sees of each: the channels ``surface`` and ``unseen`` of its crop, in blocks of voxels.
    poses : (n, 4, 4) float64
        A grasp that held, ``crop_from_hand``, metres.
    preshapes : (n,) float64
        Its preshape.
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
    """Look once at scenes of a data set's split ``train`` in which a grasp held; secure ones come before others.

    Parameters
    ----------
    data : str or PathLike
        A data set (``graspbox dataset``).
    scenes : SceneConfig
        How scenes are seen.
    most : int
        Most scenes, drawn at random.
    seed : int
        Of the draw, the cameras and their noise.

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
    draw = rng.permutation(len(held))[:most]
    views = SceneViews(scenes, observed_only, seed, count=1)
    found = []
    for scene, trial in zip(held[draw].tolist(), chosen[draw].tolist(), strict=True):
        if (seen := views.get(str(trials.source[scene]), trials.world_from_object[scene], 0)) is not None:
            volume, world_from_crop = seen
            pose = np.linalg.inv(world_from_crop) @ trials.world_from_hand[trial]
            found.append((_description(volume[1:]), pose, trials.preshape[trial]))
    if not found:
        raise ConfigError(f"no grasp in the split 'train' of {os.fspath(data)!r} held; give a larger data set")
    descriptions, poses, preshapes = zip(*found, strict=True)
    return Memory(np.stack(descriptions), np.stack(poses), np.array(preshapes))


def _description(channels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Describe what is seen: (2, N, N, N) uint8 to (d,)."""
    n = channels.shape[1] // _BLOCK
    blocks = channels[:, : n * _BLOCK, : n * _BLOCK, : n * _BLOCK].reshape(2, n, _BLOCK, n, _BLOCK, n, _BLOCK)
    return np.asarray(blocks.mean(axis=(2, 4, 6)) / 255.0, dtype=np.float32).ravel()


class NearestFinder(Finder):
    """Finds grasps in depth images by memory; stands where a `graspbox.perception.finder.GraspFinder` does.

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

    def decide(
        self, crops: Crops, *, seed: int = 0, complete: Complete | None = None, score: Score | None = None
    ) -> FoundGrasp | None:
        """Find the grasp to try; arguments and errors as for `Finder.find`, of which the last three change nothing.

        Returns
        -------
        FoundGrasp or None
            Its score is minus the distance of the descriptions; its seconds are those of ``crop`` and ``search``. None
            where no object is seen.
        """
        del seed, complete, score
        if not crops.found[0]:
            return None
        began = time.perf_counter()
        memory = self._memory
        distances = np.linalg.norm(memory.descriptions - _description(crops.channels[0, :2]), axis=1)
        nearest = int(np.argmin(distances))
        return _found(crops, memory, nearest, -float(distances[nearest]), time.perf_counter() - began)


def _found(crops: Crops, memory: Memory, nearest: int, score: float, seconds: float) -> FoundGrasp:
    """Put the grasp of a known scene into a crop."""
    pose, preshape = memory.poses[nearest], memory.preshapes[nearest]
    return FoundGrasp(
        world_from_hand=crops.world_from_crop[0] @ pose,
        preshape=float(preshape),
        score=score,
        world_from_crop=crops.world_from_crop[0],
        object=crops.object[0],
        volume=np.concatenate([observed_only(crops.channels), crops.channels[0, :2]]),
        poses=pose[None],
        preshapes=preshape[None],
        scores=np.array([score]),
        seconds={"search": seconds},
    )
