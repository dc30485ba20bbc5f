"""Numbers that describe a hand to a scorer of many hands, besides the cells that it sweeps."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.hands import Hand, reach_of
from graspbox.hands.description import Actuator, HandDescription, describe
from graspbox.perception.hand_grids import HandGrid

__all__ = ["CELL", "HAND_NUMBERS", "HandTables", "hand_numbers", "tables_of"]

#: Reference side of a hand's cells, metres.
CELL = 0.01
#: Width of hands that open without limit, metres.
_WIDE = 0.15
#: Least closing work, joules, and least path of a fingertip, metres, whose logarithms are taken.
_LEAST = 1e-3


class _Shaped(NamedTuple):
    """A hand with one preshape: its grid and its description."""

    grid: HandGrid
    described: HandDescription
    preshape: float

    @property
    def hand(self) -> Hand:
        """The hand."""
        return self.grid.hand

    @property
    def closing(self) -> list[Actuator]:
        """The actuators that close it."""
        return [actuator for actuator in self.described.actuators if actuator.closes]


def _work(shaped: _Shaped) -> float:
    """Sum the work of all motors from open to closed at their greatest load, J."""
    total = 0.0
    for actuator in shaped.closing:
        low, high = actuator.travel
        arm = 1.0 if actuator.spool is None else actuator.spool[1]
        total += actuator.load_limit * arm * (high - low)
    return total


def _path(shaped: _Shaped) -> float:
    """Return the longest distance between a shape's open and closed place, metres."""
    opened, closed = (shaped.hand.shapes(shaped.hand.closed(shaped.preshape, share))[0] for share in (0.0, 1.0))
    return float(np.linalg.norm(closed[:, :3, 3] - opened[:, :3, 3], axis=1).max())


#: The numbers, by name, about 0 to 2 each.
HAND_NUMBERS: dict[str, Callable[[_Shaped], float]] = {
    "cell, cm": lambda shaped: 100.0 * shaped.grid.cell,
    "width, dm": lambda shaped: 10.0 * min(shaped.hand.widest, _WIDE),
    "reach, dm": lambda shaped: 10.0 * reach_of(shaped.hand, shaped.preshape),
    "chains / 4": lambda shaped: len(shaped.hand.chains) / 4.0,
    "closing motors / 4": lambda shaped: min(len(shaped.closing), 8) / 4.0,
    "log10 of the closing work, J": lambda shaped: float(np.log10(max(_work(shaped), _LEAST))),
    "log10 of the path, m": lambda shaped: float(np.log10(max(_path(shaped), _LEAST))),
    "friction of pads": lambda shaped: shaped.described.pad_friction,
    "friction elsewhere": lambda shaped: shaped.described.bare_friction,
}


class HandTables(NamedTuple):
    """Inputs for one of many hands, per preshape: `HandGrid.swept`, `hand_numbers`, side of its cells over `CELL`."""

    swept: NDArray[np.uint8]
    numbers: NDArray[np.float32]
    scale: NDArray[np.float32]


def tables_of(grid: HandGrid) -> HandTables:
    """Return the inputs of a scorer of many hands for one of them."""
    scale = np.full((len(grid.preshapes), 1), grid.cell / CELL, dtype=np.float32)
    return HandTables(grid.swept, hand_numbers(grid), scale)


def hand_numbers(grid: HandGrid) -> NDArray[np.float32]:
    """Return `HAND_NUMBERS` of a hand with each of its preshapes, (p, 9), in the order of `HandGrid.preshapes`."""
    described = describe(grid.hand)
    rows = [_Shaped(grid, described, float(preshape)) for preshape in grid.preshapes]
    return np.array([[number(row) for number in HAND_NUMBERS.values()] for row in rows], dtype=np.float32)
