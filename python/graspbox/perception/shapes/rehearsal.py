"""Grasps tried in simulation on the completed shape of a depth image, before the robot moves.

A scorer judges a grasp by the voxels around the hand; a rehearsal runs the trial itself. The completed volume becomes a
mesh at its place, and the hand closes, lifts and holds, at the pose itself and perhaps at some around it. The mass
follows from the completed volume, the friction is the default. Convex parts and time steps are coarser than in other
trials: their outcomes change no more than by an error of the hand of 3 mm, and the shape is not known any better.
"""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand, Mesh
from graspbox.configs import ImplicitConfig, PhysicsConfig
from graspbox.errors import MeshError, SimulationError
from graspbox.perception.configs import CropConfig, RehearsalConfig
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.perception.shapes.surface import surface_of
from graspbox.simulation import Scene
from graspbox.simulation.layouts import Arrangement

__all__ = ["Rehearsal", "rehearsed_score", "rehearsed_success"]

_LOG = logging.getLogger(__name__)

#: Convex parts of a completed shape: half a voxel of error, 16 parts of 24 corners.
_PARTS = {"max_error": 3e-3, "max_parts": 16, "max_points": 24, "max_nodes": 30_000}
#: Steps four times the default, and contacts found and solved less exactly: a quarter of the time of a trial.
_PHYSICS = PhysicsConfig(dt=8e-3, implicit=ImplicitConfig(contact_drift=5e-4, stick_speed=1e-3, tolerance=2e-4))
#: Fewest trials of a grasp with a stated error of the hand.
_WITH_ERROR = 4

#: Least and greatest mass of a completed shape, kg.
_LIGHTEST, _HEAVIEST = 0.03, 1.0
#: Scores count as at least this, and as at most one less this.
_CERTAIN = 1e-3
#: What a secure hold adds to a success, relative to it.
_SECURE = 0.3


class Rehearsal:
    """Completed shapes at rest, on which grasps are tried.

    Parameters
    ----------
    scenes : sequence of Scene
        Shapes in the frame of the crop.
    config : RehearsalConfig
        How grasps are tried.
    error : PoseNoise, optional
        Expected error of the hand, instead of that of the settings.
    num_threads : int, optional
        By default one per core; the result does not depend on it.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        config: RehearsalConfig,
        error: PoseNoise | None = None,
        num_threads: int | None = None,
    ) -> None:
        self.scenes, self._heavy, self._num_threads = tuple(scenes), config.heavy, num_threads
        noise = error or PoseNoise(config.position, config.rotation)
        trials = config.trials if error is None else max(config.trials, _WITH_ERROR)
        still, rng = np.tile(np.eye(4), (trials - 1, 1, 1)), np.random.default_rng(0)
        # All grasps have the same errors with a shape: chance must not decide between them.
        self._errors = [
            np.concatenate([np.eye(4)[None], perturbed(still, rng, noise.position, noise.rotation)]) for _ in scenes
        ]

    @classmethod
    def of(
        cls,
        occupancy: NDArray[np.uint8],
        crop: CropConfig,
        hand: Hand,
        config: RehearsalConfig,
        *,
        error: PoseNoise | None = None,
        num_threads: int | None = None,
    ) -> "Rehearsal | None":
        """Make the shapes of a completed volume (N, N, N) uint8, whose table is at z = 0; arguments as of `Rehearsal`.

        None if it has no shape that can be simulated: it is empty, or too thin.
        """
        volume = occupancy.sum(dtype=np.int64) / 255 * crop.voxel_size**3
        mass = float(np.clip(config.density * volume, _LIGHTEST, _HEAVIEST))
        shapes = (_at_rest(occupancy, crop, hand, threshold, mass) for threshold in config.thresholds)
        scenes = [scene for scene in shapes if scene is not None]
        return cls(scenes, config, error, num_threads) if scenes else None

    def shares(self, poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Try grasps: poses ``crop_from_hand`` (m, 4, 4), metres, and preshapes (m,).

        Returns
        -------
        (m,) float64
            Share of the trials that succeed, where secure holds count more: 0 for none, 1 if all are secure.
        """
        shares = np.zeros(len(poses))
        for scene, errors in zip(self.scenes, self._errors, strict=True):
            masses = sorted({1.0, max(1.0, self._heavy / scene.mesh.mass)})
            around, each = (poses[:, None] @ errors).reshape(-1, 4, 4), np.repeat(preshapes, len(errors))
            success, secure = scene.simulate_masses(around, each, masses, num_threads=self._num_threads)
            held = (success + _SECURE * secure) / (1.0 + _SECURE)
            shares += held.reshape(len(poses), -1).mean(axis=1)
        return np.asarray(shares / len(self.scenes))


def rehearsed_score(
    scores: NDArray[np.float64], shares: NDArray[np.float64], config: RehearsalConfig
) -> NDArray[np.float64]:
    """Combine scores or probabilities (m,) with the shares (m,) of successful trials: see `RehearsalConfig`."""
    sure = np.clip(scores, _CERTAIN, 1.0 - _CERTAIN)
    logits = config.offset + config.slope * np.log(sure / (1.0 - sure)) + config.gain * shares
    return np.asarray(1.0 / (1.0 + np.exp(-logits)))


def rehearsed_success(
    success: NDArray[np.float64], shares: NDArray[np.float64], config: RehearsalConfig
) -> NDArray[np.float64]:
    """Combine probabilities (m,) with shares (m,); those of grasps without trials, NaN, stay as they are."""
    return np.where(np.isnan(shares), success, rehearsed_score(success, np.nan_to_num(shares), config))


def _at_rest(occupancy: NDArray[np.uint8], crop: CropConfig, hand: Hand, threshold: int, mass: float) -> Scene | None:
    """Place the shape of a threshold on the table; None if it cannot be simulated."""
    surface = surface_of(occupancy, crop, threshold=threshold)
    if surface is None:
        return None
    vertices, faces = surface
    # The surface of the lowest voxels may be below the table, or above it.
    vertices[:, 2] = np.maximum(vertices[:, 2] - max(vertices[:, 2].min(), 0.0), 0.0)
    try:
        corners = np.ascontiguousarray(faces, dtype=np.uint32)
        mesh = Mesh.in_parts(vertices, corners, "completed", mass, _PARTS)
        return Scene.of(Arrangement.of_one(mesh, np.eye(4)), hand=hand, physics=_PHYSICS, cached=False)
    except (MeshError, SimulationError) as error:
        _LOG.info("no grasp is rehearsed with the shape of threshold %d: %s", threshold, error)
        return None
