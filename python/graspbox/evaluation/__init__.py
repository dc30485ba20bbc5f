"""Evaluation of policies: success and security on a fixed set of seeded trials, with Wilson intervals.

>>> import graspbox
>>> result = graspbox.evaluation.evaluate("planner", "graspbox/GraspPose-v0", "procedural:can:0-9", trials=8, seed=0)
>>> result.succeeded, result.rate, [round(bound, 2) for bound in result.ci95]
(8, 1.0, [0.68, 1.0])

A trial is one episode with its own seed, which determines object, pose, and the policy's random numbers. All trials
run to completion, in any free environment: neither the number of environments nor the length of an episode
changes the result.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, SupportsIndex

import gymnasium
from gymnasium.vector import AutoresetMode

from graspbox import object_sets, policies
from graspbox._common.arguments import natural, plain
from graspbox.envs import EVALUATED_IDS
from graspbox.envs.settings import ObjectsArgument
from graspbox.errors import ConfigError, MissingExtraError, ObjectSetError
from graspbox.evaluation.conditions import settings_of
from graspbox.evaluation.results import Evaluation, ObjectCount, TrialResult, wilson
from graspbox.evaluation.trials import run_trials, run_usable, trial_seeds
from graspbox.object_sets import learned_sets
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

#: Greatest number of trials of an evaluation.
MAX_TRIALS = 1_000_000
#: Greatest number of environments stepped in parallel.
MAX_ENVS = 4096


def evaluate(
    policy: Policy | str,
    env_id: str | None = None,
    objects: ObjectsArgument | None = None,
    trials: SupportsIndex = 200,
    seed: SupportsIndex = 0,
    *,
    scale: float = 1.0,
    mass: float | None = None,
    split: object_sets.Split | None = None,
    include_learned: bool = False,
    condition: str = "nominal",
    num_envs: SupportsIndex = 16,
    progress: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> Evaluation:
    """Evaluate a policy on seeded trials; the same seed gives the same trials for any `num_envs`.

    Training objects of the policy (`Policy.learned_from`) are left out, and so are objects that cannot be read or
    simulated: `Evaluation.refused` names them, and further seeds replace their trials. If no object is left, the result
    has no trial. With a `layout` of several objects a trial counts for its target, and an object that cannot be used is
    an error.

    Parameters
    ----------
    policy : Policy or str
        A policy, or a name for `graspbox.policies.load`.
    env_id : str, optional
        One of `graspbox.envs.EVALUATED_IDS`; by default the policy's own, else ``graspbox/GraspPose-v0``.
    objects : str, Path, ObjectSet or sequence of str, optional
        Object sets, from which each trial samples one object: see `graspbox.object_sets`. With ``remote`` those that
        the server offers. By default those of `Policy.held_out`, else ``procedural``.
    trials : int
        Number of trials, 1 to `MAX_TRIALS`.
    seed : int
        Determines the seeds of the trials (`trial_seeds`); at least 0.
    scale, mass : float
        As for `graspbox.object_sets.load`.
    split : {"train", "validation", "test"}, optional
        Sample from this split only.
    include_learned : bool
        Also sample training objects of the policy.
    condition : str
        Variation of the trials: a name in `graspbox.evaluation.conditions.CONDITIONS`.
    num_envs : int
        Environments stepped in parallel, 1 to `MAX_ENVS`.
    progress : callable
        Called with the number of finished trials.
    **settings
        Other keywords of the environment. ``obs`` is by default the policy's observation.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError
        If an argument is invalid, or all objects are training objects of the policy.
    """
    chosen = policies.load(policy) if isinstance(policy, str) else policy
    if not isinstance(chosen, policies.Policy):
        raise ConfigError(f"policy is a {type(policy).__name__}; pass a graspbox.policies.Policy, or the name of one")
    count = _within("trials", trials, MAX_TRIALS)
    first = natural(seed, "seed", bits=64)
    width = min(_within("num_envs", num_envs, MAX_ENVS), count)
    env_id = env_id or chosen.env_id or EVALUATED_IDS[0]
    if env_id.removeprefix("graspbox:") not in EVALUATED_IDS:
        raise ConfigError(f"there is no environment {env_id!r}; choose from {', '.join(EVALUATED_IDS)}")
    changed = settings_of(condition, env_id.removeprefix("graspbox:"))
    if twice := [name for name in changed if name in settings]:
        raise ConfigError(f"{twice[0]} is set, and the condition {condition!r} sets it too; leave one of them out")
    if objects is None:
        objects, split = chosen.default_objects(split)
    obs = chosen.needed_obs(target=settings.get("layout", "single") != "single")
    if obs is not None:
        settings.setdefault("obs", obs)
    settings = {"scale": scale, "mass": mass, "split": split, **chosen.settings_in(env_id), **changed, **settings}
    learned_from = () if include_learned else chosen.learned_from
    left_out = 0
    if settings.get("remote") is None or learned_from:
        every = _load_objects(objects, settings)
        objects = learned_sets.without(every, learned_from)
        left_out = len(every) - len(objects)
        if not objects:
            raise ConfigError(
                f"the policy {chosen.name!r} learned from all {len(every)} objects of {every.name!r}; name others, "
                "such as 'procedural:unseen' or split='test', or pass include_learned=True (--include-learned)"
            )
    envs = gymnasium.make_vec(env_id, width, objects=objects, autoreset_mode=AutoresetMode.DISABLED, **settings)
    try:
        chosen.bind(Task.of(envs))
        result = run_usable(chosen, envs, count, first, progress=progress)
        total = len(envs.unwrapped.object_names) + left_out  # type: ignore[attr-defined]
        result = replace(result, condition=condition, settings=_described(settings))
        return replace(result, objects_given=total, objects_left_out=left_out)
    finally:
        envs.close()


def _described(settings: dict[str, Any]) -> dict[str, Any] | None:
    """Describe the keywords that determine trials as plain JSON values; None where that is not possible."""
    if settings.get("remote") is not None:
        return None
    # Objects are described one by one, with their scale and mass.
    others = ("obs", "num_threads", "remote", "scale", "mass", "split", "render_mode", "picture", "info")
    try:
        return {name: plain(value, name) for name, value in settings.items() if name not in others}
    except ConfigError:
        return None


def _load_objects(objects: ObjectsArgument, settings: dict[str, Any]) -> object_sets.ObjectSet:
    """Load the objects on this machine, and remove the settings that chose them from those of the environments."""
    remote = settings.get("remote") is not None
    # A server applies scale and mass.
    chosen = {name: settings.pop(name) for name in (("split",) if remote else ("scale", "mass", "split"))}
    try:
        return object_sets.load(objects, **chosen)
    except (MissingExtraError, ObjectSetError) as error:
        if not remote:
            raise
        raise ConfigError(
            f"objects from which the policy learned cannot be left out of a set that only the server has ({error}); "
            "pass include_learned=True (--include-learned)"
        ) from None


def _within(name: str, value: Any, high: int) -> int:
    count = natural(value, name)
    if not 1 <= count <= high:
        raise ConfigError(f"{name} is {count}; it must be between 1 and {high}")
    return count
