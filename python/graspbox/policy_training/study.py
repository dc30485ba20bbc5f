"""The best small network of a reproduction of the study as a published policy, with its card."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from graspbox.errors import ConfigError
from graspbox.learning.export import export_pose_model
from graspbox.learning.model import PoseModel
from graspbox.learning.samples import Samples
from graspbox.learning.study_results import NetworkResult
from graspbox.perception.policy_folders import write_learned_from
from graspbox.perception.weight_files import LARGEST_NETWORK
from graspbox.policy_training.cards import rate
from graspbox.policy_training.network_cards import Score, measure, write_pose_card
from graspbox.progress import shown_time

__all__ = ["best_small", "publish_best"]

#: Views with which an export is checked.
_CHECKED = 16


def _trained(out: Path, result: NetworkResult) -> Path:
    return out / result.settings / result.network / result.loss


def best_small(out: Path, results: Sequence[NetworkResult]) -> tuple[NetworkResult, list[NetworkResult]]:
    """Find the network to publish.

    Of those whose weights take at most `graspbox.perception.weight_files.LARGEST_NETWORK` bytes it is the one whose
    predictions for the test samples succeed most often; of equals the one that turns least wrong in the validation.

    Parameters
    ----------
    out : Path
        Folder of the reproduction.
    results : sequence of NetworkResult
        Its networks.

    Returns
    -------
    best : NetworkResult
        The one to publish.
    small : list of NetworkResult
        All that are small enough.

    Raises
    ------
    ConfigError
        If none is.
    """
    sizes = [(_trained(out, result) / "weights.pt").stat().st_size for result in results]
    small = [result for result, size in zip(results, sizes, strict=True) if size <= LARGEST_NETWORK]
    if not small:
        found = {r.network: f"{r.network} has {size / 1e6:.0f} MB" for r, size in zip(results, sizes, strict=True)}
        raise ConfigError(
            f"no network is small enough to be published, at most {LARGEST_NETWORK / 1e6:.0f} MB: "
            f"{', '.join(found.values())}; train cnn3d too"
        )

    def order(result: NetworkResult) -> tuple[float, float]:
        return result.test.success / max(result.test.tried, 1), -result.errors["validation"]["angle"]

    return max(small, key=order), small


def publish_best(
    folder: Path,
    out: Path,
    results: Sequence[NetworkResult],
    data: Mapping[str, tuple[Samples, Samples]],
    *,
    mapping: str,
    learned_from: Sequence[str],
    objects: Sequence[str],
    trials: int,
    seed: int,
    command: str,
    licence: Path,
    progress: Callable[[int], None] = lambda _: None,
    **settings: Any,
) -> list[Score]:
    """Export the best small network, evaluate it in ``GraspPose-v0``, and write its card.

    Parameters
    ----------
    folder : Path
        Folder of the policy; its name is the policy's.
    out, results
        As `best_small`.
    data : mapping
        Samples by their kind, and views of objects that no sample shows, with which the export is checked.
    mapping : str
        Which view went with which pose.
    learned_from : sequence of str
        Object sets of the samples; the evaluation leaves them out.
    objects, trials, seed, progress, **settings
        As `graspbox.policy_training.network_cards.measure`.
    command : str
        What trained and published it.
    licence : Path
        A file that is copied as ``LICENSE``.

    Raises
    ------
    ConfigError
        As `best_small` and `graspbox.learning.export.export_pose_model`.
    """
    best, small = best_small(out, results)
    model = PoseModel.load(_trained(out, best))
    samples, unseen = data[model.config.kind]
    config = export_pose_model(folder, folder.name, model, unseen.inputs[:_CHECKED], licence=licence)
    write_learned_from(folder, learned_from)
    scores = measure(str(folder), objects, trials, seed, progress=progress, **settings)
    facts = {
        "objects": ", ".join(samples.names),
        "samples": f"{len(samples)}, {mapping}; seed {seed}",
        "training": f"settings `{best.settings}`, {best.iterations} iterations, {shown_time(best.seconds)}, "
        f"stopped by {best.stopped}",
        "errors on the test samples": f"{100 * best.errors['test']['position']:.1f} cm, "
        f"{np.degrees(best.errors['test']['angle']):.0f} degrees",
    }
    limit = LARGEST_NETWORK / 1e6
    write_pose_card(folder, config, scores, seed=seed, command=command, limit=limit, facts=facts, others=_others(small))
    return scores


def _others(small: Sequence[NetworkResult]) -> str:
    """Write the table of the networks that it was chosen from."""
    text = "Of the networks that are small enough it is the one that succeeds most often for the test samples:\n\n"
    text += "| network | loss | settings | test samples | views of unseen objects |\n|---|---|---|--:|--:|\n"
    for result in small:
        cells = [rate(score.success, score.tried) if score.tried else "-" for score in (result.test, result.unseen)]
        text += f"| {result.network} | {result.loss} | {result.settings} | {' | '.join(cells)} |\n"
    return text
