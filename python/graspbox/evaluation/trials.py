"""Runs seeded trials in environments, one episode each."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.refusals import reason
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation.results import Evaluation, TrialResult
from graspbox.object_sets import ObjectSet
from graspbox.policies import Actions, Policy

__all__ = ["Refusals", "Steps", "TrialRun", "run_trials", "run_usable", "trial_seeds"]

#: Greatest number of seeds that are tried if objects cannot be used: the first number, plus the second for each
#: requested trial.
_SPARE, _SPARE_EACH = 100, 20


def trial_seeds(seed: int, trials: int) -> list[int]:
    """Seeds of the trials of an evaluation; the first ones are the same for any number of trials.

    Each is below 2^53, so that JSON can represent it, and ``env.reset(seed=...)`` reproduces that trial.
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
        If there are no seeds, the environments reset automatically, or the policy is bound to others.
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


class Refusals:
    """Objects that trials could not use, with the reason for each by name.

    `names` are those of all objects that the environments sample from; reasons name the files of `objects`, which are
    absent for a server's.
    """

    def __init__(self, names: Sequence[str], objects: ObjectSet | None = None) -> None:
        self._names, self._objects = set(names), objects or ()
        self.reasons: dict[str, str] = {}

    def add(self, error: GraspboxError) -> None:
        """Record an object, which `GraspboxError.object` names."""
        assert error.object is not None
        if error.object not in self.reasons:
            paths = (spec.path for spec in self._objects if spec.name == error.object)
            self.reasons[error.object] = reason(error, next(paths, None))

    @property
    def all(self) -> bool:
        """Whether no object of the set can be used."""
        return self._names <= set(self.reasons)


def run_usable(
    policy: Policy,
    envs: VectorEnv[Any, Any, Any],
    trials: int,
    seed: int,
    *,
    progress: Callable[[int], None] = lambda _: None,
) -> Evaluation:
    """Run trials of usable objects: a further seed replaces a trial whose object cannot be used.

    The seeds are those of `trial_seeds`, in order. If almost no object can be used there are fewer trials:
    ``100 + 20 * trials`` seeds are tried; and none if no object can be used. Other parameters and errors are those of
    `run_trials`.
    """
    results: dict[int, TrialResult] = {}
    native: Any = envs.unwrapped
    # The objects of a server need not be on this machine.
    refusals = Refusals(native.object_names, None if native.is_remote else native.objects)
    first, seconds, decisions = 0, 0.0, 0
    while len(results) < trials and first < _SPARE + _SPARE_EACH * trials and not refusals.all:
        last = first + trials - len(results)
        run = TrialRun(policy, envs, trial_seeds(seed, last)[first:], refused=lambda _, error: refusals.add(error))
        for index, result in run.results():
            results[first + index] = result
            progress(len(results))
        # An object refused in some of its trials is left out of all.
        results = {trial: result for trial, result in results.items() if result.object not in refusals.reasons}
        first, seconds, decisions = last, seconds + run.seconds, decisions + run.decisions
    ordered = tuple(results[trial] for trial in sorted(results))
    pace = 1e3 * seconds / decisions if decisions else 0.0
    return Evaluation(policy.name, policy.task.env_id, ordered, pace, refused=dict(sorted(refusals.reasons.items())))


