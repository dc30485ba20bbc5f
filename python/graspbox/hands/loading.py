"""Loading hands by name or from their two files."""

import os
import re
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TypeAlias

from graspbox._core import Hand
from graspbox.errors import ConfigError, HandError
from graspbox.hands.reading import read_hand
from graspbox.hands.urdf_meshes import FittedUrdf, read_text

__all__ = ["AssumedWarning", "HandLike", "hand_like", "load_fitted", "load_hand", "told"]

#: A name, a hand, or the paths of a URDF and a ``hand.toml``.
HandLike: TypeAlias = str | Hand | tuple[str | os.PathLike[str], str | os.PathLike[str]]


def hand_like(text: str) -> str | tuple[str, str]:
    """Split the text that names a hand: its name, or its two files with a comma between."""
    urdf, comma, toml = text.partition(",")
    return (urdf, toml) if comma else text


def load_hand(hand: HandLike = "reflex") -> Hand:
    """Load a hand by name, or from the two files that describe it.

    Parameters
    ----------
    hand : str, Hand, or pair of paths
        A name of `graspbox.Hand.names`, or (URDF, ``hand.toml``). Collision meshes are replaced by primitives
        (`graspbox.hands.fitted_urdf`). A warning, once per file, says how much the URDF does not state and was assumed;
        `Hand.assumptions` lists it.

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


#: A name that may be that of a shape in place of a mesh.
_UNKNOWN = re.compile(r"there is no (?:link or )?collider ")
#: Files about whose assumptions a warning was given.
_TOLD: set[str] = set()


class AssumedWarning(UserWarning):
    """The first of the sentences `assumed` about what the files of a hand or an arm do not state."""

    def __init__(self, assumed: Sequence[str], where: str = "Hand.assumptions") -> None:
        self.assumed = tuple(assumed)
        super().__init__(told(assumed, f"in {where}"))


def told(assumed: Sequence[str], where: str) -> str:
    """Return the first of some assumptions, and how many more there are, where."""
    return assumed[0] if len(assumed) == 1 else f"{assumed[0]}; {len(assumed) - 1} more {where}"


def load_fitted(urdf: Path, toml: Path) -> tuple[Hand, FittedUrdf]:
    """Load a hand from its files, and its URDF without meshes; both are checked together before meshes are fitted."""
    text = read_text(toml)
    try:
        fitted = read_hand(urdf, partial(_check, text, str(toml)))
        return Hand(fitted.text, text, (fitted.name, str(toml)), fitted.assumptions), fitted
    except HandError as error:
        # As `graspbox hand new` names the URDF of a hand without its wrist or arm.
        for alone in (toml.with_name(f"{toml.stem}_hand.urdf"), toml.with_suffix(".urdf")):
            if alone.is_file() and not alone.samefile(urdf):
                raise HandError(f"{error}\n{toml} may belong to {alone}, the URDF beside it; pass that") from error
        raise


def _loaded(urdf: Path, toml: Path) -> Hand:
    """Load a hand from its files, and warn once of what was assumed."""
    if not urdf.is_file() or not toml.is_file():
        return Hand.load(urdf, toml)  # raises
    hand, fitted = load_fitted(urdf, toml)
    if hand.assumptions and fitted.name not in _TOLD:
        _TOLD.add(fitted.name)
        warnings.warn(AssumedWarning(hand.assumptions), stacklevel=3)
    return hand


def _check(toml: str, toml_name: str, urdf: str, urdf_name: str) -> None:
    """Raise the errors of the two files with a box in place of each mesh, but for names of shapes that come later."""
    try:
        Hand(urdf, toml, (urdf_name, toml_name))
    except HandError as error:
        if not all(_UNKNOWN.search(line) for line in str(error).splitlines()[1:]):
            raise
