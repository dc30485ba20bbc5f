"""``head``: grasps that one network predicts from one depth camera."""

from pathlib import Path

from graspbox.errors import ConfigError
from graspbox.perception.anchors import Anchors
from graspbox.perception.configs import DepthNoise
from graspbox.perception.finder import Finder
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.head_finder import HeadFinder
from graspbox.perception.head_folders import read_head_policy
from graspbox.perception.runtimes import AnchorHead, onnx_network
from graspbox.policies.depth import DepthGrasp

__all__ = ["HEAD", "HeadGrasp"]

#: File of a folder in which a head was trained; a published one has ``config.json`` instead.
HEAD = "head.json"


class HeadGrasp(DepthGrasp):
    """Grasps as one network says: crop and head (`graspbox.perception.heads`), and a collision filter.

    It looks and moves as `DepthGrasp` does; it is not privileged.

    Parameters
    ----------
    folder : Path
        A published head, which onnxruntime runs (`graspbox.perception.head_folders`); or one that
        `graspbox.perception.head_training.train_head` trained, which torch runs.
    filtered : bool, optional
        Take its best grasp that does not collide with what is seen, instead of its best. By default as the published
        folder says; else not.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    num_threads : int, optional
        Threads of a decision; by default one per core.

    Raises
    ------
    ConfigError, FileError
        If the folder is wrong, or lacks a file.
    """

    name = "head"

    def __init__(
        self,
        folder: Path,
        *,
        filtered: bool | None = None,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
    ) -> None:
        super().__init__(folder, noise=noise, num_threads=num_threads)
        self._head = None if (Path(folder) / HEAD).is_file() else read_head_policy(Path(folder))
        self._filtered = filtered if filtered is not None else self._head is not None and self._head.filtered
        if self._head is not None:
            self.name = self._head.name

    def _read(self, folder: Path | None) -> None:
        """Leave the folder: a head has other settings."""
        del folder

    def _make_finder(self) -> Finder:
        """Load the head; one that was not published needs torch."""
        folder = Path(self._folder or "")
        if self._head is None:
            from graspbox.perception.head_training import load_head

            grid = HandGrid(self.hand, crop=self.crop, num_threads=self._num_threads)
            net = load_head(folder, len(grid.preshapes), self.crop)
            return HeadFinder(grid, net, crop=self.crop, filtered=self._filtered)
        if self.hand.name != self._head.hand:
            raise ConfigError(f"the policy {self.name!r} knows the hand {self._head.hand!r}, not {self.hand.name!r}")
        crop = self._head.crop
        grid = HandGrid(self.hand, crop=crop, num_threads=self._num_threads)
        anchors = Anchors(self._head.preshapes, self._head.head.anchors)
        head = AnchorHead(onnx_network(folder / "head.onnx", self._num_threads), anchors)
        return HeadFinder(grid, head, crop=crop, filtered=self._filtered)
