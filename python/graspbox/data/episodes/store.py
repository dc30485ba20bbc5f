"""The files of demonstrations: writing and reading."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.runs import refuse_changes
from graspbox.data.episodes.manifest import REMEDY, Episode, File, content_of, read_manifest, write_manifest
from graspbox.data.files import MANIFEST, parquet, parquet_bytes, pyarrow, sha256, write_durably
from graspbox.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Demonstrations", "EpisodeSteps", "Store"]

#: Keywords of the environment that apply only to the recording.
_RECORDING_ONLY = ("obs", "split", "num_threads")
#: Rows per row group: the unit of decompression.
_ROW_GROUP = 1024


@dataclass(frozen=True)
class EpisodeSteps:
    """The steps of an episode of n actions.

    Attributes
    ----------
    observations : dict
        Arrays (n + 1, ...) by name; the last row follows the last action.
    actions : (n, k) float32 array
        In [-1, 1].
    rewards, terminated, truncated : (n,) array
        Rewards of the actions, and whether the episode ended with the action, and how.
    """

    episode: Episode
    observations: dict[str, NDArray[Any]]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class Demonstrations:
    """Recorded episodes in a folder that `record` wrote, in the order of their trials.

    Attributes
    ----------
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
                raise ConfigError(f"{str(self.folder / file.name)!r} is missing; {REMEDY}")
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
        """Id and keywords of the environment, for a policy that learns from the episodes.

        One name in `obs` yields an array as observation, several a mapping, none ``state``.
        """
        spec = self.settings["env_spec"]
        keywords = {
            name: value for name, value in spec["kwargs"].items() if name not in _RECORDING_ONLY and value is not None
        }
        seen: Any = list(obs) if len(obs) > 1 else (*obs, "state")[0]
        return self.settings["env_id"], {**keywords, "max_episode_steps": spec["max_episode_steps"], "obs": seen}

    def read(self, names: tuple[str, ...] | None = None) -> Iterator[EpisodeSteps]:
        """Read episode by episode, with all observations or those named; one file is in memory at a time.

        Raises
        ------
        ConfigError
            For an observation that was not recorded, or a damaged file.
        """
        known = self.settings["observations"]
        if unknown := [name for name in names or () if name not in known]:
            raise ConfigError(
                f"there is no observation {unknown[0]!r} in {str(self.folder)!r}; it has {', '.join(known)}"
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
        """Read all steps of the first `limit` episodes that `chosen` selects.

        Returns
        -------
        observations : dict
            By name: (steps, ...) arrays.
        actions, rewards : (steps, k) float32 array, (steps,) float64 array
            Actions in [-1, 1], and their rewards.
        episode : (steps,) int64 array
            Number of the episode among those selected, from 0.

        Raises
        ------
        ConfigError
            As `read`; if no episode is selected, or fewer than `limit`.
        """
        taken = list(islice((one for one in self.read(names) if chosen(one.episode)), limit))
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
    """Writes demonstrations file by file, each atomically, into a folder that is created if needed.

    The manifest names a file before the file is written. A named file that is missing was interrupted, or removed as
    damaged; it is a gap to be filled again. `settings` determine the episodes, as plain JSON values; `refused` has the
    reasons why objects could not be used, by name.

    Raises
    ------
    ConfigError
        If the folder holds demonstrations with other settings, a damaged file, or a foreign one.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder, self._settings = folder, settings
        self._files: list[File] = []
        self.refused: dict[str, str] = {}
        if (folder / MANIFEST).exists():
            manifest = read_manifest(folder)
            refuse_changes(folder, manifest.settings, settings)
            self._files, self.refused = list(manifest.files), dict(manifest.refused)
        known = {file.name for file in self._files}
        if others := sorted(path.name for path in folder.glob("episodes-*.parquet") if path.name not in known):
            raise ConfigError(
                f"{str(folder)!r} holds {others[0]!r}, which its {MANIFEST} does not name; move it elsewhere, or "
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
        content = parquet_bytes(_table(episodes, before, self._settings), _ROW_GROUP)
        rows = tuple(one.episode for one in episodes)
        self._files[index : index + 1] = [File(name, sha256(content), first_trial, next_trial, rows)]
        write_manifest(self._folder, self._files, self.refused, self._settings)
        write_durably(self._folder / name, content)


def _read_table(folder: Path, file: File, settings: Mapping[str, Any], columns: list[str]) -> "pa.Table":
    """Read columns of a file, and check its rows and types against the settings."""
    pa = pyarrow()
    rows = sum(episode.steps + 1 for episode in file.episodes)
    complaint = f"{str(folder / file.name)!r} does not contain the episodes that {MANIFEST} lists"
    content = pa.BufferReader(content_of(folder, file))
    try:
        stored = parquet().ParquetFile(content)
        if stored.metadata.num_rows == rows and stored.schema_arrow.equals(_table([], 0, settings).schema):
            return stored.read(columns=columns)
    except (OSError, OverflowError, ValueError, pa.ArrowException) as error:
        raise ConfigError(f"{complaint}: {error}") from None
    raise ConfigError(complaint)


def _steps(episode: Episode, table: "pa.Table", spaces: Mapping[str, Any]) -> EpisodeSteps:
    def flat(rows: "pa.Table", name: str) -> NDArray[Any]:
        return np.asarray(rows[name].combine_chunks().flatten().to_numpy(zero_copy_only=False))

    observations = {
        name: flat(table, f"observation.{name}").astype(space["dtype"], copy=False).reshape(-1, *space["shape"])
        for name, space in spaces.items()
    }
    before = table.slice(0, table.num_rows - 1)
    actions = flat(before, "action").reshape(before.num_rows, -1)
    rewards, terminated, truncated = (before[name].to_numpy() for name in ("reward", "terminated", "truncated"))
    return EpisodeSteps(episode, observations, actions, rewards, terminated.astype(bool), truncated.astype(bool))


def _table(episodes: list[EpisodeSteps], first: int, settings: Mapping[str, Any]) -> "pa.Table":
    """Convert episodes to rows; the first episode has the index `first`."""
    pa = pyarrow()
    counts = [one.episode.steps + 1 for one in episodes]
    last = np.concatenate([np.zeros(0, np.bool_), *(np.arange(count) == count - 1 for count in counts)])
    columns: dict[str, Any] = {
        "episode": np.repeat(np.arange(first, first + len(episodes), dtype=np.int32), counts),
        "step": np.concatenate([np.zeros(0, np.int32), *(np.arange(count, dtype=np.int32) for count in counts)]),
    }

    def fixed_lists(parts: list[NDArray[Any]], size: int, dtype: Any, mask: Any = None) -> Any:
        flat = np.concatenate([part.reshape(-1) for part in (*parts, np.zeros(0, dtype))]).astype(dtype, copy=False)
        return pa.FixedSizeListArray.from_arrays(pa.array(flat), size, mask=mask)

    for name, space in settings["observations"].items():
        parts = [one.observations[name] for one in episodes]
        columns[f"observation.{name}"] = fixed_lists(parts, int(np.prod(space["shape"])), space["dtype"])
    size = settings["action_size"]
    padded = [np.append(one.actions, np.zeros((1, size), np.float32), axis=0) for one in episodes]
    columns["action"] = fixed_lists(padded, size, np.float32, pa.array(last))
    for name, attribute, kind in (
        ("reward", "rewards", np.float64),
        ("terminated", "terminated", np.bool_),
        ("truncated", "truncated", np.bool_),
    ):
        values = [np.append(getattr(one, attribute), kind(0)) for one in episodes]
        columns[name] = pa.array(np.concatenate([*values, np.zeros(0, kind)]), mask=last)
    return pa.table(columns)
