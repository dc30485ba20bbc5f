"""Numbers that describe a hand to a scorer of many hands, beside the cells that it sweeps; no torch."""

import tomllib
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.hands import Hand, reach_of
from graspbox.perception.hand_grids import HandGrid

__all__ = ["CELL", "HAND_NUMBERS", "HandTables", "hand_numbers", "tables_of"]

#: Side of the cells to which those of a hand are compared, metres.
CELL = 0.01
#: Width that stands for no limit of the width, metres.
_WIDE = 0.15
#: Least closing work, joules, and least path of a fingertip, metres, whose logarithms are taken.
_LEAST = 1e-3


class _Shaped(NamedTuple):
    """A hand with one preshape: its grid, and the tables of its ``hand.toml``."""

    grid: HandGrid
    toml: dict[str, Any]
    preshape: float

    @property
    def hand(self) -> Hand:
        """The hand."""
        return self.grid.hand

    @property
    def closing(self) -> list[dict[str, Any]]:
        """The tables of the actuators that close it."""
        names = self.toml["grasp"]["closing"]
        return [table for table in self.toml["actuators"] if table["name"] in names]


def _work(shaped: _Shaped) -> float:
    """Sum the work of all motors from open to closed at their greatest load, J."""
    total = 0.0
    for table in shaped.closing:
        low, high = table["travel"]["value"]
        arm = table["spool"]["radius"]["value"] if "spool" in table else 1.0
        total += table["load_limit"]["value"] * arm * (high - low)
    return total


def _path(shaped: _Shaped) -> float:
    """Measure how far the shape that moves most goes from open to closed, metres."""
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
    "friction of pads": lambda shaped: shaped.toml["friction"]["pad"]["value"],
    "friction elsewhere": lambda shaped: shaped.toml["friction"]["bare"]["value"],
}


class HandTables(NamedTuple):
    """What a scorer of many hands knows of one, a row for each preshape.

    Attributes
    ----------
    swept : (p, X, Y, Z) uint8
        `HandGrid.swept`.
    numbers : (p, 9) float32
        `hand_numbers`.
    scale : (p, 1) float32
        Side of the cells over `CELL`.
    """

    swept: NDArray[np.uint8]
    numbers: NDArray[np.float32]
    scale: NDArray[np.float32]


def tables_of(grid: HandGrid) -> HandTables:
    """Return what a scorer of many hands knows of a hand."""
    scale = np.full((len(grid.preshapes), 1), grid.cell / CELL, dtype=np.float32)
    return HandTables(grid.swept, hand_numbers(grid), scale)


def hand_numbers(grid: HandGrid) -> NDArray[np.float32]:
    """Return `HAND_NUMBERS` of a hand with each of its preshapes, (p, 9), in the order of `HandGrid.preshapes`."""
    toml = tomllib.loads(grid.hand.files[1])
    rows = [_Shaped(grid, toml, float(preshape)) for preshape in grid.preshapes]
    return np.array([[number(row) for number in HAND_NUMBERS.values()] for row in rows], dtype=np.float32)
