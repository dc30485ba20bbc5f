"""Cards of networks that act by themselves: policies of Stable-Baselines3, and networks of the study; torch-free."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import graspbox
from graspbox import evaluation, object_sets
from graspbox.envs.spaces import tables
from graspbox.files import write_text
from graspbox.learning.pose_folders import PosePolicyConfig
from graspbox.policies import Policy
from graspbox.policies.network_folders import NetworkPolicyConfig
from graspbox.policy_training.cards import LICENCE, rate
from graspbox.progress import shown_time
from graspbox.simulation import load_hand

__all__ = ["Score", "measure", "object_set", "write_network_card", "write_pose_card"]

_SCORES = """## Scores

First attempt in `{env_id}`, seed {seed} of the trials. In brackets the 95 % intervals (Wilson).
*Known* is how many objects were left out because it learned from them. The folder was measured as it is, by
onnxruntime.

| objects | known | trials | success | secure | most frequent failures |
|---|--:|--:|--:|--:|---|
"""

_NETWORK = """# {name}

{what}

```
graspbox evaluate policies/{name} --objects procedural:unseen:0-19
```

"""

_NETWORK_LIMITS = """
## Limits

{first}
- One object on a flat table; masses and friction are those of the simulation, and sensors have no noise that the
  environment does not add.
- Its scores are those of one training; other seeds may give others.
"""

_POSE = """# {name}

A network of the reference study, `{network}` with the loss `{loss}`: from {sees} of an object to one grasp
pose. Made by graspbox {version}, for the hand `{hand}`.

```
graspbox evaluate policies/{name} --objects procedural:unseen:0-19
```

"""

_POSE_LIMITS = """
## Limits

- It stands for what the study's networks can do, not for a policy that is worth using: see `docs/study.md`.
- It sees a camera where the study had it, 0.7 m away and 45 degrees above the table, without noise; the camera's pose
  is known.
