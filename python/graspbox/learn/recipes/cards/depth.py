"""Cards of policies that use one depth image: the values of their templates."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from graspbox.hands import load_hand
from graspbox.learn.models.scenes import SceneConfig
from graspbox.learn.recipes.cards.writing import ScoreRow, rate, training_of, with_split, write_card
from graspbox.learn.recipes.settings.any_hand import AnyHandSettings
from graspbox.learn.recipes.settings.depth import HEAD_OF_ROUNDS, DepthSettings
from graspbox.learn.recipes.settings.feel import FeelSettings
from graspbox.learn.recipes.settings.head import HeadSettings
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.folders import hand_of, load
from graspbox.policies.stability_inputs import StabilityInputs

__all__ = ["Stages", "write_any_hand_card", "write_depth_card", "write_feel_card", "write_head_card"]

_HERE = Path(__file__).parent
_DECISION, _GRASP = "graspbox/GraspPose-v0", "graspbox/Grasp-v0"
#: Stages whose results have tables of their own.
_OWN_TABLES = ("calibrate", "evaluate", "export", "ablations", "clear")

#: Results of each stage of a run by name, with its seconds.
Stages = Mapping[str, Mapping[str, Any]]


def write_depth_card(
    folder: Path,
    config: DepthPolicyConfig,
    *,
    command: str,
    settings: DepthSettings,
    scenes: SceneConfig,
    stages: Stages,
) -> None:
    """Write the card of a policy of one depth image, from the training's command, options and results of its stages."""
    scores = []
    for objects, result in _by_objects(stages["evaluate"]).items():
        counts = (result["trials"], result["succeeded"], result["secure"])
        scores.append(ScoreRow(with_split(objects), _DECISION, *counts, more=_more(result)))
    scorers = [result for result in stages.values() if "on_policy" in result]
    widest = load_hand(hand_of(folder, config)).widest
    write_card(
        folder,
        config,
        _HERE / "depth.md.jinja",
        scores,
        command=command,
        settings=settings,
        scenes=scenes,
        stages=stages,
        results={name: _result(name, result) for name, result in stages.items()},
        widest=1e3 * widest if widest < math.inf else None,
        cleared=[_cleared(name, row) for name, row in _by_objects(stages.get("clear", {})).items()],
        trials=max((result["trials"] for result in scorers), default=0),
        on_policy=max((result["on_policy"] for result in scorers), default=0),
        before="" if scorers or settings.start is None else training_of(settings.start),
    )


def _by_objects(stage: Mapping[str, Any]) -> dict[str, Any]:
    """Return the results of a stage without its seconds."""
    return {name: result for name, result in stage.items() if name != "seconds"}


def _cleared(name: str, row: Mapping[str, Any]) -> dict[str, Any]:
    """Format the rounds of clearing of one layout and object set."""
    rates = {}
    for key, share in (("success", "success_rate"), ("cleared", "cleared")):
        low, high = row[f"{key}_interval"]
        rates[key] = f"{row[share]:.1%} ({low:.1%} to {high:.1%})"
    return {"layout": row["layout"], "objects": with_split(name.partition(" ")[2]), "rounds": row["rounds"], **rates}


def _more(result: Mapping[str, Any]) -> dict[str, str]:
    """Format further columns of the scores: calibration, and the rate where some objects do not fit the hand."""
    more = {"ECE": f"{result['ece']:.3f}"}
    if (fitting := result["fitting"])["trials"] < result["trials"]:
        counts = fitting["succeeded"], fitting["trials"]
        more["objects that fit: trials"], more["objects that fit: success"] = str(counts[1]), rate(*counts)
    return more


def _result(name: str, result: Mapping[str, Any]) -> str:
    """Summarize the result of a stage, unless it has its own table."""
    if name.startswith("collect"):
        return "; ".join(
            f"{split}: {part['trials']} trials, {part['success']:.1%} success, {part['secure']:.1%} secure"
            for split, part in _by_objects(result).items()
        )
    if name in _OWN_TABLES:
        return ""
    if name == "data":
        return f"{result['train']} trials for training, {result['validation']} for validation"
    adopted = f"that of the policy `{result['policy']}`" if "policy" in result else ""
    if "steps" not in result:
        return adopted
    held = "first choices that held"
    measure = {"completion": "overlap (IoU)", "head": held, HEAD_OF_ROUNDS: held}.get(name, "AUC")
    trained = f"{result['steps']} steps, {measure} {result['best']:.3f}"
    return f"{adopted}, trained further: {trained}" if adopted else trained


def write_any_hand_card(
    folder: Path,
    config: DepthPolicyConfig,
    *,
    command: str,
    settings: AnyHandSettings,
    scenes: SceneConfig,
    stages: Stages,
) -> None:
    """Write the card of a policy for any hand; arguments as of `write_depth_card`."""
    scores = []
    evaluations = {
        name.removeprefix("evaluate-"): result for name, result in stages.items() if name.startswith("evaluate-")
    }
    for name, results in evaluations.items():
        for objects in settings.evaluated:
            row = results[objects]
            counts = (row["trials"], row["succeeded"], row["secure"])
            variant = f"hand `{name}`" + ("" if results["trained"] else ", of which nothing was learned")
            fitting = row["fitting"]["succeeded"], row["fitting"]["trials"]
            more = {"ECE": f"{row['calibration_error']:.3f}"}
            more |= {"objects that fit: success": rate(*fitting)} if fitting[1] else {}
            scores.append(ScoreRow(with_split(objects), _DECISION, *counts, variant=variant, more=more))
    write_card(
        folder,
        config,
        _HERE / "any_hand.md.jinja",
        scores,
        command=command,
        settings=settings,
        scenes=scenes,
        stages=stages,
        hands=[name for name, results in evaluations.items() if results["trained"]],
        on_policy=sum(result["train"]["trials"] for name, result in stages.items() if name.startswith("collect")),
    )


def write_head_card(
    folder: Path, settings: HeadSettings, command: str, trained: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write the card of a published head, from numbers of its training and rows of its evaluation."""
    scores = []
    for row in rows:
        counts = (row["trials"], row["success"], row["secure"])
        variant = "collisions filtered" if row["filtered"] else "unfiltered"
        scores.append(ScoreRow(row["objects"], _DECISION, *counts, variant))
    values = {"command": command, "settings": settings, "scenes": SceneConfig(), "trained": trained}
    write_card(folder, load(folder), _HERE / "head.md.jinja", scores, **values)


def write_feel_card(folder: Path, settings: FeelSettings, command: str, stages: Stages) -> None:
    """Write the card of a policy that checks grasp stability before it lifts; arguments as of `write_depth_card`."""
    config, scores = load(folder), []
    evaluated = _by_objects(stages["evaluate"])
    for objects, part in evaluated.items():
        first, feel, trials = part["first"], part["feel"], part["first"]["trials"]
        more = {
            "success, first attempt": rate(first["succeeded"], trials),
            "secure, first attempt": rate(first["secure"], trials),
            "success, perfect prediction": rate(part["perfect"], trials),
        }
        counts = feel["succeeded"], feel["secure"]
        scores.append(ScoreRow(with_split(objects), _GRASP, trials, *counts, "paired trials", more))
    write_card(
        folder,
        config,
        _HERE / "feel.md.jinja",
        scores,
        command=command,
        settings=settings,
        stages=stages,
        evaluated=evaluated,
        sensors=StabilityInputs(load_hand(hand_of(folder, config))).sensors,
    )
