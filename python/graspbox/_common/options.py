"""Command lines of dataclasses: typer's options are made from the fields of settings (extra ``cli``)."""

import ast
import functools
import inspect
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import typer
from rich.markup import escape

from graspbox.errors import ConfigError

__all__ = ["flattened", "parse"]

Settings = TypeVar("Settings")


def parse(
    kind: type[Settings], words: Sequence[str] | None = None, prog: str | None = None, text: str = ""
) -> Settings:
    """Parse a command line, by default that of the process, into a dataclass.

    A field is an option, such as ``--torch-threads``; positional if it is annotated with `typer.Argument`; repeatable
    if it is a tuple, which an empty text leaves empty. Fields of a nested dataclass, which have defaults, are options
    such as ``--hours.data``. The docstring below a field is its help; `text`, by default the docstring of the class,
    is that of the program `prog`.

    Raises
    ------
    SystemExit
        After ``--help``, and for wrong options, which include those that the dataclass refuses.
    """
    made: list[Settings] = []

    def command(_context: typer.Context, **values: Any) -> None:
        if _context.args:
            raise typer.BadParameter(
                f"unexpected {' '.join(map(repr, _context.args))}; an option with several values is repeated for each, "
                "as in --objects procedural --objects ycb"
            )
        try:
            made.append(_made(kind, values))
        except ConfigError as error:
            raise typer.BadParameter(str(error)) from None

    options = [_parameter("_context", typer.Context), *_options(kind)]
    command.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    command.__annotations__ = {option.name: option.annotation for option in options}
    program, extra = typer.Typer(add_completion=False, pretty_exceptions_enable=False), {"allow_extra_args": True}
    program.command(help=_paragraphs(text or inspect.getdoc(kind) or ""), context_settings=extra)(command)
    try:
        program(args=None if words is None else list(words), prog_name=prog)
    except SystemExit:
        if not made:
            raise
    return made[0]


def flattened(command: Callable[..., None]) -> Callable[..., None]:
    """Let the fields of the dataclasses among a command's parameters be its options, so that commands share them.

    Each field is annotated as typer's parameters are, and has the name of its option.
    """
    hints, parameters, kinds = get_type_hints(command, include_extras=True), [], {}
    for name, own in inspect.signature(command).parameters.items():
        if is_dataclass(hints[name]):
            kinds[name] = hints[name]
            of = get_type_hints(hints[name], include_extras=True)
            parameters += [_parameter(one.name, of[one.name], _default(one)) for one in fields(hints[name])]
        else:
            parameters.append(_parameter(name, hints[name], own.default))

    @functools.wraps(command)
    def called(**values: Any) -> None:
        groups = {
            name: kind(**{one.name: values.pop(one.name) for one in fields(kind)}) for name, kind in kinds.items()
        }
        command(**groups, **values)

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    del called.__wrapped__  # its parameters are others
    return called


def _options(kind: type, prefix: str = "") -> list[inspect.Parameter]:
    """Make a parameter for each field, as typer reads it; `prefix` is the path of a nested dataclass."""
    hints, docs, parameters = get_type_hints(kind, include_extras=True), _field_docs(kind), []
    for field in fields(kind):
        if not field.init:
            continue
        hint, name = hints[field.name], prefix + field.name
        if is_dataclass(hint):
            parameters += _options(hint, f"{name}.")  # type: ignore[arg-type]
            continue
        positional = get_origin(hint) is Annotated
        plain = get_args(hint)[0] if positional else hint
        if get_origin(plain) is tuple:
            plain = list[_item(get_args(plain)[0])]  # type: ignore[misc]
        flag = f"--{name.replace('_', '-')}"
        info: Any = typer.Argument(help=escape(docs.get(field.name, "")))
        if not positional:
            names = f"{flag}/--no-{flag[2:]}" if plain is bool else flag
            panel = f"Options: {prefix[:-1]}" if prefix else None
            info = typer.Option(names, help=escape(docs.get(field.name, "")), rich_help_panel=panel)
        parameters.append(_parameter(name.replace(".", "__"), Annotated[plain, info], _default(field)))
    return parameters


def _parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _item(hint: Any) -> Any:
    """Return the type of a repeatable option; typer takes lists of enums, and no lists of literals."""
    return Enum("Choice", {value: value for value in get_args(hint)}) if get_origin(hint) is Literal else hint


def _default(field: "Field[Any]") -> Any:
    value = field.default if field.default_factory is MISSING else field.default_factory()
    if value is MISSING:
        return inspect.Parameter.empty
    return list(value) if isinstance(value, tuple) else value


def _made(kind: type[Settings], values: dict[str, Any], prefix: str = "") -> Settings:
    """Assemble a dataclass from the values of typer."""
    arguments: dict[str, Any] = {}
    hints = get_type_hints(kind)
    for field in fields(kind):  # type: ignore[arg-type]
        if not field.init:
            continue
        name, hint = prefix + field.name, hints[field.name]
        if is_dataclass(hint):
            arguments[field.name] = _made(hint, values, f"{name}__")  # type: ignore[arg-type]
        elif get_origin(hint) is tuple:
            arguments[field.name] = tuple(getattr(item, "value", item) for item in values[name] or () if item != "")
        else:
            arguments[field.name] = values[name]
    return kind(**arguments)


def _field_docs(kind: type) -> dict[str, str]:
    """Read the docstrings below the fields of a dataclass and of its bases from the source."""
    texts = {}
    for base in reversed(kind.__mro__[:-1]):
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        for field, doc in pairwise(node.body):  # type: ignore[attr-defined]
            if isinstance(field, ast.AnnAssign) and isinstance(doc, ast.Expr) and isinstance(doc.value, ast.Constant):
                texts[ast.unparse(field.target)] = " ".join(str(doc.value.value).split())
    return texts


def _paragraphs(text: str) -> str:
    """Mark paragraphs with indented or numbered lines, which typer would wrap otherwise."""
    marked = [f"\b\n{part}" if re.search(r"^( |\d+\. )", part, re.MULTILINE) else part for part in text.split("\n\n")]
    return escape("\n\n".join(marked))
