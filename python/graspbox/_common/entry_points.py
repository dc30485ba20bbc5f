"""Extensions by Python entry points, listed without importing them."""

import re
from difflib import get_close_matches
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from graspbox.errors import ConfigError, MissingExtraError

__all__ = ["entry_points_of", "load_entry_point", "summary"]

_OURS = "graspbox"


def entry_points_of(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name; the first one of a name that several packages declare."""
    return {point.name: point for point in reversed(tuple(entry_points(group=group)))}


def load_entry_point(group: str, name: str, kind: str, advice: str) -> Any:
    """Import what an entry point refers to; errors call it a `kind`, and `advice` ends that of an unknown name."""
    points = tuple(entry_points(group=group, name=name))
    if not points:
        close = get_close_matches(str(name), entry_points(group=group).names, 1)
        raise ConfigError(f"there is no {kind} {name!r}{f' (did you mean {close[0]}?)' if close else ''}; {advice}")
    if len(points) > 1:
        owners = " and ".join(sorted(map(_distribution, points)))
        raise ConfigError(f"the {kind} {name!r} is declared by {owners}; uninstall one of them")
    owner = _distribution(points[0])
    try:
        return points[0].load()
    except MissingExtraError:
        raise
    except (ImportError, AttributeError) as error:
        if owner == _OURS:
            raise
        raise ConfigError(f"the {kind} {name!r} of {owner} cannot be imported: {error}") from error


def _distribution(point: EntryPoint) -> str:
    return "an unknown package" if point.dist is None else str(point.dist.name)


def summary(point: EntryPoint) -> str:
    """Return the first paragraph of the docstring of a function or class, read from the source file.

    For anything else, such as a `typer.Typer`, it is that of the module; without one, the name of the distribution.
    """
    source = _source(point.module)
    header = rf"^(?:async )?(?:def|class) {re.escape(point.attr)}\b.*?(?=^[^\s)#@]|\Z)"
    if match := re.search(header, source, re.MULTILINE | re.DOTALL):
        text = re.search(r'^    r?"""(.+?)(?:\n[ \t]*\n|""")', match[0], re.MULTILINE | re.DOTALL)
    else:
        text = re.match(r'r?"""(.+?)(?:\n[ \t]*\n|""")', source, re.DOTALL)
    return f"from {_distribution(point)}" if text is None else " ".join(text[1].split())


def _source(module: str) -> str:
    """Read the source of a module without importing it or its parents; empty where there is none."""
    paths, name, spec = None, "", None
    for part in module.split("."):
        name = f"{name}.{part}" if name else part
        spec = PathFinder.find_spec(name, paths)
        if spec is None:
            return ""
        paths = spec.submodule_search_locations
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return ""
    with open(spec.origin, encoding="utf-8") as file:
        return file.read()
