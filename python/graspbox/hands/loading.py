"""Loading hands by name or from their two files."""

import os
from pathlib import Path
from typing import TypeAlias

from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.hands.urdf_meshes import fitted_urdf, read_text

__all__ = ["HandLike", "load_hand"]

#: A name, a hand, or the paths of a URDF and a ``hand.toml``.
HandLike: TypeAlias = str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]]


def load_hand(hand: HandLike = "reflex") -> Hand:
    """Load a hand by name, or from the two files that describe it.

    Parameters
    ----------
    hand : str, Hand, or pair of paths
        A name of `graspbox.Hand.names`, or (URDF, ``hand.toml``). Collision meshes are replaced by primitives
        (`graspbox.hands.fitted_urdf`).

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
        return _loaded(Path(hand[0]), Path(hand[1]))
    if isinstance(hand, str) and hand in Hand.names():
        return Hand.named(hand)
    if isinstance(hand, str) and hand.endswith((".urdf", ".toml")):
        raise ConfigError(
            f"{hand!r} is one file, but a hand has two: pass (URDF, hand.toml), or 'hand.urdf,hand.toml' in a shell"
        )
    known = ", ".join(repr(name) for name in Hand.names())
    raise ConfigError(f"there is no hand {hand!r}; choose from {known}, or pass the paths of a URDF and a hand.toml")


def _loaded(urdf: Path, toml: Path) -> Hand:
    """Load a hand from its files; the core reads those without collision meshes, and names their lines in errors."""
    if not urdf.is_file() or not (fitted := fitted_urdf(urdf)).fits:
        return Hand.load(urdf, toml)
    # Lines of the text without meshes are not those of the file.
    return Hand(fitted.text, read_text(toml), (f"{urdf} (meshes replaced)", str(toml)))
