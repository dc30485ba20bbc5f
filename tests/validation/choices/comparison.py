"""The grasps that a policy chooses, in both engines: MuJoCo as a second judge of a policy.

The policy acts in seeded trials of the core. Each of its grasps is then replayed in MuJoCo from the object's resting
pose. A trial without a grasp, and a grasp whose open hand is in collision, fail in the engine concerned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from graspbox import _core, object_sets
from graspbox.evaluation.results import wilson
from graspbox.hands import load_hand
from graspbox.object_sets import ObjectSet
from validation.forces.sources import chosen
from validation.mujoco.compare import check_patch, check_settings, describe, judge
from validation.mujoco.report import Report
from validation.mujoco.scene import Numerics
from validation.versions import MUJOCO_VERSION

__all__ = ["ChoicesReport", "compare_choices"]


@dataclass
class ChoicesReport:
    """Result of `compare_choices`.

    Attributes
    ----------
    policy, hand : str
        Names of the policy and of its hand.
    trials : int
        Trials of the policy.
    core : int
        Those that succeed in the core.
    missing : int
        Trials in which it chose no grasp.
    compared : Report
        The others, in both engines; grasps whose open hand is in collision in MuJoCo have no row.
    """

    policy: str
    hand: str
    trials: int
    core: int
    missing: int = 0
    compared: Report = field(default_factory=Report)

    @property
    def mujoco(self) -> int:
        """Number of trials that succeed in MuJoCo."""
        return sum(row.mujoco.success for row in self.compared.rows)

    @property
    def difference(self) -> float:
        """The core's success rate minus MuJoCo's, over all trials."""
        return (self.core - self.mujoco) / self.trials

    def to_json(self) -> dict[str, Any]:
        """Return the values as JSON types."""
        rates = {name: (count, wilson(count, self.trials)) for name, count in self.successes().items()}
        facts = self.compared.to_json()
        return {
            "mujoco_version": MUJOCO_VERSION,
            "policy": self.policy,
            "hand": self.hand,
            "trials": self.trials,
            "missing": self.missing,
            "successes": {name: {"count": count, "ci95": list(ci95)} for name, (count, ci95) in rates.items()},
            "difference": self.difference,
            **{name: facts[name] for name in ("equal", "infeasible_in_mujoco", "by_kind", "by_object", "different")},
        }

    def successes(self) -> dict[str, int]:
        """Return the number of successful trials by engine."""
        return {"core": self.core, "mujoco": self.mujoco}


def compare_choices(
    policy: str,
    objects: str | Sequence[str] | ObjectSet,
    trials: int = 200,
    seed: int = 0,
    *,
    rehearsed: int | None = None,
    threads: int | None = None,
    numerics: Numerics | None = None,
    patch: float = 0.0,
    progress: Callable[[int], None] = lambda _: None,
) -> ChoicesReport:
    """Replay the grasps that a policy chooses in MuJoCo.

    Parameters
    ----------
    policy, rehearsed
        As for `graspbox.policies.load`.
    objects, trials, seed
        As for `graspbox.evaluation.evaluate`; at least one trial.
    threads : int, optional
        Number of threads for both engines; by default that of the core.
    numerics : Numerics, optional
        MuJoCo's settings.
    patch : float
        Mean distance of a contact area from its middle, metres: MuJoCo's contacts then resist turning about their
        normal. 0: they are points.
    progress : callable
        Called with the number of replayed trials.

    Raises
    ------
    ConfigError, ObjectSetError
        As `graspbox.evaluation.evaluate`, and if MuJoCo's time step or `patch` is out of range.
    """
    numerics = numerics or Numerics()
    check_settings(trials, numerics)
    check_patch(patch)
    choices = chosen(policy, object_sets.load(objects), trials, seed, rehearsed=rehearsed)
    hand = load_hand((choices.result.settings or {}).get("hand", "reflex"))
    described = describe(hand)
    report = ChoicesReport(choices.result.policy, hand.name, trials, choices.result.succeeded)
    report.compared.threads = threads or _core.num_threads()
    for done, batch in enumerate(choices.batches, 1):
        if batch is None:
            report.missing += 1
        else:
            sampled = batch.poses, batch.preshape
            report.compared.rows += judge(report.compared, batch.scene, described, sampled, numerics, patch)
        progress(done)
    return report
