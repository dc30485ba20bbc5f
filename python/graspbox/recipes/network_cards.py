"""Scores and cards of end-to-end networks: policies of Stable-Baselines3, and networks of the study."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspbox import evaluation, object_sets
from graspbox._common.progress import shown_time
from graspbox.artifacts.configs import GOAL_NAME, NetworkPolicyConfig
from graspbox.artifacts.folders import hand_of
from graspbox.envs.spaces import tables
from graspbox.hands import load_hand
from graspbox.policies import Policy
from graspbox.recipes.cards import Card, ScoreRow, code, listed, paragraph, table
from graspbox.study.pose_folders import PosePolicyConfig

__all__ = ["Score", "measure", "network_card", "object_set", "pose_card"]

_SEES = {"image": "a grey image", "binary": "occupied voxels", "ternary": "occupied, free and unseen voxels"}


@dataclass(frozen=True)
class Score:
    """The trials of a policy on a set of objects.

    Attributes
    ----------
    objects : str
        The set, in command-line syntax: ``NAME`` or ``NAME/SPLIT``.
    result : Evaluation
        The trials.
    """

    objects: str
    result: evaluation.Evaluation

    def row(self) -> ScoreRow:
        """Return the row of a card, with the objects that were left out and the most frequent failures."""
        found = self.result
        most = sorted(found.failures.items(), key=lambda item: -item[1])[:3]
        more = {
            "left out": f"{found.objects_left_out} of {found.objects_given}",
            "most frequent failures": ", ".join(f"{count} {kind}" for kind, count in most),
        }
        counts = (len(found.trials), found.succeeded, found.secure)
        return ScoreRow(self.objects, found.env_id, *counts, more=more)


def object_set(source: str) -> object_sets.ObjectSet:
    """Find the objects of ``NAME`` or ``NAME/SPLIT``; raises as `graspbox.object_sets.load`."""
    name, split = object_sets.name_and_split(source)
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
        Number of trials per set, and their seed.
    progress : callable
        Called with the number of finished trials of all sets.
    **settings
        As for `graspbox.evaluation.evaluate`.
    """
    scores = []
    for i, name in enumerate(objects):

        def done(count: int, before: int = i * trials) -> None:
            progress(before + count)

        result = evaluation.evaluate(policy, None, object_set(name), trials, seed, progress=done, **settings)
        scores.append(Score(name, result))
    return scores


def _measured(seed: int) -> str:
    return (
        f"First attempts, seed {seed} of the trials, measured on this folder with onnxruntime. *Left out* counts the "
        "objects that were used in training."
    )


def network_card(
    folder: Path,
    config: NetworkPolicyConfig,
    made: Sequence[Any],
    scores: Sequence[ScoreRow],
    *,
    seed: int,
    command: str,
) -> Card:
    """Describe a policy of Stable-Baselines3.

    Parameters
    ----------
    folder : Path
        Its folder.
    config : NetworkPolicyConfig
        Its description.
    made : sequence of graspbox.sb3.histories.Made
        Training steps that produced it.
    scores : sequence of ScoreRow
        Its scores.
    seed : int
        Seed of their trials.
    command : str
        The command that published it.
    """
    names = config.environment.names
    privileged = {*tables(load_hand(hand_of(folder, config)))["privileged"], "segmentation", "amodal"}
    true = [name for name in names if name.split("_")[0] in privileged]
    summary = (
        f"{_origin([one.kind for one in made], config.algorithm)}: one network from observations to actions. It acts "
        f"in `{config.environment.id}` and observes {listed(names)}."
    )
    if GOAL_NAME in config.uses:
        summary += (
            f" The observation `goal` is the grasp that the policy in `{config.uses[GOAL_NAME].policy}` finds in one "
            "depth image, as soon as the hand has left the image. That folder must be present; its card names its "
            "training objects."
        )
    if true:
        summary += f" It is **privileged**: no sensor measures {listed(true)}; the simulation gives it."
    steps = [(one.kind, one.told, "-" if one.seconds is None else shown_time(one.seconds)) for one in made]
    training = (
        f"{code(*(one.command for one in made), command)}\n\n{table(('step', 'description', 'time'), steps, 'll')}"
    )
    learned = [one.objects for one in made if one.objects]
    sets = list(dict.fromkeys(listed(_names(one["objects"])) + _split(one.get("split")) for one in learned))
    training += f"\n\nTraining objects: {'; and '.join(sets)}." if sets else ""
    settings = ", ".join(f"`{name}={value!r}`" for name, value in config.settings.items())
    return Card(
        summary=summary,
        commands=(f"graspbox evaluate policies/{config.name} --objects procedural:unseen:0-19",),
        method=_measured(seed),
        scores=scores,
        training=training,
        limits=(
            f"It acts with the environment settings in `config.json` alone: {settings}.",
            "One object on a flat table. Masses and friction are those of the simulation, and sensors have no noise "
            "besides that of the environment.",
            "The scores are those of one training; other seeds may give others.",
        ),
    )


def _origin(steps: Sequence[str], algorithm: str) -> str:
    if steps[-1] == "clone":
        return f"A clone of demonstrations, a policy of Stable-Baselines3's {algorithm.upper()}"
    if "clone" in steps:
        return f"A clone of demonstrations, fine-tuned by rewards with Stable-Baselines3's {algorithm.upper()}"
    return f"A policy trained by rewards with Stable-Baselines3's {algorithm.upper()}"


def _names(objects: Any) -> Sequence[str]:
    return (objects,) if isinstance(objects, str) else objects


def _split(split: str | None) -> str:
    return f", split `{split}`" if split else ""


def pose_card(
    config: PosePolicyConfig,
    scores: Sequence[ScoreRow],
    *,
    seed: int,
    command: str,
    limit: float,
    facts: Mapping[str, str],
    others: str,
) -> Card:
    """Describe a network of the study.

    Parameters
    ----------
    config : PosePolicyConfig
        Its description.
    scores : sequence of ScoreRow
        Its scores.
    seed : int
        Seed of their trials.
    command : str
        The command that trained and published it.
    limit : float
        Greatest size of a published network, megabytes.
    facts : mapping
        Facts about its training, by name.
    others : str
        A table of the candidate networks, and the selection criterion.
    """
    model = config.model
    listing = "\n".join(paragraph(f"- {name}: {value}", "  ") for name, value in facts.items())
    return Card(
        summary=f"A network of the reference study, `{model.network}` with the loss `{model.loss}`: from "
        f"{_SEES[model.kind]} of an object to one grasp pose.",
        commands=(f"graspbox evaluate policies/{config.name} --objects procedural:unseen:0-19",),
        method=_measured(seed),
        scores=scores,
        training=f"{code(command)}\n\n{listing}\n\n{others}",
        limits=(
            "It documents the study's networks; other policies grasp better.",
            "Its camera is where the study had it, 0.7 m away and 45 degrees above the table, without noise; the pose "
            "of the camera is known.",
            "It learned from few objects, each seen from one side, and predicts one pose, with the preshape "
            f"{model.preshape:.4f} rad.",
            f"Networks whose weights take more than {limit:.0f} MB are not published.",
        ),
    )
