"""The page of a comparison: a table of results, the curves, the commands."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from cloning.steps import INPUTS, Settings, Step
from graspbox._common.files import write_text
from graspbox._common.runs import Rows
from graspbox.pictures.files import Figure, write

COLORS = {"rl": "tab:blue", "tuned": "tab:orange", "dense": "tab:green"}
#: The shares that are measured, with their intervals.
SHARES = (("success", "ci95"), ("secure", "secure_ci95"))


def results(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the results of the comparison so far, by the name of the run."""
    paths = sorted(folder.glob("*.test.json"))
    return {path.name.removesuffix(".test.json"): json.loads(path.read_text())["policy"] for path in paths}


def plot(panel: Any, settings: Settings, input_name: str, name: str, interval: str) -> None:
    """Plot a share over the steps of training, with lines for the clone and the demonstrator."""
    for kind, color in COLORS.items():
        if rows := Rows(settings.folder / f"{kind}-{input_name}/evaluations.jsonl"):
            places = [row["timesteps"] for row in rows]
            panel.plot(places, [row[name] for row in rows], marker=".", label=kind, color=color)
            panel.fill_between(places, *np.array([row[interval] for row in rows]).T, color=color, alpha=0.15, lw=0)
    for row in Rows(settings.folder / f"clone-{input_name}/evaluations.jsonl")[-1:]:
        panel.axhline(row[name], ls="--", color="0.3", lw=1, label="clone")
    shown = Path(settings.demonstrator).name
    if row_of := results(settings.folder).get(shown):
        panel.axhline(row_of[name], ls=":", color="0.3", lw=1, label=f"{shown}, on test objects")
    panel.set(ylim=(-0.03, 1.03), ylabel="share that succeeds" if name == "success" else "share secure")
    panel.grid(alpha=0.3)


def write_page(settings: Settings, steps: list[Step]) -> None:
    """Write the results so far, with the curves and the commands."""
    figure = Figure(figsize=(5.5 * len(settings.inputs), 7.5), dpi=120, layout="constrained")
    panels = figure.subplots(2, len(settings.inputs), sharex=True, sharey=True, squeeze=False)
    for input_name, column in zip(settings.inputs, panels.T, strict=True):
        for panel, (name, interval) in zip(column, SHARES, strict=True):
            plot(panel, settings, input_name, name, interval)
        column[0].set_title(", ".join(INPUTS[input_name]))
        column[1].set_xlabel("steps of all environments")
    if panels[0, 0].get_legend_handles_labels()[0]:
        panels[0, 0].legend(loc="best", fontsize=9)
    write(figure, settings.folder / "curves.png")
    lines = ["# Cloning, rewards, and both", "", "Written by `scripts/compare_cloning.py`.", ""]
    lines += [f"{settings.episodes} trials with unseen objects; in brackets Wilson's 95 % intervals.", ""]
    lines += ["| policy | success | secure |", "|---|--:|--:|"]
    for name, row in results(settings.folder).items():
        cells = (f"{row[key]:.1%} ({row[ci][0]:.1%} to {row[ci][1]:.1%})" for key, ci in SHARES)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines += ["", "![Curves](curves.png)", "", "```", *(step.text for step in steps), "```", ""]
    write_text(settings.folder / "README.md", "\n".join(lines))
