"""Scenes seen and completed, ready to learn from: views are made when they are first drawn and kept compressed."""

import zlib
from collections import OrderedDict
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.finder import Complete
from graspbox.perception.scenes import SceneConfig, look

__all__ = ["SceneViews"]

#: Most views of a scene, and bytes that one takes (12,600 in the mean, with true occupancies).
_MOST_VIEWS, _BYTES = 8, 14_000
#: Meshes that are kept, ready to render.
_MESHES = 512


class SceneViews:
    """Views of scenes, each from several cameras; a view follows from the seed, its scene and its number alone.

    Parameters
    ----------
    source : sequence of str
        Object set that holds the object of each scene alone.
    world_from_object : (s, 4, 4) float64
        How it rests, metres.
    scenes : SceneConfig
        How scenes are seen.
    complete : callable, optional
        Tells the object's occupancy; by default it is the true one.
    seed : int
        Seed of all cameras.
    count : int, optional
        Views of each scene; by default as many as are likely to be kept, 1 to 8.
    memory : int
        Bytes that are kept; views that were not drawn for longest are made again.

    Attributes
    ----------
    count : int
        Views of each scene.
    """

    def __init__(
        self,
        source: Sequence[str],
        world_from_object: NDArray[np.float64],
        scenes: SceneConfig,
        complete: Complete | None,
        seed: int,
        *,
        count: int | None = None,
        memory: int = 400_000_000,
    ) -> None:
        self._source, self._poses, self._scenes = source, world_from_object, scenes
        self._complete, self._seed = complete, seed
        expected = memory // (_BYTES * max(1, len(source)))
        self.count = max(1, min(_MOST_VIEWS, expected)) if count is None else count
        self._memory = memory
        self._kept: OrderedDict[tuple[int, int], tuple[bytes, NDArray[np.float64]]] = OrderedDict()
        self._bytes = 0

        @lru_cache(_MESHES)
        def mesh(name: str) -> Mesh:
            return object_sets.load(name)[0].load()

        self._mesh = mesh

    def get(self, scene: int, view: int) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        """Give a view: completed, surface and unseen (3, N, N, N), and ``world_from_crop`` (4, 4).

        None where the camera finds no object.
        """
        key = (scene, view)
        if key in self._kept:
            self._kept.move_to_end(key)
        else:
            made = self._make(scene, view)
            packed = (b"", np.zeros((4, 4))) if made is None else (zlib.compress(made[0].tobytes(), 1), made[1])
            self._kept[key] = packed
            self._bytes += len(packed[0])
            while self._bytes > self._memory and len(self._kept) > 1:
                self._bytes -= len(self._kept.popitem(last=False)[1][0])
        data, pose = self._kept[key]
        if not data:
            return None
        n = self._scenes.crop.resolution
        return np.frombuffer(zlib.decompress(data), dtype=np.uint8).reshape(3, n, n, n), pose

    def _make(self, scene: int, view: int) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
        mesh, pose = self._mesh(str(self._source[scene])), self._poses[scene]
        crops = look(mesh, pose, self._scenes, [self._seed, scene, view], 1)
        if not crops.found[0]:
            return None
        if self._complete is None:
            inside = np.linalg.inv(crops.world_from_crop) @ pose
            completed = solid_occupancy([mesh], [0], inside, config=self._scenes.crop)
        else:
            completed = self._complete(crops.channels)
        return np.concatenate([completed, crops.channels[0, :2]]), crops.world_from_crop[0]
