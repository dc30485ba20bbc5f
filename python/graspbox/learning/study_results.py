"""Results of the reproduction as Markdown: tables 3.2 and 3.3 of the study beside ours, and the page that shows all."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.learning.execution import Score
from graspbox.learning.study_settings import BATCH_SIZES, STUDY_WEIGHTS, TABLES, StudyRow

__all__ = ["PARTS", "NetworkResult", "baseline_table", "cause_table", "network_table", "page", "study_error"]

#: Parts of the data, in the order in which the study gives its errors.
PARTS = ("train", "test", "validation")
_TITLES = {"cnn2d": "2DCNN", "cnn2d_dropout": "2DCNN with dropout", "cnn3d": "3DCNN"}


@dataclass(frozen=True)
class NetworkResult:
    """One trained network.

    Attributes
    ----------
    settings, network, loss : str
        Which one it is.
    stopped : str
        Why training stopped: ``patience``, ``max_epochs`` or ``budget``.
    iterations : int
        Iterations until then.
    seconds : float
        Wall time of training.
    errors : mapping
        Per part of `PARTS`: ``position`` (m), ``rotation`` (unit of the loss), ``angle`` (rad).
    test, unseen : Score
        Predictions executed for the test samples, and for views of objects that no sample shows.
    spread : mapping
        Mean distance of positions from their mean over the test samples, metres: ``predicted`` and ``labels``.
    orientation_norm : tuple of float
        Mean length of the four orientation outputs before they are normalized (of the three angles for ``euler``): in
        the first iteration, in the second and in the last.
    moved : float
        How far all weights but those of the last layer moved in training, as a share of their norm.
    """

    settings: str
    network: str
    loss: str
    stopped: str
    iterations: int
    seconds: float
    errors: Mapping[str, Mapping[str, float]]
    test: Score
    unseen: Score
    spread: Mapping[str, float]
    orientation_norm: tuple[float, ...]
    moved: float

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> "NetworkResult":
        """Make it from what `row` gave, read back from JSON."""
        scores = {name: Score(**row[name]) for name in ("test", "unseen")}
        return cls(**{**row, **scores, "orientation_norm": tuple(row["orientation_norm"])})

    def row(self) -> dict[str, Any]:
        """Give it as JSON holds it."""
        return {**asdict(self), "orientation_norm": list(self.orientation_norm)}


def study_error(network: str, errors: Mapping[str, float]) -> float:
    """Error as the study's tables have it: the errors weighted as its program does, summed over one of its batches."""
    per_sample = STUDY_WEIGHTS["position"] * errors["position"] + STUDY_WEIGHTS["rotation"] * errors["rotation"]
    return BATCH_SIZES[network] * per_sample


def position_spread(poses: NDArray[np.float64]) -> float:
    """Mean distance of the positions of poses (n, 4, 4) from their mean, metres."""
    positions = poses[:, :3, 3]
    return float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).mean())


