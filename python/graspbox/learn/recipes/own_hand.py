"""``graspbox hand train``: from the file of a hand to a policy, by the steps that other commands have.

`graspbox.learn.recipes.settings.own_hand.OwnHandSettings` describes the stages.
"""

import re
import shlex
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from graspbox import load_hand, pictures
from graspbox._common.files import write_text
from graspbox._common.imports import imported
from graspbox._common.progress import shown_time
from graspbox._common.runs import Run
from graspbox.errors import ConfigError, HandError
from graspbox.hand_tools import GuessedHand, check_hand
from graspbox.hand_tools.guessing import Guess, begin_guess
from graspbox.hand_tools.searching import Budget, search_hand
from graspbox.hands import Hand
from graspbox.hands.loading import AssumedWarning
from graspbox.learn.recipes import depth
from graspbox.learn.recipes.collection import unlearned
from graspbox.learn.recipes.depth.evaluate import evaluated
from graspbox.learn.recipes.settings.own_hand import OwnHandSettings
from graspbox.learn.recipes.stages import Stage, run_stages
from graspbox.learn.training.options import TrainingOutcome
from graspbox.policies import DepthGrasp
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import read_depth_policy

__all__ = ["train"]

#: Simulated grasps of the search with ``--quick``.
_QUICK_SEARCH = 48
#: Stages that evaluate a policy, and which.
_POLICIES = {
    "start": "the policy of many hands",
    "tuned": "after this hand's trials it",
    "own": "the hand's own policy",
}


@dataclass(frozen=True, eq=False)
class _Context:
    """What the stages share.

    `guess` is None once the hand is known; `given` is the hand, if the user has its ``hand.toml``.
    """

    settings: OwnHandSettings
    command: str
    echo: Callable[[str], None]
    guess: Guess | None
    given: Hand | None

    @property
    def files(self) -> tuple[Path, Path]:
        """The two files of the hand."""
        return self.settings.out / "hand" / "hand.urdf", self.settings.out / "hand" / "hand.toml"


