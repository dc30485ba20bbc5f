"""Rendered and completed views of scenes for training, made on first use and cached in compressed form."""

import zlib
from collections import OrderedDict
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from graspbox.learn.models.cluttered import place
from graspbox.learn.models.scenes import SceneConfig
from graspbox.perception.finder import Complete

__all__ = ["SceneViews"]


class SceneViews:
    """Views of scenes, each from several cameras; the seed, the scene and the number determine a view.

    One instance serves all samplers and stages of a training, from several threads: making a view costs more than a
    training step on it.

    Parameters
    ----------
    complete : callable, optional
        Predicts the object's occupancy; the default is ground truth.
    count : int
        Views of each scene.
    memory : int
        Size of the cache, bytes; a view takes about 13,000. Least recently used views are evicted and made again.
    """

    def __init__(
        self,
        scenes: SceneConfig,
        complete: Complete | None = None,
        seed: int = 0,
        *,
        count: int = 4,
        memory: int = 1_000_000_000,
    ) -> None:
        self.count, self._scenes = count, scenes
        self._complete, self._seed = complete, seed
        self._memory, self._bytes = memory, 0
        self._kept: OrderedDict[tuple[str, bytes, int], tuple[bytes, NDArray[np.float64]]] = OrderedDict()
        self._lock = Lock()

    def get(
        self, source: str, world_from_object: NDArray[np.float64], view: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        """Return a view, less than `count`: completed, surface and unseen (3, N, N, N), and ``world_from_crop`` (4, 4).

        None if the camera sees no object. The scene is one of `graspbox.learn.models.cluttered`, with its object's
        resting pose (4, 4), metres; a text has those of all objects.
        """
        key = (source, world_from_object.tobytes(), view)
        with self._lock:
            packed = self._kept.get(key)
            if packed is not None:
                self._kept.move_to_end(key)
        if packed is None:
            made = self._make(source, world_from_object, view)
            packed = (b"", np.zeros((4, 4))) if made is None else (zlib.compress(made[0].tobytes(), 1), made[1])
            self._keep(key, packed)
        data, pose = packed
        if not data:
            return None
        n = self._scenes.crop.resolution
        return np.frombuffer(zlib.decompress(data), dtype=np.uint8).reshape(3, n, n, n), pose

    def _keep(self, key: tuple[str, bytes, int], packed: tuple[bytes, NDArray[np.float64]]) -> None:
        with self._lock:
            if key in self._kept:
                return
            self._kept[key] = packed
            self._bytes += len(packed[0])
            while self._bytes > self._memory and len(self._kept) > 1:
                self._bytes -= len(self._kept.popitem(last=False)[1][0])

    def _make(
        self, source: str, pose: NDArray[np.float64], view: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        placed = place(source, pose)
        name = zlib.crc32(source.encode() + pose.tobytes())
        crops = placed.render(self._scenes, [self._seed, name, view], 1)
        if not crops.found[0]:
            return None
        complete = self._complete
        completed = placed.occupancy(crops, self._scenes.crop) if complete is None else complete(crops.channels)
        return np.concatenate([completed, crops.channels[0, :2]]), crops.world_from_crop[0]
