"""The chart of a policy that checks grasp stability: success against the threshold, and reliability."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from graspbox.evaluation import wilson
from graspbox.learn.recipes.feel.paired import PairedTrials, at_threshold
from graspbox.pictures.files import Figure, check_path, write

__all__ = ["save_feel_chart"]

#: Thresholds of the chart.
_THRESHOLDS = np.linspace(0.0, 1.0, 101)
#: Bins of the reliability diagram; bins with fewer grasps are omitted.
_BINS, _LEAST = 8, 5


def save_feel_chart(path: Path, trials: Mapping[str, PairedTrials], threshold: float) -> None:
    """Plot success against the threshold, and the observed against the predicted rate of holding (extra ``cli``).

    Trials are by set of objects; the policy's threshold is marked.
    """
    target = check_path(path)
    figure = Figure(figsize=(10, 4.2), dpi=120, layout="constrained")
    success, reliability = figure.subplots(1, 2)
    for objects, pairs in trials.items():
        counts = np.array([at_threshold(pairs, float(t))["succeeded"] for t in _THRESHOLDS])
        bounds = np.array([wilson(int(count), len(pairs)) for count in counts])
        (line,) = success.plot(_THRESHOLDS, counts / len(pairs), label=f"{objects} ({len(pairs)} trials)")
        success.fill_between(_THRESHOLDS, *bounds.T, color=line.get_color(), alpha=0.15, lw=0)
        success.axhline(pairs.first.mean(), color=line.get_color(), ls=":", lw=1)
        bins = np.minimum((pairs.probability * _BINS).astype(np.int64), _BINS - 1)
        kept = [b for b in range(_BINS) if (bins == b).sum() >= _LEAST]
        stated = [pairs.probability[bins == b].mean() for b in kept]
        true = np.array([pairs.first[bins == b].mean() for b in kept])
        ends = np.array([wilson(int(pairs.first[bins == b].sum()), int((bins == b).sum())) for b in kept])
        if kept:
            reliability.errorbar(stated, true, np.abs(ends.T - true), fmt="o", ms=4, lw=1, color=line.get_color())
    success.axvline(threshold, color="0.4", ls="--", lw=1)
    success.set(xlabel="opens below this probability", ylabel="share of trials that succeed", xlim=(0, 1))
    success.legend(fontsize=8, title="dotted: first attempt only; dashed: the policy's threshold", title_fontsize=8)
    reliability.plot([0, 1], [0, 1], color="0.6", lw=1)
    reliability.set(
        xlabel="predicted probability that the grasp holds", ylabel="share that held", xlim=(0, 1), ylim=(0, 1)
    )
    for panel in (success, reliability):
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.3)
    write(figure, target)
