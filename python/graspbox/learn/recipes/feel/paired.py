"""Feel-then-lift twice on the same trials: once never opening the hand again, once always.

Both runs are bit-identical until the hand decides. They therefore determine the policy's outcome for every threshold:
the second run's where the probability is below it, otherwise the first run's.
"""

import contextlib
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.evaluation import TrialResult, trial_seeds
from graspbox.evaluation.trials import TrialRun
from graspbox.learn.training.array_files import ArrayTable
from graspbox.object_sets import ObjectSet
from graspbox.policies import FeelThenLift, Task

__all__ = ["PairedTrials", "at_threshold", "best_threshold", "run_pairs"]

#: Threshold above every probability.
_ALWAYS = 2.0
#: Thresholds that are compared.
_THRESHOLDS = np.round(np.arange(0.0, 1.0001, 0.01), 2)


@dataclass(frozen=True, eq=False)
class PairedTrials(ArrayTable):
    """n trials, each with and without a second attempt.

    Attributes
    ----------
    probability : (n,) float64
        Predicted probability that the first grasp holds; 1 without a prediction.
    first, second : (n,) bool
        Whether the trial succeeded with the first grasp, and with the second one after opening the hand.
        ``_secure`` and ``_steps`` are likewise secure holds and numbers of actions.
    """

    probability: NDArray[np.float64]
    first: NDArray[np.bool_]
    second: NDArray[np.bool_]
    first_secure: NDArray[np.bool_]
    second_secure: NDArray[np.bool_]
    first_steps: NDArray[np.int64]
    second_steps: NDArray[np.int64]


def run_pairs(
    folder: Path,
    objects: str | ObjectSet,
    trials: int,
    seed: int,
    *,
    num_envs: int = 16,
    progress: Callable[[int], None] = lambda _: None,
) -> PairedTrials:
    """Run seeded trials of the folder of a `FeelThenLift` policy with and without a second attempt.

    Arguments as of `graspbox.evaluation.evaluate`; `progress` is called with the number of finished trials of both.
    """
    seeds, counts = trial_seeds(seed, trials), itertools.count(1)

    def run(threshold: float) -> tuple[list[TrialResult], NDArray[np.float64]]:
        """Run the trials with one threshold: results, and predictions for the first grasps."""
        policy = FeelThenLift(folder, threshold=threshold)
        settings = {**policy.settings_in("graspbox/Grasp-v0"), "objects": objects, "obs": policy.obs}
        count, mode = min(num_envs, trials), AutoresetMode.DISABLED
        envs = gymnasium.make_vec("graspbox/Grasp-v0", count, autoreset_mode=mode, **settings)
        predicted = np.ones(trials)

        def watch(steps: Any) -> None:
            for trial, env in zip(steps.trial.tolist(), steps.env.tolist(), strict=True):
                if policy.attempts[env]:
                    predicted[trial] = policy.attempts[env][0].probability

        results: dict[int, TrialResult] = {}
        with contextlib.closing(envs):
            policy.bind(Task.of(envs))
            for trial, result in TrialRun(policy, envs, seeds, watch).results():
                results[trial] = result
                progress(next(counts))
        return [results[trial] for trial in range(trials)], predicted

    (first, predicted), (second, again) = run(0.0), run(_ALWAYS)
    if not np.array_equal(predicted, again):
        raise ConfigError("the two runs differ before the hand decides; run them with the same build and folder")
    names = ("success", "secure", "steps")
    columns = (np.array([getattr(trial, name) for trial in results]) for name in names for results in (first, second))
    return PairedTrials(predicted, *columns)


def at_threshold(pairs: PairedTrials, threshold: float) -> dict[str, Any]:
    """Return the policy's outcome with a threshold.

    Returns
    -------
    dict
        ``trials``; ``succeeded`` and ``secure``; ``opened``: number of times it opens; ``rightly``: number of these
        first grasps that would not have held; ``saved``: number of second grasps that then held; ``lost``: number of
        failed trials whose first grasp would have held; ``steps``: mean number of actions of a success.
    """
    opened = pairs.probability < threshold
    success = np.where(opened, pairs.second, pairs.first)
    steps = np.where(opened, pairs.second_steps, pairs.first_steps)
    return {
        "trials": len(pairs),
        "succeeded": int(success.sum()),
        "secure": int(np.where(opened, pairs.second_secure, pairs.first_secure).sum()),
        "opened": int(opened.sum()),
        "rightly": int((opened & ~pairs.first).sum()),
        "saved": int((opened & ~pairs.first & pairs.second).sum()),
        "lost": int((opened & pairs.first & ~pairs.second).sum()),
        "steps": round(float(steps[success].mean()), 1) if success.any() else 0.0,
    }


def best_threshold(pairs: PairedTrials) -> float:
    """Choose the threshold with the most successes: the middle of those within half a standard error of the best."""
    rates = np.array([at_threshold(pairs, t)["succeeded"] for t in _THRESHOLDS]) / len(pairs)
    best = float(rates.max())
    # Neighbouring thresholds differ in few trials; a run of good ones is stronger evidence than one peak.
    near = _THRESHOLDS[rates >= best - 0.5 * np.sqrt(best * (1.0 - best) / len(pairs))]
    return float(np.median(near))
