"""Loading hands by name or from their two files; angles of a URDF; the cache folder."""

import os
from pathlib import Path
from typing import TypeAlias

from graspbox._common.rotations import euler_from_rotation
from graspbox._core import Hand
from graspbox.errors import ConfigError

__all__ = ["Hand", "HandLike", "cache_folder", "euler_from_rotation", "load_hand"]

#: A name, a hand, or the paths of a URDF and a ``hand.toml``.
HandLike: TypeAlias = str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]]


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
