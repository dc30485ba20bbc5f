"""The page of the command line, from the commands of the package."""

import inspect
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo

from doc_tables.environments import markdown
from graspbox._common.entry_points import entry_points_of
from graspbox.cli import COMMANDS, typer_app


def option_values(kind: Any, info: Any) -> str:
    """Describe the values of an argument or option: empty for a flag, else their type, bounds or meaning."""
    options = [part for part in get_args(kind) if part is not NoneType]
    if get_origin(kind) in (Union, UnionType):  # an option without a default
        return option_values(options[0], info)
    if get_origin(kind) is list:
        return f"{option_values(options[0], info)}; repeatable"
    if kind is bool:
        return ""
    if info.metavar and not isinstance(info, ArgumentInfo):
        return str(info.metavar)
    if options:  # a literal
        return " or ".join(f"`{option}`" for option in options)
    text = {int: "integer", float: "number", str: "text", Path: "path"}[kind]
    if info.min is None:
        return text
    # The greatest seed of 64 bits is not informative.
    bounded = info.max is not None and info.max < 2**32
    return f"{text}, {info.min} to {info.max}" if bounded else f"{text}, at least {info.min}"


def option_row(option: Any, kind: Any, info: Any) -> tuple[str, ...]:
    """Write an argument or option of a command: its names, values, default and meaning."""
    names = [f"`{name}`" for name in (*option.opts, *option.secondary_opts)]
    if isinstance(info, ArgumentInfo):
        names = [f"`{option.metavar or option.name.upper()}`"]
    if option.required:
        default = "required"
    elif kind is bool:
        default = names[0] if option.default else ""
    else:
        default = "" if option.default is None else f"`{option.default}`"
    return ", ".join(names), option_values(kind, info), default, option.help or ""


def options_table(command: Any) -> str:
    """Write the arguments and options of a command."""
    hints = get_type_hints(inspect.unwrap(command.callback), include_extras=True)
    options = [option for option in command.params if option.name in hints]
    rows = [option_row(option, *get_args(hints[option.name])[:2]) for option in options]
    return markdown("name values default meaning", rows)


def command_sections() -> str:
    """Write a section for each command, with its arguments and options, or with its own commands and their sections."""
    pages = []
    for name, point in sorted(entry_points_of(COMMANDS).items()):
        if point.dist is None or point.dist.name != "graspbox":
            continue
        command: Any = typer.main.get_command(typer_app(name)).commands[name]  # type: ignore[attr-defined]
        below = {} if name == "train" else getattr(command, "commands", {})
        if inner := getattr(command, "commands", None):
            first = {one: inspect.cleandoc(inner[one].help or "").partition("\n\n")[0] for one in inner}
            table = markdown("command meaning", [(f"`{one}`", " ".join(first[one].split())) for one in inner])
        else:
            table = options_table(command)
        pages.append(f"## graspbox {name}\n\n{inspect.cleandoc(command.help or '')}\n\n{table}")
        for one, each in below.items():
            text = inspect.cleandoc(each.help or "")
            pages.append(f"### graspbox {name} {one}\n\n{text}\n\n{options_table(each)}")
    return "\n\n".join(pages)
