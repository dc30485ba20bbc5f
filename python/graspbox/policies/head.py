"""``head``: grasps that one network predicts from one depth camera."""

from pathlib import Path

from graspbox.perception.configs import DepthNoise
from graspbox.perception.finder import Finder
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies.depth import DepthGrasp

__all__ = ["HEAD", "HeadGrasp"]

#: File of a head's folder that says which it is.
HEAD = "head.json"


class HeadGrasp(DepthGrasp):
    """Grasps as one network says: crop and head (`graspbox.perception.heads`), nothing else.

    It looks and moves as `DepthGrasp` does; it is not privileged.

    Parameters
    ----------
    folder : Path
        A head that `graspbox.perception.head_training.train_head` trained: ``head.json`` and ``weights.pt``.
    filtered : bool
        Take its best grasp that does not collide with what is seen, instead of its best.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    """

    name = "head"

    def __init__(
        self,
        folder: Path,
        *,
        filtered: bool = False,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
    ) -> None:
        super().__init__(folder, noise=noise)
        self._filtered = filtered

    def _read(self, folder: Path | None) -> None:
        """Leave the folder for `_make_finder`: a head has no other settings than its own."""
        del folder

    def _make_finder(self) -> Finder:
        """Load the head, which needs torch."""
        from graspbox.perception.head_finder import HeadFinder
        from graspbox.perception.head_training import load_head

        grid = HandGrid(self.hand, crop=self.crop)
        assert self._folder is not None
        net = load_head(Path(self._folder), len(grid.preshapes), self.crop)
        return HeadFinder(grid, net, crop=self.crop, filtered=self._filtered)
