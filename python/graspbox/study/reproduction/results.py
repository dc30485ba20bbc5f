"""Results of the reproduction as Markdown: tables 3.2 and 3.3 of the study next to ours, and the page of all."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.evaluation.results import wilson
from graspbox.study.execution import Score
from graspbox.study.reproduction.protocol import BATCH_SIZES, STUDY_WEIGHTS, TABLES

__all__ = ["PARTS", "NetworkResult", "baseline_table", "cause_table", "network_table", "page", "study_error"]

#: Parts of the data, in the study's order.
PARTS = ("train", "test", "validation")
_TITLES = {"cnn2d": "2DCNN", "cnn2d_dropout": "2DCNN with dropout", "cnn3d": "3DCNN"}


@dataclass(frozen=True)
class NetworkResult:
    """One trained network.

    Attributes
    ----------
    stopped : str
        Why training stopped: ``patience``, ``steps`` or ``time``.
    errors : mapping
        Per part of `PARTS`: ``position`` (m), ``rotation`` (unit of the loss), ``angle`` (rad).
    test, unseen : Score
        Results of predictions executed for the test samples, and for views of objects outside the samples.
    spread : mapping
        Mean distance of positions from their mean over the test samples, metres: ``predicted`` and ``labels``.
    orientation_norm : tuple of float
        Mean length of the four orientation outputs before they are normalized (of the three angles for ``euler``): in
        the first iteration, in the second and in the last.
    moved : float
        Change of all weights except the last layer's in training, as a share of their norm.
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
        """Build from the output of `row`, read back from JSON."""
        scores = {name: Score(**row[name]) for name in ("test", "unseen")}
        return cls(**{**row, **scores, "orientation_norm": tuple(row["orientation_norm"])})

    def row(self) -> dict[str, Any]:
        """Convert to JSON types."""
        return {**asdict(self), "orientation_norm": list(self.orientation_norm)}


def study_error(network: str, errors: Mapping[str, float]) -> float:
    """Error as in the study's tables: the errors weighted as in its program, summed over one of its batches."""
    per_sample = STUDY_WEIGHTS["position"] * errors["position"] + STUDY_WEIGHTS["rotation"] * errors["rotation"]
    return BATCH_SIZES[network] * per_sample


def position_spread(poses: NDArray[np.float64]) -> float:
    """Mean distance of the positions of poses (n, 4, 4) from their mean, metres."""
    positions = poses[:, :3, 3]
    return float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).mean())


def _markdown(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [titles, ["---", *["--:"] * (len(titles) - 1)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _rate(part: int, whole: int) -> str:
    """Format a count with Wilson's 95 % interval of its rate."""
    if not whole:
        return f"{part}/{whole}"
    low, high = wilson(part, whole)
    return f"{part}/{whole}, {part / whole:.0%} ({100 * low:.0f} to {100 * high:.0f})"


def network_table(network: str, results: Sequence[NetworkResult]) -> str:
    """Table of a network: for each loss the row of the study's table, if it has one, and below it one per settings."""
    study = {row.loss: row for row in TABLES.get(network, ("", ()))[1]}
    own = [result for result in results if result.network == network]
    titles = ["loss", "settings", "success", "secure", "study's criterion", "infeasible", "success, unseen objects",
              "errors: training/test/validation", "test: position, angle"]  # fmt: skip
    rows = []
    for loss in dict.fromkeys([*study, *(result.loss for result in own)]):
        if loss in study:
            known = study[loss]
            errors = f"{known.train:.2f}/{known.test:.2f}/{known.validation:.2f}"
            rows.append([loss, "the study", "", "", f"{known.success} of about 61", "", "", errors, ""])
        rows += [_cells(result) for result in own if result.loss == loss]
    return _markdown(titles, rows)


def _score(score: Score) -> list[str]:
    return [_rate(score.success, score.tried), str(score.secure), str(score.legacy), str(score.infeasible)]


def _cells(result: NetworkResult) -> list[str]:
    return [
        result.loss,
        result.settings,
        *_score(result.test),
        _rate(result.unseen.success, result.unseen.tried),
        "/".join(f"{study_error(result.network, result.errors[part]):.2f}" for part in PARTS),
        f"{100 * result.errors['test']['position']:.1f} cm, {np.degrees(result.errors['test']['angle']):.0f} deg",
    ]


def baseline_table(baselines: Mapping[str, Mapping[str, Mapping[str, int]]]) -> str:
    """Table of the baselines: per kind of data and baseline, the counts of `Score`."""
    rows = [[f"{kind}: {name}", *_score(Score(**s))] for kind, each in baselines.items() for name, s in each.items()]
    return _markdown(["baseline", "success", "secure", "study's criterion", "infeasible"], rows)


def cause_table(results: Sequence[NetworkResult]) -> str:
    """Table of the effect of training on each network."""
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
    """Write the page of a reproduction: facts about the data by name, networks, baselines, file names by caption."""
    parts = ["# The study's networks, trained again\n", f"Made by `{command}`.\n"]
    parts.append("".join(f"- {name}: {value}\n" for name, value in facts.items()))
    for network in dict.fromkeys(result.network for result in results):
        table = TABLES.get(network, ("", ()))[0]
        beside = f", beside table {table} of the study" if table else ""
        parts += [f"## {_TITLES[network]}{beside}\n", network_table(network, results)]
    parts += [
        "Errors are training/test/validation errors in the study's unit: 0.005 position (m) + 0.031 orientation (unit "
        "of the loss), summed over one of its batches. Training errors are over as many samples as the validation has. "
        "Intervals are Wilson's, 95 %; where several trials are of one object they are too narrow. The study's "
        "successes are by its own criterion. `psi2` and `psi3` are the same function: different results of the two "
        "measure only chance.\n",
        "## Predictions without a network\n",
        "`label` executes the pose of the test sample itself, `nearest` that of the nearest training input, `average` "
        "the average of the object's training poses, `constant` one training pose for everything "
        "(`graspbox.study.execution`).\n",
        baseline_table(baselines),
        "## Training\n",
        '"Weights moved by" is over all layers but the last, as a share of their norm.\n',
        cause_table(results),
    ]
    for caption, file in figures.items():
        parts += [f"## {caption}\n", f"![{caption}]({file})\n"]
    return "\n".join(parts)
