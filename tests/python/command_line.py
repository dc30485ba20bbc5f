"""The command line in the process of the tests."""

from collections.abc import Sequence
from typing import Any

from typer.testing import CliRunner, Result

from graspbox.cli import typer_app

__all__ = ["invoke"]


def invoke(words: Sequence[Any], **settings: Any) -> Result:
    """Run ``graspbox`` with arguments; settings are those of ``CliRunner.invoke``."""
    return CliRunner().invoke(typer_app(words[0]), list(map(str, words)), **settings)
