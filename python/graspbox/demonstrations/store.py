"""The files of demonstrations: writing and reading."""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import write_bytes
from graspbox.dataset.extras import parquet, pyarrow
from graspbox.demonstrations.manifest import FILE, Episode, File, content_of, read_manifest, write_manifest
from graspbox.errors import ConfigError
from graspbox.policies.goals import GOAL_NAME
from graspbox.training.runs import refuse_changes

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Demonstrations", "EpisodeSteps", "Store"]

_COMPRESSION_LEVEL = 3
#: Keywords of the environment that apply to the recording alone.
_OWN = ("obs", "split", "num_threads")
#: Rows per row group: the unit of decompression.
_ROW_GROUP = 1024


@dataclass(frozen=True)
class EpisodeSteps:
    """The steps of an episode of n actions.

    Attributes
    ----------
    episode : Episode
        Its outcome.
    observations : dict
        Arrays (n + 1, ...) by name; the last row follows the last action.
    actions : (n, k) float32 array
        In [-1, 1].
    rewards : (n,) float64 array
        Rewards of the actions.
    terminated, truncated : (n,) bool array
        Whether the episode ended with the action, and how.
    """

    episode: Episode
    observations: dict[str, NDArray[Any]]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class Demonstrations:
    """Recorded episodes, in the order of their trials.

    Parameters
    ----------
    folder : str or Path
        A folder that `record` wrote.

    Attributes
    ----------
    folder : Path
        The folder.
    settings : dict
        Settings of the episodes: ``env_id``, ``env_spec``, ``policy``, ``keep``, ``seed``, ``fps`` and others.
    episodes : tuple of Episode
        All of them.
    trials : int
        Number of trials that were run.
    refused : dict
        Reasons why objects could not be used, by name; no episode has such an object.

    Raises
    ------
    ConfigError
        If the folder holds no demonstrations, or a file of them is missing.
    MissingExtraError
        Without pydantic (extra ``data``).
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        manifest = read_manifest(self.folder)
        self.settings, self.refused, self._files = manifest.settings, manifest.refused, manifest.files
        for file in self._files:
            if not (self.folder / file.name).is_file():
                raise ConfigError(
                    f"{str(self.folder / file.name)!r} is missing; the same call of record makes its episodes again"
                )
        self.episodes = tuple(episode for file in self._files for episode in file.episodes)
        self.trials = self._files[-1].next_trial if self._files else 0

    @property
    def observations(self) -> dict[str, tuple[int, ...]]:
        """Shape of each observation by its name."""
        return {name: tuple(space["shape"]) for name, space in self.settings["observations"].items()}

    @property
    def action_size(self) -> int:
        """Length of an action."""
        return int(self.settings["action_size"])

    def environment(self, obs: tuple[str, ...] = ()) -> tuple[str, dict[str, Any]]:
        """Id and keywords of the environment, for a policy that learns from them.

        Parameters
        ----------
        obs : tuple of str
            The policy's observations; one name gives an array, several give a mapping, none gives ``state``.
        """
        spec = self.settings["env_spec"]
        keywords = {name: value for name, value in spec["kwargs"].items() if name not in _OWN and value is not None}
        seen: Any = list(obs) if len(obs) > 1 else (*obs, "state")[0]
        looked = {"goal_from": self.settings["goal_from"]} if GOAL_NAME in obs else {}
        more = {"max_episode_steps": spec["max_episode_steps"], "obs": seen, **looked}
        return self.settings["env_id"], {**keywords, **more}

    def read(self, names: tuple[str, ...] | None = None) -> Iterator[EpisodeSteps]:
        """Read episode by episode; one file is in memory at a time.

        Parameters
        ----------
        names : tuple of str, optional
            Observations to read; by default all.

        Raises
        ------
        ConfigError
            For an observation that was not recorded, or a damaged file.
        """
        known = self.settings["observations"]
        for name in names or ():
            if name not in known:
                raise ConfigError(
                    f"there is no observation {name!r} in {str(self.folder)!r}; it has {', '.join(known)}"
                )
        wanted = tuple(known) if names is None else names
        columns = ["action", "reward", "terminated", "truncated", *(f"observation.{name}" for name in wanted)]
        for file in self._files:
            table = _read_table(self.folder, file, self.settings, columns)
            first = 0
            for episode in file.episodes:
                steps = table.slice(first, episode.steps + 1)
                yield _steps(episode, steps, {name: known[name] for name in wanted})
                first += episode.steps + 1

    def steps(
        self,
        names: tuple[str, ...],
        *,
        chosen: Callable[[Episode], bool] = lambda _: True,
        limit: int | None = None,
    ) -> tuple[dict[str, NDArray[Any]], NDArray[np.float32], NDArray[np.float64], NDArray[np.int64]]:
        """All steps of some episodes, in memory.

        Parameters
        ----------
        names : tuple of str
            Observations to read.
        chosen : callable
            Predicate that selects episodes.
        limit : int, optional
            Use only the first ones.

        Returns
        -------
        observations : dict
            By name: (steps, ...) arrays.
        actions : (steps, k) float32 array
            In [-1, 1].
        rewards : (steps,) float64 array
            Rewards of the actions.
        episode : (steps,) int64 array
            Number of the episode among those selected, from 0.

        Raises
        ------
        ConfigError
            As `read`; if no episode is selected, or fewer than `limit`.
        """
        taken: list[EpisodeSteps] = []
        for one in self.read(names):
            if chosen(one.episode) and (limit is None or len(taken) < limit):
                taken.append(one)
        if len(taken) < max(1, limit or 0):
            raise ConfigError(
                f"{str(self.folder)!r} has {len(taken)} such episodes of {len(self.episodes)}; record more of them"
            )
        observations = {name: np.concatenate([one.observations[name][:-1] for one in taken]) for name in names}
        counts = [len(one.actions) for one in taken]
        actions = np.concatenate([one.actions for one in taken])
        rewards = np.concatenate([one.rewards for one in taken])
        return observations, actions, rewards, np.repeat(np.arange(len(taken)), counts)


class Store:
    """Writes demonstrations file by file, each atomically.

    The manifest names a file before the file is written. A named file that is missing was interrupted, or removed as
    damaged; it is a gap to be filled again.

    Parameters
    ----------
    folder : Path
        Its folder, created if needed. Files of an interrupted recording are kept.
    settings : dict
        Settings that determine the episodes, as plain JSON values.

    Attributes
    ----------
    refused : dict
        Reasons why objects could not be used, by name.

    Raises
    ------
    ConfigError
        If the folder holds demonstrations with other settings, a damaged file, or a foreign one.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder, self._settings = folder, settings
        self._files: list[File] = []
        self.refused: dict[str, str] = {}
        if (folder / FILE).exists():
            found = read_manifest(folder)
            refuse_changes(folder, found.settings, settings)
            self._files, self.refused = list(found.files), dict(found.refused)
        known = {file.name for file in self._files}
        if strangers := sorted(path.name for path in folder.glob("episodes-*.parquet") if path.name not in known):
            raise ConfigError(
                f"{str(folder)!r} holds {strangers[0]!r}, which its {FILE} does not name; move it elsewhere, or "
                "name another folder"
            )
        for file in self._files:
            if (folder / file.name).is_file():
                content_of(folder, file)
        folder.mkdir(parents=True, exist_ok=True)
        for left in folder.glob(".*.parquet"):
            # Left by a call that was killed while writing.
            left.unlink()
        write_manifest(folder, self._files, self.refused, settings)

    @property
    def kept(self) -> int:
        """Number of episodes, those of gaps included."""
        return sum(len(file.episodes) for file in self._files)

    @property
    def next_trial(self) -> int:
        """The trial after the last file."""
        return self._files[-1].next_trial if self._files else 0

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """First trial and next trial of each missing file."""
        missing = (file for file in self._files if not (self._folder / file.name).is_file())
        return [(file.first_trial, file.next_trial) for file in missing]

    def append(self, episodes: list[EpisodeSteps], next_trial: int) -> None:
        """Write a file of episodes; the next one continues with the trial `next_trial`."""
        number = int(self._files[-1].name[len("episodes-") : -len(".parquet")]) + 1 if self._files else 0
        self._write(len(self._files), f"episodes-{number:05d}.parquet", episodes, self.next_trial, next_trial)

    def fill(self, first_trial: int, episodes: list[EpisodeSteps]) -> None:
        """Write the file of a gap again."""
        index = next(index for index, file in enumerate(self._files) if file.first_trial == first_trial)
        self._write(index, self._files[index].name, episodes, first_trial, self._files[index].next_trial)

    def _write(self, index: int, name: str, episodes: list[EpisodeSteps], first_trial: int, next_trial: int) -> None:
        before = sum(len(file.episodes) for file in self._files[:index])
        sink = pyarrow().BufferOutputStream()
        options = {"compression": "zstd", "compression_level": _COMPRESSION_LEVEL, "row_group_size": _ROW_GROUP}
        parquet().write_table(_table(episodes, before, self._settings), sink, **options)
        content = bytes(sink.getvalue())
        digest, rows = hashlib.sha256(content).hexdigest(), tuple(one.episode for one in episodes)
        self._files[index : index + 1] = [File(name, digest, first_trial, next_trial, rows)]
        write_manifest(self._folder, self._files, self.refused, self._settings)
        write_bytes(self._folder / name, content)


