"""The stages that train one scorer on the trials of many hands (extra ``train``).

`graspbox.recipes.settings.any_hand.AnyHandSettings` describes each; ``graspbox train any-hand`` runs them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from graspbox import evaluation, object_sets
from graspbox.artifacts.downloads import folder_of
from graspbox.artifacts.exports import FINALISTS, export_depth_policy
from graspbox.artifacts.folders import completion_folder, read_depth_policy
from graspbox.artifacts.graphs import ScorerGraph
from graspbox.artifacts.runtimes import Completion, Scorer, onnx_network, torch_network
from graspbox.dataset.learned import evaluated_split, of_splits
from graspbox.errors import ConfigError
from graspbox.hand_tools.families import random_hand
from graspbox.hands import Hand, load_hand
from graspbox.models.calibration import Calibration, fit_logits
from graspbox.models.scene_views import SceneViews
from graspbox.models.scenes import SceneConfig, SceneSampler
from graspbox.models.scorer.inputs import ScorerInputs
from graspbox.models.scorer.shared import SHARED_SHAPE, SharedScorerNet
from graspbox.models.scorer.training import JoinedSampler, TrialSampler, fit_scorer
from graspbox.models.trials import GraspTrials
from graspbox.object_sets import learned_sets
from graspbox.perception import HandGrid, HandGridConfig
from graspbox.perception.configs import FinderConfig
from graspbox.perception.hand_settings import settings_of
from graspbox.policies import DepthGrasp
from graspbox.recipes.cards import package_licence, write_card
from graspbox.recipes.choices import SECURE_WEIGHTS, Choices, try_choices
from graspbox.recipes.collection import CollectConfig, collect, load_trials
from graspbox.recipes.depth import FINDER, reporter, results_of
from graspbox.recipes.depth_cards import any_hand_card
from graspbox.recipes.settings.any_hand import ANY_HAND_QUICK, AnyHandSettings
from graspbox.training.configs import TrainConfig
from graspbox.training.options import Outcome
from graspbox.training.runs import Run
from graspbox.training.trainer import load_weights

__all__ = ["train"]

#: Scenes that one hand collects before it is the next one's turn.
_TURN = 20
#: Proposals of a scene from which trials are taken.
_MOST = 256


@dataclass(frozen=True, eq=False)
class _TrainedHand:
    """A hand of the training.

    Attributes
    ----------
    name : str
        Its name, unique within the run.
    grid : HandGrid
        Its voxel grid.
    finder : FinderConfig
        How its grasps are proposed.
    scenes : range
        Numbers of its training scenes.
    shipped : bool
        Whether it is a real hand, not a random one.
    """

    name: str
    grid: HandGrid
    finder: FinderConfig
    scenes: range
    shipped: bool

    @property
    def collected(self) -> CollectConfig:
        """How its trials are collected."""
        proposals = replace(self.finder.proposals, most=_MOST)
        return CollectConfig(finder=replace(self.finder, proposals=proposals))


def train(settings: AnyHandSettings, command: str, echo: Callable[[str], None]) -> Outcome:
    """Run ``graspbox train any-hand``: all stages.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings, if the evaluation has only training objects, or if no hand is
        left to learn from.
    """
    if settings.quick:
        settings = replace(settings, **ANY_HAND_QUICK)
    learned = [*of_splits(settings.objects), *read_depth_policy(folder_of(settings.completion)).learned_from]
    for objects in settings.evaluated:
        if not learned_sets.without(object_sets.load(objects, split=evaluated_split(objects)), learned):
            raise ConfigError(f"--evaluated is {objects!r}; name objects from which nothing is learned")
    with settings.run(echo) as run:
        training = _AnyHandTraining(settings, run, learned)
        training.go(command)
        return Outcome({"folder": str(training.policy_folder()), **run.stages}, str(training.policy_folder()))


class _AnyHandTraining:
    """The stages of one run."""

    def __init__(self, settings: AnyHandSettings, run: Run, learned: list[str]) -> None:
        self.settings, self.sizes, self.run, self.learned = settings, settings.sizes, run, learned
        self.seed, self.out, self.scenes = settings.seed, settings.out, SceneConfig()
        self.source = folder_of(settings.completion)
        published = read_depth_policy(self.source)
        if published.crop != self.scenes.crop:
            raise ConfigError(f"the completion of {settings.completion!r} takes {published.crop}; name another policy")
        folder = completion_folder(self.source, published)
        self.completion_folder = folder
        self.completion = Completion(onnx_network(folder / "completion.onnx"))
        for name in settings.without:
            # Refused now, not by the evaluation after hours.
            load_hand(name)
        self._samplers: dict[tuple[str, int], SceneSampler] = {}
        self.hands = list(self._hands())
        if not self.hands:
            raise ConfigError("--hands, --jaws and --fingers leave no hand to learn from; name one")

    def _hands(self) -> Iterator[_TrainedHand]:
        """Make the hands: those that are named, then random ones."""
        settings, sizes = self.settings, self.sizes
        for name in settings.hands:
            if name not in settings.without:
                yield self.hand_of(name, load_hand(name), range(sizes.scenes), shipped=True)
        counts = {"jaws": settings.jaws, "fingers": settings.fingers}
        number = 0
        for family, count in counts.items():
            for index in range(count):
                start = number * sizes.random_scenes % max(1, sizes.scenes - sizes.random_scenes + 1)
                scenes = range(start, start + sizes.random_scenes)
                yield self.hand_of(f"{family}-{index}", random_hand(family, index), scenes, shipped=False)
                number += 1

    def hand_of(self, name: str, hand: Hand, scenes: range, *, shipped: bool) -> _TrainedHand:
        """Prepare a hand."""
        fitted = settings_of(hand, FINDER.proposals, shape=SHARED_SHAPE)
        grid = HandGrid(hand, fitted.grid, crop=self.scenes.crop)
        finder = replace(FINDER, proposals=fitted.proposals, predicted=0, refinements=0)
        return _TrainedHand(name, grid, finder, scenes, shipped)

    @cached_property
    def views(self) -> SceneViews:
        """Views shared by all stages."""
        return SceneViews(self.scenes, self.completion, self.seed, count=self.sizes.views)

    def sampler(self, split: object_sets.Split, seed: int) -> SceneSampler:
        """Sample scenes of a split of the objects; all hands share a sampler, which keeps its objects ready."""
        if (split, seed) not in self._samplers:
            found = object_sets.load(self.settings.objects, split=split)
            self._samplers[split, seed] = SceneSampler(found, self.scenes, seed)
        return self._samplers[split, seed]

    def go(self, command: str) -> None:
        """Run the stages."""
        hours, sizes = self.settings.hours, self.sizes

        def stage(name: str, limit: float, work: Callable[[Run], dict[str, Any]]) -> dict[str, Any]:
            return self.run.stage(name, 3600 * limit, work)

        stage("trials", hours.trials, partial(self.collect, number=0))
        stage("scorer", hours.scorer, partial(self.learn, rounds=0))
        for n in range(1, sizes.rounds + 1):
            stage(f"collect-{n}", hours.collect, partial(self.collect, number=n))
            stage(f"round-{n}", hours.round, partial(self.learn, rounds=n))
        found = stage("calibrate", hours.calibrate, self.calibrate)
        calibration = Calibration(tuple(found["success"]), tuple(found["secure"]), found["secure_weight"])
        stage("export", hours.evaluate, lambda _: self.export(calibration))
        names = dict.fromkeys((*self.settings.without, *self.settings.hands))
        for name in names:
            stage(f"evaluate-{name}", hours.evaluate, partial(self.evaluate, name=name))
        folder = self.policy_folder()
        config = read_depth_policy(folder)
        card = any_hand_card(
            folder, config, command=command, settings=self.settings, scenes=self.scenes, stages=self.run.stages
        )
        write_card(folder, config, card)
        self.run.log(f"the policy is in {folder}")

    # --- stages --------------------------------------------------------------------------------------------------

    def collect(self, stage: Run, number: int) -> dict[str, Any]:
        """Collect trials of all hands in turns: of random proposals, or in rounds of those that the scorer chose."""
        share = 1.0 if number == 0 else self.sizes.round_share
        total = sum(round(share * len(hand.scenes)) + self.held_out(hand) for hand in self.hands)
        done, results = 0, dict[str, Any]()
        for hand, split, scenes in self._turns(share):
            if stage.late():
                break
            sampler = self.sampler(split, self.seed + 1000 * number)
            collect(
                stage.folder / hand.name / split,
                sampler,
                scenes,
                hand.grid,
                hand.collected,
                complete=self.completion,
                score=self.scorer(hand, number - 1) if number else None,
                stop=stage.late,
            )
            done += len(scenes)
            stage.report(f"{done} of {total} scenes", done / total)
        for split in ("train", "validation"):
            found = [trials for hand in self.hands if (trials := self.trials(number, hand, split)) is not None]
            joined = GraspTrials.joined(found)
            rates = {"success": float(joined.success.mean()), "secure": float(joined.secure.mean())}
            results[split] = {"hands": len(found), "trials": len(joined), **{k: round(v, 4) for k, v in rates.items()}}
        return results

    def held_out(self, hand: _TrainedHand) -> int:
        """Return the number of validation scenes of a hand."""
        return self.sizes.held_out_scenes if hand.shipped else min(self.sizes.held_out_scenes, 2)

    def _turns(self, share: float) -> Iterator[tuple[_TrainedHand, object_sets.Split, range]]:
        """List which scenes each hand collects, turn by turn, so that a time limit leaves all hands about as many."""
        for hand in self.hands:
            yield hand, "validation", range(self.held_out(hand))
        counts = [round(share * len(hand.scenes)) for hand in self.hands]
        turns = -(-max(counts) // _TURN)
        for turn in range(turns):
            for hand, count in zip(self.hands, counts, strict=True):
                # A hand with few scenes has its turns spread over those of the others.
                first, last = (round(count * at / turns) for at in (turn, turn + 1))
                if last > first:
                    yield hand, "train", hand.scenes[first:last]

    def trials(self, number: int, hand: _TrainedHand, split: str) -> GraspTrials | None:
        """Read the trials of a hand in a round, 0 for those of random proposals; None if there are none."""
        folder = self.out / (f"collect-{number}" if number else "trials") / hand.name / split
        if not any(folder.glob("*.npz")):
            return None
        found = load_trials(folder)
        return found if len(found) else None

    def weights(self, rounds: int) -> Path:
        """Name the file of the weights after a round."""
        return self.out / (f"round-{rounds}" if rounds else "scorer") / "weights.pt"

    @cached_property
    def net(self) -> SharedScorerNet:
        """The network of all hands."""
        return SharedScorerNet([hand.grid for hand in self.hands], self.sizes.width)

    def scorer(self, hand: _TrainedHand, rounds: int) -> Scorer:
        """Give the scorer of a hand after a round."""
        load_weights(self.net, self.weights(rounds))
        graph = ScorerGraph([self.net.of_hand(hand.grid)], Calibration(), FINALISTS)
        return Scorer(torch_network(graph), ScorerInputs(hand.grid), FINALISTS)

    def learn(self, stage: Run, rounds: int) -> dict[str, Any]:
        """Train the network on the trials of random proposals, and on those of the first rounds."""
        sizes = self.sizes
        config = TrainConfig(
            learning_rate=5e-4 if rounds else 1e-3,
            batch_size=sizes.batch,
            max_steps=sizes.round_steps if rounds else sizes.steps,
            validate_every=sizes.validate_every,
            max_seconds=stage.limit,
            seed=self.seed + rounds,
            device=self.settings.device,
        )
        net = SharedScorerNet([hand.grid for hand in self.hands], sizes.width)
        if rounds:
            load_weights(net, self.weights(rounds - 1))

        def joined(number: int, split: str, seed: int) -> JoinedSampler | None:
            found = []
            for hand, first in zip(self.hands, net.first, strict=True):
                trials = self.trials(number, hand, split)
                if trials is not None:
                    found.append(TrialSampler(trials, ScorerInputs(hand.grid, first), self.views, seed))
            return JoinedSampler(found) if found else None

        samplers = [joined(number, "train", config.seed) for number in range(rounds + 1)]
        held_out = joined(rounds, "validation", 0)
        if held_out is None:
            raise ConfigError("no hand has trials; give --hours.trials more")
        settings = {"hands": [hand.name for hand in self.hands], "width": sizes.width, "rounds": rounds}
        used = [sampler for sampler in samplers if sampler is not None]
        progress = reporter(stage, "AUC")
        trained = fit_scorer(stage.folder, net, used, held_out, config, settings, progress, trained=rounds > 0)
        return results_of(trained)

    def choices(
        self, folder: Path, hand: _TrainedHand, sampler: SceneSampler, count: int, scorer: Scorer, late: Any
    ) -> Choices:
        """Try choices with a hand."""
        return try_choices(folder, sampler, range(count), hand.grid, self.completion, scorer, hand.finder, stop=late)

    def calibrate(self, stage: Run) -> dict[str, Any]:
        """Try choices on held-out objects with every shipped hand; fit the logits of all together."""
        sampler = self.sampler("validation", self.seed + 9000)
        hands = [hand for hand in self.hands if hand.shipped] or self.hands[:4]
        each = max(1, self.sizes.choices // len(hands))
        found, rates = [], {}
        for index, hand in enumerate(hands):
            limit = stage.limit * (index + 1) / len(hands)
            scorer = self.scorer(hand, self.sizes.rounds)
            late = partial(lambda end: stage.seconds >= end, limit)
            found.append(self.choices(stage.folder / hand.name, hand, sampler, each, scorer, late))
            rates[hand.name] = round(float(found[-1].success[:, 0].mean()), 4)
            stage.report(f"{index + 1} of {len(hands)} hands", (index + 1) / len(hands))
        logits, success, secure = (
            np.concatenate([getattr(c, n) for c in found]) for n in ("logits", "success", "secure")
        )
        totals = success.mean(axis=0) + secure.mean(axis=0)
        best = int(np.argmax(totals))
        return {
            "choices": len(success),
            "hands": rates,
            "secure_weight": SECURE_WEIGHTS[best],
            "success": fit_logits(logits[:, best, 0], success[:, best]),
            "secure": fit_logits(logits[:, best, 1], secure[:, best]),
        }

    def policy_folder(self) -> Path:
        """Name the folder of the policy."""
        return self.settings.publish or self.out / "policy"

    def export(self, calibration: Calibration) -> dict[str, Any]:
        """Write the policy's folder."""
        net = SharedScorerNet.load(self.weights(self.sizes.rounds), [self.hands[0].grid])
        config = export_depth_policy(
            self.policy_folder(),
            self.settings.name,
            self.completion_folder,
            [net],
            calibration,
            learned_from=self.learned,
            crop=self.scenes.crop,
            grid=HandGridConfig(shape=SHARED_SHAPE),
            finder=replace(FINDER, predicted=0, refinements=0),
            licence=package_licence(),
        )
        return {"files": len(config.files)}

    def evaluate(self, stage: Run, name: str) -> dict[str, Any]:
        """Evaluate the policy with one hand, as ``graspbox evaluate --hand`` does."""
        policy = DepthGrasp(self.policy_folder())
        results: dict[str, Any] = {"trained": name not in self.settings.without}
        for objects in self.settings.evaluated:
            count = self.sizes.trials
            progress = stage.counter(count, f"trials ({objects})")
            result = evaluation.evaluate(
                policy, objects=objects, split=evaluated_split(objects), trials=count, progress=progress, hand=name
            )
            results[objects] = {k: v for k, v in result.to_json().items() if k != "objects"}
        return results
