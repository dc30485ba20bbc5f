"""Plot the held-out success of runs of ``graspbox train sb3``, of random actions, zero actions and the planner.

    python scripts/plot_sb3.py out/train/ppo out/train/sac --out success.png

Needs the extra ``cli``.
"""

import json
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from graspbox._common.programs import run_program
from graspbox._common.runs import Rows, read_settings
from graspbox.errors import GraspboxError
from graspbox.pictures.files import Figure, check_path, write

LINES = {"planner": "--", "random": ":", "zero": "-."}


def read(folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, Any]]:
    """Read settings, evaluations and baselines of a run."""
    try:
        settings = read_settings(folder)
    except GraspboxError as error:
        raise typer.BadParameter(str(error)) from None
    rows = Rows(folder / "evaluations.jsonl")
    if not rows:
        raise typer.BadParameter(f"the run in {str(folder)!r} has not been evaluated yet")
    baselines = folder / "baselines.json"
    return settings, rows, json.loads(baselines.read_text()) if baselines.is_file() else {}


def main(
    folders: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    out: Annotated[Path | None, typer.Option(help="The picture; by default success.png in the first folder.")] = None,
) -> None:
    """Plot success over steps and over minutes; bands are 95 % intervals."""
    try:
        path = check_path(out or folders[0] / "success.png")
    except GraspboxError as error:
        raise typer.BadParameter(str(error)) from None
    runs = [read(folder) for folder in folders]
    write(success_figure(runs), path)
    typer.echo(str(path))


def success_figure(runs: list[tuple[dict[str, Any], list[dict[str, Any]], dict[str, Any]]]) -> Figure:
    """Plot runs as `read` returns them: success with its 95 % interval, and the baselines as horizontal lines."""
    figure = Figure(figsize=(11, 4.4), dpi=120, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    known: dict[str, float] = {}
    for settings, rows, baselines in runs:
        success, intervals = (np.array([row[name] for row in rows]) for name in ("success", "ci95"))
        for panel, name, unit in ((panels[0], "timesteps", 1.0), (panels[1], "seconds", 60.0)):
            places = np.array([row[name] for row in rows]) / unit
            label = f"{settings['algorithm']}, seed {settings['seed']} (band: Wilson's 95 % interval)"
            (line,) = panel.plot(places, success, marker=".", label=label)
            panel.fill_between(places, *intervals.T, color=line.get_color(), alpha=0.2, lw=0)
        known |= {name: row["success"] for name, row in baselines.items()}
    for panel, title in zip(
        panels, ("steps of all environments", "minutes of training, evaluations included"), strict=True
    ):
        for name, rate in known.items():
            panel.axhline(rate, ls=LINES.get(name, "-"), color="0.4", lw=1, label=f"{name}: {rate:.0%}")
        panel.set(xlabel=title, ylim=(-0.03, 1.03))
        panel.grid(alpha=0.3)
    panels[0].set(ylabel="share of held-out trials that succeed")
    panels[0].legend(loc="best", fontsize=9)
    figure.suptitle(f"{settings['id']}, split {settings['evaluate']}: {settings['episodes']} trials per evaluation")
    return figure


if __name__ == "__main__":
    run_program(partial(typer.run, main))