- It learned from few objects, each seen from one side, and predicts one pose, with the preshape {preshape:.4f} rad.
- Networks with more weights than {limit:.0f} MB hold are not published.
"""

_SEES = {"image": "a grey image", "binary": "occupied voxels", "ternary": "occupied, free and unseen voxels"}


@dataclass(frozen=True)
class Score:
    """What a policy did on a set of objects.

    Attributes
    ----------
    objects : str
        The set, as the command line has it: ``NAME`` or ``NAME/SPLIT``.
    count, known : int
        Number of its objects, and how many of them were left out since the policy learned from them.
    result : Evaluation
        The trials.
    """

    objects: str
    count: int
    known: int
    result: evaluation.Evaluation


def object_set(given: str) -> object_sets.ObjectSet:
    """Find the objects of ``NAME`` or ``NAME/SPLIT``; raises as `graspbox.object_sets.load`."""
    name, split = object_sets.name_and_split(given)
    return object_sets.load(name, split=split)


def measure(
    policy: Policy | str,
    objects: Sequence[str],
    trials: int,
    seed: int,
    *,
    progress: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> list[Score]:
    """Evaluate a published policy on sets of objects.

    Parameters
    ----------
    policy : Policy or str
        The policy, or its folder.
    objects : sequence of str
        Sets: ``NAME`` or ``NAME/SPLIT``.
    trials, seed : int
        Of each set.
    progress : callable
        Called with the number of finished trials of all sets.
    **settings
        As for `graspbox.evaluation.evaluate`.
    """
    scores = []
    for i, name in enumerate(objects):
        found = object_set(name)

        def done(count: int, before: int = i * trials) -> None:
            progress(before + count)

        result = evaluation.evaluate(policy, None, found, trials, seed, progress=done, **settings)
        scores.append(Score(name, result.objects_given, result.objects_left_out, result))
    return scores


def _table(scores: Sequence[Score], seed: int) -> str:
    text = _SCORES.format(env_id=scores[0].result.env_id if scores else "", seed=seed)
    for score in scores:
        result, trials = score.result, len(score.result.trials)
        cells = [rate(count, trials) for count in (result.succeeded, result.secure)]
        most = sorted(result.failures.items(), key=lambda item: -item[1])[:3]
        failures = ", ".join(f"{count} {kind}" for kind, count in most)
        known = f"{score.known} of {score.count}"
        text += f"| `{score.objects}` | {known} | {trials} | {' | '.join(cells)} | {failures} |\n"
    return text


def write_network_card(
    folder: Path, config: NetworkPolicyConfig, made: Sequence[Any], scores: Sequence[Score], *, seed: int, command: str
) -> None:
    """Write ``README.md`` into the folder of a policy of Stable-Baselines3.

    Parameters
    ----------
    folder : Path
        The folder.
    config : NetworkPolicyConfig
        What it holds.
    made : sequence of graspbox.sb3.histories.Made
        The steps that made it.
    scores : sequence of Score
        Its scores.
    seed : int
        Seed of their trials.
    command : str
        What published it.
    """
    names = (config.obs,) if isinstance(config.obs, str) else config.obs
    hand = config.settings["hand"]
    true = [name for name in names if name.split("_")[0] in {*tables(load_hand(hand))["privileged"], "segmentation"}]
    what = (
        f"{_what([one.what for one in made], config.algorithm)}, one network from observations to actions. It acts in "
        f"`{config.env_id}` and observes {_listed(names)}. Made by graspbox {graspbox.__version__}, for the hand "
        f"`{hand}`."
    )
    if config.goal_from:
        what += (
            f" The observation `goal` is the grasp that the policy in `{config.goal_from}` finds in one depth image, "
            "as soon as the hand has left the image. That policy must lie there; its card tells what it learned from."
        )
    if true:
        what += f" It is **privileged**: no sensor measures {_listed(true)}, which the simulation tells."
    text = _NETWORK.format(name=config.name, what=_filled(what))
    text += _table(scores, seed) + "\n## Data and training\n\n"
    lines = "\n".join([*(one.command for one in made), command])
    text += f"```\n{lines}\n```\n\n| step | what | time |\n|---|---|--:|\n"
    for one in made:
        text += f"| {one.what} | {one.told} | {'-' if one.seconds is None else shown_time(one.seconds)} |\n"
    learned = [one.objects for one in made if one.objects]
    sets = list(dict.fromkeys(_listed(_names(one["objects"])) + _split(one.get("split")) for one in learned))
    text += f"\nIt learned from {'; and from '.join(sets)}.\n" if sets else ""
    settings = ", ".join(f"`{name}={value!r}`" for name, value in config.settings.items())
    first = _filled(f"- It acts with the environment settings of `config.json` alone: {settings}.").replace(
        "\n", "\n  "
    )
    write_text(folder / "README.md", text + _NETWORK_LIMITS.format(first=first) + LICENCE)


def _filled(text: str) -> str:
    return textwrap.fill(text, 119, break_long_words=False, break_on_hyphens=False)


def _what(steps: Sequence[str], algorithm: str) -> str:
    if steps[-1] == "clone":
        return f"A clone of demonstrations, a policy of Stable-Baselines3's {algorithm.upper()}"
    if "clone" in steps:
        return f"A clone of demonstrations tuned by rewards with Stable-Baselines3's {algorithm.upper()}"
    return f"A policy that Stable-Baselines3's {algorithm.upper()} learned from rewards"


def _names(objects: Any) -> Sequence[str]:
    return (objects,) if isinstance(objects, str) else objects


def _listed(names: Sequence[str]) -> str:
    quoted = [f"`{name}`" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def _split(split: str | None) -> str:
    return f", split `{split}`" if split else ""


def write_pose_card(
    folder: Path,
    config: PosePolicyConfig,
    scores: Sequence[Score],
    *,
    seed: int,
    command: str,
    limit: float,
    facts: Mapping[str, str],
    others: str,
) -> None:
    """Write ``README.md`` into the folder of a published network of the study.

    Parameters
    ----------
    folder : Path
        The folder.
    config : PosePolicyConfig
        What it holds.
    scores : sequence of Score
        Its scores.
    seed : int
        Seed of their trials.
    command : str
        What trained and published it.
    limit : float
        Most megabytes of a published network.
    facts : mapping
        Facts about its training, by name.
    others : str
        A table of the networks that it was chosen from, and what by.
    """
    model = config.model
    text = _POSE.format(
        name=config.name,
        network=model.network,
        loss=model.loss,
        sees=_SEES[model.kind],
        version=graspbox.__version__,
        hand=config.hand,
    )
    text += _table(scores, seed) + f"\n## Data and training\n\n```\n{command}\n```\n\n"
    text += "".join(f"- {name}: {value}\n" for name, value in facts.items()) + f"\n{others}"
    write_text(folder / "README.md", text + _POSE_LIMITS.format(preshape=model.preshape, limit=limit) + LICENCE)
