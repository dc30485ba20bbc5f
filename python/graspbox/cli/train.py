"""``graspbox train``: every training of this package, with the same options for folder, seed, device and output.

tyro reads the options, which are dataclasses of the packages that train. Torch is imported once the options of a
command are parsed.
"""

import inspect
import shlex
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import typer

from graspbox import sb3, study
from graspbox.cli.common import console, print_json
from graspbox.errors import ConfigError, MissingExtraError
from graspbox.training.options import Options, Outcome

__all__ = ["parse", "train", "train_app"]

train_app = typer.Typer(
    no_args_is_help=True,
    help="Train a policy, or a part of one, in a folder. The same command continues an interrupted run.",
)


class _Training(NamedTuple):
    """A training: the module of its function ``train``, its options, and one line about it."""

    module: str
    options: str
    summary: str


_RECIPES, _SB3 = "graspbox.recipes.settings.", "graspbox.sb3.settings:"
TRAININGS = {
    name: _Training(f"graspbox.{module}", options, summary)
    for name, module, options, summary in (
        ("depth", "recipes.depth", f"{_RECIPES}depth:DepthSettings", "A policy that grasps from one depth image."),
        (
            "any-hand",
            "recipes.any_hand",
            f"{_RECIPES}any_hand:AnyHandSettings",
            "One scorer for many hands, seen or not.",
        ),
        ("feel", "recipes.feel", f"{_RECIPES}feel:FeelSettings", "Add a grasp-stability check to a depth policy."),
        ("head", "recipes.head", f"{_RECIPES}head:HeadSettings", "Heads: one network from a depth image to a grasp."),
        ("residual", "sb3.residual_training", f"{_SB3}ResidualSettings", "Correct a policy's grasps, by rewards."),
        ("clone", "sb3.cloning", f"{_SB3}CloneSettings", "Behaviour cloning of recorded demonstrations."),
        ("sb3", "sb3.training", f"{_SB3}Sb3Settings", "Reinforcement learning with Stable-Baselines3."),
        ("study", "recipes.study", f"{_RECIPES}study:StudySettings", "The networks of the 2017 study, trained again."),
    )
}


def _found(where: str) -> Any:
    module, _, name = where.partition(":")
    return getattr(import_module(module), name)


def parse(name: str, words: Sequence[str]) -> Options:
    """Parse the options of a training; wrong ones, and ``--help``, end the program as they should.

    Raises
    ------
    MissingExtraError
        If a package that reads options is not installed.
    """
    try:
        import tyro

        kind = _found(TRAININGS[name].options)
    except ModuleNotFoundError as error:
        if error.name not in ("tyro", "yaml"):
            raise
        raise MissingExtraError(f"graspbox train needs {error.name}: pip install 'graspbox[train]'") from None
    found: Options = tyro.cli(kind, args=list(words), prog=f"graspbox train {name}", description=inspect.getdoc(kind))
    return found


def train(name: str, words: Sequence[str]) -> int:
    """Run a training and print its results; returns the exit status."""
    options = parse(name, words)
    study.require()
    sb3.require()
    import torch

    try:
        torch.empty(0, device=options.device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigError(f"--device is {options.device!r}, which this machine does not have: {reason}") from None
    torch.set_num_threads(options.torch_threads)
    command = shlex.join(["graspbox", "train", name, *words])
    try:
        outcome: Outcome = _found(f"{TRAININGS[name].module}:train")(options, command, _show)
    except KeyboardInterrupt:
        _show("interrupted; the same command continues")
        return 130
    if options.json:
        print_json(outcome.results)
    else:
        typer.echo(outcome.text.rstrip("\n"))
    return outcome.status


def _show(line: str) -> None:
    console.print(line, soft_wrap=True)


def _add(name: str, summary: str) -> None:
    def command(context: typer.Context) -> None:
        if status := train(name, context.args):
            raise typer.Exit(status)

    anything = {"allow_extra_args": True, "ignore_unknown_options": True}
    train_app.command(name, help=summary, context_settings=anything, add_help_option=False)(command)


for _name, _training in TRAININGS.items():
    _add(_name, _training.summary)
