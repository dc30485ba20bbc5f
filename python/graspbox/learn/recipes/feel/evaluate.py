"""Stage ``evaluate``: the policy, its first attempt only, and its predictions, on objects excluded from training."""

from typing import Any

from graspbox._common.runs import Run
from graspbox.learn.recipes.feel.chart import save_feel_chart
from graspbox.learn.recipes.feel.context import FeelContext
from graspbox.learn.recipes.feel.paired import PairedTrials, at_threshold
from graspbox.learn.training.metrics import auc
from graspbox.policies.published.calibration import calibration_error
from graspbox.policies.published.configs import FeelPolicyConfig
from graspbox.policies.published.folders import load

__all__ = ["evaluate"]


def evaluate(context: FeelContext, stage: Run) -> dict[str, Any]:
    """Run the trials, and draw the chart."""
    folder = context.policy_folder
    threshold = load(folder, FeelPolicyConfig).threshold
    results: dict[str, Any] = {}
    trials: dict[str, PairedTrials] = {}
    for name, objects in context.evaluated.items():
        pairs = trials[name] = context.pairs(stage, name, objects, context.settings.sizes.trials, 1900)
        results[name] = {
            "first": at_threshold(pairs, 0.0),
            "feel": at_threshold(pairs, threshold),
            "always": at_threshold(pairs, 2.0),
            # Upper bound with perfect predictions: open exactly when the first grasp does not hold.
            "perfect": int((pairs.first | pairs.second).sum()),
            "auc": round(auc(pairs.probability, pairs.first), 4),
            "ece": round(calibration_error(pairs.probability, pairs.first), 4),
        }
    save_feel_chart(folder / "feel.png", trials, threshold)
    return results