def train(settings: OwnHandSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox hand train``: all stages.

    Raises
    ------
    HandError, FileError
        If the file describes no hand, before anything is written; or if the check finds an error.
    ConfigError
        If the folder holds a run of another file or with other settings, or there is no policy to begin with.
    MissingExtraError
        Without a package that a stage needs.
    """
    kept, command = settings.kept(), command.replace("graspbox train hand", "graspbox hand train", 1)
    _check_needs(settings)
    with warnings.catch_warnings():
        # The first stage logs what the file does not state.
        warnings.simplefilter("ignore", AssumedWarning)
        guess, given = None, None
        if not (settings.out / "hand.json").exists():
            if settings.given is None:
                guess = begin_guess(settings.file, settings.name, base=settings.base)
            else:
                given = load_hand(settings.given)
        with settings.run(echo, kept) as run:
            run_stages(run, _Context(settings, command, echo, guess, given), _stages(settings))
            return _outcome(settings, run, command)


def _check_needs(settings: OwnHandSettings) -> None:
    """Find what later stages lack before minutes of search."""
    start, completion = (read_depth_policy(folder_of(policy)) for policy in (settings.start, settings.completion))
    if start.hand_numbers is None:
        raise ConfigError(f"--start is {settings.start!r}, a policy of the hand {start.hand!r}; name one of many hands")
    for objects in settings.tested[0]:
        unlearned(objects, [*start.learned_from, *completion.learned_from])
    for package, extra in (("cmaes", "search"), ("pyarrow", "data")):
        imported(package, f"graspbox hand train needs the package {package}", extra)


def _stages(settings: OwnHandSettings) -> Iterator[Stage[_Context]]:
    """List the stages in order."""
    minutes, unlimited = settings.minutes, float("inf")
    yield Stage("hand", minutes.search / 60, _make_hand)
    yield Stage("check", unlimited, _check)
    yield Stage("start", unlimited, _evaluate_start)
    yield Stage("tuned", minutes.tuned / 60, partial(_train_policy, own=False))
    if settings.own_rounds:
        yield Stage("own", minutes.own / 60, partial(_train_policy, own=True))


def _make_hand(context: _Context, stage: Run) -> dict[str, Any]:
    """Search for the hand's posture, or copy the files of the given hand; write both files."""
    results: dict[str, Any] = {}
    if (hand := context.given) is None:
        assert context.guess is not None
        found, results = _search(context.guess, context.settings, stage)
        fitted = found.fitted
        # Assumptions name the lines of the user's file.
        hand = Hand(fitted.text, found.text, (fitted.name, "hand.toml"), fitted.assumptions)
    for path, text in zip(context.files, hand.files, strict=True):
        write_text(path, text)
    for sentence in hand.assumptions:
        stage.log(f"assumed: {sentence}")
    return {"name": hand.name, **results, "assumptions": list(hand.assumptions)}


def _search(guess: Guess, settings: OwnHandSettings, stage: Run) -> tuple[GuessedHand, dict[str, Any]]:
    """Search in the rest of the time; an interrupted search is continued by the next call."""
    budget = Budget(trials=_QUICK_SEARCH) if settings.quick else Budget(seconds=max(0.0, stage.limit - stage.seconds))

    def told(trials: int, best: float) -> None:
        share = trials / _QUICK_SEARCH if settings.quick else stage.seconds / stage.limit
        stage.report(f"{trials} grasps, best value {best:.2f}", min(1.0, share))

    found = search_hand(guess, budget, stage.folder / "search.jsonl", seed=settings.seed, told=told)
    if not found.finished:
        stage.record()
        raise KeyboardInterrupt
    return found.guessed, {"search": found.table(), "review": list(found.guessed.review)}


def _check(context: _Context, stage: Run) -> dict[str, Any]:
    """Check the hand, with a picture; errors end the run, and the next call checks again."""
    hand, picture = load_hand(context.files), stage.folder / "hand.png"
    report = check_hand(hand, seed=context.settings.seed)
    pictures.save_hand_motion(picture, hand)
    if report.has_errors:
        found = (each for each in report.findings if each.severity == "error")
        lines = (f"- {each.subject}: {each.value}: {each.message}; {each.remedy}" for each in found)
        raise HandError(
            f"{context.files[1]}: no policy can use this hand; correct the file (see {picture}), and repeat the "
            "command:\n" + "\n".join(lines)
        )
    worth = [each.row() for each in report.findings if each.severity != "note"]
    return {**report.table(), "findings": worth, "picture": str(picture)}


def _evaluate_start(context: _Context, stage: Run) -> dict[str, Any]:
    """Evaluate the policy of many hands with this hand."""
    folder, (sets, trials) = folder_of(context.settings.start), context.settings.tested
    policy = DepthGrasp(folder)
    return {"policy": str(folder), "objects": {s: evaluated(stage, policy, s, trials, context.files) for s in sets}}


def _train_policy(context: _Context, stage: Run, own: bool) -> dict[str, Any]:
    """Run or continue ``graspbox train depth``, whose run the stages `tuned` and `own` share."""
    settings, (urdf, toml) = context.settings, context.files
    hand, folder = load_hand(context.files), stage.folder / "policy"
    name = settings.name or hand.name
    options = settings.training(f"{urdf},{toml}", name, folder, fingers=len(hand.chains), own=own)
    done = depth.train(options, context.command, context.echo).results
    return {"policy": str(folder), "objects": {each: done["evaluate"][each] for each in options.evaluated}}


def _outcome(settings: OwnHandSettings, run: Run, command: str) -> TrainingOutcome:
    """Return what the stages found, and the next commands."""
    made = {name: run.stages[name] for name in _POLICIES if name in run.stages}
    shares = {name: _share(stage["objects"]) for name, stage in made.items()}
    last, best = list(made)[-1], max(shares, key=lambda name: shares[name])
    policy = str(made[last]["policy"])
    again = re.sub(r" --minutes\.own[ =]\S+", "", command)
    commands = [
        f"graspbox evaluate {shlex.quote(policy)} --objects {settings.tested[0][0]}",
        f"graspbox play {shlex.quote(policy)} --episodes 5 --video {shlex.quote(str(settings.out / 'policy.webp'))}",
        f"{again} --minutes.own {settings.more_minutes:g}",
    ]
    stages = [
        {"stage": name, "folder": str(settings.out / name), "figure": _figure(name, results), **results}
        for name, results in run.stages.items()
    ]
    rows = [f"{each['stage']:<7} {shown_time(each['seconds'])}  {each['folder']}: {each['figure']}" for each in stages]
    note = []
    if shares[best] > shares[last]:
        note = [f"{best} grasps more of these objects than {last}: the minutes were too few, or chance decided"]
    text = "\n".join([*rows, *note, "", "Evaluate it, watch it, train it further:", *commands])
    results = {"policy": policy, "best": str(made[best]["policy"]), "stages": stages, "next": commands}
    return TrainingOutcome(results, text)


def _share(objects: dict[str, dict[str, Any]]) -> float:
    """Return the share of all trials that succeeded."""
    return float(sum(each["succeeded"] for each in objects.values()) / sum(each["trials"] for each in objects.values()))


def _figure(name: str, results: dict[str, Any]) -> str:
    """Say in a line how well the hand of a stage, or its policy, grasps."""
    if "objects" in results:
        shown = (
            f"{sets} {each['rate']:.1%} ({each['ci95'][0]:.1%} to {each['ci95'][1]:.1%})"
            for sets, each in results["objects"].items()
        )
        return f"{_POLICIES[name]} grasps {', '.join(shown)}"
    if "counts" in results:
        return ", ".join(f"{count} {severity}s" for severity, count in results["counts"].items())
    if not results.get("search", {}).get("held_out"):
        return "nothing held in the search, so this is the guess" if "search" in results else "as given"
    total = results["search"]["held_out"]["all"]
    held = {which: f"{total[which]['held']} of {total[which]['asked']}" for which in ("guess", "search")}
    kept = "" if results["search"]["better"] else ", so the guess stays"
    return f"of held-out cans, boxes and balls the guess holds {held['guess']}, the search {held['search']}{kept}"
