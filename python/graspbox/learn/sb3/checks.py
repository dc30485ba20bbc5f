"""Checks of the parameters of trainings with Stable-Baselines3, before anything is made of them."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from numbers import Real
from typing import Any

from graspbox._common.arguments import shown
from graspbox.errors import ConfigError

__all__ = ["check_arguments", "check_name", "check_parameters"]

#: Arguments of algorithms that a training gives itself.
_GIVEN = ("self", "policy", "env", "seed", "device", "tensorboard_log", "_init_setup_model")
#: Arguments that an algorithm gives its policy itself.
_GIVEN_TO_POLICIES = ("self", "observation_space", "action_space", "lr_schedule")
#: Keywords of environments that a training gives itself, and what to change instead.
_GIVEN_TO_ENVIRONMENTS = {
    "num_envs": "set num_envs",
    "split": "training uses train, and --evaluate names the split of evaluations",
    "autoreset_mode": "Stable-Baselines3 needs SameStep",
}


def _is_integer(value: Any, least: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def _is_number(value: Any, least: float, most: float = float("inf")) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and least <= float(value) <= most


def _at_least(least: int) -> tuple[Callable[[Any], bool], str]:
    return (lambda value: _is_integer(value, least)), f"an integer of at least {least}"


def _is_rate(value: Any) -> bool:
    """Whether this is a learning rate: a number, which YAML may read as text, or ``linear_`` and a number."""
    try:
        return 0.0 < float(value.removeprefix("linear_") if isinstance(value, str) else value) < float("inf")
    except (TypeError, ValueError):
        return False


_SHARE = (lambda value: _is_number(value, 0.0, 1.0)), "a number from 0 to 1"
_NOT_NEGATIVE = (lambda value: _is_number(value, 0.0)), "a number of at least 0"
_MAPPING = (lambda value: isinstance(value, Mapping)), "names with their values"
#: What values must be.
_VALUES: dict[str, tuple[Callable[[Any], bool], str]] = {
    "steps": _at_least(1),
    "num_envs": _at_least(1),
    "demonstrations": _at_least(0),
    "normalize": (
        lambda value: (
            isinstance(value, Mapping)
            and set(value) == {"observations", "reward"}
            and all(isinstance(one, bool) for one in value.values())
        ),
        "observations and reward, true or false each: normalize.reward=true",
    ),
    "env": _MAPPING,
    "model": _MAPPING,
    "model.policy_kwargs": _MAPPING,
    "model.learning_rate": (_is_rate, "a positive number, or linear_X for one that falls from X to 0"),
    "model.n_steps": _at_least(1),
    "model.batch_size": _at_least(2),
    "model.n_epochs": _at_least(1),
    "model.buffer_size": _at_least(1),
    "model.learning_starts": _at_least(0),
    "model.train_freq": _at_least(1),
    "model.gradient_steps": (
        lambda value: _is_integer(value, 1) or (_is_integer(value, -1) and value == -1),
        "an integer of at least 1, or -1 for one per step of the environments",
    ),
    "model.gamma": _SHARE,
    "model.gae_lambda": _SHARE,
    "model.tau": _SHARE,
    "model.vf_coef": _NOT_NEGATIVE,
    "model.ent_coef": (
        lambda value: _is_number(value, 0.0) or str(value).startswith("auto"),
        "a number of at least 0; for off-policy algorithms also auto, or auto_X to begin at X",
    ),
    "model.target_kl": (lambda value: value is None or _is_number(value, 0.0), "a number of at least 0, or null"),
    "model.max_grad_norm": _NOT_NEGATIVE,
    "model.action_noise": _NOT_NEGATIVE,
    "model.replay_buffer_class": (lambda value: value == "HerReplayBuffer", "HerReplayBuffer, or leave it out"),
    "model.replay_buffer_kwargs": _MAPPING,
}


def check_name(name: str, known: Iterable[str], what: str) -> None:
    """Refuse an unknown name with a `ConfigError` that suggests the nearest one."""
    choices = list(known)
    if name in choices:
        return
    near = get_close_matches(name, choices, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"choose from {', '.join(choices)}"
    raise ConfigError(f"there is no {what} {name!r}; {hint}")


def check_parameters(parameters: Mapping[str, Any]) -> None:
    """Refuse values of another type or out of range, and keywords of environments that a training gives itself."""
    for name, (fits, wanted) in _VALUES.items():
        group, _, last = name.rpartition(".")
        place = parameters[group] if group else parameters
        if last in place and not fits(place[last]):
            raise ConfigError(f"{name} is {shown(place[last])}; give {wanted}")
    for name, instead in _GIVEN_TO_ENVIRONMENTS.items():
        if name in parameters["env"]:
            raise ConfigError(f"env.{name} is given by the training; {instead}")


def check_arguments(algorithm: Any, arguments: Mapping[str, Any]) -> None:
    """Refuse arguments that an algorithm, or its policy, does not have; `arguments` is the entry ``model``."""
    known = [name for name in _keywords(algorithm) if name not in _GIVEN]
    for name in arguments:
        check_name(name, known, f"argument of {algorithm.__name__}")
    policy = algorithm.policy_aliases["MlpPolicy"]
    known = [name for name in _keywords(policy) if name not in _GIVEN_TO_POLICIES]
    chosen = arguments.get("policy_kwargs", {})
    for name in chosen:
        check_name(name, known, "argument of the policy in model.policy_kwargs,")
    if "activation_fn" in chosen:
        from torch.nn.modules import activation

        check_name(chosen["activation_fn"], activation.__all__, "activation")


def _keywords(kind: type) -> list[str]:
    """List the keywords of a constructor, and of those that it passes others on to."""
    names: dict[str, None] = {}
    for base in kind.__mro__:
        if "__init__" not in vars(base):
            continue
        found = inspect.signature(base.__init__).parameters.values()  # type: ignore[misc]
        names |= dict.fromkeys(
            one.name for one in found if one.kind is one.POSITIONAL_OR_KEYWORD or one.kind is one.KEYWORD_ONLY
        )
        if not any(one.kind is one.VAR_KEYWORD for one in found):
            break
    return list(names)
