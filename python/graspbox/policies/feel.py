"""Grasps from one depth image, and a second choice if the hand feels that the first grasp will not hold."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.artifacts.configs import FeelPolicyConfig
from graspbox.artifacts.folders import load, used_folder
from graspbox.artifacts.runtimes import Backend, load_stability
from graspbox.errors import ConfigError
from graspbox.models.stability.inputs import Feeling, StabilityInputs
from graspbox.perception.configs import DepthNoise
from graspbox.perception.finder import FoundGrasp
from graspbox.perception.outputs import check_finite
from graspbox.policies._executor import GraspExecutor
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.depth import DepthGrasp
from graspbox.simulation import load_hand

__all__ = ["Attempt", "FeelThenLift"]


@dataclass(frozen=True, eq=False)
class Attempt:
    """One grasp of an episode, felt.

    Attributes
    ----------
    found : FoundGrasp
        The grasp.
    felt : (k,) float32
        Inputs of the network: facts known before, and sensations (`graspbox.models.stability.inputs.Feeling`).
    probability : float
        That it holds, as the network says.
    released : bool
        Whether the hand opened again.
    """

    found: FoundGrasp
    felt: NDArray[np.float32]
    probability: float
    released: bool


class FeelThenLift(Policy):
    """Grasps the object in one depth image, feels whether the grasp will hold, and lifts, or opens and chooses again.

    It acts in ``Grasp-v0`` alone. The first grasp is that of `DepthGrasp`. As the fingers close, and by default through
    the first half second of the lift, the hand feels joints, loads and tactile forces; a network predicts from these,
    and from facts known before, how likely the grasp holds. If that is less than the threshold, the hand goes back
    down, opens, backs off, leaves the image and looks again; grasps score lower the nearer they are to the one that
    failed. The second grasp is lifted in any case.

    Parameters
    ----------
    folder : Path
        A policy's folder (`graspbox.artifacts`); it names that of the policy that chooses the grasps.
    threshold : float, optional
        Below this probability it opens: 0 never, anything over 1 always. By default the folder's.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    backend : {"onnx", "torch"}
        Runs the networks of `DepthGrasp`; onnxruntime runs those that feel.
    num_threads : int, optional
        Threads of a decision; by default one per core.

    Attributes
    ----------
    base : DepthGrasp
        Looks, chooses and moves.
    attempts : list of list of Attempt
        Grasps of the present or last episode in each environment, as far as they were felt.
    threshold : float
        The same.

    Raises
    ------
    ConfigError
        If the folder is wrong, or lacks a file.
    """

    base: DepthGrasp
    obs: tuple[str, ...] = ("depth", "proprio")
    env_id = "graspbox/Grasp-v0"
    # Two attempts have taken up to 395 steps.
    settings: Mapping[str, Any] = {"image_size": 128, "max_episode_steps": 450}

    def __init__(
        self,
        folder: Path,
        *,
        threshold: float | None = None,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        folder = Path(folder)
        self._feel, self._stability = load(folder, FeelPolicyConfig), load_stability(folder)
        chooser = used_folder(folder, self._feel, "depth")
        self.base = DepthGrasp(chooser, noise=noise, backend=backend, num_threads=num_threads)
        self.name, self.learned_from = self._feel.name, (*self.base.learned_from, *self._feel.learned_from)
        self.threshold = self._feel.threshold if threshold is None else float(threshold)
        # A hand without tactile sensors feels its joints and loads alone.
        felt = StabilityInputs(load_hand(self._feel.hand), self._feel.times)
        self.obs = ("depth", *felt.obs)
        self.attempts: list[list[Attempt]] = []

    @property
    def found(self) -> list[FoundGrasp | None]:
        """The last grasp that was found in each environment; None where none was."""
        return self.base.found

    def _bind(self, task: Task) -> None:
        if not task.closed_loop:
            raise ConfigError(
                f"the policy {self.name!r} feels as its fingers close, which {task.env_id!r} does not show; evaluate "
                "it with --env graspbox/Grasp-v0"
            )
        self.base.bind(task)
        crop = self.base.finder.crop
        self._inputs = StabilityInputs(self.base.hand, self._feel.times, crop, task.control)
        self.attempts = [[] for _ in range(task.num_envs)]
        self._feelings: list[Feeling | None] = [None] * task.num_envs

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del seed, info
        self.attempts[env], self._feelings[env] = [], None

    def act(self, observation: Any) -> Actions:
        """Feel where the fingers close, and act as `DepthGrasp` does."""
        for env in range(self.task.num_envs):
            self._sense(env, {name: observation[name][env] for name in self.obs})
        return self.base.act(observation)

    def confidence(self, env: int) -> float | None:
        """Give the scorer's probability of success; 0 where no grasp was found."""
        return self.base.confidence(env)

    def _sense(self, env: int, row: Mapping[str, Any]) -> None:
        """Feel the grasp that is being carried out; once all of it was felt, keep it or take it back."""
        executor, found = self.base.executor, self.found[env]
        assert isinstance(executor, GraspExecutor)
        since = executor.closing_time(env)
        if since is None or found is None:
            return
        feeling = self._feelings[env]
        if feeling is None or feeling.found is not found:
            feeling = self._feelings[env] = Feeling(self._inputs, found)
        if not feeling.add(since, row):
            return
        felt = feeling.vector()
        probability = self._stability(felt)
        check_finite(np.array([probability]), "networks that feel")
        released = not self.attempts[env] and probability < self.threshold
        self.attempts[env].append(Attempt(found, felt, probability, released))
        if released:
            self.base.retry(env, row, self.base.finder.avoiding(found))
