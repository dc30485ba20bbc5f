"""Demonstrations as a data set of Minari (extra ``[minari]``)."""

import json
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gymnasium.envs.registration import EnvSpec

from graspbox._common.imports import imported
from graspbox.data.episodes.store import Demonstrations
from graspbox.errors import ConfigError

__all__ = ["to_minari"]


def to_minari(demonstrations: Demonstrations, dataset_id: str) -> Any:
    """Write demonstrations as a ``minari.MinariDataset``, which is returned.

    Minari's folder is ``MINARI_DATASETS_PATH``, or ``~/.minari/datasets``. ``minari.load_dataset(dataset_id)`` loads
    the data set, and its ``recover_environment()`` makes the environment. Images are stored without loss. One file of
    demonstrations is in memory at a time. The metadata of an episode hold its seed, its object, and whether it was a
    success and secure.

    Parameters
    ----------
    demonstrations : Demonstrations
        At least one episode.
    dataset_id : str
        A name such as ``graspbox/expert-v0``.

    Raises
    ------
    ConfigError
        If there is no episode, or Minari rejects the id or has such a data set already.
    MissingExtraError
        Without Minari.
    """
    names = "minari", "minari.data_collector.episode_buffer", "minari.storage.datasets_root_dir"
    minari, buffers, roots = (imported(name, "the format of Minari needs minari", "minari") for name in names)
    if not demonstrations.episodes:
        raise ConfigError(f"{str(demonstrations.folder)!r} has no episode; record some")
    settings = demonstrations.settings
    spec = EnvSpec.from_json(json.dumps(settings["env_spec"]))
    try:
        minari.dataset.minari_dataset.parse_dataset_id(dataset_id)
    except ValueError as error:
        raise ConfigError(f"Minari does not take the id {dataset_id!r}: {error}") from None
    folder = Path(roots.get_dataset_path(dataset_id))
    if folder.exists():
        raise ConfigError(f"{str(folder)!r} exists; remove it, or pass another id")
    about = {
        "algorithm_name": settings["policy"],
        "description": f"Episodes of the policy {settings['policy']!r} in {settings['env_id']}, made by graspbox "
        f"{settings['versions']['graspbox']}; kept: {settings['keep']}.",
        "requirements": ["graspbox"],
    }
    try:
        with warnings.catch_warnings():
            # The publisher of the data set adds authors and the address of the code.
            warnings.filterwarnings("ignore", message=r"`(author|author_email|code_permalink|eval_env)` is set to None")
            written = minari.create_dataset_from_buffers(
                dataset_id,
                # Any iterable works: the storage takes one episode after the other.
                _buffers(demonstrations, buffers.EpisodeBuffer),
                env=spec,
                data_format="parquet",
                jpeg_encoding=False,
                **about,
            )
        rows = [{"object": one.object, "success": one.success, "secure": one.secure} for one in demonstrations.episodes]
        written.storage.update_episode_metadata(rows)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return written


def _buffers(demonstrations: Demonstrations, kind: Any) -> Iterator[Any]:
    # An environment made with a sequence of one observation name returns a mapping too.
    for index, one in enumerate(demonstrations.read()):
        yield kind(
            id=index,
            seed=one.episode.seed,
            observations=one.observations,
            actions=one.actions,
            rewards=one.rewards.tolist(),
            terminations=one.terminated.tolist(),
            truncations=one.truncated.tolist(),
        )
