"""Recording: a policy acts in many environments in parallel, and the episodes worth imitating are written to disk."""

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, SupportsIndex

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from graspbox import object_sets, policies
from graspbox._common.arguments import natural
from graspbox._common.files import locked
from graspbox.data.episodes.manifest import Episode
from graspbox.data.episodes.store import Demonstrations, EpisodeSteps, Store
from graspbox.data.files import versions
from graspbox.envs import IDS
from graspbox.envs.settings import ObjectsArgument
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation.results import TrialResult
from graspbox.evaluation.trials import Refusals, Steps, TrialRun, trial_seeds
from graspbox.policies import Actions, Policy, Task

__all__ = ["KEEP", "record"]

#: Episodes to keep: secure successes, all successes, or all episodes.
KEEP: dict[str, Callable[[TrialResult], bool]] = {
    "secure": lambda result: result.secure,
    "success": lambda result: result.success,
    "all": lambda result: True,
}
#: Recording stops with an error after the first number of trials, plus the second for each requested episode.
_TRIALS, _TRIALS_EACH = 100, 20
#: Number of trials whose seeds are made at a time.
_BLOCK = 4096


def record(
    policy: Policy | str,
    out: str | Path,
    env_id: str = "graspbox/Grasp-v0",
    objects: ObjectsArgument = "procedural",
    episodes: SupportsIndex = 500,
    obs: str | Sequence[str] = ("state",),
    seed: SupportsIndex = 0,
    *,
    keep: str = "secure",
    acting: Policy | str | None = None,
    noise: float = 0.0,
    split: object_sets.Split | None = None,
    num_envs: SupportsIndex = 32,
    file_episodes: SupportsIndex = 64,
    progress: Callable[[int, int], None] = lambda kept, trials: None,
    **settings: Any,
) -> Demonstrations:
    """Record episodes of a policy, until a number of them are worth keeping.

    The trials are those of `graspbox.evaluation.trial_seeds`, one after the other; kept episodes are stored in their
    order. A folder with fewer episodes resumes after its last trial, and missing files are recorded again.
    Trials whose object cannot be read or simulated are left out: `Demonstrations.refused` names the objects.

    Parameters
    ----------
    policy : Policy or str
        A policy, or a name for `graspbox.policies.load`, such as ``expert`` or ``planner``.
    out : str or Path
        The folder.
    env_id : str
        One of `graspbox.envs.IDS`.
    objects : str, Path, ObjectSet or sequence of str
        Object sets to sample from: see `graspbox.object_sets`.
    episodes : int
        Number of episodes to keep.
    obs : str or sequence of str
        Observations to record; they need not include the policy's own.
    seed : int
        Determines the seeds of the trials.
    keep : {"secure", "success", "all"}
        Episodes to keep.
    acting : Policy or str, optional
        Executes the episodes instead of `policy`, whose actions are recorded: a clone then learns what to do where it
        goes itself (Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret
        online learning", 2011).
    noise : float
        Standard deviation of the noise on executed actions, as a share of the action range, at most 1; the recording
        holds the policy's own actions. A clone then learns to recover from its errors (Laskey, Lee, Fox, Dragan,
        Goldberg, "DART: noise injection for robust imitation learning", 2017).
    split : {"train", "validation", "test"}, optional
        Sample objects from this split only.
    num_envs : int
        Environments stepped in parallel; the episodes do not depend on it.
    file_episodes : int
        Episodes per file: kept in memory until written, and lost by an interruption.
    progress : callable
        Called with the number of kept episodes, and the number of trials.
    **settings
        Other keywords of the environment, plain values only.

    Returns
    -------
    Demonstrations
        All demonstrations of the folder; at least `episodes`.

    Raises
    ------
    ConfigError
        If an argument is invalid, the folder was begun with other settings, a file in it is damaged, another process is
        writing to it, or too few trials are worth keeping.
    MeshError, FileError, SimulationError
        If no object can be used.
    MissingExtraError
        Without pyarrow.
    """
    chosen = policies.load(policy) if isinstance(policy, str) else policy
    pupil = policies.load(acting) if isinstance(acting, str) else acting
    if keep not in KEEP:
        raise ConfigError(f"keep is {keep!r}; choose from {', '.join(KEEP)}")
    if not 0.0 <= noise <= 1.0:
        raise ConfigError(f"noise is {noise}; it must be between 0 and 1")
    wanted, width, per_file = (
        _positive(name, value)
        for name, value in (("episodes", episodes), ("num_envs", num_envs), ("file_episodes", file_episodes))
    )
    names = (obs,) if isinstance(obs, str) else tuple(dict.fromkeys(obs))
    kwargs = {**chosen.settings_in(env_id), **settings, "objects": objects, "split": split}
    described = {
        **_describe(env_id, names, kwargs),
        "policy": chosen.name,
        **({} if pupil is None else {"acting": pupil.name}),
        "keep": keep,
        "noise": float(noise),
        "seed": natural(seed, "seed", bits=64),
        "file_episodes": per_file,
        "versions": versions(),
    }
    with locked(Path(out)):
        store = Store(Path(out), described)
        if store.gaps or store.kept < wanted:
            needed = [_names(one.obs) for one in (chosen, pupil) if one is not None]
            shown = tuple(dict.fromkeys(chain(names, *needed)))
            envs = gymnasium.make_vec(env_id, width, obs=shown, autoreset_mode=AutoresetMode.DISABLED, **kwargs)
            try:
                noisy = _Noisy(chosen, noise, pupil)
                noisy.bind(Task.of(envs))
                _Recording(noisy, envs, names, store, wanted, KEEP[keep]).run(described, progress)
            finally:
                envs.close()
        return Demonstrations(out)


