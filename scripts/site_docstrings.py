"""An extension of Griffe for the documentation site: docstrings of the package as Markdown.

Doctests become code blocks. Names in single backticks, such as ```Policy``` or ```graspbox.load_mesh```, become links
to their documentation if the site has it. Sections outside numpy's style, such as the tables of an environment, become
headings. `mkdocs.yml` names this file.
"""

import re
from typing import Any

import griffe

#: A doctest in the prose of a docstring: lines that begin with a prompt, and their output up to an empty line.
_DOCTEST = re.compile(r"^(?P<indent> *)>>> .*(?:\n(?P=indent)\S.*)*", re.MULTILINE)
#: A section of a docstring, and the sections that Griffe reads.
_SECTION = re.compile(r"^(?P<title>\S[^\n]*)\n-{3,}$", re.MULTILINE)
_KNOWN = ("Attributes", "Examples", "Methods", "Notes", "Parameters", "Raises", "Returns", "Warns", "Yields")
#: A name in single backticks outside code blocks.
_NAME = re.compile(r"(?<![`\w])`(?P<name>[A-Za-z_][\w.]*)`(?!`)")


def fenced(text: str) -> str:
    """Put every doctest into a code block."""
    return _DOCTEST.sub(lambda match: f"{match['indent']}```pycon\n{match[0]}\n{match['indent']}```", text)


def titled(text: str) -> str:
    """Turn sections outside numpy's style into headings."""
    return _SECTION.sub(lambda match: match[0] if match["title"] in _KNOWN else f"## {match['title']}", text)


def linked(text: str, place: griffe.Object) -> str:
    """Turn names in single backticks into links; those that `place` cannot resolve remain as they are."""

    def link(match: re.Match[str]) -> str:
        name = match["name"]
        target = name if name.startswith("graspbox.") else _resolved(name, place)
        return f'<autoref identifier="{target}" optional><code>{name}</code></autoref>' if target else match[0]

    # Code blocks stay as they are.
    parts = re.split(r"(^ *```.*?^ *```$)", text, flags=re.DOTALL | re.MULTILINE)
    return "".join(part if index % 2 else _NAME.sub(link, part) for index, part in enumerate(parts))


def _resolved(name: str, place: griffe.Object) -> str:
    """Return the path of a name in the scope of an object, or an empty text."""
    first, _, rest = name.partition(".")
    if first in place.members and not isinstance(place.members[first], griffe.Attribute):
        return f"{place.path}.{name}"
    try:
        path = place.resolve(first)
    except griffe.NameResolutionError:
        return ""
    return f"{path}.{rest}" if rest else path


class Docstrings(griffe.Extension):
    """Rewrites the docstring of every object before it is rendered."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite one docstring."""
        if obj.docstring is not None:
            obj.docstring.value = linked(titled(fenced(obj.docstring.value)), obj)
