"""The command line: ``graspbox --help``. Each command has its own module, imported when the command is called.

Commands are entry points of the group ``graspbox.commands``, those of this package and of others alike. An entry point
names a function with typer's annotations, or a `typer.Typer` with commands of its own::

    [project.entry-points."graspbox.commands"]
    weigh = "my_package.commands:weigh"

Exit status: 0 if the command did its work, 1 if it could not (or could not for some of the objects), 2 for a wrong
call, 130 after Ctrl-C, 141 if a reader such as ``head`` closed the output.
"""

import sys
from typing import TYPE_CHECKING, Any, NoReturn

from graspbox._common.entry_points import entry_points_of, load_entry_point, summary
from graspbox._common.programs import run_program
from graspbox.errors import MissingExtraError

if TYPE_CHECKING:
    import typer

__all__ = ["COMMANDS", "app", "overview", "typer_app"]

#: Group of the entry points.
COMMANDS = "graspbox.commands"
#: Packages of the extra ``cli`` that every command needs.
_NEEDED = ("typer", "rich")


def app() -> NoReturn:
    """Run the command line; errors that graspbox raises on purpose become one line and an exit status."""
    run_program(lambda: _run(sys.argv[1:]))


def _run(words: list[str]) -> object:
    if not words or words[0] == "--help":
        print(overview())
        return 0 if words else 2
    if words[0] == "--version":
        from graspbox._core import __version__

        print(f"graspbox {__version__}")
        return 0
    return typer_app(words[0])()


def overview() -> str:
    """Describe the command line: a line for each command. No command is imported."""
    import shutil
    import textwrap

    points = entry_points_of(COMMANDS)
    rows = {"--version": "Print the version and exit.", "--help": "Show this message and exit."}
    commands = {name: summary(points[name]) for name in sorted(points)}
    indent = 2 + max(map(len, (*rows, *commands))) + 2
    width = max(60, min(120, shutil.get_terminal_size().columns))

    def lines(entries: dict[str, str]) -> str:
        return "\n".join(
            textwrap.fill(text, width, initial_indent=f"  {name}".ljust(indent), subsequent_indent=" " * indent)
            for name, text in entries.items()
        )

    usage = "Usage: graspbox [OPTIONS] COMMAND [ARGS]...\n\nFrom a mesh to simulated grasps."
    help_of_one = "graspbox COMMAND --help explains a command."
    return f"{usage}\n\nOptions:\n{lines(rows)}\n\nCommands:\n{lines(commands)}\n\n{help_of_one}"


def typer_app(name: str) -> "typer.Typer":
    """Import a command, and return a program whose only command it is."""
    try:
        import rich  # noqa: F401 (the commands print with it)
        import typer
    except ModuleNotFoundError as error:
        if error.name not in _NEEDED:
            raise
        message = f"the command line needs {error.name}, from the extra 'cli': pip install 'graspbox[cli]'"
        raise MissingExtraError(message) from None
    command: Any = load_entry_point(COMMANDS, name, "command", "graspbox --help lists all")
    program = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    if isinstance(command, typer.Typer):
        program.add_typer(command, name=name)
    else:
        program.command(name)(command)

    @program.callback()
    def _program() -> None:
        """From a mesh to simulated grasps."""

    return program
