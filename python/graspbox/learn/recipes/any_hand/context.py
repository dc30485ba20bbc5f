"""What the stages of ``graspbox train any-hand`` share: settings, the hands, and the networks trained so far."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.hands import Hand, load_hand
from graspbox.learn.export.exports import FINALISTS
from graspbox.learn.export.graphs import ScorerGraph
from graspbox.learn.models.scene_views import SceneViews
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.learn.models.scorer.shared import SHARED_SHAPE, SharedScorerNet
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.random_hands import random_hand
from graspbox.learn.recipes.collection import load_trials
from graspbox.learn.recipes.depth.context import FINDER
from graspbox.learn.recipes.settings.any_hand import AnyHandSettings
from graspbox.learn.training.trainer import load_weights
from graspbox.perception import HandGrid
from graspbox.perception.configs import FinderConfig
from graspbox.perception.hand_settings import settings_of
from graspbox.perception.inputs.scorer import ScorerInputs
from graspbox.policies.published.calibration import Calibration
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import completion_folder, read_depth_policy
from graspbox.policies.published.runtimes import Completion, Scorer, onnx_network, torch_network

__all__ = ["AnyHandContext", "TrainedHand"]


@dataclass(frozen=True, eq=False)
class TrainedHand:
    """A hand of the training: its name, unique within the run, how its grasps are proposed, and its training scenes.

    `named` says whether it is one of --hands, not a random one.
    """

    name: str
    grid: HandGrid
    finder: FinderConfig
    scenes: range
    named: bool


class AnyHandContext:
    """What the stages of one run share: `hands`, those of --hands before random ones, and the completion.

    The policy learns from the object sets `learned`. Raises ConfigError if the completion is for other crops, or no
    hand is left to learn from.
    """

    def __init__(self, settings: AnyHandSettings, run: Run, learned: list[str]) -> None:
        self.settings, self.sizes, self.run, self.learned = settings, settings.sizes, run, learned
        self.scenes = SceneConfig()
        source = folder_of(settings.completion)
        published = read_depth_policy(source)
        if published.crop != self.scenes.crop:
            raise ConfigError(f"the completion of {settings.completion!r} takes {published.crop}; name another policy")
        self.completion_folder = completion_folder(source, published)
        self.completion = Completion(onnx_network(self.completion_folder / "completion.onnx"))
        self._samplers: dict[tuple[str, int], SceneSampler] = {}
        self.hands = list(self._hands())
        if not self.hands:
            raise ConfigError("--hands, --jaws and --fingers leave no hand to learn from; name one")

    def _hands(self) -> Iterator[TrainedHand]:
        settings, sizes = self.settings, self.sizes
        # Hands of --without are loaded too: what is wrong is refused now, not by the evaluation after hours.
        for name, (hand, trained) in settings.evaluated_hands().items():
            if trained:
                yield self._hand(name, load_hand(hand), range(sizes.scenes), named=True)
        families = [("jaws", index) for index in range(settings.jaws)]
        families += [("fingers", index) for index in range(settings.fingers)]
        for number, (family, index) in enumerate(families):
            start = number * sizes.random_scenes % max(1, sizes.scenes - sizes.random_scenes + 1)
            scenes = range(start, start + sizes.random_scenes)
            yield self._hand(f"{family}-{index}", random_hand(family, index), scenes, named=False)

    def _hand(self, name: str, hand: Hand, scenes: range, *, named: bool) -> TrainedHand:
        fitted = settings_of(hand, FINDER.proposals, shape=SHARED_SHAPE)
        grid = HandGrid(hand, fitted.grid, crop=self.scenes.crop)
        finder = replace(FINDER, proposals=fitted.proposals, predicted=0, refinements=0)
        return TrainedHand(name, grid, finder, scenes, named)

    @property
    def policy_folder(self) -> Path:
        """Folder of the policy."""
        return self.settings.publish or self.settings.out / "policy"

    @cached_property
    def views(self) -> SceneViews:
        """Views of the scenes, completed; all rounds share them."""
        return SceneViews(self.scenes, self.completion, self.settings.seed, count=self.sizes.views)

    def sampler(self, split: object_sets.Split, seed: int) -> SceneSampler:
        """Return a sampler of scenes of a split; all hands share it, since it keeps its objects ready."""
        if (split, seed) not in self._samplers:
            objects = object_sets.load(self.settings.objects, split=split)
            self._samplers[split, seed] = SceneSampler(objects, self.scenes, seed)
        return self._samplers[split, seed]

    def trials(self, number: int, hand: TrainedHand, split: str) -> GraspTrials | None:
        """Read the trials of a hand in a round, 0 for those of random proposals; None if there are none."""
        folder = self.settings.out / (f"collect-{number}" if number else "trials") / hand.name / split
        if not any(folder.glob("*.npz")):
            return None
        return load_trials(folder) or None

    def weights(self, rounds: int) -> Path:
        """Return the file of the weights after a number of rounds."""
        return self.settings.out / (f"round-{rounds}" if rounds else "scorer") / "weights.pt"

    @cached_property
    def _net(self) -> SharedScorerNet:
        return SharedScorerNet([hand.grid for hand in self.hands], self.sizes.width)

    def scorer(self, hand: TrainedHand, rounds: int) -> Scorer:
        """Load the scorer of a hand after a number of rounds, before its calibration."""
        load_weights(self._net, self.weights(rounds))
        graph = ScorerGraph([self._net.of_hand(hand.grid)], Calibration(), FINALISTS)
        return Scorer(torch_network(graph), ScorerInputs(hand.grid), FINALISTS)
