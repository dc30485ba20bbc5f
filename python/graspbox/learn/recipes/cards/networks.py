"""Scores and cards of end-to-end networks: policies of Stable-Baselines3, and networks of the study."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspbox import evaluation, object_sets
from graspbox.envs.spaces import tables
from graspbox.hands import load_hand
from graspbox.learn.recipes.cards.writing import ScoreRow, listed, write_card
from graspbox.learn.sb3.histories import TrainingStep
from graspbox.policies import Policy
from graspbox.policies.published.configs import NetworkPolicyConfig
from graspbox.policies.published.folders import hand_of

__all__ = ["ObjectSetScore", "measure", "object_set", "write_network_card"]


@dataclass(frozen=True)
class ObjectSetScore:
    """The trials of a policy on a set of objects, in command-line syntax: ``NAME`` or ``NAME/SPLIT``."""

    objects: str
    result: evaluation.Evaluation

    def row(self) -> ScoreRow:
        """Return the row of a card, with the objects that were left out and the most frequent failures."""
        result = self.result
        most = sorted(result.failures.items(), key=lambda item: -item[1])[:3]
        more = {
            "left out": f"{result.objects_left_out} of {result.objects_given}",
            "most frequent failures": ", ".join(f"{count} {kind}" for kind, count in most),
        }
        counts = (len(result.trials), result.succeeded, result.secure)
        return ScoreRow(self.objects, result.env_id, *counts, more=more)


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
) -> list[ObjectSetScore]:
    """Evaluate a published policy on sets of objects, ``NAME`` or ``NAME/SPLIT``, as `graspbox.evaluation.evaluate`.

    `progress` is called with the number of finished trials of all sets.
    """
    scores = []
    for i, name in enumerate(objects):

        def done(count: int, before: int = i * trials) -> None:
            progress(before + count)

        result = evaluation.evaluate(policy, None, object_set(name), trials, seed, progress=done, **settings)
        scores.append(ObjectSetScore(name, result))
    return scores


def write_network_card(
    folder: Path,
    config: NetworkPolicyConfig,
    steps: Sequence[TrainingStep],
    scores: Sequence[ScoreRow],
    *,
    seed: int,
    command: str,
) -> None:
    """Write the card of a policy of Stable-Baselines3, from the training steps that produced it, and its scores.

    The seed is that of the trials; the command published the policy.
    """
    simulated = {*tables(load_hand(hand_of(folder, config)))["privileged"], "segmentation", "amodal", "achieved"}
    # In goal tasks a vector or an image is named by its entry.
    meant = {"observation": str(config.environment.obs)}
    sets = []
    for objects in (step.objects for step in steps if step.objects):
        names, split = objects["objects"], objects.get("split")
        sets.append(listed((names,) if isinstance(names, str) else names) + (f", split `{split}`" if split else ""))
    write_card(
        folder,
        config,
        Path(__file__).parent / "network.md.jinja",
        scores,
        command="\n".join((*(step.command for step in steps), command)),
        seed=seed,
        steps=steps,
        origin=_origin([step.kind for step in steps], config.algorithm),
        privileged=[name for name in config.environment.names if meant.get(name, name).split("_")[0] in simulated],
        sets=list(dict.fromkeys(sets)),
        environment=", ".join(f"`{name}={value!r}`" for name, value in config.settings.items()),
    )


def _origin(steps: Sequence[str], algorithm: str) -> str:
    if steps[-1] == "student":
        return f"A student of a policy that knows the state, a policy of Stable-Baselines3's {algorithm.upper()}"
    if steps[-1] == "clone":
        return f"A clone of demonstrations, a policy of Stable-Baselines3's {algorithm.upper()}"
    return f"A policy trained by rewards with Stable-Baselines3's {algorithm.upper()}"
