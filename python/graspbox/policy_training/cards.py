"""Cards of published policies: pages that say how each was made and what it can do, from measured values alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import graspbox
from graspbox.evaluation import wilson
from graspbox.files import write_text
from graspbox.perception.head_folders import HeadPolicyConfig
from graspbox.perception.scenes import SceneConfig
from graspbox.policy_training.learned import evaluated_split
from graspbox.progress import shown_time

__all__ = ["LICENCE", "rate", "write_card", "write_head_card"]

_HEAD = """# {name}

Grasps an object on a table from one depth image: no mesh, no true pose. Made by graspbox {version}, for the hand
`{hand}`.

```
{use}
```

## Scores

First attempt in `GraspPose-v0`, on objects from which nothing was learned; the camera has the noise of a real one. In
brackets the 95 % intervals (Wilson).{more}

"""
#: Last part of a card.
LICENCE = "\n## Licence\n\nApache-2.0; see `LICENSE`. Objects: `graspbox objects` names their licences.\n"
_ECE = " ECE is the expected calibration error of the stated probability of success."

_LIMITS = """
## Limits

- One object on a flat table, no larger than a cube of 0.3 m, seen from {near} to {far} m and at least
  {elevation:.0f} degrees above the table.
- Depth of a camera with the noise of a structured-light sensor; it has seen no transparent and shiny surfaces,
  which such cameras do not see.
- Masses and friction are those of the simulation; probabilities hold there, not on a real arm.
"""


def rate(count: int, trials: int) -> str:
    """Show a rate with its 95 % interval (Wilson)."""
    low, high = wilson(count, trials)
    return f"{count / trials:.1%} ({low:.1%} to {high:.1%})"


def _result(name: str, found: Mapping[str, Any]) -> str:
    """Tell what came of a stage; what has a table of its own is left out."""
    if name.startswith("collect"):
        return "; ".join(
            f"{split}: {part['trials']} trials, {part['success']:.1%} success, {part['secure']:.1%} secure"
            for split, part in found.items()
            if split != "seconds"
        )
    if name.startswith("calibrate") or name in ("evaluate", "export", "rungs"):
        return ""
    if name == "data":
        return f"{found['train']} trials to learn from, {found['validation']} to validate"
    measure = {"completion": "overlap (IoU)", "head": "share of its first choices that held"}.get(name, "AUC")
    return f"{found['steps']} steps, {measure} {found['best']:.3f}"


def write_card(
    folder: Path,
    *,
    config: Any,
    command: str,
    settings: Any,
    scenes: SceneConfig,
    stages: Mapping[str, Mapping[str, Any]],
) -> None:
    """Write ``README.md`` into a policy's folder.

    Parameters
    ----------
    folder : Path
        The folder.
    config : DepthPolicyConfig
        What the folder holds.
    command : str
        What made it.
    settings : Settings
        Arguments of the training (`graspbox.policy_training.depth`).
    scenes : SceneConfig
        How scenes were seen.
    stages : mapping
        Results of each stage by name, with its seconds.
    """
    use = (
        f"{_evaluated(folder)}\ngraspbox grasp-image DEPTH.npy --intrinsics FX FY CX CY --policy policies/{folder.name}"
    )
    text = _HEAD.format(name=config.name, version=graspbox.__version__, hand=config.hand, use=use, more=_ECE)
    text += "| objects | trials | success | secure | ECE |\n|---|--:|--:|--:|--:|\n"
    for objects, found in stages["evaluate"].items():
        if objects == "seconds":
            continue
        trials = found["trials"]
        cells = [rate(found[key], trials) for key in ("succeeded", "secure")]
        split = evaluated_split(objects)
        name = f"`{objects}`, split `{split}`" if split else f"`{objects}`"
        text += f"| {name} | {trials} | {cells[0]} | {cells[1]} | {found['ece']:.3f} |\n"
    text += (
        f"\nA grasp is chosen by (success + {config.calibration.secure_weight} secure) / "
        f"{1 + config.calibration.secure_weight}, after {config.finder.refinements} refinements. On held-out scenes "
        "other settings gave:\n\n| refinements | weight of a secure hold | scenes | success | secure |\n"
        "|--:|--:|--:|--:|--:|\n"
    )
    for name, found in stages.items():
        stage, _, count = name.partition("-")
        if stage == "calibrate":
            rates = found["rates"].items()
            text += "".join(f"| {count} | {w} | {found['choices']} | {a:.1%} | {b:.1%} |\n" for w, (a, b) in rates)
    text += f"\n## Data and training\n\n```\n{command}\n```\n\n"
    data, fresh = (
        " and ".join(f"`{name}`" for name in names) for names in (settings.data or settings.objects, settings.fresh)
    )
    trials = max(found["trials"] for found in stages.values() if "on_policy" in found)
    on_policy = max(found.get("on_policy", 0) for found in stages.values())
    text += (
        f"Seed {settings.seed}. {trials} trials of {data} (split `train`), then {on_policy} trials that\n"
        f"the policy chose on {fresh}.\n\n| stage | time | result |\n|---|--:|---|\n"
    )
    for name, found in stages.items():
        text += f"| {name} | {shown_time(found['seconds'])} | {_result(name, found)} |\n"
    text += f"| all | {shown_time(sum(found['seconds'] for found in stages.values()))} | |\n"
    write_text(folder / "README.md", text + _limits(scenes) + LICENCE)


def _evaluated(folder: Path) -> str:
    return f"graspbox evaluate policies/{folder.name} --objects procedural:unseen:0-19"


def _limits(scenes: SceneConfig) -> str:
    near, far = scenes.distance
    return _LIMITS.format(near=near, far=far, elevation=scenes.elevation * 57.29578)


def write_head_card(
    folder: Path,
    *,
    config: HeadPolicyConfig,
    command: str,
    data: str,
    seed: int,
    trained: Mapping[str, Any],
    scores: Sequence[Mapping[str, Any]],
) -> None:
    """Write ``README.md`` into the folder of a published head.

    Parameters
    ----------
    folder : Path
        The folder.
    config : HeadPolicyConfig
        What the folder holds.
    command, data, seed
        What made it; from which data, and which splits of them.
    trained : mapping
        Trials, scenes, steps and seconds of the training.
    scores : sequence of mapping
        Rows of ``scripts/train_heads.py``: objects, whether collisions are filtered, trials, success, secure.
    """
    use = _evaluated(folder)
    text = _HEAD.format(name=config.name, version=graspbox.__version__, hand=config.hand, use=use, more="")
    text += "| objects | trials | success | secure |\n|---|--:|--:|--:|\n"
    for row in scores:
        name = f"`{row['objects']}`{', collisions filtered' if row['filtered'] else ''}"
        cells = [rate(row[key], row["trials"]) for key in ("success", "secure")]
        text += f"| {name} | {row['trials']} | {cells[0]} | {cells[1]} |\n"
    text += f"\n## Data and training\n\n```\n{command}\n```\n\nSeed {seed}. {trained['trials']} trials in "
    text += f"{trained['scenes']} scenes of {data}; {trained['step']} steps"
    text += f" in {shown_time(trained['seconds'])}.\n"
    write_text(folder / "README.md", text + _limits(SceneConfig()) + LICENCE)
