"""Policies of installed packages, by bare names such as ``depth``; no code of those packages runs.

A package offers policies by entry points of the group ``graspbox.policies``, one per policy: its name, and its folder
as a dotted path of which the first part is an importable package::

    [project.entry-points."graspbox.policies"]
    depth = "graspbox_policies.depth"

The published policies are in the package ``graspbox-policies``.
"""

import os
import re
from collections.abc import Iterable
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from graspbox._core import __version__
from graspbox.errors import ConfigError, MissingExtraError

__all__ = ["GROUP", "PACKAGE", "PUBLISHED", "find", "folders", "is_bare", "name_of", "names", "package_of"]

#: Group of the entry points that name policies.
GROUP = "graspbox.policies"
#: The package of the published policies, and their names.
PACKAGE = "graspbox-policies"
PUBLISHED = (
    "any_hand", "depth", "feel", "feel_inspire", "feel_leap", "head", "inspire", "leap", "panda",
    "panda_clutter", "reflex_clutter", "robotiq", "soft_hand", "study",
)  # fmt: skip
_BARE = re.compile(r"[A-Za-z0-9][\w.-]*")
_DOTTED = re.compile(r"\w+(\.\w+)*")


def is_bare(name: str | os.PathLike[str]) -> bool:
    """Return whether a name may be that of an installed policy: no path, and no address."""
    return isinstance(name, str) and _BARE.fullmatch(name) is not None


def names() -> tuple[str, ...]:
    """Names of the policies that installed packages offer, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=GROUP)}))


def folders(name: str) -> list[Path]:
    """Folders that installed packages offer under a name; most often one or none."""
    return [folder for entry in entry_points(group=GROUP, name=name) if (folder := _folder(entry)) is not None]


def name_of(folder: Path) -> str | None:
    """Find the name under which an installed package offers a folder; None if none does."""
    wanted = folder.resolve()
    return next((entry.name for entry in entry_points(group=GROUP) if _folder(entry) == wanted), None)


def find(name: str, others: Iterable[str] = ()) -> Path:
    """Find the folder of an installed policy by its bare name; errors also list the names `others`.

    Raises
    ------
    ConfigError
        If no package, or more than one, offers a policy of that name, or its folder is missing.
    MissingExtraError
        If it is a published policy, and its package is not installed.
    """
    offers = tuple(entry_points(group=GROUP, name=name))
    if len(offers) > 1:
        packages = " and ".join(sorted(package_of(entry) for entry in offers))
        raise ConfigError(f"the packages {packages} both offer a policy {name!r}; name the folder of one")
    if offers:
        folder = _folder(offers[0])
        if folder is None:
            package = package_of(offers[0])
            raise ConfigError(
                f"the package {package} offers the policy {name!r}, but {offers[0].value!r} is no folder; install it "
                f"again: pip install --force-reinstall {package}"
            )
        return folder
    known = names()
    if name in PUBLISHED and not set(PUBLISHED) & set(known):
        raise MissingExtraError(
            f"the policy {name!r} is in the package {PACKAGE}, which is not installed: pip install "
            f"{PACKAGE}=={__version__}, or, in a checkout, pip install ./packages/policies"
        )
    choices = (*others, *known)
    near = get_close_matches(name, (*choices, *PUBLISHED), n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    listed = f"choose from {', '.join(choices)}, or name" if choices else "name"
    raise ConfigError(f"there is no policy {name!r}; {hint}{listed} a folder with config.json")


def _folder(entry: EntryPoint) -> Path | None:
    """Locate the folder of an entry point without an import; None if there is none."""
    if not _DOTTED.fullmatch(entry.value):
        return None
    package, *parts = entry.value.split(".")
    spec = find_spec(package)
    places = (spec.submodule_search_locations if spec is not None else None) or ()
    folders = (Path(place, *parts) for place in places)
    return next((folder.resolve() for folder in folders if folder.is_dir()), None)


def package_of(entry: EntryPoint) -> str:
    """Return the name of the package that declares an entry point."""
    return entry.dist.name if entry.dist is not None else entry.value.partition(".")[0]