def _read_table(folder: Path, file: File, settings: Mapping[str, Any], columns: list[str]) -> "pa.Table":
    """Read columns of a file, and check its rows and types against the settings."""
    pa, path = pyarrow(), folder / file.name
    content = pa.BufferReader(content_of(folder, file))
    rows = sum(episode.steps + 1 for episode in file.episodes)
    complaint = f"{str(path)!r} does not contain the episodes that {FILE} lists"
    try:
        schema = _table([], 0, settings).schema
        found = parquet().ParquetFile(content)
        if found.metadata.num_rows != rows or not found.schema_arrow.equals(schema):
            raise ConfigError(complaint)
        return found.read(columns=columns)
    except (OSError, OverflowError, ValueError, pa.ArrowException) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{complaint}: {error}") from None


def _steps(episode: Episode, table: "pa.Table", spaces: Mapping[str, Any]) -> EpisodeSteps:
    def column(name: str) -> Any:
        return table[name].combine_chunks()

    observations = {}
    for name, space in spaces.items():
        flat = column(f"observation.{name}").flatten().to_numpy(zero_copy_only=False)
        observations[name] = flat.astype(space["dtype"], copy=False).reshape(table.num_rows, *space["shape"])
    before = table.slice(0, table.num_rows - 1)
    actions = before["action"].combine_chunks().flatten().to_numpy(zero_copy_only=False)
    rewards, terminated, truncated = (before[name].to_numpy() for name in ("reward", "terminated", "truncated"))
    ends = terminated.astype(bool), truncated.astype(bool)
    return EpisodeSteps(episode, observations, actions.reshape(before.num_rows, -1), rewards, *ends)


