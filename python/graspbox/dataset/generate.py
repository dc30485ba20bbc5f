"""Generation of a data set shard by shard, each written atomically; resumes after an interruption."""

import hashlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from graspbox import object_sets
from graspbox._common.files import locked, replacing, write_text
from graspbox._core import Hand
from graspbox.dataset import extras, manifest
from graspbox.dataset.manifest import KINDS
from graspbox.dataset.runners import MOST_WORKERS, Runner, local
from graspbox.dataset.scenes import Subject
from graspbox.dataset.settings import DatasetConfig
from graspbox.dataset.shards import Shard, divide, stored_facts
from graspbox.errors import ConfigError, FileError
from graspbox.hands import HandLike, load_hand
from graspbox.object_sets import ObjectSet

__all__ = ["Progress", "Result", "generate"]

#: The manifest is rewritten after a shard once this multiple of its own writing time has passed. Shards that it does
#: not name when the process is killed are made again.
_PAUSE = 20.0


@dataclass(frozen=True)
class Progress:
    """Progress of a data set.

    Attributes
    ----------
    trials, total : int
        Trials on disk, and the requested total. Refused objects, or objects with few poses, have fewer.
    made : int
        Trials made by this run.
    seconds : float
        Time of this run.
    """

    trials: int
    total: int
    made: int
    seconds: float

    @property
    def rate(self) -> float:
        """Trials per second of this run."""
        return self.made / self.seconds if self.seconds > 0 else 0.0

    @property
    def remaining(self) -> float:
        """Expected remaining time, seconds; infinity before the first shard."""
        return (self.total - self.trials) / self.rate if self.rate else float("inf")


@dataclass(frozen=True)
class Result:
    """Result of `generate`.

    Attributes
    ----------
    folder : Path
        Folder of the data set.
    manifest : dict
        Contents of ``manifest.json``.
    made, resumed : int
        Number of shards that this run made, and number that it found.
    seconds : float
        Time of this run.
    trials : int
        Trials that this run made.
    """

    folder: Path
    manifest: dict[str, Any] = field(repr=False)
    made: int = 0
    resumed: int = 0
    seconds: float = 0.0
    trials: int = 0

    def table(self) -> dict[str, Any]:
        """Summarize it, as ``graspbox dataset --json`` prints it."""
        found = self.manifest
        return {
            "folder": str(self.folder),
            "complete": found["complete"],
            "counts": found["counts"],
            "candidates": found["candidates"],
            "objects": len(found["objects"]),
            "refused": found["refused"],
            "shards": {"made": self.made, "resumed": self.resumed},
            "trials_made": self.trials,
            "seconds": self.seconds,
            "trials_per_s": self.trials / self.seconds if self.seconds else 0.0,
        }


