"""Descriptions of hands as URDFs without collision meshes: URDF, xacro (extra ``urdf``) and MJCF (extra ``mjcf``)."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from graspbox._common.imports import imported
from graspbox.errors import HandError
from graspbox.hands.mjcf import urdf_of_mjcf
from graspbox.hands.urdf_meshes import FittedUrdf, read_text, with_primitives

__all__ = ["fitted_urdf", "is_mjcf", "read_hand"]

#: The first element of an XML file, after declaration and comments.
_ROOT = re.compile(r"\s*+(?:(?><\?.*?\?>|<!--.*?-->)\s*+)*+<([\w:.-]+)", re.DOTALL)
_COMMENT, _XACRO = re.compile(r"<!--.*?-->", re.DOTALL), re.compile(r"<\s*xacro:")


def fitted_urdf(path: str | os.PathLike[str], text: str | None = None) -> FittedUrdf:
    """Read a URDF, and fit primitives to its collision meshes; without any, its text stays the same.

    Parameters
    ----------
    path : str or PathLike
        The URDF; a xacro is expanded (extra ``urdf``), an MJCF file converted (`urdf_of_mjcf`). Meshes are STL, OBJ,
        PLY, OFF, GLB, glTF or COLLADA files in metres, named relative to its folder, by ``file://``, or by
        ``package://NAME/...``, where a folder NAME above the URDF or a sourced ROS workspace holds them. Of a path of
        another machine the longest end is taken that exists in the URDF's folder or above; an assumption says so.
    text : str, optional
        A URDF to use instead of the file's content, with the same lines.

    Raises
    ------
    HandError
        If the file cannot be read, describes no tree of links, or a mesh is missing, cannot be read or is flat; the
        message names every wrong line.
    MissingExtraError
        Without a package that the file needs.
    """
    path = Path(path)
    return read_hand(path) if text is None else with_primitives(text, path, str(path))


def read_hand(
    path: Path,
    check: Callable[[str, str], object] | None = None,
    edit: Callable[[str], str] | None = None,
    base: str | None = None,
) -> FittedUrdf:
    """Do as `fitted_urdf`, with an edited URDF.

    `check` is called with a text and its name before meshes are fitted, and may raise. `edit` returns the URDF to use
    instead of a text, with the same lines; errors of what it leaves out do not matter. `base` is as in `urdf_of_mjcf`.
    """
    text = read_text(path)
    if is_mjcf(text):
        converted = replace(urdf_of_mjcf(path, base), name=f"{path} (converted)")
        return converted if edit is None else replace(converted, text=edit(converted.text))
    name = str(path)
    if _XACRO.search(_COMMENT.sub("", text)) and find_spec("xacrodoc") is not None:
        text, name = _expanded(path), f"{path} (expanded)"
    if edit is not None:
        text = edit(text)
    return with_primitives(text, path, name, None if check is None else lambda simple: check(simple, name))


def is_mjcf(text: str) -> bool:
    """Whether a file is an MJCF file, by its first element."""
    root = _ROOT.match(text)
    return root is not None and root[1] == "mujoco"


def _expanded(path: Path) -> str:
    """Expand a xacro; xacrodoc finds packages without ROS, in the folders above it."""
    packages: Any = imported("xacrodoc.packages", "reading a xacro needs the package xacrodoc", "urdf")
    xacro: Any = imported("xacro", "reading a xacro needs the package xacro", "urdf")
    try:
        packages.walk_up_from(path)
        expanded = str(xacro.process_file(str(path)).toprettyxml(indent="  "))
    except Exception as error:  # xacro raises whatever its expressions do
        raise HandError(f"{path}: xacro cannot expand it: {' '.join(str(error).split())}") from None
    if not re.search(r"<\s*link\b", expanded):
        raise HandError(f"{path}: it defines macros and makes no link; pass the xacro that calls them")
    return expanded