@dataclass(frozen=True)
class Steps:
    """One step of some trials; each row is one trial.

    Attributes
    ----------
    trial, env : (rows,) int64
        Index of the trial in the list of seeds, and of its environment.
    observation, following : (rows, ...) array, or mapping of them
        The policy's observation before the action, and the one after it.
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
    """Trials in progress: each free environment takes the next trial.

    Parameters and errors are those of `run_trials`, and:

    watch : callable, optional
        Called with every step of every trial (`Steps`), before the results of the trials that it ends.
    refused : callable, optional
        Called with the index of each trial whose object cannot be used, and the error, which names the object; by
        default, and with several objects in a scene, the error is raised.
    """

    def __init__(
        self,
        policy: Policy,
        envs: VectorEnv[Any, Any, Any],
        seeds: Sequence[int],
        watch: Callable[[Steps], None] | None = None,
        refused: Callable[[int, GraspboxError], None] | None = None,
    ) -> None:
        if not seeds:
            raise ConfigError("there are no seeds; pass one for each trial")
        if envs.metadata.get("autoreset_mode") != AutoresetMode.DISABLED:
            raise ConfigError("trials begin by an explicit reset; make the environments with autoreset_mode='Disabled'")
        if policy.task.num_envs != envs.num_envs:
            raise ConfigError(f"the policy is bound to {policy.task.num_envs} environments, these are {envs.num_envs}")
        # A seed does not determine the objects of a scene of several: an unusable one is an error there.
        refused = refused if policy.task.layout == "single" else None
        self._policy, self._seeds, self._watch, self._refused = policy, seeds, watch, refused
        # Gymnasium's class declares neither seeds per environment nor send and recv.
        self._native: Any = envs.unwrapped
        self.seconds, self.decisions = 0.0, 0
        self._next = 0
        #: Object of each trial, if it can be left out; errors of unusable objects, by name.
        names = envs.unwrapped.object_names  # type: ignore[attr-defined]
        self._sampled = [] if refused is None else [names[i] for i in _core.sampled_objects(seeds, len(names))]
        self._errors: dict[str, GraspboxError] = {}
        #: Trial of each environment; -1 once all trials are taken.
        self._trial = np.full(envs.num_envs, -1)
        #: Environments with an episode; the others can only be reset.
        self._begun = np.zeros(envs.num_envs, dtype=np.bool_)
        self._objects = [""] * envs.num_envs
        self._steps = np.zeros(envs.num_envs, dtype=np.int64)
        self._rewards = np.zeros(envs.num_envs)
        self._observation: Any = None

    def results(self) -> Iterator[tuple[int, TrialResult]]:
        """Run all trials; yields each with its index when it ends."""
        while True:
            self._begin()
            active = np.flatnonzero(self._trial >= 0)
            if not len(active):
                return
            began = time.perf_counter()
            actions = self._policy.act(self._observation)
            self.seconds += time.perf_counter() - began
            self.decisions += len(active)
            yield from self._advance(actions[active], active)

    def _begin(self) -> None:
        """Begin trials in the free environments while any are left."""
        begin: dict[int, int] = {}
        while True:
            for env in np.flatnonzero(self._trial < 0).tolist():
                if env not in begin and (trial := self._following()) is not None:
                    begin[env] = trial
            if not begin:
                return
            try:
                state = self._reset(begin)
            except GraspboxError as error:
                if self._refused is None or error.object is None:
                    raise
                self._errors[error.object] = error
                unusable = [env for env, trial in begin.items() if self._sampled[trial] == error.object]
                if not unusable:
                    raise
                for env in unusable:
                    self._refused(begin.pop(env), error)
            else:
                self._take(begin, *state)
                begin = {}

    def _following(self) -> int | None:
        """Return the next trial whose object is not known to be unusable; reports the skipped ones."""
        while self._next < len(self._seeds):
            trial, self._next = self._next, self._next + 1
            if self._refused is None or self._sampled[trial] not in self._errors:
                return trial
            self._refused(trial, self._errors[self._sampled[trial]])
        return None

    def _reset(self, begin: Mapping[int, int]) -> tuple[Any, dict[str, Any]]:
        """Reset environments for trials, by their index; a repeated call gives the same result."""
        # Environments without an episode begin one of these trials too; they would block the others.
        filler = self._seeds[next(iter(begin.values()))]
        seeds: list[int | None] = [None if begun else filler for begun in self._begun]
        mask = ~self._begun
        for env, trial in begin.items():
            seeds[env], mask[env] = self._seeds[trial], True
        state: tuple[Any, dict[str, Any]] = self._native.reset(seed=seeds, options={"reset_mask": mask})
        self._begun |= mask
        return state

    def _take(self, begin: Mapping[int, int], observation: Any, info: dict[str, Any]) -> None:
        """Record the trials that began, and inform the policy."""
        seeds: list[int | None] = [None] * self._native.num_envs
        mask = np.zeros(self._native.num_envs, dtype=np.bool_)
        for env, trial in begin.items():
            self._trial[env], seeds[env], mask[env] = trial, self._seeds[trial], True
            self._steps[env], self._rewards[env] = 0, 0.0
            if not isinstance(info["object"][env], str):
                raise ConfigError("the environments have info='numeric'; trials need the names of info='full'")
            self._objects[env] = info["object"][env]
        self._observation = observation
        self._policy.reset(seeds, mask=mask, info=info)

    def _advance(self, actions: Actions, active: NDArray[np.intp]) -> Iterator[tuple[int, TrialResult]]:
        """Step the environments with a trial in progress."""
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
            # Goal tasks have no grasp.
            secure=bool(info["is_secure"][row]) if "is_secure" in info else False,
            failure="" if success else str(info["failure"][row]) if "failure" in info else "goal_missed",
            steps=int(self._steps[env]),
            reward=float(self._rewards[env]),
            # Only in GraspPose-v0.
            survives_shake=bool(info["survives_shake"][row]) if "survives_shake" in info else False,
            fits=bool(info["fits"][row]),
            confidence=self._policy.confidence(env),
        )


def _rows(values: Any, rows: NDArray[np.intp]) -> Any:
    """Select rows of an observation, an array or a dictionary of arrays."""
    return {name: part[rows] for name, part in values.items()} if isinstance(values, dict) else values[rows]


def _scatter(old: Any, new: Any, rows: NDArray[np.intp]) -> Any:
    """Replace rows of an observation, an array or a dictionary of arrays; returns a copy."""
    if isinstance(old, dict):
        return {name: _scatter(values, new[name], rows) for name, values in old.items()}
    replaced = old.copy()
    replaced[rows] = new
    return replaced
