"""Runs seeded trials in environments; each is one episode."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.evaluation.results import Evaluation, TrialResult
from graspbox.policies import Actions, Policy

__all__ = ["Steps", "TrialRun", "run_trials", "trial_seeds"]


def trial_seeds(seed: int, trials: int) -> list[int]:
    """Seeds of the trials of an evaluation; the first ones are the same for any number of trials.

    Each is below 2^53, so that JSON holds it, and ``env.reset(seed=...)`` begins that trial again.
    """
    words = np.random.SeedSequence(seed).generate_state(trials, np.uint64)
    return [int(word) >> 11 for word in words]


def run_trials(
    policy: Policy,
    envs: VectorEnv[Any, Any, Any],
    seeds: Sequence[int],
    *,
    progress: Callable[[int], None] = lambda _: None,
) -> Evaluation:
    """Run one trial per seed.

    Parameters
    ----------
    policy : Policy
        Bound to `envs`.
    envs : VectorEnv
        One of graspbox's, with ``autoreset_mode="Disabled"``.
    seeds : sequence of int
        Seeds of the trials, at least one.
    progress : callable
        Called with the number of finished trials.

    Raises
    ------
    ConfigError
        If there are no seeds, the environments reset by themselves, or the policy is bound to others.
    MeshError, FileError, SimulationError
        If an object cannot be read or simulated.
    """
    run = TrialRun(policy, envs, seeds)
    results: dict[int, TrialResult] = {}
    for trial, result in run.results():
        results[trial] = result
        progress(len(results))
    ordered = tuple(results[trial] for trial in range(len(seeds)))
    return Evaluation(policy.name, policy.task.env_id, ordered, 1e3 * run.seconds / run.decisions)


@dataclass(frozen=True)
class Steps:
    """One step of some trials; each row is one trial.

    Attributes
    ----------
    trial, env : (rows,) int64
        Index of the trial in the list of seeds, and of its environment.
    observation, following : (rows, ...) array, or mapping of them
        What the policy saw, and what its action led to.
    action : (rows, k) float32
        What it did.
    reward : (rows,) float64
        What it was paid.
    terminated, truncated : (rows,) bool
        Whether the trial ended, and how.
    """

    trial: NDArray[np.int64]
    env: NDArray[np.int64]
    observation: Any
    action: Actions
    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    following: Any


class TrialRun:
    """Trials in progress: the environments take the next trial whenever they are free.

    Parameters
    ----------
    policy, envs, seeds
        As for `run_trials`.
    watch : callable, optional
        Called with every step of every trial (`Steps`), before the results of the trials that end with it.

    Raises
    ------
    ConfigError
        As `run_trials`.
    """

    def __init__(
        self,
        policy: Policy,
        envs: VectorEnv[Any, Any, Any],
        seeds: Sequence[int],
        watch: Callable[[Steps], None] | None = None,
    ) -> None:
        if not seeds:
            raise ConfigError("there are no seeds; give one for each trial")
        if envs.metadata.get("autoreset_mode") != AutoresetMode.DISABLED:
            raise ConfigError("trials begin by an explicit reset; make the environments with autoreset_mode='Disabled'")
        if policy.task.num_envs != envs.num_envs:
            raise ConfigError(f"the policy is bound to {policy.task.num_envs} environments, these are {envs.num_envs}")
        self._policy, self._seeds, self._watch = policy, seeds, watch
        # Seeds per environment, send and recv are more than Gymnasium's class knows.
        self._native: Any = envs.unwrapped
        self.seconds, self.decisions = 0.0, 0
        self._next = 0
        #: Trial of each environment; -1 where all trials have been taken.
        self._trial = np.full(envs.num_envs, -1)
        self._objects = [""] * envs.num_envs
        self._steps = np.zeros(envs.num_envs, dtype=np.int64)
        self._rewards = np.zeros(envs.num_envs)
        self._observation: Any = None

    def results(self) -> Iterator[tuple[int, TrialResult]]:
        """Run all trials; gives each with its index when it ends."""
        while True:
            self._begin()
            active = np.flatnonzero(self._trial >= 0)
            if not len(active):
                return
            yield from self._advance(self._act(active), active)

    def _begin(self) -> None:
        """Begin trials in the free environments, as long as there are any."""
        free = np.flatnonzero(self._trial < 0)[: len(self._seeds) - self._next]
        if not len(free):
            return
        seeds: list[int | None] = [None] * self._native.num_envs
        mask = np.zeros(self._native.num_envs, dtype=np.bool_)
        for env in free.tolist():
            self._trial[env], seeds[env], mask[env] = self._next, self._seeds[self._next], True
            self._steps[env], self._rewards[env] = 0, 0.0
            self._next += 1
        self._observation, info = self._native.reset(seed=seeds, options={"reset_mask": mask})
        if not isinstance(info["object"][free[0]], str):
            raise ConfigError("the environments have info='numeric'; trials need the names of info='full'")
        for env in free.tolist():
            self._objects[env] = info["object"][env]
        self._policy.reset(seeds, mask=mask, info=info)

    def _act(self, active: NDArray[np.intp]) -> Actions:
        """Let the policy choose, and take its time."""
        began = time.perf_counter()
        actions = self._policy.act(self._observation)
        self.seconds += time.perf_counter() - began
        self.decisions += len(active)
        return actions[active]

    def _advance(self, actions: Actions, active: NDArray[np.intp]) -> Iterator[tuple[int, TrialResult]]:
        """Step the environments whose trial is not over."""
        self._native.send(actions, active)
        observation, rewards, terminated, truncated, info = self._native.recv(len(active))
        rows = info["env_id"]
        if self._watch is not None:
            acted = np.zeros((self._native.num_envs, actions.shape[1]), dtype=np.float32)
            acted[active] = actions
            before = _rows(self._observation, rows)
            ends = terminated, truncated
            self._watch(Steps(self._trial[rows], rows, before, acted[rows], rewards, *ends, observation))
        self._observation = _scatter(self._observation, observation, rows)
        self._steps[rows] += 1
        self._rewards[rows] += rewards
        for row in np.flatnonzero(terminated | truncated).tolist():
            env = int(rows[row])
            yield int(self._trial[env]), self._result(env, info, row)
            self._trial[env] = -1

    def _result(self, env: int, info: dict[str, Any], row: int) -> TrialResult:
        success = bool(info["is_success"][row])
        return TrialResult(
            seed=self._seeds[int(self._trial[env])],
            object=self._objects[env],
            success=success,
            secure=bool(info["is_secure"][row]),
            failure="" if success else str(info["failure"][row]),
            steps=int(self._steps[env]),
            reward=float(self._rewards[env]),
            # Of GraspPose-v0 alone.
            survives_shake=bool(info["survives_shake"][row]) if "survives_shake" in info else False,
            confidence=self._policy.confidence(env),
        )


def _rows(values: Any, rows: NDArray[np.intp]) -> Any:
    """Take some rows of an observation, an array or a dictionary of arrays."""
    return {name: part[rows] for name, part in values.items()} if isinstance(values, dict) else values[rows]


def _scatter(old: Any, new: Any, rows: NDArray[np.intp]) -> Any:
    """Replace some rows of an observation, an array or a dictionary of arrays; gives a new one."""
    if isinstance(old, dict):
        return {name: _scatter(values, new[name], rows) for name, values in old.items()}
    replaced = old.copy()
    replaced[rows] = new
    return replaced