def _markdown(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [titles, ["---", *["--:"] * (len(titles) - 1)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _percent(part: int, whole: int) -> str:
    return f"{part}/{whole}" + (f", {part / whole:.0%}" if whole else "")


def network_table(network: str, results: Sequence[NetworkResult]) -> str:
    """Table of a network: a row per loss, the study's results beside those of each of our settings."""
    table, study = TABLES.get(network, ("", ()))
    known = {row.loss: row for row in study}
    own = [result for result in results if result.network == network]
    losses = [*known, *(loss for loss in dict.fromkeys(r.loss for r in own) if loss not in known)]
    settings = list(dict.fromkeys(result.settings for result in own))
    titles = ["loss"]
    if study:
        titles += [f"study: grasps that succeed, of about 61 (table {table})", "study: errors"]
    for name in settings:
        titles += [f"{name}: success", "secure", "study's criterion", "infeasible", "unseen objects", "errors",
                   "position, angle"]  # fmt: skip
    rows = []
    for loss in losses:
        cells = [loss, *(_study_cells(known.get(loss)) if study else ())]
        for name in settings:
            found = next((r for r in own if (r.loss, r.settings) == (loss, name)), None)
            cells += _cells(found) if found else [""] * 7
        rows.append(cells)
    return _markdown(titles, rows)


def _study_cells(row: StudyRow | None) -> list[str]:
    return ["", ""] if row is None else [f"{row.success}", f"{row.train:.2f}/{row.test:.2f}/{row.validation:.2f}"]


def _cells(result: NetworkResult) -> list[str]:
    test, unseen = result.test, result.unseen
    return [
        _percent(test.success, test.tried),
        str(test.secure),
        str(test.legacy),
        str(test.infeasible),
        _percent(unseen.success, unseen.tried),
        "/".join(f"{study_error(result.network, result.errors[part]):.2f}" for part in PARTS),
        f"{100 * result.errors['test']['position']:.1f} cm, {np.degrees(result.errors['test']['angle']):.0f} deg",
    ]


def baseline_table(baselines: Mapping[str, Mapping[str, Mapping[str, int]]]) -> str:
    """Table of predictions that no network made: per kind of data and baseline, the counts of `Score`."""
    rows = []
    for kind, scores in baselines.items():
        for name, counts in scores.items():
            score = Score(**counts)
            rows.append([f"{kind}: {name}", _percent(score.success, score.tried), str(score.secure),
                         str(score.legacy), str(score.infeasible)])  # fmt: skip
    return _markdown(["baseline", "success", "secure", "study's criterion", "infeasible"], rows)


def cause_table(results: Sequence[NetworkResult]) -> str:
    """Table of what training did to each network."""
    rows = [
        [
            f"{result.settings}, {result.network}, {result.loss}",
            f"{result.iterations} ({result.stopped})",
            f"{result.seconds / 60:.1f} min",
            f"{result.moved:.2g}",
            ", ".join(f"{norm:.3g}" for norm in result.orientation_norm),
            f"{1e3 * result.spread['predicted']:.1f} mm of {1e3 * result.spread['labels']:.1f} mm",
        ]
        for result in results
    ]
    titles = [
        "network",
        "iterations",
        "wall time",
        "weights moved by",
        "norm of the orientation outputs: first, second, last iteration",
        "spread of predicted positions, of labels",
    ]
    return _markdown(titles, rows)


def page(
    command: str,
    facts: Mapping[str, str],
    results: Sequence[NetworkResult],
    baselines: Mapping[str, Mapping[str, Mapping[str, int]]],
    figures: Mapping[str, str],
) -> str:
    """Write the page of a reproduction.

    Parameters
    ----------
    command : str
        The command that made it.
    facts : mapping
        Facts about the data, by name.
    results : sequence of NetworkResult
        The networks.
    baselines : mapping
        See `baseline_table`.
    figures : mapping
        File names of the figures, by their captions.
    """
    parts = ["# The study's networks, trained again\n", f"Made by `{command}`.\n"]
    parts.append("".join(f"- {name}: {value}\n" for name, value in facts.items()))
    for network in dict.fromkeys(result.network for result in results):
        table = TABLES.get(network, ("", ()))[0]
        beside = f", beside table {table} of the study" if table else ""
        parts += [f"## {_TITLES[network]}{beside}\n", network_table(network, results)]
    parts += [
        "Errors are training/test/validation errors in the study's unit: 0.005 position (m) + 0.031 orientation (unit "
        "of the loss), summed over one of its batches. Training errors are over as many samples as the validation has. "
        "`psi2` and `psi3` are the same function, so different results of the two measure chance alone.\n",
        "## Predictions without a network\n",
        "`label` executes the pose of the test sample itself, `nearest` that of the nearest training input, `average` "
        "the average of the object's training poses, `constant` one training pose for everything "
        "(`graspbox.learning.execution`).\n",
        baseline_table(baselines),
        "## What training did\n",
        '"Weights moved by" is over all layers but the last, as a share of their norm.\n',
        cause_table(results),
    ]
    for caption, file in figures.items():
        parts += [f"## {caption}\n", f"![{caption}]({file})\n"]
    return "\n".join(parts)
