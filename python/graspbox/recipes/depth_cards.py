"""Cards of policies that use one depth image: `DepthGrasp`, `HeadGrasp` and `FeelThenLift`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from graspbox._common.progress import shown_time
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.folders import hand_of, load
from graspbox.dataset.learned import evaluated_split
from graspbox.hands import load_hand
from graspbox.models.scenes import SceneConfig
from graspbox.models.stability.inputs import StabilityInputs
from graspbox.perception.configs import FinderConfig
from graspbox.recipes.cards import Card, ScoreRow, code, listed, paragraph, rate, table, times, training_of
from graspbox.recipes.settings.depth import HEAD_OF_ROUNDS

__all__ = ["any_hand_card", "depth_card", "feel_card", "head_card"]

_DECISION, _GRASP = "graspbox/GraspPose-v0", "graspbox/Grasp-v0"
_SUMMARY = "Grasps an object on a table from one depth image; it needs neither a mesh nor the object's true pose."
_SEVERAL = (
    "It looks at everything on the table at once, and clears scenes of several objects in `graspbox/Clear-v0`, one "
    "attempt after another."
)
_METHOD = (
    f"First attempts in `{_DECISION}`, on objects that were not used in training; the depth images have the noise of a "
    "real camera."
)

Stages = Mapping[str, Mapping[str, Any]]


def _use(folder: Path) -> str:
    return f"graspbox evaluate {folder} --objects procedural:unseen:0-19"


def _limits(scenes: SceneConfig) -> tuple[str, ...]:
    near, far = scenes.distance
    return (
        f"What is on the flat table fits a cube of 0.3 m. The camera is {near} to {far} m away, at least "
        f"{scenes.elevation * 57.29578:.0f} degrees above the table.",
        "Depth images have the noise of a structured-light sensor. Such sensors do not measure transparent and shiny "
        "surfaces; the training images show none.",
        "Masses and friction are those of the simulation. The probabilities hold there, not on a real arm.",
    )


def depth_card(
    folder: Path, config: DepthPolicyConfig, *, command: str, settings: Any, scenes: SceneConfig, stages: Stages
) -> Card:
    """Describe a policy of one depth image.

    Parameters
    ----------
    folder : Path
        Its folder.
    config : DepthPolicyConfig
        Its description.
    command : str
        The command that trained it.
    settings : Settings
        Arguments of the training (`graspbox.recipes.depth`).
    scenes : SceneConfig
        How training scenes were rendered.
    stages : mapping
        Results of each stage by name, with its seconds.
    """
    scores = []
    for objects, found in stages["evaluate"].items():
        if objects != "seconds":
            counts = (found["trials"], found["succeeded"], found["secure"])
            scores.append(ScoreRow(_with_split(objects), _DECISION, *counts, more=_more(found)))
    weight, tried = config.calibration.secure_weight, []
    for name, found in stages.items():
        stage, _, count = name.partition("-")
        if stage == "calibrate":
            rates = found["rates"].items()
            tried += [(count, str(w), str(found["choices"]), f"{a:.1%}", f"{b:.1%}") for w, (a, b) in rates]
    details = paragraph(
        "ECE is the expected calibration error of the predicted probability of success. The policy takes the grasp "
        f"with the greatest (success + w secure) / (1 + w), where w = {weight}, after {config.finder.refinements} "
        f"refinements. {_lost(config.finder)}Its head adds grasps {_asked(config.finder)}. Settings on held-out scenes:"
    )
    if (widest := load_hand(hand_of(folder, config)).widest) < math.inf:
        details = (
            paragraph(f"An object fits if its least width in plan view, as it rests, is at most {1e3 * widest:.0f} mm.")
            + "\n\n"
            + details
        )
    columns = ("refinements", "w", "scenes", "success", "secure")
    fresh = f"{listed(settings.fresh)}, in scenes of the layout {listed(settings.layout)}"
    before = ""
    if trained := [found for found in stages.values() if "on_policy" in found]:
        trials, on_policy = (max(found[name] for found in trained) for name in ("trials", "on_policy"))
        learned = f"{trials} trials of {listed(settings.data or settings.objects)} (split `train`), then {on_policy} "
        learned += f"trials of grasps that the policy chose on {fresh}."
    else:
        learned = f"The networks are those of `{settings.start}`, calibrated on {fresh}."
        if earlier := training_of(settings.start):
            before = f"\n\n### How its networks were trained\n\n{earlier}"
    stage_table = times({name: (found["seconds"], _result(name, found)) for name, found in stages.items()})
    return Card(
        summary=_SUMMARY if settings.layout == ("single",) else f"{_SUMMARY} {_SEVERAL}",
        commands=(
            _use(folder),
            f"graspbox grasp-image DEPTH.npy --intrinsics FX FY CX CY --policy {folder}",
        ),
        method=_METHOD,
        scores=scores,
        details=f"{details}\n\n{table(columns, tried, 'r')}{_cleared(stages.get('clear', {}))}",
        training=f"{code(command)}\n\n{paragraph(f'Seed {settings.seed}. {learned}')}\n\n{stage_table}{before}",
        limits=_limits(scenes),
    )


def _lost(finder: FinderConfig) -> str:
    """Tell what grasps lose for their lever."""
    if not finder.lever_penalty:
        return ""
    return (
        f"The score loses {finder.lever_penalty:g} for each metre from the fingertips to the middle of what is near "
        "them (`HandGrid.levers`). "
    )


def _asked(finder: FinderConfig) -> str:
    """Tell where the head is asked."""
    return "always" if finder.enough is None else f"where geometry proposes fewer than {finder.enough}"


def _cleared(found: Mapping[str, Any]) -> str:
    """Describe the rounds of clearing, if there were any."""
    rows = [
        (
            row["layout"],
            f"`{_with_split(name.partition(' ')[2])}`",
            str(row["rounds"]),
            *(f"{row[key]:.1%} ({low:.1%} to {high:.1%})" for key, (low, high) in _intervals(row)),
        )
        for name, row in found.items()
        if name != "seconds"
    ]
    if not rows:
        return ""
    text = paragraph(
        "Rounds of clearing five objects in `graspbox/Clear-v0`, which end after two failed attempts in a row "
        "(`graspbox benchmark clutter`): successful attempts, and objects taken away."
    )
    return f"\n\n{text}\n\n{table(('layout', 'objects', 'rounds', 'success', 'cleared'), rows, 'r')}"


def _with_split(objects: str) -> str:
    """Name an object set with the split of its evaluation."""
    split = evaluated_split(objects)
    return f"{objects}/{split}" if split else objects


def _intervals(row: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[float]]]:
    """Name the rates of rounds, with their intervals."""
    yield "success_rate", row["success_interval"]
    yield "cleared", row["cleared_interval"]


def any_hand_card(
    folder: Path, config: DepthPolicyConfig, *, command: str, settings: Any, scenes: SceneConfig, stages: Stages
) -> Card:
    """Describe a policy for any hand; arguments as of `depth_card`."""
    scores, hands = [], []
    for stage, found in stages.items():
        name = stage.removeprefix("evaluate-")
        if name == stage:
            continue
        if found["trained"]:
            hands.append(name)
        for objects in settings.evaluated:
            split, row = evaluated_split(objects), found[objects]
            called = f"{objects}/{split}" if split else objects
            counts = (row["trials"], row["succeeded"], row["secure"])
            variant = f"hand `{name}`" + ("" if found["trained"] else ", of which nothing was learned")
            fitting = row["fitting"]["succeeded"], row["fitting"]["trials"]
            # Runs of earlier versions have no calibration error.
            more = {"ECE": f"{error:.3f}"} if (error := row.get("calibration_error")) is not None else {}
            more |= {"objects that fit: success": rate(*fitting)} if fitting[1] else {}
            scores.append(ScoreRow(called, _DECISION, *counts, variant=variant, more=more))
    first, calibrated = stages["trials"]["train"], stages["calibrate"]
    rounds = [found["train"]["trials"] for name, found in stages.items() if name.startswith("collect")]
    learned = f"Seed {settings.seed}. {first['trials']} trials of grasps that geometry proposes, with {first['hands']} "
    named = f"{listed(hands)}, " if hands else ""
    learned += f"hands: {named}{settings.jaws} random parallel jaws and {settings.fingers} random hands with "
    learned += (
        f"fingers; then {sum(rounds)} trials of grasps that the policy chose. Objects: {listed(settings.objects)}."
    )
    details = "ECE is the expected calibration error of the predicted probability of success, calibrated once for all "
    details += "hands. An object fits if its least width in plan view, as it rests, is at most that of the hand. "
    weight = calibrated["secure_weight"]
    details += f"The policy takes the grasp with the greatest (success + w secure) / (1 + w), where w = {weight}."
    return Card(
        summary=f"{_SUMMARY} It grasps with any hand, also one of which nothing was learned: its scorer reads the "
        "description of the hand. Where no hand is named it takes the one below.",
        commands=(
            f"{_use(folder)} --hand panda_gripper",
            f"{_use(folder)} --hand hand.urdf,hand.toml",
        ),
        method=_METHOD,
        scores=scores,
        details=paragraph(details),
        training=f"{code(command)}\n\n{paragraph(learned)}\n\n"
        + times({name: (found["seconds"], "") for name, found in stages.items()}),
        limits=_limits(scenes),
    )


def _more(found: Mapping[str, Any]) -> dict[str, str]:
    """Format further columns of the scores: calibration, and the rate where some objects do not fit the hand."""
    more = {"ECE": f"{found['ece']:.3f}"}
    # Runs of earlier versions have no counts of objects that fit.
    if (fitting := found.get("fitting", found))["trials"] < found["trials"]:
        counts = fitting["succeeded"], fitting["trials"]
        more["objects that fit: trials"], more["objects that fit: success"] = str(counts[1]), rate(*counts)
    return more


def _result(name: str, found: Mapping[str, Any]) -> str:
    """Summarize the result of a stage, unless it has its own table."""
    if name.startswith("collect"):
        return "; ".join(
            f"{split}: {part['trials']} trials, {part['success']:.1%} success, {part['secure']:.1%} secure"
            for split, part in found.items()
            if split != "seconds"
        )
    if name.startswith("calibrate") or name in ("evaluate", "export", "ablations", "clear"):
        return ""
    if name == "data":
        return f"{found['train']} trials for training, {found['validation']} for validation"
    adopted = f"that of the policy `{found['policy']}`" if "policy" in found else ""
    if "steps" not in found:
        return adopted
    held = "first choices that held"
    measure = {"completion": "overlap (IoU)", "head": held, HEAD_OF_ROUNDS: held}.get(name, "AUC")
    trained = f"{found['steps']} steps, {measure} {found['best']:.3f}"
    return f"{adopted}, trained further: {trained}" if adopted else trained


def head_card(
    folder: Path, *, command: str, data: str, seed: int, trained: Mapping[str, Any], scores: Sequence[Mapping[str, Any]]
) -> Card:
    """Describe a published head.

    Parameters
    ----------
    folder : Path
        Its folder.
    command, data, seed
        Command of the training; its data sets and their splits; the seed.
    trained : mapping
        Trials, scenes, steps and seconds of the training.
    scores : sequence of mapping
        Rows with objects, whether collisions are filtered, trials, success, secure.
    """
    rows = [
        ScoreRow(
            row["objects"],
            _DECISION,
            row["trials"],
            row["success"],
            row["secure"],
            "collisions filtered" if row["filtered"] else "unfiltered",
        )
        for row in scores
    ]
    learned = (
        f"Seed {seed}. {trained['trials']} trials in {trained['scenes']} scenes of {data}; {trained['step']} steps in "
        f"{shown_time(trained['seconds'])}."
    )
    return Card(
        summary=_SUMMARY,
        commands=(_use(folder),),
        method=_METHOD,
        scores=rows,
        training=f"{code(command)}\n\n{paragraph(learned)}",
        limits=_limits(SceneConfig()),
    )


def feel_card(folder: Path, settings: Any, command: str, stages: Stages) -> Card:
    """Describe a policy that checks grasp stability before it lifts.

    Parameters
    ----------
    folder : Path
        Its folder.
    settings : FeelSettings
        Arguments of the training (`graspbox.recipes.feel`).
    command : str
        The command that trained it.
    stages : mapping
        Results of each stage by name, with its seconds.
    """
    found = {objects: part for objects, part in stages["evaluate"].items() if objects != "seconds"}
    scores, paired = [], []
    for objects, part in found.items():
        first, feel, trials = part["first"], part["feel"], part["first"]["trials"]
        more = {
            "success, first attempt": rate(first["succeeded"], trials),
            "secure, first attempt": rate(first["secure"], trials),
            "success, perfect prediction": rate(part["perfect"], trials),
        }
        called, kept = _with_split(objects), (feel["succeeded"], feel["secure"])
        scores.append(ScoreRow(called, _GRASP, trials, *kept, "paired trials", more))
        counts = [str(feel[key]) for key in ("opened", "rightly", "saved", "lost")]
        measures = [f"{part['auc']:.3f}", f"{part['ece']:.3f}", f"{first['steps']}", f"{feel['steps']}"]
        paired.append([f"`{called}`", *counts, *measures])
    columns = ("objects", "opened", "rightly", "saved", "lost", "AUC", "ECE", "steps, first attempt", "steps")
    details = paragraph(
        f"The hand opens where the predicted probability that the grasp holds is below "
        f"{stages['threshold']['threshold']:.2f}. *Rightly*: the first grasp would not have held. *Saved*: of these, "
        "the second grasp held. *Lost*: the first grasp would have held, but the second one did not. AUC is the area "
        "under the ROC curve of the predicted probability, ECE its expected calibration error; steps are those of a "
        "successful trial, on average. *Perfect prediction* opens exactly where the first grasp does not hold."
    )
    train = stages["record-train"]
    learned = paragraph(
        f"Seed {settings.seed}. {train['trials']} grasps of `{settings.objects}`, {train['held']:.1%} of which held. "
        f"Validation, calibration and the choice of the threshold used {stages['record-held-out']['trials']} grasps of "
        f"`{settings.held_out}`. Sensors are read {' and '.join(f'{time} s' for time in settings.times)} after closing "
        "begins."
    )
    stage_table = times({name: (part["seconds"], "") for name, part in stages.items()})
    sensors = StabilityInputs(load_hand(hand_of(folder, load(folder)))).sensors
    return Card(
        summary="Grasps an object on a table from one depth image, closes the fingers, and predicts from its sensors "
        "whether the grasp will hold. If not, it opens, looks again and tries one other grasp. The policy "
        f"`{settings.policy.name}` looks and chooses the grasps: the one that `config.json` names by its hash, in the "
        "folder given there or installed.",
        commands=(_use(folder),),
        method=f"Trials in `{_GRASP}`. Paired trials run the same scenes with the first attempt alone and with a "
        "second one.",
        scores=scores,
        details=f"{details}\n\n{table(columns, paired)}\n\n![Success against the threshold, and reliability](feel.png)",
        training=f"{code(command)}\n\n{learned}\n\n{stage_table}",
        limits=(
            f"Those of the policy that chooses the grasps; see the card of `{settings.policy.name}`.",
            f"It reads the sensors of the simulated hand, {listed(sensors)}, without the noise of real sensors.",
            "There is one second attempt, which is lifted in any case.",
        ),
    )
