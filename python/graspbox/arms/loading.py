"""Loading arms by name or from their two files."""

import os
import warnings
from pathlib import Path
from typing import TypeAlias

from graspbox._core import Arm
from graspbox.errors import ArmError, ConfigError, HandError
from graspbox.hands.loading import AssumedWarning
from graspbox.hands.reading import read_hand
from graspbox.hands.urdf_meshes import read_text

__all__ = ["ArmLike", "load_arm"]

#: A name, an arm, or the paths of a URDF and an ``arm.toml``.
ArmLike: TypeAlias = str | Arm | tuple[str | os.PathLike[str], str | os.PathLike[str]]

#: Files about whose assumptions a warning was given.
_TOLD: set[str] = set()


def load_arm(arm: ArmLike) -> Arm:
    """Load an arm by name, or from the two files that describe it.

    Parameters
    ----------
    arm : str, Arm, or pair of paths
        A name of `graspbox.arms.Arm.names`, or (URDF, ``arm.toml``). The URDF is read as that of a hand
        (`graspbox.load_hand`): xacro and MJCF files are converted, collision meshes replaced by primitives. Of a file
        with arm and gripper, what is beyond the flange is left out. A warning, once per file, says what was assumed;
        `Arm.assumptions` lists it.

    Raises
    ------
    ArmError
        If the files do not describe an arm; the message lists every wrong line.
    ConfigError
        If there is no arm of that name.
    """
    if isinstance(arm, Arm):
        return arm
    if isinstance(arm, tuple | list) and len(arm) == 2:
        return _loaded(Path(arm[0]), Path(arm[1]))
    if isinstance(arm, str) and arm in Arm.names():
        return Arm.named(arm)
    if isinstance(arm, str) and arm.endswith((".urdf", ".toml")):
        raise ConfigError(
            f"{arm!r} is one file, but an arm has two: pass (URDF, arm.toml), or 'arm.urdf,arm.toml' in a shell"
        )
    known = ", ".join(repr(name) for name in Arm.names())
    raise ConfigError(f"there is no arm {arm!r}; choose from {known}, or pass the paths of a URDF and an arm.toml")


def _loaded(urdf: Path, toml: Path) -> Arm:
    """Load an arm from its files, and warn once of what was assumed."""
    if not urdf.is_file() or not toml.is_file():
        return Arm.load(urdf, toml)  # raises
    text = read_text(toml)
    try:
        fitted = read_hand(urdf)
    except HandError as error:
        raise ArmError(str(error)) from None
    arm = Arm(fitted.text, text, (fitted.name, str(toml)), fitted.assumptions)
    if arm.assumptions and fitted.name not in _TOLD:
        _TOLD.add(fitted.name)
        warnings.warn(AssumedWarning(arm.assumptions, "Arm.assumptions"), stacklevel=3)
    return arm
