"""The files of demonstrations: how they are written and read."""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspbox.dataset.extras import parquet, pyarrow
from graspbox.errors import ConfigError
from graspbox.files import dumps, read_bounded, write_bytes, write_text
from graspbox.policies.goals import GOAL_NAME
from graspbox.resume_log import changes

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Demonstrations", "Episode", "EpisodeSteps", "Store"]

_MANIFEST = "manifest.json"
_FORMAT, _VERSION = "graspbox.demonstrations", 1
_MAX_MANIFEST = 1 << 26
#: Key of the facts about the episodes of a file in its metadata.
_KEY = b"graspbox"
_COMPRESSION_LEVEL = 3
#: Keywords of the environment that were those of the recording alone.
_OWN = ("obs", "split", "num_threads")
#: Rows of a row group: what is decompressed at once.
_ROW_GROUP = 1024


@dataclass(frozen=True)
class Episode:
    """An episode.

    Attributes
    ----------
    trial : int
        Index of its seed in `graspbox.evaluation.trial_seeds`.
    seed : int
        Seed of its reset.
    object : str
        Name of its object.
    success, secure : bool
        As `graspbox.simulation` defines them.
    steps : int
        Number of its actions.
    reward : float
        Sum of its rewards.
    """

    trial: int
    seed: int
    object: str
    success: bool
    secure: bool
    steps: int
    reward: float


@dataclass(frozen=True)
class EpisodeSteps:
    """The steps of an episode of n actions.

    Attributes
    ----------
    episode : Episode
        What came of it.
    observations : dict
        By name: (n + 1, ...) arrays; the last one follows the last action.
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
        What `record` wrote.

    Attributes
    ----------
    folder : Path
        The folder.
    settings : dict
        What the episodes depend on: ``env_id``, ``env_spec``, ``policy``, ``keep``, ``seed``, ``fps`` and others.
    episodes : tuple of Episode
        All of them.
    trials : int
        Trials that were run for them.

    Raises
    ------
    ConfigError
        If the folder holds no demonstrations.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.settings = _read_manifest(self.folder)["settings"]
        self._files = [(path, _facts(path)) for path in _paths(self.folder)]
        self.episodes = tuple(Episode(**row) for _, facts in self._files for row in facts["episodes"])
        self.trials: int = self._files[-1][1]["next_trial"] if self._files else 0

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
            What the policy observes; one name gives an array, several give a mapping, none gives ``state``.
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
        for path, facts in self._files:
            table = _read_table(path, columns)
            first = 0
            for row in facts["episodes"]:
                count = row["steps"]
                yield _steps(Episode(**row), table.slice(first, count + 1), {name: known[name] for name in wanted})
                first += count + 1

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
            Which episodes count.
        limit : int, optional
            Take the first ones only.

        Returns
        -------
        observations : dict
            By name: (steps, ...) arrays.
        actions : (steps, k) float32 array
            In [-1, 1].
        rewards : (steps,) float64 array
            Rewards of the actions.
        episode : (steps,) int64 array
            Counts the episodes that were taken, from 0.

        Raises
        ------
        ConfigError
            As `read`; if no episode is taken, or there are fewer than `limit`.
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
    """Writes demonstrations: file after file, each whole.

    Parameters
    ----------
    folder : Path
        Where they go; made if need be. Files of an interrupted call are kept.
    settings : dict
        What the episodes depend on, as plain JSON values.

    Raises
    ------
    ConfigError
        If the folder holds demonstrations with other settings.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self.folder, self._settings = folder, settings
        if (folder / _MANIFEST).exists():
            found = "; ".join(changes(_read_manifest(folder)["settings"], settings))
            if found:
                raise ConfigError(f"{str(folder)!r} was begun with other settings: {found}; name another folder")
        elif _paths(folder):
            raise ConfigError(f"{str(folder)!r} holds episodes without their {_MANIFEST}; name another folder")
        folder.mkdir(parents=True, exist_ok=True)
        for left in folder.glob(".*.parquet"):
            # Of a call that was killed while it wrote.
            left.unlink()
        self._write_manifest()

    def append(self, episodes: list[EpisodeSteps], next_trial: int) -> None:
        """Write a file of episodes; the next one goes on with the trial `next_trial`."""
        done = Demonstrations(self.folder)
        facts = {"next_trial": next_trial, "episodes": [asdict(one.episode) for one in episodes]}
        table = _table(episodes, len(done.episodes), self._settings)
        table = table.replace_schema_metadata({_KEY: json.dumps(facts)})
        sink = pyarrow().BufferOutputStream()
        options = {"compression": "zstd", "compression_level": _COMPRESSION_LEVEL, "row_group_size": _ROW_GROUP}
        parquet().write_table(table, sink, **options)
        write_bytes(self.folder / f"episodes-{len(_paths(self.folder)):05d}.parquet", bytes(sink.getvalue()))
        self._write_manifest()

    def _write_manifest(self) -> None:
        files = [(path, _facts(path)) for path in _paths(self.folder)]
        rows = [row for _, facts in files for row in facts["episodes"]]
        counts = {
            "trials": files[-1][1]["next_trial"] if files else 0,
            "episodes": len(rows),
            "steps": sum(row["steps"] for row in rows),
            "success": sum(row["success"] for row in rows),
            "secure": sum(row["secure"] for row in rows),
        }
        hashes = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path, _ in files}
        manifest = {"format": _FORMAT, "version": _VERSION, "counts": counts, "files": hashes}
        write_text(self.folder / _MANIFEST, dumps({**manifest, "settings": self._settings}) + "\n")


def _paths(folder: Path) -> list[Path]:
    return sorted(folder.glob("episodes-*.parquet"))


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / _MANIFEST
    if not path.is_file():
        raise ConfigError(f"there are no demonstrations in {str(folder)!r}: it has no {_MANIFEST}")
    try:
        found: dict[str, Any] = json.loads(read_bounded(path, _MAX_MANIFEST))
        known = found["format"] == _FORMAT and found["version"] == _VERSION and isinstance(found["settings"], dict)
    except (ValueError, LookupError, TypeError):
        known = False
    if not known:
        raise ConfigError(f"{str(path)!r} is no manifest of demonstrations, or one of another version")
    return found


def _facts(path: Path) -> dict[str, Any]:
    try:
        facts: dict[str, Any] = json.loads((parquet().read_schema(path).metadata or {})[_KEY])
    except (KeyError, ValueError, pyarrow().ArrowException):
        raise ConfigError(f"{str(path)!r} holds no demonstrations; remove it and record again") from None
    return facts


def _read_table(path: Path, columns: list[str]) -> "pa.Table":
    try:
        return parquet().read_table(path, columns=columns)
    except (OSError, pyarrow().ArrowException) as error:
        raise ConfigError(f"{str(path)!r} cannot be read ({error}); remove it and record again") from None


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
    """Rows of episodes, the first of which has the index `first`."""
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
