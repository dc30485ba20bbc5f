"""Rendered and completed views of scenes for training, made on first use and cached in compressed form."""

import zlib
from collections import OrderedDict
from functools import lru_cache
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.models.cluttered import is_scene, read_scene
from graspbox.models.scenes import PlacedObjects, SceneConfig
from graspbox.perception.finder import Complete

__all__ = ["SceneViews"]

#: Meshes kept in memory.
_MESHES = 512


class SceneViews:
    """Views of scenes, each from several cameras; the seed, the scene and the number determine a view.

    One instance serves all samplers and stages of a training, from several threads: making a view costs more than a
    training step on it.

    Parameters
    ----------
    scenes : SceneConfig
        How scenes are rendered.
    complete : callable, optional
        Predicts the object's occupancy; the default is ground truth.
    seed : int
        Seed of all cameras.
    count : int
        Views of each scene.
    memory : int
        Size of the cache, bytes; a view takes about 13,000. Least recently used views are evicted and made again.

    Attributes
    ----------
    count : int
        Views of each scene.
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

        @lru_cache(_MESHES)
        def mesh(name: str) -> Mesh:
            return object_sets.load(name)[0].load()

        self._mesh = mesh

    def get(
        self, source: str, world_from_object: NDArray[np.float64], view: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        """Return a view: completed, surface and unseen (3, N, N, N), and ``world_from_crop`` (4, 4).

        None if the camera finds no object.

        Parameters
        ----------
        source : str
            Object set that holds the object of the scene alone, or the text of a scene of several
            (`graspbox.models.cluttered`).
        world_from_object : (4, 4) float64
            Its resting pose, metres; a text has those of all objects.
        view : int
            Number of the view, less than `count`.
        """
        key = (source, world_from_object.tobytes(), view)
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
        if found is None:
            made = self._make(source, world_from_object, view)
            found = (b"", np.zeros((4, 4))) if made is None else (zlib.compress(made[0].tobytes(), 1), made[1])
            self._keep(key, found)
        data, pose = found
        if not data:
            return None
        n = self._scenes.crop.resolution
        return np.frombuffer(zlib.decompress(data), dtype=np.uint8).reshape(3, n, n, n), pose

    def _keep(self, key: tuple[str, bytes, int], found: tuple[bytes, NDArray[np.float64]]) -> None:
        with self._lock:
            if key in self._kept:
                return
            self._kept[key] = found
            self._bytes += len(found[0])
            while self._bytes > self._memory and len(self._kept) > 1:
                self._bytes -= len(self._kept.popitem(last=False)[1][0])

    def _make(
        self, source: str, pose: NDArray[np.float64], view: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        placed = read_scene(source) if is_scene(source) else PlacedObjects((self._mesh(source),), pose[None])
        name = zlib.crc32(source.encode() + pose.tobytes())
        crops = placed.look(self._scenes, [self._seed, name, view], 1)
        if not crops.found[0]:
            return None
        complete = self._complete
        completed = placed.solid(crops, self._scenes.crop) if complete is None else complete(crops.channels)
        return np.concatenate([completed, crops.channels[0, :2]]), crops.world_from_crop[0]
