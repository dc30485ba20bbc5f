"""A hand in a voxel grid: candidate grasps of an occupied volume, and the voxels around the hand at each."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict, floats, natural
from graspbox._common.by_value import ByValue
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand, symmetries_of
from graspbox.perception.configs import CropConfig, HandGridConfig, ProposalConfig

__all__ = ["HAND_CHANNELS", "HandGrid", "Proposals"]

#: Names of the channels around a hand, in order.
HAND_CHANNELS: tuple[str, ...] = tuple(_core.channel_names()[1])
#: Greatest distance of the middle of the cells from a plane of symmetry, in cells.
_CENTRED = 0.05


@dataclass(frozen=True, eq=False)
class Proposals(ByValue):
    """Candidate grasps in a crop, the most different first.

    Attributes
    ----------
    poses : (m, 4, 4) float64
        ``crop_from_hand``, metres.
    preshape : (m,) float64
        See `graspbox.Hand.preshape_limits`.
    source : (m,) str
        ``normal``: a surface point, approached against its normal or half-way to the vertical. ``vertical``: one that
        is approached from above. ``low``: a steep approach that ends with the fingertips just over the table. ``box``:
        a face of a box of the planner's decomposition.
    """

    poses: NDArray[np.float64]
    preshape: NDArray[np.float64]
    source: NDArray[np.str_]

    def __len__(self) -> int:
        """Count the candidates."""
        return len(self.preshape)


class HandGrid:
    """A hand's own grid of cells, made once per hand: the cells that its fingers sweep, and those that must be free.

    Parameters
    ----------
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    config : HandGridConfig
        The grid.
    crop : CropConfig
        The crops of its arguments.
    num_threads : int, optional
        By default one per core; results do not depend on it.

    Raises
    ------
    ConfigError
        For a setting out of range.
    HandError
        If no part of the hand closes.
    """

    def __init__(
        self,
        hand: HandLike = "reflex",
        config: HandGridConfig = HandGridConfig(),  # noqa: B008 (frozen)
        *,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
    ) -> None:
        #: The hand.
        self.hand = load_hand(hand)
        self._core = _core.HandVolumes(self.hand, config_dict(config, HandGridConfig))
        #: The grid's settings.
        self.config = config
        self._crop = config_dict(crop, CropConfig, "crop")
        #: The crops of its arguments.
        self.crop = crop
        #: Threads to use; None: one per core.
        self.num_threads = num_threads

    @property
    def shape(self) -> tuple[int, int, int]:
        """Cells along the axes of the hand frame."""
        x, y, z = self._core.shape
        return (x, y, z)

    @property
    def origin(self) -> NDArray[np.float64]:
        """Least corner (3,) of the cells, hand frame, metres."""
        return self._core.origin

    @property
    def cell(self) -> float:
        """Side of a cell, metres."""
        return self._core.cell

    @property
    def preshapes(self) -> NDArray[np.float64]:
        """The hand's preshapes (p,), in the order of its file."""
        return self._core.preshapes

    @property
    def swept(self) -> NDArray[np.uint8]:
        """The cells that the fingers sweep with each preshape, (p, X, Y, Z).

        255 where a finger is when the hand is open, less where it comes later, 64 where it comes last, 0 elsewhere.
        """
        return self._core.swept

    @cached_property
    def symmetries(self) -> tuple[tuple[float, float, float], ...]:
        """Reflections of the hand frame that map hand and cells onto themselves: see `graspbox.hands.symmetries_of`."""
        middle = self.origin + 0.5 * self.cell * np.array(self.shape)
        return tuple(
            signs
            for signs in symmetries_of(self.hand)
            if (np.abs(middle[np.array(signs) < 0.0]) < _CENTRED * self.cell).all()
        )

    def nearest(self, preshape: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the preshape nearest to each number (m,)."""
        return self._core.nearest(floats(preshape, "preshape"))

    def propose(
        self,
        occupancy: ArrayLike,
        config: ProposalConfig = ProposalConfig(),  # noqa: B008 (frozen)
        *,
        whole: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
    ) -> Proposals:
        """Propose grasps of an occupied volume over the table.

        Parameters
        ----------
        occupancy : (N, N, N) uint8 array
            Voxels of a crop, 0 to 255 for 0 to 1; occupied from a quarter on.
        config : ProposalConfig
            How candidates are made.
        whole : (N, N, N) uint8 array, optional
            All that is occupied, if the volume is only the object to grasp; the open hand must not touch it either.
        obstacles : (k, 3) array, optional
            Points of the crop's frame that the open hand must not touch either, metres.

        Returns
        -------
        Proposals
            Grasps that the open hand reaches without touching the volume, the table, or anything else that it must not
            touch,
            and with which enough fingers meet the volume. There may be none.

        Raises
        ------
        ConfigError
            For an array of another shape or type, or a setting out of range.
        """
        made = self._core.propose(
            _bytes(occupancy, "occupancy"),
            self._crop,
            config_dict(config, ProposalConfig),
            None if whole is None else _bytes(whole, "whole"),
            floats(np.zeros((0, 3)) if obstacles is None else obstacles, "obstacles"),
            self.num_threads,
        )
        return Proposals(made["poses"], made["preshape"], np.array(made["source"], dtype=np.str_))

    def meets(
        self,
        occupancy: ArrayLike,
        poses: ArrayLike,
        preshape: ArrayLike,
        *,
        points: int = 1000,
        obstacles: ArrayLike | None = None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return whether the open hand reaches poses, and how many fingers meet the volume as they close.

        Parameters
        ----------
        occupancy, obstacles
            As for `propose`.
        poses : (m, 4, 4) array
            ``crop_from_hand``, metres.
        preshape : (m,) array
            The nearest of the hand's preshapes is taken.
        points : int
            Points of the volume's surface with which collisions are searched.

        Returns
        -------
        (m,) bool, (m,) int64
            Whether the open hand touches neither volume, table nor obstacles, at the pose and on the approach; and the
            number of chains that meet the volume as they close, 0 if the hand touches something.
        """
        return self._core.meets(
            _bytes(occupancy, "occupancy"),
            self._crop,
            natural(points, "points"),
            floats(np.zeros((0, 3)) if obstacles is None else obstacles, "obstacles"),
            floats(poses, "poses"),
            floats(preshape, "preshape"),
            self.num_threads,
        )

    def levers(self, occupancy: ArrayLike, poses: ArrayLike, preshape: ArrayLike) -> NDArray[np.float64]:
        """Return how far the hand is from the middle of what it grasps: a long object that is held at its end tips.

        Returns
        -------
        (m,) float64
            Distance in plan view, metres, from the point where the fingertips close to the mean of the occupied voxels,
            weighted by a normal distribution (0.05 m) around that point; 0 if nothing is occupied. Arguments as of
            `meets`.
        """
        return self._core.levers(
            _bytes(occupancy, "occupancy"),
            self._crop,
            floats(poses, "poses"),
            floats(preshape, "preshape"),
            self.num_threads,
        )

    def crops(
        self, channels: ArrayLike, crop_of: Sequence[int] | NDArray[np.int64], poses: ArrayLike
    ) -> NDArray[np.uint8]:
        """Sample the voxels around the hand.

        Parameters
        ----------
        channels : (s, 3, N, N, N) uint8 array
            Of s crops: the completed occupancy, and the channels ``surface`` and ``unseen`` of `Crops`.
        crop_of : (m,) sequence of int
            Which crop each pose is in.
        poses : (m, 4, 4) array
            ``crop_from_hand``, metres.

        Returns
        -------
        (m, 4, X, Y, Z) uint8
            `HAND_CHANNELS`, 0 to 255 for 0 to 1, interpolated between voxels; 0 outside the crop. The last is the share
            of a cell below the table.

        Raises
        ------
        ConfigError
            For arrays of another shape or type, or an index without a crop.
        """
        indices = [natural(index, "crop_of") for index in crop_of]
        grids = _bytes(channels, "channels")
        return self._core.crops(grids, self._crop, indices, floats(poses, "poses"), self.num_threads)


def _bytes(values: ArrayLike, name: str) -> NDArray[np.uint8]:
    """Lay out an array of bytes for the core."""
    array = np.ascontiguousarray(values)
    if array.dtype != np.uint8:
        raise ConfigError(f"{name} is of dtype {array.dtype}; pass uint8, 0 to 255 for 0 to 1")
    return array
