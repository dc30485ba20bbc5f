"""The card and the picture of a policy that feels before it lifts, from measured values alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import graspbox
from graspbox.evaluation import wilson
from graspbox.files import write_text
from graspbox.pictures.files import Figure, check_path, write
from graspbox.policy_training.cards import rate
from graspbox.policy_training.paired import PairedTrials, at_threshold
from graspbox.progress import shown_time

__all__ = ["save_feel_chart", "write_feel_card"]

#: Thresholds of the picture.
_THRESHOLDS = np.linspace(0.0, 1.0, 101)
#: Bins of the reliability; bins with fewer grasps are left out.
_BINS, _LEAST = 8, 5

_HEAD = """# {name}, feel then lift

Grasps an object on a table from one depth image, closes the fingers, and feels whether the grasp will hold; if not, it
opens, looks again and chooses once more. Made by graspbox {version}. `DEPTH.md` is the card of the policy that looks
and chooses; this folder holds it too.

```
graspbox evaluate {folder} --objects procedural:unseen:0-19
```

## Scores

In `Grasp-v0`, on the same trials: the first attempt alone, and with a second one where the first felt unlikely to hold.
In brackets the 95 % intervals (Wilson). *Perfect feeling* would open where the first grasp does not hold.

| objects | trials | first attempt | feel, then lift | perfect feeling | secure: first | feel, then lift |
|---|--:|--:|--:|--:|--:|--:|
"""

_FEEL = """
It opens below a probability of {threshold:.2f} that the grasp holds. AUC is how well the probability tells grasps that
hold from those that do not, ECE its expected calibration error.

| objects | opens | rightly | saved | lost | AUC | ECE | steps of a success: first | feel, then lift |
|---|--:|--:|--:|--:|--:|--:|--:|--:|
"""

_END = """
*Rightly*: the first grasp would not have held. *Saved*: the second one then did. *Lost*: the first one would have held,
the second did not.

![Success against the threshold, and reliability](feel.png)

## Data and training

```
{command}
```

Seed {seed}. {trials} grasps of `{objects}`, of which {held:.1%} held; validated and calibrated on {others} of
`{held_out}`, where the threshold was chosen too. The hand feels {times} s after it began to close.

| stage | time |
|---|--:|
"""

_LIMITS = """
## Limits

- Those of the policy that it builds on; see `DEPTH.md`.
- It feels what the simulated hand measures: joint positions, tendon tensions and tactile forces, without the noise of
  real sensors.
- There is one second attempt, which is lifted whatever is felt.
"""


def write_feel_card(folder: Path, settings: Any, command: str, stages: Mapping[str, Mapping[str, Any]]) -> None:
    """Write ``README.md`` into the folder, and the card of the policy that it builds on as ``DEPTH.md``.

    Parameters
    ----------
    folder : Path
        The folder.
    settings : FeelSettings
        Arguments of the training (`graspbox.policy_training.feel`).
    command : str
        What made it.
    stages : mapping
        Results of each stage by name, with its seconds.
    """
    source = settings.policy / "README.md"
    if source.is_file() and folder.resolve() != settings.policy.resolve():
        write_text(folder / "DEPTH.md", source.read_text())
    text = _HEAD.format(name=folder.name, version=graspbox.__version__, folder=f"policies/{folder.name}")
    found = {objects: part for objects, part in stages["evaluate"].items() if objects != "seconds"}
    for objects, part in found.items():
        first, feel, trials = part["first"], part["feel"], part["first"]["trials"]
        counts = (first["succeeded"], feel["succeeded"], part["perfect"], first["secure"], feel["secure"])
        cells = [rate(count, trials) for count in counts]
        text += f"| `{objects}` | {trials} | {' | '.join(cells)} |\n"
    text += _FEEL.format(threshold=stages["threshold"]["threshold"])
    for objects, part in found.items():
        feel = part["feel"]
        cells = [str(feel[key]) for key in ("opened", "rightly", "saved", "lost")]
        cells += [f"{part['auc']:.3f}", f"{part['ece']:.3f}", f"{part['first']['steps']}", f"{feel['steps']}"]
        text += f"| `{objects}` | {' | '.join(cells)} |\n"
    train = stages["record-train"]
    text += _END.format(
        command=command,
        seed=settings.seed,
        trials=train["trials"],
        objects=settings.objects,
        held=train["held"],
        others=stages["record-held-out"]["trials"],
        held_out=settings.held_out,
        times=", ".join(str(time) for time in settings.times),
    )
    text += "".join(f"| {name} | {shown_time(part['seconds'])} |\n" for name, part in stages.items())
    text += f"| all | {shown_time(sum(part['seconds'] for part in stages.values()))} |\n"
    text += _LIMITS + "\n## Licence\n\nAs that of the policy that it builds on: `LICENSE`, where there is one.\n"
    write_text(folder / "README.md", text)


def save_feel_chart(path: Path, found: Mapping[str, PairedTrials], threshold: float) -> None:
    """Draw success against the threshold, and how often grasps hold against what was felt (extra ``cli``).

    Parameters
    ----------
    path : Path
        Image file.
    found : mapping
        Trials by set of objects.
    threshold : float
        The policy's.
    """
    target = check_path(path)
    figure = Figure(figsize=(10, 4.2), dpi=120, layout="constrained")
    success, reliability = figure.subplots(1, 2)
    for objects, pairs in found.items():
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
    success.legend(fontsize=8, title="dotted: first attempt alone; dashed: the policy's threshold", title_fontsize=8)
    reliability.plot([0, 1], [0, 1], color="0.6", lw=1)
    reliability.set(
        xlabel="probability that the grasp holds, as felt", ylabel="share that held", xlim=(0, 1), ylim=(0, 1)
    )
    for panel in (success, reliability):
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.3)
    write(figure, target)
