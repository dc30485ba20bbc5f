"""What the stages of ``graspbox train feel`` share: settings, recorded trials, networks and paired trials."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from graspbox._common.runs import Run
from graspbox.learn.models.stability.network import StabilityNet
from graspbox.learn.recipes.feel.paired import PairedTrials, run_pairs
from graspbox.learn.recipes.feel.stability_trials import StabilityTrials
from graspbox.learn.recipes.settings.feel import FeelSettings
from graspbox.learn.training.array_files import load_or_make
from graspbox.learn.training.trainer import load_weights
from graspbox.object_sets import ObjectSet

__all__ = ["FeelContext"]


@dataclass(frozen=True, eq=False)
class FeelContext:
    """What the stages of one run share.

    `evaluated` are the objects of the evaluation, by the name of their set, without those from which something is
    learned.
    """

    settings: FeelSettings
    run: Run
    evaluated: Mapping[str, ObjectSet]

    @property
    def policy_folder(self) -> Path:
        """Folder of the policy with the grasp-stability check."""
        return self.settings.publish or self.settings.out / "policy"

    def trials(self, part: str) -> StabilityTrials:
        """Load the recorded trials of a part: train or held-out."""
        files = sorted((self.settings.out / f"record-{part}").glob("*.npz"))
        return StabilityTrials.joined([StabilityTrials.load(path) for path in files])

    def networks(self) -> list[StabilityNet]:
        """Load the trained networks."""
        inputs = self.trials("held-out").readings.shape[1]
        nets = [StabilityNet(inputs, self.settings.sizes.width) for _ in range(self.settings.sizes.members)]
        for number, net in enumerate(nets):
            load_weights(net, self.settings.out / f"member-{number}" / "weights.pt")
        return nets

    def pairs(self, stage: Run, name: str, objects: ObjectSet, trials: int, offset: int) -> PairedTrials:
        """Run trials with and without a second attempt; the offset is added to the seed."""
        progress = stage.counter(2 * trials, f"trials ({name})")

        def run() -> PairedTrials:
            return run_pairs(self.policy_folder, objects, trials, self.settings.seed + offset, progress=progress)

        return load_or_make(PairedTrials, stage.folder / f"{name.replace(':', '-')}.npz", run)
