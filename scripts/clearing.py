"""The picture of a pile that a policy clears, attempt by attempt; for ``figures.py``."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from graspbox.evaluation.rounds import clear_rounds
from graspbox.policies import load

_COLUMNS = 4
_DPI = 100


def save_clearing(path: Path, policy: Path, objects: str, count: int, seed: int) -> None:
    """Show the scene at first and after every attempt."""
    frames, titles = list[Any](), list[str]()

    def film(picture: Any, shown: str) -> None:
        frames.append(picture)
        titles.append(shown)

    clear_rounds(load(policy), objects=objects, objects_per_scene=count, rounds=1, seed=seed, film=film)
    _draw(path, frames, titles)


def _draw(path: Path, frames: list[Any], titles: list[str]) -> None:
    """Draw frames under their titles."""
    rows = -(-len(frames) // _COLUMNS)
    high, wide = frames[0].shape[:2]
    figure = Figure(figsize=(_COLUMNS * wide / _DPI, rows * (high + 40) / _DPI), dpi=_DPI, layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels:
        axes.axis("off")
    for axes, frame, title in zip(panels, frames, titles, strict=False):
        axes.imshow(frame)
        axes.set_title(title, fontsize=10)
    figure.savefig(path)
