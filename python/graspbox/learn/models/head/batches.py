"""Training batches of heads: scenes of grasp trials, rendered by noisy cameras, with the outcomes of the trials.

Reachability needs no trial: `HeadSampler` checks for random anchors whether the hand touches object or table on its
way, and whether the fingers meet the object as they close. `untried_scenes` makes scenes with only these labels.
"""

import zlib
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.errors import ConfigError
from graspbox.learn.models.cluttered import place
from graspbox.learn.models.head.network import AnchorSamples
from graspbox.learn.models.scenes import SceneConfig, render_crops
from graspbox.learn.models.trials import GraspTrials
from graspbox.perception.anchors import Anchors
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import perturbed

__all__ = ["HeadBatch", "HeadSampler", "HeadView", "untried_scenes"]

#: Channels of a crop that are inputs of a head.
_SEEN = 2
#: Random anchors whose reachability is checked. Near a tried pose: standard deviation, in steps of the grid. Others:
#: greatest distance from the origin along x and y.
_NEAR, _FAR = 1.5, 5.0
#: Fewest fingers that must meet the object.
_FINGERS = 2
#: Reflection of a crop in its plane y = 0.
_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def untried_scenes(objects: object_sets.ObjectSet, count: int, seed: int) -> GraspTrials:
    """Make scenes without trials: random objects on the table in any orientation, stable or not.

    Reachability depends only on geometry, and objects at rest are seldom tall. Raises ConfigError if the set is empty,
    or `count` is less than 1.
    """
    if not len(objects):
        raise ConfigError(f"the object set {objects.name!r} is empty; name objects to learn from")
    scenes = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        spec = objects[int(rng.integers(len(objects)))]
        pose = perturbed(np.eye(4)[None], rng, 0.0, np.pi)[0]
        pose[2, 3] = -(spec.load().vertices @ pose[2, :3]).min()
        scenes.append(GraspTrials.empty(spec.source, pose))
    return GraspTrials.joined(scenes)


@dataclass(frozen=True, eq=False)
class HeadView:
    """One view: ``surface`` and ``unseen`` (2, N, N, N), true occupancy (N, N, N), both uint8, and frame (4, 4)."""

    volume: NDArray[np.uint8]
    solid: NDArray[np.uint8]
    world_from_crop: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeadBatch:
    """n views with m trials, and q anchors whose reachability was checked.

    Attributes
    ----------
    volumes, solids : (n, 2, N, N, N) uint8, (n, N, N, N) uint8
        Channels of the crops, and occupancy of the objects, as `HandGrid.meets` takes it.
    sample_of, poses, preshape : (m,) int64, (m, 4, 4) float32, (m,) int64
        View of each trial, its ``crop_from_hand``, metres, and the index of its preshape.
    success, secure : (m,) float32
        Whether the trial succeeded, and was secure: 0 or 1.
    inside : (m,) bool
        Whether the pose lies within the anchor grid.
    trials : AnchorSamples
        The trials inside the grid, in order.
    nearest, residuals : (m,) int64, (m, 6) float32
        Nearest anchors and `graspbox.perception.anchors.Anchors.encode`; undefined outside the grid.
    probes, reached : AnchorSamples, (q,) float32
        The anchors that were checked; whether the open hand reaches the pose, and fingers meet the object.
    """

    volumes: Tensor
    solids: NDArray[np.uint8]
    sample_of: Tensor
    poses: Tensor
    preshape: Tensor
    success: Tensor
    secure: Tensor
    inside: Tensor
    trials: AnchorSamples
    nearest: Tensor
    residuals: Tensor
    probes: AnchorSamples
    reached: Tensor


