"""Measure a policy: success and security of a fixed set of seeded trials, with Wilson intervals.

>>> import graspbox
>>> result = graspbox.evaluation.evaluate("planner", "graspbox/GraspPose-v0", "procedural:can:0-9", trials=8, seed=0)
>>> result.succeeded, result.rate, [round(bound, 2) for bound in result.ci95]
(8, 1.0, [0.68, 1.0])

| name | what it is |
|---|---|
| `evaluate`    | makes the environments, runs the trials, counts |
| `run_trials`  | runs seeded trials in environments that exist |
| `trial_seeds` | the seeds of the trials |
| `wilson`      | interval of a rate |

A trial is one episode with a seed of its own, which fixes object, pose, and what is random in the policy. All trials
run to their end, in whatever environment is free: neither the number of environments nor the length of an episode
changes what is counted.
"""

import operator
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, SupportsIndex

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from graspbox import object_sets, policies
from graspbox.envs import IDS
from graspbox.envs.settings import ObjectsArgument
from graspbox.errors import ConfigError
from graspbox.policies import Actions, Policy, Task

__all__ = [
    "MAX_ENVS",
    "MAX_TRIALS",
    "Evaluation",
    "ObjectCount",
    "TrialResult",
    "evaluate",
    "run_trials",
    "trial_seeds",
    "wilson",
]

#: Most trials of an evaluation.
MAX_TRIALS = 1_000_000
#: Most environments that step at once.
MAX_ENVS = 4096
#: 97.5 % quantile of the normal distribution.
_Z95 = 1.959963984540054


def wilson(succeeded: int, trials: int, z: float = _Z95) -> tuple[float, float]:
    """Wilson score interval of a rate.

    Parameters
    ----------
    succeeded, trials : int
        Number of successes, and of independent trials; at least one trial.
    z : float
        Quantile of the normal distribution; by default that of a 95 % interval.

    Raises
    ------
    ConfigError
        If there is no trial, or there are more successes than trials.

    Notes
    -----
    Source: Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927.
    """
    if trials < 1 or not 0 <= succeeded <= trials:
        raise ConfigError(f"{succeeded} of {trials} trials succeeded; give at least one trial and no more successes")
    rate, weight = succeeded / trials, z * z / trials
    center = (rate + weight / 2) / (1 + weight)
    half = z / (1 + weight) * np.sqrt(rate * (1 - rate) / trials + weight / (4 * trials))
    # Exact where the formula only comes within rounding.
    low = 0.0 if succeeded == 0 else float(center - half)
    high = 1.0 if succeeded == trials else float(center + half)
    return low, high


def trial_seeds(seed: int, trials: int) -> list[int]:
    """Seeds of the trials of an evaluation; the first ones are the same for any number of trials.

    Each is below 2^53, so that JSON holds it, and ``env.reset(seed=...)`` begins that trial again.
    """
    words = np.random.SeedSequence(seed).generate_state(trials, np.uint64)
    return [int(word) >> 11 for word in words]


@dataclass(frozen=True)
class TrialResult:
    """One trial.

    Attributes
    ----------
    seed : int
        Seed of its episode.
    object : str
        Name of its object.
    success, secure : bool
        As `graspbox.simulation` defines them; a secure grasp is a success too.
    failure : str
        Kind of the failure; empty for a success.
    steps : int
        Actions taken.
    reward : float
        Sum of the rewards.
    """

    seed: int
    object: str
    success: bool
    secure: bool
    failure: str
    steps: int
    reward: float


@dataclass(frozen=True)
class ObjectCount:
    """Counts of one object: its name, its trials, and how many of them succeeded and were secure."""

    name: str
    trials: int
    succeeded: int
    secure: int


@dataclass(frozen=True)
class Evaluation:
    """Result of an evaluation; two are equal if their trials are.

    Attributes
    ----------
    policy : str
        Name of the policy.
    env_id : str
        Id of the environment.
    trials : tuple of TrialResult
        In the order of `trial_seeds`.
    ms_per_decision : float
        Wall time of the policy per action, milliseconds; the simulation is not included.
    """

    policy: str
    env_id: str
    trials: tuple[TrialResult, ...]
    ms_per_decision: float = field(compare=False)

    @property
    def succeeded(self) -> int:
        """Number of trials that succeeded."""
        return sum(trial.success for trial in self.trials)

    @property
    def secure(self) -> int:
        """Number of trials that ended with a secure grasp."""
        return sum(trial.secure for trial in self.trials)

    @property
    def rate(self) -> float:
        """Share of trials that succeeded."""
        return self.succeeded / len(self.trials)

    @property
    def ci95(self) -> tuple[float, float]:
        """Wilson 95 % interval of `rate`."""
        return wilson(self.succeeded, len(self.trials))

    @property
    def secure_ci95(self) -> tuple[float, float]:
        """Wilson 95 % interval of the share of secure trials."""
        return wilson(self.secure, len(self.trials))

    @property
    def failures(self) -> dict[str, int]:
        """Number of failures by kind, in alphabetical order."""
        kinds = sorted(trial.failure for trial in self.trials if not trial.success)
        return {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}

    @property
    def objects(self) -> tuple[ObjectCount, ...]:
        """Counts of every object that was drawn, in alphabetical order."""
        rows: dict[str, list[TrialResult]] = {}
        for trial in self.trials:
            rows.setdefault(trial.object, []).append(trial)
        return tuple(
            ObjectCount(name, len(found), sum(t.success for t in found), sum(t.secure for t in found))
            for name, found in sorted(rows.items())
        )

    def to_json(self) -> dict[str, Any]:
        """Plain values, as ``graspbox evaluate --json`` prints them."""
        return {
            "policy": self.policy,
            "trials": len(self.trials),
            "succeeded": self.succeeded,
            "secure": self.secure,
            "rate": self.rate,
            "ci95": list(self.ci95),
            "objects": [{"name": o.name, "trials": o.trials, "succeeded": o.succeeded} for o in self.objects],
            "ms_per_decision": self.ms_per_decision,
        }


