"""Execution of predicted poses in simulation, and baselines without a network.

| baseline | prediction |
|---|---|
| ``label``   | the pose of the test sample itself: the bound of a perfect network |
| ``nearest`` | the pose of the training sample whose input differs least, by the sum of squares |
| ``average`` | the average of each object's training poses: the optimum of a network that knows only the object and minimizes a squared error over poses that are all valid |
| ``constant`` | one pose for everything: the training pose with the least mean distance to all others |

The average orientation is that of Markley et al., "Averaging quaternions", Journal of Guidance, Control, and Dynamics
30(4), 2007: the leading eigenvector of the sum of q q^T.
"""  # noqa: E501 (a table)

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox._common.rotations import poses_from, quaternion_from_rotation, rotation_from_quaternion
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.object_sets import ObjectSet
from graspbox.simulation import Scene
from graspbox.study.grasps import executed
from graspbox.study.samples import Samples

__all__ = ["BASELINES", "ObjectScenes", "Score", "average_pose", "execute"]

#: Distance between positions that counts as much as an angle of one radian, metres.
_METRES_PER_RADIAN = 0.1


class ObjectScenes:
    """Scenes of objects by name, each prepared once."""

    def __init__(self, objects: ObjectSet, hand: str = "reflex") -> None:
        self._specs, self._hand = {spec.name: spec for spec in objects}, hand
        self._made: dict[str, Scene] = {}

    def __getitem__(self, name: str) -> Scene:
        if name not in self._specs:
            raise ConfigError(f"there is no object {name!r} among {', '.join(self._specs)}")
        if name not in self._made:
            self._made[name] = Scene(self._specs[name].load(), hand=self._hand)
        return self._made[name]


@dataclass(frozen=True)
class Score:
    """Counts of executed predictions.

    `secure` ones held without shifting, `legacy` ones succeeded by the study's own criterion, and `infeasible` ones
    collide with the object or the table before the hand closes.
    """

    tried: int
    success: int
    secure: int
    legacy: int
    infeasible: int


def execute(scenes: ObjectScenes, samples: Samples, base_from_hand: NDArray[np.float64]) -> Score:
    """Try a pose ``base_from_hand`` (n, 4, 4) for every sample, on that sample's object and with its preshape."""
    if base_from_hand.shape != (len(samples), 4, 4):
        raise ConfigError(f"base_from_hand has shape {base_from_hand.shape}; it must be ({len(samples)}, 4, 4)")
    counts = np.zeros(4, dtype=np.int64)
    for i in np.unique(samples.object):
        rows = samples.object == i
        scene = scenes[samples.names[i]]
        poses = executed(scene, base_from_hand[rows])
        out = scene.simulate(poses, samples.preshape[rows], config=TrialConfig(legacy=True))
        flags = (out.success, out.secure, out.legacy_success, out.failure == "infeasible")
        counts += [flag.sum() for flag in flags]
    return Score(len(samples), *counts.tolist())


def average_pose(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average poses (n, 4, 4) to one (4, 4): the mean position, and the average orientation."""
    q = quaternion_from_rotation(poses[:, :3, :3])
    _, vectors = np.linalg.eigh(q.T @ q)
    rotation = rotation_from_quaternion(vectors[:, -1][None])
    return np.asarray(poses_from(poses[:, :3, 3].mean(axis=0)[None], rotation)[0])


def _nearest(train: Samples, test: Samples) -> NDArray[np.float64]:
    known = train.inputs.reshape(len(train), -1)
    # Row by row: float arrays of all images would take 4 times their memory.
    chosen = [
        int(np.argmin([float(np.square(row.astype(np.float32) - one).sum()) for row in known]))
        for one in test.inputs.reshape(len(test), -1)
    ]
    return train.base_from_hand[chosen]


def _average(train: Samples, test: Samples) -> NDArray[np.float64]:
    known = {i: average_pose(train.base_from_hand[train.object == i]) for i in np.unique(train.object)}
    everything = average_pose(train.base_from_hand)
    return np.stack([known.get(i, everything) for i in test.object])


def _constant(train: Samples, test: Samples) -> NDArray[np.float64]:
    poses = train.base_from_hand
    q = quaternion_from_rotation(poses[:, :3, :3])
    angles = 2 * np.arccos(np.clip(np.abs(q @ q.T), 0, 1))
    positions = poses[:, :3, 3]
    offsets = np.linalg.norm(positions[:, None] - positions[None], axis=2) / _METRES_PER_RADIAN
    middle = int(np.argmin((angles + offsets).mean(axis=1)))
    return np.broadcast_to(poses[middle], (len(test), 4, 4)).copy()


#: Baselines by name: functions from training and test samples to poses (n, 4, 4) for the latter.
BASELINES: Mapping[str, Callable[[Samples, Samples], NDArray[np.float64]]] = {
    "label": lambda _, test: test.base_from_hand,
    "nearest": _nearest,
    "average": _average,
    "constant": _constant,
}
