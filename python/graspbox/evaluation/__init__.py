"""Measure a policy: success and security of a fixed set of seeded trials, with Wilson intervals.

>>> import graspbox
>>> result = graspbox.evaluation.evaluate("planner", "graspbox/GraspPose-v0", "procedural:can:0-9", trials=8, seed=0)
>>> result.succeeded, result.rate, [round(bound, 2) for bound in result.ci95]
(8, 1.0, [0.68, 1.0])

| name | what it is |
|---|---|
| `evaluate`    | makes the environments, runs the trials, counts |
| `Evaluation`  | the result: trials, counts, intervals |
| `run_trials`  | runs seeded trials in existing environments |
| `trial_seeds` | the seeds of the trials |
| `wilson`      | interval of a rate |

A trial is one episode with a seed of its own, which fixes object, pose, and what is random in the policy. All trials
run to their end, in whatever environment is free: neither the number of environments nor the length of an episode
changes what is counted.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, SupportsIndex

import gymnasium
from gymnasium.vector import AutoresetMode

from graspbox import learned_sets, object_sets, policies
from graspbox.arguments import natural
from graspbox.envs import IDS
from graspbox.envs.settings import ObjectsArgument
from graspbox.errors import ConfigError
from graspbox.evaluation.results import Evaluation, ObjectCount, TrialResult, wilson
from graspbox.evaluation.trials import run_trials, trial_seeds
from graspbox.policies import Policy, Task

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


def evaluate(
    policy: Policy | str,
    env_id: str | None = None,
    objects: ObjectsArgument = "procedural",
    trials: SupportsIndex = 200,
    seed: SupportsIndex = 0,
    *,
    split: object_sets.Split | None = None,
    include_learned: bool = False,
    num_envs: SupportsIndex = 16,
    progress: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> Evaluation:
    """Evaluate a policy on seeded trials; the same seed gives the same trials, whatever `num_envs` is.

    Objects from which the policy learned (`Policy.learned_from`) are left out.

    Parameters
    ----------
    policy : Policy or str
        A policy, or a name that `graspbox.policies.load` takes.
    env_id : str, optional
        One of `graspbox.envs.IDS`; by default the one that the policy acts in, else ``graspbox/GraspPose-v0``.
    objects : str, Path, ObjectSet or sequence of str
        Object sets, from which each trial samples one object: see `graspbox.object_sets`.
    trials : int
        Number of trials, 1 to `MAX_TRIALS`.
    seed : int
        Determines the seeds of the trials (`trial_seeds`); at least 0.
    split : {"train", "validation", "test"}, optional
        Sample from this split only.
    include_learned : bool
        Sample from objects from which the policy learned, too.
    num_envs : int
        Environments that step at once, 1 to `MAX_ENVS`.
    progress : callable
        Called with the number of finished trials.
    **settings
        Other keywords of the environment. ``obs`` is by default what the policy observes.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError
        If an argument cannot be used, or the policy learned from all objects.
    MeshError, FileError, SimulationError
        If an object cannot be read or simulated.
    """
    chosen = policies.load(policy) if isinstance(policy, str) else policy
    if not isinstance(chosen, policies.Policy):
        raise ConfigError(f"policy is a {type(policy).__name__}; give a graspbox.policies.Policy, or the name of one")
    count = _within("trials", trials, MAX_TRIALS)
    seeds = trial_seeds(natural(seed, "seed", bits=64), count)
    width = min(_within("num_envs", num_envs, MAX_ENVS), count)
    env_id = env_id or chosen.env_id or IDS[0]
    if env_id.removeprefix("graspbox:") not in IDS:
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join(IDS)}")
    if chosen.obs is not None:
        settings.setdefault("obs", chosen.obs)
    settings = {**chosen.settings, **settings}
    found = object_sets.load(objects, split=split)
    kept = found if include_learned else learned_sets.without(found, chosen.learned_from)
    if not kept:
        raise ConfigError(
            f"the policy {chosen.name!r} learned from all {len(found)} objects of {found.name!r}; name others, such as "
            "'procedural:unseen' or split='test', or give include_learned=True (--include-learned)"
        )
    envs = gymnasium.make_vec(env_id, width, objects=kept, autoreset_mode=AutoresetMode.DISABLED, **settings)
    try:
        chosen.bind(Task.of(envs))
        result = run_trials(chosen, envs, seeds, progress=progress)
        return replace(result, objects_given=len(found), objects_left_out=len(found) - len(kept))
    finally:
        envs.close()


def _within(name: str, value: Any, high: int) -> int:
    """Check a count, which is at least 1."""
    found = natural(value, name)
    if not 1 <= found <= high:
        raise ConfigError(f"{name} is {found}; it must be between 1 and {high}")
    return found
