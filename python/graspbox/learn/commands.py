"""Train a policy, or a part of one, in a folder. The same command continues an interrupted run.

Trainings are entry points of the group ``graspbox.trainings``; each names a function of the options, the command line
and what prints a line, which returns a `TrainingOutcome`. The entry point of the same name in the group
``graspbox.trainings.options`` names its options, a subclass of `Options`. Torch is imported once they are parsed.
"""

import shlex
from collections.abc import Sequence
from typing import Any

import typer

from graspbox import learn
from graspbox._common import options
from graspbox._common.entry_points import entry_points_of, load_entry_point, summary
from graspbox.cli.common import console, print_json
from graspbox.errors import ConfigError
from graspbox.learn.training.options import Options, TrainingOutcome

__all__ = ["OPTIONS", "TRAININGS", "parse", "train", "train_app"]

#: Groups of the entry points: functions that train, and their options.
TRAININGS, OPTIONS = "graspbox.trainings", "graspbox.trainings.options"

train_app = typer.Typer(no_args_is_help=True, help=__doc__.partition("\n\n")[0])


def _loaded(group: str, name: str) -> Any:
    return load_entry_point(group, name, "training", "graspbox train --help lists all")


def parse(name: str, words: Sequence[str]) -> Options:
    """Parse the options of a training; wrong ones, and ``--help``, end the program."""
    found: Options = options.parse(_loaded(OPTIONS, name), words, f"graspbox train {name}")
    return found


def train(name: str, words: Sequence[str]) -> int:
    """Run a training and print its results; returns the exit status."""
    given = parse(name, words)
    learn.require("tensorboard", "stable_baselines3", "sb3_contrib")
    import torch

    try:
        torch.empty(0, device=given.device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigError(f"--device is {given.device!r}, which this machine does not have: {reason}") from None
    torch.set_num_threads(given.torch_threads)
    command = shlex.join(["graspbox", "train", name, *words])
    try:
        outcome: TrainingOutcome = _loaded(TRAININGS, name)(given, command, _show)
    except KeyboardInterrupt:
        _show("interrupted; the same command continues")
        return 130
    if given.json:
        print_json(outcome.results)
    else:
        typer.echo(outcome.text.rstrip("\n"))
    return outcome.status


def _show(line: str) -> None:
    console.print(line, soft_wrap=True)


def _add(name: str, meaning: str) -> None:
    def command(context: typer.Context) -> None:
        if status := train(name, context.args):
            raise typer.Exit(status)

    anything = {"allow_extra_args": True, "ignore_unknown_options": True}
    train_app.command(name, help=meaning, context_settings=anything, add_help_option=False)(command)


for _name, _point in sorted(entry_points_of(OPTIONS).items()):
    _add(_name, summary(_point))
