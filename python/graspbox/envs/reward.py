"""Weights of the reward terms.

A reward is the weighted sum of named terms, which the core computes. ``graspbox.envs.spaces.tables(hand)["terms"]``
lists them with their ranges and meanings.
"""

import sys
from collections.abc import Mapping, Sequence
from numbers import Real
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import about, shown
from graspbox.envs.spaces import Tables
from graspbox.errors import ConfigError

__all__ = [
    "DECISION",
    "DECISION_WEIGHTS",
    "DENSE",
    "FIRM",
    "FIRM_DECISION",
    "GOAL_WEIGHTS",
    "SPARSE",
    "WEIGHTS",
    "goal_weights",
    "term_weights",
    "total",
]

#: Greatest absolute value of a weight.
_MAX_WEIGHT = sys.float_info.max

#: 1 for a success, else 0.
SPARSE: Mapping[str, float] = MappingProxyType({"success": 1.0})

#: Shaped reward. The shaping terms are differences of bounded potentials, so their sum over an episode depends only on
#: its first and last state, not on the path. Weights rise towards the goal: lifting pays more than all progress before
#: it, and success pays more than everything before it. There are no costs: chance pushes objects, touches the table and
#: loses the object long before it grasps anything, and learners then settled on not moving (docs/results/training.md).
DENSE: Mapping[str, float] = MappingProxyType(
    {
        "reach": 1.0,
        "contact": 1.0,
        "closure": 0.5,
        "lift": 3.0,
        "hold": 3.0,
        "success": 10.0,
    }
)

#: Shaped reward for one decision per episode. Proximity pays even without contact, and the penalty of an infeasible
#: attempt is smaller than the reward of proximity.
DECISION: Mapping[str, float] = MappingProxyType(
    {
        "reach": 1.0,
        "contact": 1.0,
        "closure": 0.5,
        "lift": 2.0,
        "hold": 1.0,
        "success": 4.0,
        "failure": 0.25,
        "push": 0.5,
    }
)

#: `DENSE` with half of the reward for a firm hold: a secure success pays more than a success, and motion of the object
#: in the hand costs as much as lifting pays.
FIRM: Mapping[str, float] = MappingProxyType({**DENSE, "success": 5.0, "secure": 10.0, "slip": 3.0})

#: `DECISION` with the same change.
FIRM_DECISION: Mapping[str, float] = MappingProxyType({**DECISION, "success": 2.0, "secure": 4.0, "slip": 1.0})

#: Weights by the name of the reward.
WEIGHTS: Mapping[str, Mapping[str, float]] = MappingProxyType({"sparse": SPARSE, "dense": DENSE, "firm": FIRM})
#: The same for one decision per episode.
DECISION_WEIGHTS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"sparse": SPARSE, "dense": DECISION, "firm": FIRM_DECISION}
)
#: The same with goals, whose rewards are single terms.
GOAL_WEIGHTS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"sparse": MappingProxyType({"goal": 1.0}), "dense": MappingProxyType({"distance": 1.0})}
)


def goal_weights(reward: str, found: Tables) -> NDArray[np.float64]:
    """Return the weights of an environment with goals, as `term_weights`: its terms are the first ones."""
    terms = found["goal"]["terms"]
    weights = term_weights(reward, None, {**found, "terms": terms}, GOAL_WEIGHTS)
    return np.pad(weights, (0, len(found["terms"]) - len(terms)))


def term_weights(
    reward: str,
    reward_weights: Mapping[str, float] | None,
    found: Tables,
    known: Mapping[str, Mapping[str, float]] = WEIGHTS,
) -> NDArray[np.float64]:
    """Return the weights in the order of the core's terms.

    Parameters
    ----------
    reward : {"sparse", "dense", "firm"}
        Name of the weights.
    reward_weights : mapping of str to float, optional
        Weights that replace those of the same name.
    found : Tables
        The result of `graspbox.envs.spaces.tables`.
    known : mapping
        Weights by the name of the reward.

    Returns
    -------
    (terms,) float64
        The weights.

    Raises
    ------
    ConfigError
        For an unknown reward or term, or a weight that is not finite.
    """
    if reward not in known:
        with about("reward"):
            raise ConfigError(f"there is no reward {reward!r}; choose from {', '.join(known)}")
    with about("reward_weights"):
        return _weights(known[reward], reward_weights, [term["name"] for term in found["terms"]])


def _weights(
    named: Mapping[str, float], reward_weights: Mapping[str, float] | None, names: Sequence[str]
) -> NDArray[np.float64]:
    """Replace weights by those of `reward_weights`, and put them into the order of the terms."""
    if reward_weights is not None and not isinstance(reward_weights, Mapping):
        raise ConfigError(
            f"reward_weights is {shown(reward_weights)}; give a dictionary of weights by the names of terms"
        )
    chosen = {**named, **(reward_weights or {})}
    for name, weight in chosen.items():
        if name not in names:
            raise ConfigError(f"there is no reward term {name!r}; choose from {', '.join(names)}")
        if not isinstance(weight, Real) or not -_MAX_WEIGHT <= weight <= _MAX_WEIGHT:
            raise ConfigError(f"the weight of {name!r} is {shown(weight)}; give a finite number")
    return np.array([float(chosen.get(name, 0.0)) for name in names])


def total(weights: NDArray[np.float64], terms: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the rewards (rows,) of terms (rows, terms), summed in order: a row's bits do not depend on other rows."""
    # Adding zero turns the -0.0 of zero terms with negative weights into 0.0.
    rewards: NDArray[np.float64] = np.cumsum(terms * weights, axis=1)[:, -1] + 0.0
    return rewards