def _table(episodes: list[EpisodeSteps], first: int, settings: Mapping[str, Any]) -> "pa.Table":
    """Convert episodes to rows; the first episode has the index `first`."""
    pa = pyarrow()
    counts = [one.episode.steps + 1 for one in episodes]
    last = np.concatenate([np.arange(count) == count - 1 for count in counts] or [np.zeros(0, dtype=bool)])
    columns: dict[str, Any] = {
        "episode": np.repeat(np.arange(first, first + len(episodes), dtype=np.int32), counts),
        "step": np.concatenate([np.arange(count, dtype=np.int32) for count in counts] or [np.zeros(0, np.int32)]),
    }
    for name, space in settings["observations"].items():
        parts: list[NDArray[Any]] = [
            one.observations[name].reshape(len(one.observations[name]), -1) for one in episodes
        ]
        size = int(np.prod(space["shape"]))
        flat = np.concatenate([*parts, np.zeros((0, size), dtype=space["dtype"])]).astype(space["dtype"], copy=False)
        columns[f"observation.{name}"] = pa.FixedSizeListArray.from_arrays(pa.array(flat.reshape(-1)), size)
    size = settings["action_size"]
    padded = [np.concatenate([one.actions, np.zeros((1, size), np.float32)]) for one in episodes]
    flat = np.concatenate([*padded, np.zeros((0, size), np.float32)]).reshape(-1)
    columns["action"] = pa.FixedSizeListArray.from_arrays(pa.array(flat), size, mask=pa.array(last))
    for name, attribute, kind in (
        ("reward", "rewards", np.float64),
        ("terminated", "terminated", np.bool_),
        ("truncated", "truncated", np.bool_),
    ):
        parts = [np.append(getattr(one, attribute), kind(0)) for one in episodes]
        columns[name] = pa.array(np.concatenate([*parts, np.zeros(0, kind)]), mask=last)
    return pa.table(columns)