def generate(
    objects: str | Path | ObjectSet | Sequence[str | Path],
    folder: str | os.PathLike[str],
    *,
    hand: HandLike = "reflex",
    config: DatasetConfig = DatasetConfig(),  # noqa: B008 (frozen)
    resume: bool = True,
    runner: Runner | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> Result:
    """Generate a data set of simulated grasp trials, or resume an interrupted one.

    Parameters
    ----------
    objects : str, Path, ObjectSet, or sequence of str
        See `graspbox.object_sets`.
    folder : str or PathLike
        The target folder, created if needed. At every moment it holds complete shards alone, and none twice.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    config : DatasetConfig
        Settings. The same settings give the same rows, with every runner and after any number of interruptions.
    resume : bool
        Resume the folder's data set; otherwise it must hold none.
    runner : Runner, optional
        Executes the shards: `graspbox.dataset.local` (all cores, by default) or `graspbox.dataset.on_ray`.
    progress : callable
        Called at the beginning and after each shard.

    Raises
    ------
    ConfigError
        If a setting is wrong, if the folder holds a data set with other settings, a damaged shard or a foreign file, or
        if another process is writing there.
    ObjectSetError
        If the objects cannot be found.
    FileError
        If a file cannot be written, for instance because the disk is full; the same call resumes.
    MissingExtraError
        If pyarrow (extra ``data``) is missing.
    """
    started = time.perf_counter()
    extras.pyarrow()
    config.check()
    found, loaded = object_sets.load(objects), load_hand(hand)
    subjects, files = manifest.subjects_of(found.objects)
    settings = manifest.settings_of(subjects, files, loaded, config)
    shards = divide(subjects, config, manifest.fingerprint(settings))
    place = Path(folder)
    with locked(place):
        before = manifest.read(place)
        _check(before, settings, place, resume)
        work = _Work(place, loaded, config, settings, shards, subjects, started)
        work.prepare(before)
        work.write_manifest()
        try:
            made = work.run(runner or local(min(os.cpu_count() or 1, MOST_WORKERS)), progress)
        except BaseException:
            # Shards that the manifest does not name are made again.
            with suppress(FileError):
                work.write_manifest()
            raise
        return Result(place, work.write_manifest(), made, len(shards) - made, work.seconds(), work.trials)


def _check(before: dict[str, Any] | None, settings: dict[str, Any], folder: Path, resume: bool) -> None:
    if before is None:
        strangers = [
            path for kind in ("trials", "images") for path in (folder / kind).glob("*.parquet") if path.is_file()
        ]
        if strangers:
            raise ConfigError(f"{str(folder)!r} has shards but no {manifest.FILE}; name another folder")
        return
    if not resume:
        raise ConfigError(f"{str(folder)!r} holds a data set already; name another folder, or resume it")
    manifest.check_unchanged(before, settings, folder)


class _Work:
    """Generation in progress."""

    def __init__(
        self,
        folder: Path,
        hand: Hand,
        config: DatasetConfig,
        settings: dict[str, Any],
        shards: list[Shard],
        subjects: list[Subject],
        started: float,
    ) -> None:
        self.folder, self.hand, self.config, self.settings, self.shards = folder, hand, config, settings, shards
        self.subjects, self.started, self.trials = subjects, started, 0
        self.done: dict[str, dict[str, Any]] = {}
        #: Time of the next write of the manifest.
        self._due = 0.0

    def seconds(self) -> float:
        """Time of this run."""
        return time.perf_counter() - self.started

    def prepare(self, before: Mapping[str, Any] | None) -> None:
        """Find the shards that exist and that the manifest names, and remove half-written files of an interruption."""
        kinds = ("trials", "images") if self.config.images else ("trials",)
        for kind in kinds:
            (self.folder / kind).mkdir(exist_ok=True)
        for pattern in ("trials/.*.parquet", "images/.*.parquet", ".manifest-*.json", ".README-*.md"):
            for left in self.folder.glob(pattern):
                left.unlink()
        mine = {self.folder / kind / shard.name for kind in kinds for shard in self.shards}
        if strangers := {*self.folder.glob("trials/*.parquet"), *self.folder.glob("images/*.parquet")} - mine:
            raise ConfigError(f"{str(min(strangers))!r} is not a file of this data set; move it elsewhere")
        listed = {shard["name"]: shard for shard in before["shards"]} if before else {}
        for shard in self.shards:
            entry = listed.get(shard.name, {})
            whole = all(KINDS[kind] in entry and (self.folder / kind / shard.name).is_file() for kind in kinds)
            if whole:
                trials, *_ = [manifest.content_of(self.folder, kind, entry) for kind in kinds]
                facts = stored_facts(trials, self.folder / "trials" / shard.name)
                if facts["fingerprint"] != shard.fingerprint:
                    raise ConfigError(f"{shard.name!r} has other settings than its folder; remove it, or the folder")
                self.done[shard.name] = {**facts, **{KINDS[kind]: entry[KINDS[kind]] for kind in kinds}}

    def run(self, runner: Runner, progress: Callable[[Progress], None]) -> int:
        """Make the missing shards in random order, so that a partial data set is diverse too; return their number."""
        missing = [shard for shard in self.shards if shard.name not in self.done]
        missing.sort(key=lambda shard: hashlib.sha256(shard.name.encode()).digest())
        sizes = {shard.name: len(shard.tasks) * self.config.poses for shard in self.shards}
        total = sum(sizes.values())
        kept = sum(sizes[name] for name in self.done)
        progress(Progress(kept, total, 0, self.seconds()))
        made = 0
        for files in runner(missing, self.hand, self.config):
            self._store(files.name, files.images, files.trials)
            self.done[files.name] = files.facts
            self.trials += sum(source["trials"] for source in files.facts["counts"].values())
            made += sizes[files.name]
            if time.perf_counter() > self._due:
                self.write_manifest()
            progress(Progress(kept + made, total, made, self.seconds()))
        return len(missing)

    def _store(self, name: str, images: bytes | None, trials: bytes) -> None:
        """Write a shard; its trials come last, so that they always have their images."""
        try:
            if images is not None:
                _write(self.folder / "images" / name, images)
            _write(self.folder / "trials" / name, trials)
        except OSError as error:
            done = f"{len(self.done)} of {len(self.shards)} shards are complete, and the same command resumes"
            raise FileError(error.errno, f"{error.strerror} ({done})", error.filename or name) from None

    def write_manifest(self) -> dict[str, Any]:
        """Write the manifest of the current state, and the data set card."""
        began = time.perf_counter()
        found = manifest.summary(self.settings, self.subjects, self.done, len(self.shards))
        write_text(self.folder / manifest.FILE, manifest.write_text_of(found))
        write_text(self.folder / "README.md", manifest.card([shard.name for shard in self.shards], self.config.images))
        ended = time.perf_counter()
        self._due = ended + _PAUSE * (ended - began)
        return found


def _write(path: Path, content: bytes) -> None:
    """Write a file atomically, even if the machine loses power."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