def evaluate(
    policy: Policy | str,
    env_id: str = "graspbox/GraspPose-v0",
    objects: ObjectsArgument = "procedural",
    trials: SupportsIndex = 200,
    seed: SupportsIndex = 0,
    *,
    split: object_sets.Split | None = None,
    num_envs: SupportsIndex = 16,
    progress: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> Evaluation:
    """Evaluate a policy on seeded trials; the same seed gives the same trials, whatever `num_envs` is.

    Parameters
    ----------
    policy : Policy or str
        A policy, or a name that `graspbox.policies.load` takes.
    env_id : str
        One of `graspbox.envs.IDS`.
    objects : str, Path, ObjectSet or sequence of str
        Object sets, from which each trial draws one object: see `graspbox.object_sets`.
    trials : int
        Number of trials, 1 to `MAX_TRIALS`.
    seed : int
        Determines the seeds of the trials (`trial_seeds`); at least 0.
    split : {"train", "validation", "test"}, optional
        Draw from this split only.
    num_envs : int
        Environments that step at once, 1 to `MAX_ENVS`.
    progress : callable
        Called with the number of finished trials.
    **settings
        Other keywords of the environment. ``obs`` is by default what the policy observes.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError
        If an argument cannot be used.
    MeshError, FileError, SimulationError
        If an object cannot be read or simulated.
    """
    chosen = policies.load(policy) if isinstance(policy, str) else policy
    count = _whole("trials", trials, 1, MAX_TRIALS)
    seeds = trial_seeds(_whole("seed", seed, 0, 2**64 - 1), count)
    width = min(_whole("num_envs", num_envs, 1, MAX_ENVS), count)
    if env_id.removeprefix("graspbox:") not in IDS:
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join(IDS)}")
    if chosen.obs is not None:
        settings.setdefault("obs", chosen.obs)
    envs = gymnasium.make_vec(
        env_id, width, objects=objects, split=split, autoreset_mode=AutoresetMode.DISABLED, **settings
    )
    try:
        chosen.bind(Task.of(envs))
        return run_trials(chosen, envs, seeds, progress=progress)
    finally:
        envs.close()


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
    if not seeds:
        raise ConfigError("there are no seeds; give one for each trial")
    if envs.metadata.get("autoreset_mode") != AutoresetMode.DISABLED:
        raise ConfigError("trials begin by an explicit reset; make the environments with autoreset_mode='Disabled'")
    if policy.task.num_envs != envs.num_envs:
        raise ConfigError(f"the policy is bound to {policy.task.num_envs} environments, these are {envs.num_envs}")
    run = _Run(policy, envs, seeds)
    results: dict[int, TrialResult] = {}
    for trial, result in run.results():
        results[trial] = result
        progress(len(results))
    ordered = tuple(results[trial] for trial in range(len(seeds)))
    return Evaluation(policy.name, policy.task.env_id, ordered, 1e3 * run.seconds / run.decisions)


class _Run:
    """Trials in progress: the environments take the next trial whenever they are free."""

    def __init__(self, policy: Policy, envs: VectorEnv[Any, Any, Any], seeds: Sequence[int]) -> None:
        self._policy, self._seeds = policy, seeds
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
        """Run all trials; gives each with its number when it ends."""
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
        )


def _scatter(old: Any, new: Any, rows: NDArray[np.intp]) -> Any:
    """Replace some rows of an observation, an array or a dictionary of arrays; gives a new one."""
    if isinstance(old, dict):
        return {name: _scatter(values, new[name], rows) for name, values in old.items()}
    replaced = old.copy()
    replaced[rows] = new
    return replaced


def _whole(name: str, value: Any, low: int, high: int) -> int:
    """Check a whole number; numpy's are whole numbers too."""
    try:
        found = operator.index(value)
    except TypeError:
        raise ConfigError(f"{name} is {value!r}; give a whole number") from None
    if not low <= found <= high:
        raise ConfigError(f"{name} is {found}; it must be between {low} and {high}")
    return found
