"""Recording: a policy acts in many environments at once, and what is worth imitating goes to the disk."""

import json
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, SupportsIndex

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from graspbox import _core, object_sets, policies
from graspbox.arguments import natural
from graspbox.demonstrations.store import Demonstrations, Episode, EpisodeSteps, Store
from graspbox.envs import IDS
from graspbox.envs.settings import ObjectsArgument
from graspbox.errors import ConfigError
from graspbox.evaluation.results import TrialResult
from graspbox.evaluation.trials import Steps, TrialRun, trial_seeds
from graspbox.files import locked
from graspbox.policies import Actions, Policy, Task
from graspbox.policies.goals import GOAL_NAME, Goals, goal_space

__all__ = ["KEEP", "record"]

#: Which episodes are kept: secure successes, all successes, or all episodes.
KEEP: dict[str, Callable[[TrialResult], bool]] = {
    "secure": lambda result: result.secure,
    "success": lambda result: result.success,
    "all": lambda result: True,
}
#: Recording gives up after this many trials, and this many for each wanted episode.
_TRIALS, _TRIALS_EACH = 100, 20
#: Trials whose seeds are made at a time.
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
    noise: float = 0.0,
    split: object_sets.Split | None = None,
    num_envs: SupportsIndex = 32,
    file_episodes: SupportsIndex = 64,
    progress: Callable[[int, int], None] = lambda kept, trials: None,
    **settings: Any,
) -> Demonstrations:
    """Record episodes of a policy, until a number of them are worth keeping.

    The trials are those of `graspbox.evaluation.trial_seeds`, one after the other; kept episodes are stored in their
    order. A folder with fewer episodes is continued after its last trial.

    Parameters
    ----------
    policy : Policy or str
        A policy, or a name that `graspbox.policies.load` takes, such as ``expert`` or ``planner``.
    out : str or Path
        The folder.
    env_id : str
        One of `graspbox.envs.IDS`.
    objects : str, Path, ObjectSet or sequence of str
        Object sets to sample from: see `graspbox.object_sets`.
    episodes : int
        Number of episodes to keep.
    obs : str or sequence of str
        Observations to record; what the policy itself observes need not be among them. ``"goal"``, beside others, is
        the grasp that the policy found, if it finds one in a depth image, and is given by the name of its folder: see
        `graspbox.policies.goals`. The policy looks when it has moved the hand out of the image, which may be a step
        later than a policy that observes goals does.
    seed : int
        Determines the seeds of the trials.
    keep : {"secure", "success", "all"}
        Which episodes are kept.
    noise : float
        Standard deviation of what is added to the actions before they are carried out, in shares of an action, at most
        1; what is recorded are the policy's own actions. A clone then learns how to come back where it errs (Laskey,
        Lee, Fox, Dragan, Goldberg, "DART: noise injection for robust imitation learning", 2017).
    split : {"train", "validation", "test"}, optional
        Sample objects from this split only.
    num_envs : int
        Environments that step at once; the episodes do not depend on it.
    file_episodes : int
        Episodes of a file: what is held in memory, and what an interruption loses.
    progress : callable
        Called with the number of episodes that are kept, and that of trials.
    **settings
        Other keywords of the environment, of plain values.

    Returns
    -------
    Demonstrations
        All of the folder; at least `episodes`.

    Raises
    ------
    ConfigError
        If an argument cannot be used, the folder was begun with other settings, another process is writing into it, or
        too few trials are worth keeping.
    MissingExtraError
        Without pyarrow.
    """
    chosen = policies.load(policy) if isinstance(policy, str) else policy
    if keep not in KEEP:
        raise ConfigError(f"keep is {keep!r}; choose from {', '.join(KEEP)}")
    if not 0.0 <= noise <= 1.0:
        raise ConfigError(f"noise is {noise}; give a number between 0 and 1")
    wanted, width, per_file = (
        _positive(name, value)
        for name, value in (("episodes", episodes), ("num_envs", num_envs), ("file_episodes", file_episodes))
    )
    names = (obs,) if isinstance(obs, str) else tuple(dict.fromkeys(obs))
    kwargs = {**chosen.settings, **settings, "objects": objects, "split": split}
    goals = Goals(chosen) if GOAL_NAME in names else None
    if goals is not None and not isinstance(policy, str):
        raise ConfigError(
            "obs has 'goal', and policy is an object; give its name or folder, so that a clone can load it"
        )
    described = {
        **_describe(env_id, names, kwargs),
        "policy": chosen.name,
        **({} if goals is None else {"goal_from": policy}),
        "keep": keep,
        "noise": float(noise),
        "seed": natural(seed, "seed", bits=64),
        "file_episodes": per_file,
        "versions": {"graspbox": _core.__version__, "numpy": version("numpy"), "pyarrow": version("pyarrow")},
    }
    with locked(Path(out)):
        store, done = Store(Path(out), described), Demonstrations(out)
        if len(done.episodes) < wanted:
            needed = (chosen.obs,) if isinstance(chosen.obs, str) else tuple(chosen.obs or ())
            together = tuple(name for name in dict.fromkeys([*names, *needed]) if name != GOAL_NAME)
            envs = gymnasium.make_vec(env_id, width, obs=together, autoreset_mode=AutoresetMode.DISABLED, **kwargs)
            try:
                noisy = _Noisy(chosen, noise, goals)
                noisy.bind(Task.of(envs))
                _Recording(noisy, envs, names, store, wanted, KEEP[keep]).run(described, done, progress)
            finally:
                envs.close()
        return Demonstrations(out)


