"""Grasps from one depth image, and a second attempt if the first grasp is predicted to fail."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.configs import DepthNoise
from graspbox.perception.finder import FoundGrasp
from graspbox.perception.outputs import check_finite
from graspbox.policies._executor import GraspExecutor
from graspbox.policies.base import SCRIPTED, Actions, Policy, Task
from graspbox.policies.depth import DepthGrasp
from graspbox.policies.published.configs import FeelPolicyConfig
from graspbox.policies.published.folders import hand_of, load, used_folder
from graspbox.policies.published.runtimes import Backend, load_stability
from graspbox.policies.stability_inputs import StabilityInputs, StabilityReading
from graspbox.simulation import load_hand

__all__ = ["Attempt", "FeelThenLift"]


@dataclass(frozen=True, eq=False)
class Attempt:
    """One grasp attempt with its stability prediction.

    Attributes
    ----------
    found : FoundGrasp
        The grasp.
    readings : (k,) float32
        Inputs of the network: facts known before, and readings
        (`graspbox.policies.stability_inputs.StabilityReading`).
    probability : float
        Predicted probability that it holds.
    released : bool
        Whether the hand opened again.
    """

    found: FoundGrasp
    readings: NDArray[np.float32]
    probability: float
    released: bool


class FeelThenLift(Policy):
    """Grasps the object in one depth image, predicts from touch whether the grasp will hold, and lifts or retries.

    It acts only in ``Grasp-v0``. The first grasp is that of `DepthGrasp`. As the fingers close, and by default through
    the first half second of the lift, it reads joints, loads and tactile forces; a network predicts from these, and
    from facts known before, the probability that the grasp holds. If that is below the threshold, the hand moves back
    down, opens, backs off and leaves the image; then the policy looks again, and grasps score lower the nearer they are
    to the failed one. The second grasp is lifted in any case.

    Parameters
    ----------
    folder : Path
        A policy's folder (`graspbox.policies.published`); it names that of the policy that chooses the grasps.
    threshold : float, optional
        The hand opens below this probability: 0 never, more than 1 always. By default the folder's.
    noise, rehearsed, num_threads
        As of `DepthGrasp`.
    backend : {"onnx", "torch"}
        Runs the networks of `DepthGrasp`; onnxruntime runs the grasp-stability networks.

    Attributes
    ----------
    base : DepthGrasp
        Looks, chooses and moves.
    attempts : list of list of Attempt
        Grasps of the current or last episode in each environment whose stability was predicted.

    Raises
    ------
    ConfigError
        If the folder is wrong, or lacks a file.
    """

    #: The class of its ``config.json``, `graspbox.policies.published.registry`.
    config_class = FeelPolicyConfig
    base: DepthGrasp
    obs: tuple[str, ...] = ("depth", "proprio")
    env_id = "graspbox/Grasp-v0"
    closed_loop_settings = SCRIPTED
    # Two attempts took up to 395 steps.
    settings: Mapping[str, Any] = {"image_size": 128, "max_episode_steps": 450}

    def __init__(
        self,
        folder: Path,
        *,
        threshold: float | None = None,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        rehearsed: int | None = None,
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        folder = Path(folder)
        self._feel, self._stability = load(folder, FeelPolicyConfig), load_stability(folder)
        chooser = used_folder(folder, self._feel, "depth")
        self.base = DepthGrasp(chooser, noise=noise, rehearsed=rehearsed, backend=backend, num_threads=num_threads)
        self.name, self.learned_from = self._feel.name, (*self.base.learned_from, *self._feel.learned_from)
        self.threshold = self._feel.threshold if threshold is None else float(threshold)
        # A hand without tactile sensors has only joints and loads.
        inputs = StabilityInputs(load_hand(hand_of(folder, self._feel)), self._feel.times)
        self.obs = ("depth", *inputs.obs)
        self.settings = {**self.settings, "hand": self.base.settings["hand"]}
        self.attempts: list[list[Attempt]] = []

    @property
    def found(self) -> list[FoundGrasp | None]:
        """The last grasp in each environment; None without one."""
        return self.base.found

    def _bind(self, task: Task) -> None:
        if not task.closed_loop:
            raise ConfigError(
                f"the policy {self.name!r} reads sensors as the fingers close, which {task.env_id!r} does not "
                "show; evaluate it with --env graspbox/Grasp-v0"
            )
        self.base.bind(task)
        crop = self.base.finder.crop
        self._inputs = StabilityInputs(self.base.hand, self._feel.times, crop, task.control)
        self.attempts = [[] for _ in range(task.num_envs)]
        self._readings: list[StabilityReading | None] = [None] * task.num_envs

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del seed, info
        self.attempts[env], self._readings[env] = [], None

    def act(self, observation: Any) -> Actions:
        """Read the sensors as the fingers close, and act as `DepthGrasp` does."""
        for env in range(self.task.num_envs):
            self._sense(env, {name: observation[name][env] for name in self.obs})
        return self.base.act(observation)

    def confidence(self, env: int) -> float | None:
        """Return the scorer's probability of success; 0 without a grasp."""
        return self.base.confidence(env)

    def found_nothing(self, env: int) -> bool:
        """Whether its last look at an environment found no grasp."""
        return self.base.found_nothing(env)

    def _sense(self, env: int, row: Mapping[str, Any]) -> None:
        """Record sensor readings during a grasp; when complete, keep or release it."""
        executor, grasp = self.base.executor, self.found[env]
        assert isinstance(executor, GraspExecutor)
        since = executor.closing_time(env)
        if since is None or grasp is None:
            return
        reading = self._readings[env]
        if reading is None or reading.grasp is not grasp:
            reading = self._readings[env] = StabilityReading(self._inputs, grasp)
        if not reading.add(since, row):
            return
        vector = reading.vector()
        probability = self._stability(vector)
        check_finite(np.array([probability]), "grasp-stability networks")
        released = not self.attempts[env] and probability < self.threshold
        self.attempts[env].append(Attempt(grasp, vector, probability, released))
        if released:
            self.base.retry(env, row)
