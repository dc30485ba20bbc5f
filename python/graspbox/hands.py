"""Loading hands by name or from their two files; their reach and symmetries; angles of a URDF; the cache folder."""

import os
from itertools import product
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from graspbox._common.rotations import euler_from_rotation
from graspbox._core import Hand
from graspbox.errors import ConfigError

__all__ = [
    "Hand",
    "HandLike",
    "cache_folder",
    "corners_of",
    "euler_from_rotation",
    "load_hand",
    "reach_of",
    "symmetries_of",
]

#: A name, a hand, or the paths of a URDF and a ``hand.toml``.
HandLike: TypeAlias = str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]]

#: Steps of closing at which the reach is measured.
_CLOSING_STEPS = 21
#: Greatest distance of a reflected hand from itself, metres.
_SAME = 5e-4


def cache_folder() -> Path | None:
    """Return the folder for cached data: ``GRASPBOX_CACHE`` (no cache if empty), else the user's cache folder."""
    chosen = os.environ.get("GRASPBOX_CACHE")
    if chosen is not None:
        return Path(chosen).expanduser() if chosen else None
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "graspbox"


def load_hand(hand: HandLike = "reflex") -> Hand:
    """Load a hand by name, or from the two files that describe it.

    Parameters
    ----------
    hand : str, Hand, or pair of paths
        A name of `graspbox.Hand.names`, or (URDF, ``hand.toml``).

    Raises
    ------
    HandError
        If the files do not describe a hand; the message lists every wrong line.
    ConfigError
        If there is no hand of that name.
    """
    if isinstance(hand, Hand):
        return hand
    if isinstance(hand, tuple | list) and len(hand) == 2:
        urdf, toml = hand
        return Hand.load(Path(urdf), Path(toml))
    if isinstance(hand, str) and hand in Hand.names():
        return Hand.named(hand)
    if isinstance(hand, str) and hand.endswith((".urdf", ".toml")):
        raise ConfigError(
            f"{hand!r} is one file, but a hand has two: give (URDF, hand.toml), or 'hand.urdf,hand.toml' in a shell"
        )
    known = ", ".join(repr(name) for name in Hand.names())
    raise ConfigError(f"there is no hand {hand!r}; choose from {known}, or give the paths of a URDF and a hand.toml")


def corners_of(
    hand: Hand, positions: NDArray[np.float64], parts: Literal["all", "palm", "fingers"] = "all"
) -> NDArray[np.float64]:
    """Return the corners (n, 3) of the boxes around a hand's collision shapes, grasp frame, metres.

    Parameters
    ----------
    hand : Hand
        The hand.
    positions : (c,) float64
        Positions of its independent joints, rad or m.
    parts : {"all", "palm", "fingers"}
        Which shapes: those of the palm do not move.
    """
    poses, half, _, carriers = hand.shapes(positions)
    wanted = {"all": carriers >= -1, "palm": carriers < 0, "fingers": carriers >= 0}[parts]
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))[None] * half[wanted, None]
    turned = corners @ poses[wanted, :3, :3].transpose(0, 2, 1) + poses[wanted, None, :3, 3]
    return np.asarray(turned.reshape(-1, 3))


def reach_of(hand: Hand, preshape: float) -> float:
    """Return how far the fingers extend from the palm while they close, metres along the grasp frame's z."""
    shares = np.linspace(0.0, 1.0, _CLOSING_STEPS).tolist()
    return max(float(corners_of(hand, hand.closed(preshape, share))[:, 2].max()) for share in shares)


def symmetries_of(hand: Hand) -> tuple[tuple[float, float, float], ...]:
    """Find the reflections of the grasp frame that map the closing hand onto itself with every preshape.

    Returns
    -------
    tuple of tuple of float
        Signs of the axes: (1, -1, 1) for the mirror plane y = 0, (-1, 1, 1) for x = 0, (-1, -1, 1) for a half turn
        about z. The identity is not among them. Boxes around the collision shapes are compared.
    """
    positions = [hand.closed(preshape, share) for preshape in hand.preshapes.values() for share in (0.0, 0.5, 1.0)]
    corners = [corners_of(hand, each) for each in positions]

    def same(signs: tuple[float, float, float]) -> bool:
        distances = (np.linalg.norm(each[:, None] - each[None] * signs, axis=2).min(axis=1).max() for each in corners)
        return all(distance < _SAME for distance in distances)

    return tuple(filter(same, ((1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0))))
