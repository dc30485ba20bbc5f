"""Options, progress bar and output that the comparisons with MuJoCo share."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from rich.console import Console
from rich.progress import Progress

from validation.versions import judged_by

__all__ = ["Report", "compare", "make_parser", "print_report", "progress_bar"]


class Report(Protocol):
    """Results of a comparison."""

    def to_json(self) -> dict[str, Any]:
        """Return the results as JSON types."""


R = TypeVar("R", bound=Report)


def make_parser(check: str, description: str | None) -> argparse.ArgumentParser:
    """Return a parser with the options ``--seed``, ``--threads`` and ``--json``."""
    parser = argparse.ArgumentParser(
        prog=f"python tests/validate.py {check}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of poses and trials (0)")
    parser.add_argument("--threads", type=int, default=None, help="threads for both engines; all by default")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


def progress_bar(args: argparse.Namespace) -> Progress:
    """Return a progress bar on stderr; with ``--json`` only in a terminal."""
    return Progress(console=Console(stderr=True), disable=args.json and not sys.stderr.isatty())


def compare(
    args: argparse.Namespace, unit: str, total: int, function: Callable[..., R], *arguments: object, **options: object
) -> R:
    """Call a comparison with the hand and the threads of the options, and with a progress bar."""
    with progress_bar(args) as bar:
        task = bar.add_task(unit, total=total)
        options = {"hand": args.hand, "threads": args.threads, **options}
        return function(*arguments, args.seed, **options, progress=lambda done: bar.update(task, completed=done))


def print_report(args: argparse.Namespace, report: R, show: Callable[[Console, R], None]) -> None:
    """Print a report as JSON or with `show`."""
    if args.json:
        print(json.dumps(report.to_json()))
    else:
        show(Console(), report)
        print(judged_by())