def _positive(name: str, value: SupportsIndex) -> int:
    count = natural(value, name)
    if count < 1:
        raise ConfigError(f"{name} is {count}; it must be 1 or more")
    return count


def _describe(env_id: str, names: tuple[str, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Describe the environment and its spaces in plain JSON values."""
    if env_id.removeprefix("graspbox:") not in IDS:
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join(IDS)}")
    if not names:
        raise ConfigError("obs is empty; name at least one observation of the environment")
    env = gymnasium.make(env_id, obs=names, **kwargs)
    try:
        spaces = env.observation_space.spaces  # type: ignore[attr-defined]
        assert env.spec is not None
        spec = json.loads(env.spec.to_json())
        fps = env.metadata["render_fps"]
    except TypeError as error:
        raise ConfigError(
            f"the environment cannot be written as JSON ({error}); name objects and hand instead"
        ) from None
    finally:
        env.close()
    observations = {name: {"shape": list(spaces[name].shape), "dtype": str(spaces[name].dtype)} for name in names}
    assert env.action_space.shape is not None
    size = env.action_space.shape[0]
    return {"env_id": env.spec.id, "env_spec": spec, "observations": observations, "action_size": size, "fps": fps}


def _names(obs: str | Sequence[str] | None) -> tuple[str, ...]:
    return (obs,) if isinstance(obs, str) else tuple(obs or ())


class _Noisy(Policy):
    """Stores the actions of a policy; executes them, or those of another one that is `acting`, with noise."""

    def __init__(self, policy: Policy, noise: float, acting: Policy | None) -> None:
        self._policy, self._noise, self._acting = policy, noise, acting
        self.name, self.obs = policy.name, policy.obs

    def _bind(self, task: Task) -> None:
        self._policy.bind(task)
        if self._acting is not None:
            self._acting.bind(task)
        self._streams = [np.random.default_rng(0) for _ in range(task.num_envs)]
        self.chosen = self._zeros()

    def reset(self, seed: Any = None, *, mask: Any = None, info: Any = None) -> None:
        """Begin episodes, and seed the noise of each."""
        self._policy.reset(seed, mask=mask, info=info)
        if self._acting is not None:
            self._acting.reset(seed, mask=mask, info=info)
        super().reset(seed, mask=mask, info=info)

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del info
        self._streams[env] = np.random.default_rng(seed)

    def act(self, observation: Any) -> Actions:
        """Act with noise."""
        chosen: Actions = np.clip(self._policy.act(observation), -1.0, 1.0)
        self.chosen = chosen
        if self._acting is not None:
            chosen = np.clip(self._acting.act(observation), -1.0, 1.0)
        if not self._noise:
            return chosen
        noise = np.stack([stream.normal(0.0, self._noise, chosen.shape[1]) for stream in self._streams])
        disturbed: Actions = np.clip(chosen + noise, -1.0, 1.0).astype(np.float32)
        return disturbed


class _Recording:
    """Episodes in progress, and finished ones that wait for earlier trials."""

    def __init__(
        self,
        policy: _Noisy,
        envs: Any,
        names: tuple[str, ...],
        store: Store,
        wanted: int,
        is_kept: Callable[[TrialResult], bool],
    ) -> None:
        self._policy, self._envs, self._names, self._store = policy, envs, names, store
        self._wanted, self._is_kept = wanted, is_kept
        self._refusals = Refusals(policy.task.objects.names, policy.task.objects)
        #: Steps of the trials in progress: observations, action, reward, ends, by index of the trial.
        self._open: dict[int, list[tuple[Any, ...]]] = {}
        #: Trials that ended before an earlier one; None if the episode is not kept.
        self._waiting: dict[int, EpisodeSteps | GraspboxError | None] = {}

    def run(self, described: dict[str, Any], progress: Callable[[int, int], None]) -> None:
        """Run trials until enough episodes are kept; those of missing files come first."""
        store, seed = self._store, described["seed"]
        for first, last in store.gaps:
            store.fill(first, [episode for _, episode in self._in_order(seed, first, last) if episode is not None])
        kept, most = store.kept, _TRIALS + _TRIALS_EACH * self._wanted
        if kept >= self._wanted:
            return
        unwritten: list[EpisodeSteps] = []
        for trial, episode in self._in_order(seed, store.next_trial, most):
            if episode is not None:
                kept += 1
                unwritten.append(episode)
            if len(unwritten) == described["file_episodes"] or (unwritten and kept >= self._wanted):
                store.append(unwritten, trial + 1)
                unwritten = []
            progress(kept, trial + 1)
            if kept >= self._wanted:
                return
        raise ConfigError(
            f"{kept} of {most} trials were worth keeping (keep={described['keep']!r}), {self._wanted} are wanted; keep "
            "others too, or record other objects"
        )

    def _in_order(self, seed: int, first: int, last: int) -> Iterator[tuple[int, EpisodeSteps | None]]:
        """Run the trials from `first` to the one before `last`; yields each in order, with its episode if kept."""
        self._open, self._waiting = {}, {}
        trial = first
        for begin in range(first, last, _BLOCK):
            end = min(begin + _BLOCK, last)
            refused = partial(self._refused, begin)
            run = TrialRun(self._policy, self._envs, trial_seeds(seed, end)[begin:], self._watch, refused)
            results: Iterator[tuple[int, TrialResult] | None] = chain(run.results(), [None])
            for ended in results:
                if ended is not None:
                    index, result = ended
                    self._waiting[begin + index] = self._finish(begin + index, index, result)
                while trial in self._waiting:
                    yield trial, self._taken(trial)
                    trial += 1

    def _refused(self, begin: int, index: int, error: GraspboxError) -> None:
        self._waiting[begin + index] = error

    def _taken(self, trial: int) -> EpisodeSteps | None:
        """Take the trial that is next in order."""
        ended = self._waiting.pop(trial)
        if not isinstance(ended, GraspboxError):
            return ended
        self._refusals.add(ended)
        self._store.refused |= self._refusals.reasons
        if self._refusals.all:
            raise ended
        return None

    def _watch(self, steps: Steps) -> None:
        for row, trial in enumerate(steps.trial.tolist()):
            seen = {name: steps.observation[name][row] for name in self._names}
            ends = bool(steps.terminated[row]), bool(steps.truncated[row])
            last = {name: steps.following[name][row] for name in self._names} if any(ends) else None
            action = self._policy.chosen[steps.env[row]]
            self._open.setdefault(trial, []).append((seen, action, float(steps.reward[row]), *ends, last))

    def _finish(self, trial: int, index: int, result: TrialResult) -> EpisodeSteps | None:
        rows = self._open.pop(index)
        if not self._is_kept(result):
            return None
        seen, actions, rewards, terminated, truncated, last = zip(*rows, strict=True)
        observations = {name: np.stack([*(one[name] for one in seen), last[-1][name]]) for name in self._names}
        facts = (result.object, result.success, result.secure, result.steps, result.reward)
        episode = Episode(trial, result.seed, *facts)
        ends = np.array(terminated), np.array(truncated)
        return EpisodeSteps(episode, observations, np.stack(actions), np.array(rewards), *ends)
