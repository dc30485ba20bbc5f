"""Feel-then-lift twice on the same trials: once never opening the hand again, once always.

Both runs are bit-identical until the hand decides. They therefore determine the policy's outcome for every threshold:
the second run's where the probability is below it, otherwise the first run's.
"""

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
from graspbox.object_sets import ObjectSet, Split
from graspbox.policies import FeelThenLift, Task
from graspbox.training.array_files import ArrayTable

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
    first_secure, second_secure : (n,) bool
        Likewise for secure holds.
    first_steps, second_steps : (n,) int64
        Number of actions of both.
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
    split: Split | None = None,
    num_envs: int = 16,
    progress: Callable[[int], None] = lambda _: None,
) -> PairedTrials:
    """Run seeded trials of a policy's folder with and without a second attempt.

    Parameters
    ----------
    folder : Path
        Folder of a `FeelThenLift` policy.
    objects : str or ObjectSet
        Object set.
    trials : int
        Number of trials.
    seed : int
        As for `graspbox.evaluation.evaluate`.
    split : {"train", "validation", "test"}, optional
        Sample objects from this split only.
    num_envs : int
        Environments stepped in parallel; the result does not depend on it.
    progress : callable
        Called with the number of finished trials of both runs.
    """
    runs: list[tuple[list[TrialResult], NDArray[np.float64]]] = []

    def report(done: int) -> None:
        progress(trials * len(runs) + done)

    for threshold in (0.0, _ALWAYS):
        runs.append(_run(folder, objects, trials, seed, threshold, split, num_envs, report))
    (first, predicted), (second, again) = runs
    if not np.array_equal(predicted, again):
        raise ConfigError("the two runs differ before the hand decides; run them with the same build and folder")
    return PairedTrials(
        predicted,
        *(np.array([t.success for t in run]) for run in (first, second)),
        *(np.array([t.secure for t in run]) for run in (first, second)),
        *(np.array([t.steps for t in run]) for run in (first, second)),
    )


def _run(
    folder: Path,
    objects: str | ObjectSet,
    trials: int,
    seed: int,
    threshold: float,
    split: Split | None,
    num_envs: int,
    progress: Callable[[int], None],
) -> tuple[list[TrialResult], NDArray[np.float64]]:
    """Run the trials with one threshold: results, and predictions for the first grasps."""
    policy = FeelThenLift(folder, threshold=threshold)
    settings = {**policy.settings, "objects": objects, "split": split, "obs": policy.obs}
    envs = gymnasium.make_vec(
        "graspbox/Grasp-v0", min(num_envs, trials), autoreset_mode=AutoresetMode.DISABLED, **settings
    )
    predicted = np.ones(trials)

    def watch(steps: Any) -> None:
        for trial, env in zip(steps.trial.tolist(), steps.env.tolist(), strict=True):
            if policy.attempts[env]:
                predicted[trial] = policy.attempts[env][0].probability

    try:
        policy.bind(Task.of(envs))
        results: dict[int, TrialResult] = {}
        for trial, result in TrialRun(policy, envs, trial_seeds(seed, trials), watch).results():
            results[trial] = result
            progress(len(results))
    finally:
        envs.close()
    return [results[trial] for trial in range(trials)], predicted


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
