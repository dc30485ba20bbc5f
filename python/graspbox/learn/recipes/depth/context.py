"""What the stages of ``graspbox train depth`` share: settings, the hand's grid, and the networks trained so far."""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import cast

from graspbox import object_sets
from graspbox._common.runs import Run
from graspbox.configs import PhysicsConfig
from graspbox.data.trials.learned import of_datasets
from graspbox.learn.models.scene_views import SceneViews
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.recipes.networks import TrainedNetworks, grid_shape, is_published
from graspbox.learn.recipes.settings.depth import DepthSettings, Sizes
from graspbox.perception import CropConfig, HandGrid, ProposalConfig
from graspbox.perception.configs import EVERYTHING, FinderConfig, SeenConfig
from graspbox.perception.hand_settings import seeing_both_sides, settings_of
from graspbox.perception.inputs.scorer import ScorerInputs
from graspbox.policies.published.folders import read_depth_policy
from graspbox.simulation.layouts import SceneLayout

__all__ = ["FINDER", "TUNING_RATE", "DepthContext"]

#: Settings of the rounds' decisions where a stage says nothing else.
FINDER = FinderConfig(
    ProposalConfig(seeds=24, points=600, most=Sizes.proposed), seen=SeenConfig(), predicted=Sizes.predicted, children=5
)
#: Learning rate with which a completion or a head is trained further.
TUNING_RATE = 3e-4


class DepthContext:
    """What the stages of one run share.

    The policy learns from the object sets `learned`, and from trials in the data sets `data`. `finder` proposes and
    ranks grasps in the rounds; `anchors` is the head's grid of poses; `networks` are those of the stages that are done.
    """

    def __init__(self, settings: DepthSettings, run: Run, learned: list[str]) -> None:
        self.settings, self.sizes, self.run, self._learned = settings, settings.sizes, run, learned
        self.layouts = cast("tuple[SceneLayout, ...]", settings.layout)
        self.physics = PhysicsConfig(dt=settings.time_step)
        crop = CropConfig(gap=EVERYTHING if self.has_several else CropConfig.gap)
        self.scenes = SceneConfig(crop=crop, real=settings.real)
        hand = settings.load_hand()
        shape = None if settings.start is None else grid_shape(settings.start)
        fitted = settings_of(hand, FINDER.proposals, shape=shape)
        # Among several objects wide proposals grasp less; a scorer of many hands learned from narrow ones.
        narrow = self.has_several or shape is not None
        proposals = fitted.proposals if narrow else seeing_both_sides(fitted.proposals, hand)
        # Of several objects it was not measured.
        self.finder = replace(FINDER, proposals=proposals, seen=None if self.has_several else FINDER.seen)
        self.anchors = fitted.anchors
        self.grid = HandGrid(hand, fitted.grid, crop=self.scenes.crop)
        self.inputs = ScorerInputs(self.grid)
        #: How the published policy finds a grasp.
        self.published_finder = self.policy_finder.rehearsing(self.sizes.rehearsed)
        self.networks = TrainedNetworks(settings.out, self.sizes, self.grid, self.scenes)
        self.data = settings.data or (settings.out / "data" / "set",)

    @property
    def has_several(self) -> bool:
        """Whether scenes have several objects."""
        return self.layouts != ("single",)

    @property
    def policy_finder(self) -> FinderConfig:
        """How the policy finds a grasp in training; it refines none, since refinement exploits errors of the scorer."""
        sizes = self.sizes
        return replace(
            self.finder,
            proposals=replace(self.finder.proposals, most=sizes.proposed),
            predicted=sizes.predicted,
            enough=sizes.enough,
            lever_penalty=sizes.lever_penalty,
            refinements=0,
        )

    @property
    def policy_folder(self) -> Path:
        """Folder of the policy."""
        return self.settings.publish or self.settings.out / "policy"

    @property
    def learns_from_trials(self) -> bool:
        """Whether a scorer or a head learns: otherwise no data set is needed."""
        sizes, start = self.sizes, self.settings.start
        adopted = start is not None and is_published(start) and read_depth_policy(start).head is not None
        return sizes.scorer_steps > 0 or sizes.rounds > 0 or not adopted

    @property
    def learned_from(self) -> list[str]:
        """Objects from which the policy learned: `settings.objects` too, since its completion did."""
        return list(dict.fromkeys([*(of_datasets(self.data) if self.learns_from_trials else ()), *self._learned]))

    @cached_property
    def views(self) -> SceneViews:
        """Views of the scenes, completed; all rounds share them."""
        return SceneViews(self.scenes, self.networks.completion(), self.settings.seed)

    def trials(self) -> tuple[GraspTrials, GraspTrials]:
        """Load the trials of the data sets for training and for validation."""
        return GraspTrials.from_datasets(self.data, "train"), GraspTrials.from_datasets(self.data, "validation")

    def sampler(
        self, objects: str | tuple[str, ...], split: object_sets.Split | None, seed: int, *, rendered: bool = False
    ) -> SceneSampler:
        """Return a sampler of scenes with objects of a set; none is seen as by a real camera if all are `rendered`."""
        scenes = replace(self.scenes, real=0.0) if rendered else self.scenes
        return SceneSampler(object_sets.load(objects, split=split), scenes, seed, self.layouts, self.physics)