class HeadSampler:
    """Samples batches of scenes with their trials.

    A number of views per scene are rendered once, and kept, compressed to about 20 kB each. Raises ConfigError without
    trials.
    """

    def __init__(
        self, trials: GraspTrials, grid: HandGrid, anchors: Anchors, scenes: SceneConfig, seed: int, views: int
    ) -> None:
        if not len(trials):
            raise ConfigError("there are no trials to learn from; make a data set first")
        self.trials, self.grid, self.anchors, self.config = trials, grid, anchors, scenes
        self._seed, self._views = seed, views
        self._rows = trials.rows_of_scenes()
        self._packed: dict[int, list[tuple[bytes, NDArray[np.float64]]]] = {}
        tried = np.array([len(rows) > 0 for rows in self._rows])
        #: Scenes with trials, and scenes without.
        self.scenes, self.untried = np.flatnonzero(tried), np.flatnonzero(~tried)
        #: Reflections that map the hand onto itself, so that scenes reflected likewise have the same outcomes.
        self.symmetries = grid.symmetries

    def mesh(self, scene: int) -> Mesh:
        """Load the object of a scene; raises ConfigError for a scene of several."""
        placed = place(str(self.trials.source[scene]), self.trials.world_from_object[scene])
        if len(placed.meshes) > 1 or len(placed.wall_half_extents):
            raise ConfigError("a head learns from scenes of one object; name data sets of the layout 'single'")
        return placed.meshes[0]

    def view(self, scene: int, number: int) -> HeadView | None:
        """Return a view of a scene, by any number; None if no camera finds the object."""
        if scene not in self._packed:
            self._packed[scene] = self._render(scene)
        packed = self._packed[scene]
        if not packed:
            return None
        data, pose = packed[number % len(packed)]
        side = self.config.crop.resolution
        both = np.frombuffer(bytearray(zlib.decompress(data)), dtype=np.uint8).reshape(_SEEN + 1, side, side, side)
        return HeadView(both[:_SEEN], both[_SEEN], pose)

    def _render(self, scene: int) -> list[tuple[bytes, NDArray[np.float64]]]:
        """Render the views of a scene."""
        mesh, pose = self.mesh(scene), self.trials.world_from_object[scene]
        crops = render_crops(mesh, pose, self.config, [self._seed, scene], self._views)
        rows = np.flatnonzero(crops.found)
        if not len(rows):
            return []
        inside = np.linalg.inv(crops.world_from_crop[rows]) @ pose
        solids = solid_occupancy([mesh], [0] * len(rows), inside, config=self.config.crop)
        both = np.concatenate([crops.channels[rows, :_SEEN], solids[:, None]], axis=1)
        return [(zlib.compress(one.tobytes(), 1), crops.world_from_crop[i]) for i, one in zip(rows, both, strict=True)]

    def sample(self, number: int, scenes: NDArray[np.int64], per_scene: int, *, augment: bool = False) -> HeadBatch:
        """Sample up to `per_scene` trials and as many anchors to check in each scene, determined by `number`.

        With `augment`, views are reflected at random by a symmetry of the hand. Scenes without a visible object are
        left out; raises ConfigError if none is left.
        """
        rng = np.random.default_rng([self._seed, number])
        parts: list[_Part] = []
        for scene in scenes.tolist():
            view = self.view(scene, int(rng.integers(1 << 30)))
            if view is None:
                continue
            rows = rng.permutation(self._rows[scene])[:per_scene]
            poses = np.linalg.inv(view.world_from_crop) @ self.trials.world_from_hand[rows]
            volume, solid = view.volume, view.solid
            if augment:
                volume, solid, poses = self._reflected(volume, solid, poses, rng)
            parts.append(_Part(volume, solid, rows, poses, *self._probe(solid, poses, per_scene, rng)))
        if not parts:
            raise ConfigError("no camera found an object in any scene of a batch; widen `fov` or come nearer")
        return self._batch(parts)

    def _reflected(
        self, volume: NDArray[np.uint8], solid: NDArray[np.uint8], poses: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float64]]:
        """Reflect a scene by a random symmetry of the hand or not at all: only mirror images change the crop."""
        choice = int(rng.integers(len(self.symmetries) + 1)) if self.symmetries else 0
        if not choice:
            return volume, solid, poses
        signs = self.symmetries[choice - 1]
        poses = poses @ np.diag([*signs, 1.0])
        if np.prod(signs) > 0.0:
            return volume, solid, poses
        return volume[:, :, ::-1], solid[:, ::-1], _MIRROR @ poses

    def _probe(
        self, solid: NDArray[np.uint8], poses: NDArray[np.float64], count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
        """Sample anchors near the poses or around the crop's origin: places, preshapes, reachability."""
        preshapes, heights, rolls, cells, _ = self.anchors.shape
        near = rng.uniform(0.0, [cells - 1, cells - 1, heights - 1, rolls], (count, 4))
        if len(poses):
            near = self.anchors.places(poses).place[rng.integers(len(poses), size=count)]
        else:
            near[:, :2] = 0.5 * (cells - 1)
        far = near.copy()
        far[:, :2] += rng.uniform(-_FAR, _FAR, (count, 2))
        far[:, 2:] = rng.uniform(0.0, [heights - 1, rolls], (count, 2))
        near += rng.normal(0.0, _NEAR, near.shape)
        place = np.rint(np.where(rng.random((count, 1)) < 0.5, near, far))
        place[:, :3] = np.clip(place[:, :3], 0, [cells - 1, cells - 1, heights - 1])
        preshape = rng.integers(preshapes, size=count)
        tried = self.anchors.poses(place, np.zeros((count, 2)))
        return place, preshape, self.reached(solid, tried, preshape)

    def reached(
        self, solid: NDArray[np.uint8], poses: NDArray[np.float64], preshape: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Return whether the open hand reaches poses (m, 4, 4), and enough fingers then meet the object."""
        free, fingers = self.grid.meets(np.ascontiguousarray(solid), poses, self.grid.preshapes[preshape])
        return free & (fingers >= _FINGERS)

    def _batch(self, parts: "list[_Part]") -> HeadBatch:
        rows, poses = np.concatenate([p.rows for p in parts]), np.concatenate([p.poses for p in parts])
        sample_of, probe_of = (
            np.repeat(np.arange(len(parts)), [len(getattr(p, name)) for p in parts]) for name in ("rows", "place")
        )
        preshape = self.grid.nearest(self.trials.preshape[rows])
        nearest, residuals, inside = self.anchors.encode(poses, preshape)
        place = self.anchors.places(poses[inside]).place
        probed = [np.concatenate([getattr(p, name) for p in parts]) for name in ("place", "preshape")]
        return HeadBatch(
            volumes=torch.from_numpy(np.stack([p.volume for p in parts])),
            solids=np.stack([p.solid for p in parts]),
            sample_of=torch.from_numpy(sample_of),
            poses=torch.from_numpy(poses).float(),
            preshape=torch.from_numpy(preshape),
            success=torch.from_numpy(self.trials.success[rows]).float(),
            secure=torch.from_numpy(self.trials.secure[rows]).float(),
            inside=torch.from_numpy(inside),
            trials=AnchorSamples.of(sample_of[inside], place, preshape[inside]),
            nearest=torch.from_numpy(nearest),
            residuals=torch.from_numpy(residuals).float(),
            probes=AnchorSamples.of(probe_of, *probed),
            reached=torch.from_numpy(np.concatenate([p.reached for p in parts])).float(),
        )


@dataclass(frozen=True, eq=False)
class _Part:
    """Contribution of one view to a batch."""

    volume: NDArray[np.uint8]
    solid: NDArray[np.uint8]
    rows: NDArray[np.int64]
    poses: NDArray[np.float64]
    place: NDArray[np.float64]
    preshape: NDArray[np.int64]
    reached: NDArray[np.bool_]
