"""``feel-then-lift``: grasps from one depth camera, feels whether the grasp will hold, and else chooses once more."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.configs import TrialConfig
from graspbox.envs.scripted import ScriptedGrasp, ScriptedRelease
from graspbox.errors import ConfigError
from graspbox.perception.configs import DepthNoise
from graspbox.perception.feel_folders import read_feel
from graspbox.perception.finder import FoundGrasp, Score
from graspbox.perception.runtimes import Backend, Stability, load_stability
from graspbox.perception.stability import Feeling, StabilityInputs
from graspbox.policies.base import Task
from graspbox.policies.depth import DepthGrasp
from graspbox.simulation import load_hand

__all__ = ["Attempt", "FeelThenLift"]

#: A grasp that is this far from one that failed, metres and radians, is another; nearer ones lose by nearness.
_MOVED, _TURNED = 0.03, 0.5


@dataclass(frozen=True, eq=False)
class Attempt:
    """One grasp of an episode, felt.

    Attributes
    ----------
    found : FoundGrasp
        The grasp.
    felt : (k,) float32
        What was known and felt of it (`graspbox.perception.stability.Feeling`).
    probability : float
        That it holds, as the network says.
    released : bool
        Whether the hand opened again.
    """

    found: FoundGrasp
    felt: NDArray[np.float32]
    probability: float
    released: bool


class FeelThenLift(DepthGrasp):
    """Grasps what a depth camera sees, feels whether the grasp will hold, and lifts, or opens and chooses once more.

    It acts in ``Grasp-v0`` alone. The first grasp is that of `DepthGrasp`. As the fingers close, and by default through
    the first half second of the lift, the hand feels joints, loads and tactile forces; a network tells from that, and
    from what was known of the grasp, how likely it holds. If that is less than the threshold, the hand goes back down,
    opens, backs off, leaves the image and looks again; grasps near the one that failed lose by their nearness. The
    second grasp is lifted in any case.

    Parameters
    ----------
    folder : Path
        A policy's folder with ``feel.json`` (`graspbox.perception.feel_folders`).
    threshold : float, optional
        Below this probability it opens: 0 never, anything over 1 always. By default the folder's.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    backend : {"onnx", "torch"}
        What runs the networks of `DepthGrasp`; what feels is run by onnxruntime.
    num_threads : int, optional
        Threads of a decision; by default one per core.

    Raises
    ------
    ConfigError
        If the folder is wrong.
    FileError
        If it lacks a file.
    """

    name = "feel-then-lift"
    env_id = "graspbox/Grasp-v0"
    # Two attempts have taken up to 395 steps.
    settings = {"image_size": 128, "max_episode_steps": 450}  # noqa: RUF012 (read only)

    def __init__(
        self,
        folder: Path,
        *,
        threshold: float | None = None,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        super().__init__(folder, noise=noise, backend=backend, num_threads=num_threads)
        self._feel = read_feel(Path(folder))
        self.name = f"{self.name}-feel"
        self.threshold = self._feel.threshold if threshold is None else float(threshold)
        self._stability: Stability = load_stability(Path(folder))
        assert self._published is not None
        # A hand without tactile sensors feels its joints and loads alone.
        felt = StabilityInputs(load_hand(self._published.hand), self._feel.times)
        self.obs = ("depth", *felt.obs)
        #: Grasps of the present or last episode in each environment, as far as they were felt.
        self.attempts: list[list[Attempt]] = []

    def _bind(self, task: Task) -> None:
        if not task.closed_loop:
            raise ConfigError(
                f"the policy {self.name!r} feels as its fingers close, which {task.env_id!r} does not show; evaluate "
                "it with --env graspbox/Grasp-v0"
            )
        super()._bind(task)
        self._inputs = StabilityInputs(self.hand, self._feel.times, self.crop, task.control)
        self.attempts = [[] for _ in range(task.num_envs)]
        self._feelings: list[Feeling | None] = [None] * task.num_envs

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        super()._begin(env, seed, info)
        self.attempts[env], self._feelings[env] = [], None

    def _move(self, env: int, seen: Mapping[str, Any]) -> NDArray[np.float32] | None:
        driver, found = self._drivers[env], self.found[env]
        if isinstance(driver, ScriptedGrasp) and found is not None:
            feeling = self._feelings[env]
            if feeling is None or feeling.found is not found:
                feeling = self._feelings[env] = Feeling(self._inputs, found)
            if feeling.add(driver.time - driver.closes_at, seen):
                self._decide(env, driver, feeling.vector(), seen)
        return super()._move(env, seen)

    def _decide(self, env: int, driver: ScriptedGrasp, felt: NDArray[np.float32], seen: Mapping[str, Any]) -> None:
        """Lift, or open and leave the image; the next decision then waits for that."""
        found = self.found[env]
        assert found is not None
        assert self._proprio is not None
        probability = self._stability(felt)
        released = not self.attempts[env] and probability < self.threshold
        self.attempts[env].append(Attempt(found, felt, probability, released))
        if not released:
            return
        behind = driver.goal.copy()
        behind[:3, 3] -= TrialConfig().standoff * behind[:3, 2]
        stops = self._view.leave(behind, found.preshape)
        hand = self._proprio.pose(seen["proprio"], "hand")
        settings = self._motion_settings()
        self._drivers[env] = ScriptedRelease(hand, driver.goal, found.preshape, stops, **settings)
        self._waiting[env] = int(self._streams[env].integers(2**62))

    def find(self, env: int, seed: int, seen: Mapping[str, Any]) -> FoundGrasp | None:
        """Look and choose; after a grasp that was taken back, another one. Parameters and result as in `DepthGrasp`."""
        if not self.attempts[env]:
            return super().find(env, seed, seen)
        assert self.scorer is not None
        score = _Other(self.scorer, self.attempts[env][-1].found)
        depth = self._noisy(seed, seen)
        return self._finder.find(
            depth, self._intrinsics, self._world_from_camera, seed=seed, score=score, on_crop=score.place
        )


class _Other:
    """Scores grasps; those near one that failed lose by their nearness."""

    def __init__(self, score: Score, failed: FoundGrasp) -> None:
        self._score, self._failed = score, failed
        self._world_from_crop = np.eye(4)

    def place(self, world_from_crop: NDArray[np.float64]) -> None:
        """Learn where the crop is."""
        self._world_from_crop = world_from_crop

    def __call__(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Score grasps: see `graspbox.perception.finder.Score`."""
        hands, failed = self._world_from_crop @ poses, self._failed.world_from_hand
        way = np.linalg.norm(hands[:, :3, 3] - failed[:3, 3], axis=1)
        traces = np.einsum("nij,ij->n", hands[:, :3, :3], failed[:3, :3])
        turn = np.arccos(np.clip((traces - 1.0) / 2.0, -1.0, 1.0))
        near = np.exp(-0.5 * ((way / _MOVED) ** 2 + (turn / _TURNED) ** 2))
        kept = 1.0 - near * (preshapes == self._failed.preshape)
        return np.asarray(self._score(volume, poses, preshapes) * kept)