def _positive(name: str, value: SupportsIndex) -> int:
    found = natural(value, name)
    if found < 1:
        raise ConfigError(f"{name} is {found}; give 1 or more")
    return found


def _describe(env_id: str, names: tuple[str, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Describe the environment and its spaces in plain JSON values."""
    if env_id.removeprefix("graspbox:") not in IDS:
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join(IDS)}")
    plain = tuple(name for name in names if name != GOAL_NAME)
    if not plain:
        raise ConfigError(f"obs is {names or 'empty'}; name at least one observation of the environment")
    env = gymnasium.make(env_id, obs=plain, **kwargs)
    try:
        spaces = {**env.observation_space.spaces, GOAL_NAME: goal_space()}  # type: ignore[attr-defined]
        assert env.spec is not None
        spec = json.loads(env.spec.to_json())
        fps = env.metadata["render_fps"]
    except TypeError as error:
        raise ConfigError(
            f"the environment cannot be written as JSON ({error}); give objects and hand by their names"
        ) from None
    finally:
        env.close()
    observations = {name: {"shape": list(spaces[name].shape), "dtype": str(spaces[name].dtype)} for name in names}
    assert env.action_space.shape is not None
    size = env.action_space.shape[0]
    return {"env_id": env.spec.id, "env_spec": spec, "observations": observations, "action_size": size, "fps": fps}


class _Noisy(Policy):
    """Adds noise to the actions of a policy, and remembers what they were."""

    def __init__(self, policy: Policy, noise: float, goals: Goals | None) -> None:
        self._policy, self._noise, self._goals = policy, noise, goals
        self.name, self.obs, self.settings = policy.name, policy.obs, policy.settings

    def _bind(self, task: Task) -> None:
        (self._goals or self._policy).bind(task)
        self._shown: dict[str, Any] = {}
        self._streams = [np.random.default_rng(0) for _ in range(task.num_envs)]
        self.chosen = self._zeros()

    def reset(self, seed: Any = None, *, mask: Any = None, info: Any = None) -> None:
        """Begin episodes, and the noise of each with its seed."""
        self._policy.reset(seed, mask=mask, info=info)
        super().reset(seed, mask=mask, info=info)

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del info
        self._streams[env] = np.random.default_rng(seed)

    def act(self, observation: Any) -> Actions:
        """Act as the policy does, with noise."""
        chosen: Actions = np.clip(self._policy.act(observation), -1.0, 1.0)
        self.chosen = chosen
        if self._goals is not None:
            self._shown = {GOAL_NAME: self._goals.show(observation["proprio"])}
        if not self._noise:
            return chosen
        noise = np.stack([stream.normal(0.0, self._noise, chosen.shape[1]) for stream in self._streams])
        disturbed: Actions = np.clip(chosen + noise, -1.0, 1.0).astype(np.float32)
        return disturbed

    def before(self, name: str, steps: Steps, row: int) -> Any:
        """Give what was observed before a step."""
        return self._shown[name][steps.env[row]] if name in self._shown else steps.observation[name][row]

    def after(self, name: str, steps: Steps, row: int) -> Any:
        """Give what was observed after the last step of an episode."""
        if name in self._shown and self._goals is not None:
            return self._goals.after(int(steps.env[row]), steps.following["proprio"][row])
        return steps.following[name][row]


class _Recording:
    """Episodes in progress, and finished ones that wait for those of earlier trials."""

    def __init__(
        self,
        policy: _Noisy,
        envs: Any,
        names: tuple[str, ...],
        store: Store,
        wanted: int,
        worth: Callable[[TrialResult], bool],
    ) -> None:
        self._policy, self._envs, self._names, self._store = policy, envs, names, store
        self._wanted, self._worth = wanted, worth
        #: Steps of the trials in progress: observations, action, reward, ends, by index of the trial.
        self._open: dict[int, list[tuple[Any, ...]]] = {}
        #: Trials that ended before an earlier one; None where the episode is not kept.
        self._waiting: dict[int, EpisodeSteps | None] = {}

    def run(self, described: dict[str, Any], done: Demonstrations, progress: Callable[[int, int], None]) -> None:
        """Run trials until enough episodes are kept."""
        per_file, kept, trial = described["file_episodes"], len(done.episodes), done.trials
        most = _TRIALS + _TRIALS_EACH * self._wanted
        unwritten: list[EpisodeSteps] = []
        while kept < self._wanted:
            if trial >= most:
                raise ConfigError(
                    f"{kept} of {trial} trials were worth keeping (keep={described['keep']!r}), {self._wanted} are "
                    "wanted; keep others too, or record other objects"
                )
            first, last = trial, min(trial + _BLOCK, most)
            seeds = trial_seeds(described["seed"], last)[first:]
            run = TrialRun(self._policy, self._envs, seeds, self._watch)
            for index, result in run.results():
                self._waiting[first + index] = self._finish(first + index, index, result)
                while trial in self._waiting and kept < self._wanted:
                    episode = self._waiting.pop(trial)
                    trial += 1
                    if episode is not None:
                        kept += 1
                        unwritten.append(episode)
                    if len(unwritten) == per_file:
                        self._store.append(unwritten, trial)
                        unwritten = []
                progress(kept, trial)
                if kept >= self._wanted:
                    break
        if unwritten:
            self._store.append(unwritten, trial)

    def _watch(self, steps: Steps) -> None:
        for row, trial in enumerate(steps.trial.tolist()):
            seen = {name: self._policy.before(name, steps, row) for name in self._names}
            ended = bool(steps.terminated[row] | steps.truncated[row])
            last = {name: self._policy.after(name, steps, row) for name in self._names} if ended else None
            action = self._policy.chosen[steps.env[row]]
            ends = bool(steps.terminated[row]), bool(steps.truncated[row])
            self._open.setdefault(trial, []).append((seen, action, float(steps.reward[row]), *ends, last))

    def _finish(self, trial: int, index: int, result: TrialResult) -> EpisodeSteps | None:
        rows = self._open.pop(index)
        if not self._worth(result):
            return None
        seen, actions, rewards, terminated, truncated, last = zip(*rows, strict=True)
        observations = {name: np.stack([*(one[name] for one in seen), last[-1][name]]) for name in self._names}
        facts = (result.object, result.success, result.secure, result.steps, result.reward)
        episode = Episode(trial, result.seed, *facts)
        ends = np.array(terminated), np.array(truncated)
        return EpisodeSteps(episode, observations, np.stack(actions), np.array(rewards), *ends)
