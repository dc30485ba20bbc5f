"""Rounds of clearing scenes of several objects with a policy, measured as those of VGN.

A round begins with a scene of a layout, and ends when nothing is left, when the policy finds no grasp
(`graspbox.policies.Policy.found_nothing`), after two failed attempts in a row, or after a number of attempts. A look
that finds no grasp is no attempt. Where ``max_failures`` allows more than two failures in a row, such a look counts as
one of them, and the policy looks again. VGN (Breyer et al., "Volumetric Grasping Network", 2020) reports the success
rate, successful attempts over attempts, and the share of the objects that were cleared.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._common.arguments import natural
from graspbox.configs import CameraConfig, PictureConfig
from graspbox.envs import IDS, MAX_ATTEMPTS
from graspbox.envs.settings import ClearConfig, HandArgument, ObjectsArgument
from graspbox.errors import ConfigError
from graspbox.evaluation.results import wilson
from graspbox.object_sets import ObjectSet, Split, learned_sets
from graspbox.policies import load as load_policy
from graspbox.policies.base import Policy, Task
from graspbox.simulation import load_hand
from graspbox.simulation.layouts import Arrangement, Layout, objects_that_fit

__all__ = ["Film", "Rounds", "Witness", "clear_rounds"]

#: Called after an attempt with the scene before it, the action, and the info after it.
Witness = Callable[[Arrangement, NDArray[np.float32], Mapping[str, Any]], None]
#: Called with a picture (H, W, 3) uint8 and what it shows, such as ``attempt 2: slipped``.
Film = Callable[[NDArray[np.uint8], str], None]
#: Looks at the middle of the table from the side on which the hand does not wait, steeply enough to see into a bin.
_CAMERA = CameraConfig("viewer", "world", eye=(0.55, -0.35, 0.85), target=(0.0, 0.0, 0.06), fov=0.5)
_PICTURE = PictureConfig(image_size=(270, 360), camera=_CAMERA)
#: Columns of `Rounds`.
_COUNTS = ("begun", "attempts", "successes", "cleared", "lost", "no_grasp")
#: Failures in a row that end a round of VGN; there a look that finds no grasp ends it at once.
_FAILURES = 2


@dataclass(frozen=True, eq=False)
class Rounds:
    """n rounds.

    Attributes
    ----------
    seeds : (n,) int64
        Seed of each round.
    begun, attempts, successes, cleared, lost : (n,) int64
        Objects at the beginning, attempts, successful ones, objects taken away, and objects that left the workspace.
    no_grasp : (n,) int64
        1 for a round that ended because the policy proposed no grasp, else 0.
    failures : dict of str to int
        Number of attempts by kind of failure.
    left_out, too_wide : int
        Objects of the set that were left out, because the policy learned from them, or because they do not fit the
        hand.
    """

    policy: str
    hand: str
    layout: Layout
    seeds: NDArray[np.int64]
    begun: NDArray[np.int64]
    attempts: NDArray[np.int64]
    successes: NDArray[np.int64]
    cleared: NDArray[np.int64]
    lost: NDArray[np.int64]
    no_grasp: NDArray[np.int64]
    failures: dict[str, int]
    left_out: int = 0
    too_wide: int = 0

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenate rounds with other seeds."""
        if not parts:
            raise ConfigError("there are no rounds to concatenate")
        failures = sum((Counter(part.failures) for part in parts), Counter[str]())
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in ("seeds", *_COUNTS)
        }
        return replace(parts[0], failures=dict(failures), **columns)

    def __len__(self) -> int:
        """Count the rounds."""
        return len(self.seeds)

    @property
    def success_rate(self) -> float:
        """Successful attempts over attempts."""
        return float(self.successes.sum() / max(1, self.attempts.sum()))

    @property
    def cleared_share(self) -> float:
        """Objects taken away over objects at the beginning."""
        return float(self.cleared.sum() / max(1, self.begun.sum()))

    def to_json(self) -> dict[str, Any]:
        """Return rates with Wilson 95 % intervals, which count attempts and objects as independent, and counts."""
        attempts, begun = int(self.attempts.sum()), int(self.begun.sum())
        return {
            "policy": self.policy,
            "hand": self.hand,
            "layout": self.layout,
            "rounds": len(self),
            "success_rate": round(self.success_rate, 4),
            "success_interval": [round(x, 4) for x in wilson(int(self.successes.sum()), max(1, attempts))],
            "cleared": round(self.cleared_share, 4),
            "cleared_interval": [round(x, 4) for x in wilson(int(self.cleared.sum()), max(1, begun))],
            "attempts": attempts,
            "objects": begun,
            "lost": int(self.lost.sum()),
            "no_grasp": int(self.no_grasp.sum()),
            "failures": self.failures,
            "objects_left_out": self.left_out,
            "objects_too_wide": self.too_wide,
        }

    def __str__(self) -> str:
        """Summarise in a sentence."""
        values = self.to_json()
        low, high = (100 * x for x in values["success_interval"])
        first, last = (100 * x for x in values["cleared_interval"])
        return (
            f"{self.policy} with {self.hand}, {self.layout}: {100 * self.success_rate:.1f} % of {values['attempts']} "
            f"attempts succeed ({low:.1f} to {high:.1f}); {100 * self.cleared_share:.1f} % of {values['objects']} "
            f"objects are cleared ({first:.1f} to {last:.1f}); {values['no_grasp']} of {len(self)} rounds end as no "
            "grasp is found"
        )


def clear_rounds(
    policy: str | Policy,
    *,
    objects: ObjectsArgument = "procedural:unseen:0-19",
    split: Split | None = None,
    layout: Layout = "pile",
    objects_per_scene: int | tuple[int, int] = 5,
    rounds: int = 40,
    seed: int = 0,
    hand: HandArgument | None = None,
    max_attempts: int = MAX_ATTEMPTS,
    fitting: bool = True,
    witness: Witness | None = None,
    progress: Callable[[int], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
    film: Film | None = None,
    **settings: Any,
) -> Rounds:
    """Clear scenes with a policy; objects from which it learned are left out.

    Parameters
    ----------
    policy : str or Policy
        As for `graspbox.evaluation.evaluate`.
    objects, split, layout, objects_per_scene
        Keywords of `graspbox.envs.clear.ClearEnv`.
    rounds : int
        Number of rounds.
    seed : int
        Seed of the first round; the others follow by ones.
    hand : str, Hand or pair of paths, optional
        By default the policy's, else ``reflex``.
    max_attempts : int
        Attempts after which a round ends.
    fitting : bool
        Leave out objects that do not fit the hand (`graspbox.simulation.layouts.objects_that_fit`), as in the sets of
        VGN.
    witness : callable, optional
        Called after each attempt with the scene before it, the action and the info.
    progress : callable
        Called with the number of rounds so far.
    stop : callable
        Asked before each round; True ends the rounds.
    film : callable, optional
        Called in the first round, at its beginning and after every attempt, with a picture (H, W, 3) uint8 and what it
        shows; the setting ``picture`` sets its size and camera.
    **settings
        Other keywords of the environment, such as ``max_failures``: see the module.

    Raises
    ------
    ConfigError
        For a wrong argument, if the policy learned from all objects, or if `stop` ended the first round.
    """
    chosen = load_policy(policy) if isinstance(policy, str) else policy
    count, first = natural(rounds, "rounds"), natural(seed, "seed", 62)
    keywords = {**chosen.settings, **settings}
    if hand is not None:
        keywords["hand"] = hand
    if chosen.obs is not None:
        keywords["obs"] = chosen.obs
    if film is not None:
        keywords = {"picture": _PICTURE, **keywords, "render_mode": "rgb_array"}
    every, kept, fits = _choose_objects(chosen, objects, split, keywords, layout if fitting else None)
    env: Any = gymnasium.make(
        IDS[2],
        objects=fits,
        layout=layout,
        objects_per_scene=objects_per_scene,
        max_episode_steps=max_attempts,
        **keywords,
    )
    most = keywords.get("max_failures", ClearConfig.max_failures)
    with env:
        chosen.bind(Task.of(env))
        rows, failures = [], Counter[str]()
        for number in range(count):
            if stop():
                break
            rows.append(_round(env, chosen, first + number, most, failures, witness, None if number else film))
            progress(number + 1)
        if not rows:
            raise ConfigError("no round was finished; allow more time")
        name = load_hand(chosen.task.hand).name
    begun, attempts, successes, cleared, lost, no_grasp = np.array(rows, dtype=np.int64).T
    counts, seeds = (begun, attempts, successes, cleared, lost, no_grasp), first + np.arange(len(rows))
    left_out = every - len(kept), len(kept) - len(fits)
    return Rounds(chosen.name, name, layout, seeds, *counts, dict(failures), *left_out)


def _choose_objects(
    policy: Policy, objects: ObjectsArgument, split: Split | None, keywords: dict[str, Any], layout: Layout | None
) -> tuple[int, ObjectSet, ObjectSet]:
    """Count the objects of a set; return those that are new to the policy, and of these the ones that fit its hand.

    Removes the keywords of the objects from those of the environment. Without a layout all objects fit.
    """
    chosen_from = {name: keywords.pop(name) for name in ("scale", "mass") if name in keywords}
    every = object_sets.load(objects, split=split, **chosen_from)
    kept = learned_sets.without(every, policy.learned_from)
    if not len(kept):
        raise ConfigError(f"the policy {policy.name!r} learned from all objects of {every.name!r}; name others")
    fits = kept if layout is None else objects_that_fit(kept, layout, keywords.get("hand", "reflex"))
    if not len(fits):
        raise ConfigError(
            f"none of {len(kept)} objects of {every.name!r} fits the hand; name smaller ones, or take all"
        )
    return len(every), kept, fits


def _round(
    env: Any,
    policy: Policy,
    seed: int,
    most: int,
    failures: Counter[str],
    witness: Witness | None,
    film: Film | None,
) -> tuple[int, int, int, int, int, bool]:
    """Run one round, which ends after `most` failures in a row; return the counts in the order of `_COUNTS`."""
    observation, info = env.reset(seed=seed)
    begun, successes, in_a_row = info["remaining"], 0, 0
    over = nothing = False
    policy.reset(seed, info=info)
    if film is not None:
        film(env.render(), "at first")
    while not over:
        batch = (
            {name: values[None] for name, values in observation.items()}
            if isinstance(observation, dict)
            else observation[None]
        )
        action = policy.act(batch)[0]
        if nothing := policy.found_nothing(0):
            in_a_row += 1
            over = most <= _FAILURES or in_a_row >= most
            continue
        before: Any = None if witness is None else env.unwrapped.arrangement()
        observation, _, ended, cut, info = env.step(action)
        if witness is not None:
            witness(before, action, info)
        successes, in_a_row = successes + info["is_success"], 0 if info["is_success"] else in_a_row + 1
        over = ended or cut or in_a_row >= most
        if info["failure"]:
            failures[info["failure"]] += 1
        if film is not None:
            outcome = "lifted an object" if info["is_success"] else f"failed: {info['failure'].replace('_', ' ')}"
            film(env.render(), f"attempt {info['attempts']}: {outcome}")
    return begun, info["attempts"], successes, info["cleared"], info["lost"], nothing
