"""Generation of a data set shard by shard, each written atomically; resumes after an interruption."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from graspbox import object_sets
from graspbox._common.files import dumps, locked, write_text
from graspbox._core import Hand
from graspbox.data.files import pyarrow, write_durably
from graspbox.data.trials import manifest
from graspbox.data.trials.manifest import KINDS
from graspbox.data.trials.runners import MOST_WORKERS, Runner, local
from graspbox.data.trials.scenes import GroupedObject
from graspbox.data.trials.schema import SPLITS
from graspbox.data.trials.settings import DatasetConfig
from graspbox.data.trials.shards import ShardFiles, divide, stored_facts
from graspbox.errors import ConfigError, FileError
from graspbox.hands import HandLike, load_hand
from graspbox.object_sets import ObjectSet

__all__ = ["Progress", "Result", "generate"]

#: The manifest is rewritten after a shard once this multiple of its own writing time has passed. Shards that it does
#: not list when the process is killed are made again.
_PAUSE = 20.0


@dataclass(frozen=True)
class Progress:
    """Progress of a data set.

    Attributes
    ----------
    trials, total : int
        Trials on disk, and the requested total. Refused objects, or objects with few poses, have fewer.
    made, seconds : int, float
        Trials made by this run, and its time.
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
    manifest : dict
        Contents of ``manifest.json``.
    made, resumed : int
        Number of shards that this run made, and number that existed.
    trials, seconds : int, float
        Trials that this run made, and its time.
    """

    folder: Path
    manifest: dict[str, Any] = field(repr=False)
    made: int = 0
    resumed: int = 0
    seconds: float = 0.0
    trials: int = 0

    def table(self) -> dict[str, Any]:
        """Summarize it, as ``graspbox dataset --json`` prints it."""
        return {
            "folder": str(self.folder),
            **{key: self.manifest[key] for key in ("complete", "counts", "candidates")},
            "objects": len(self.manifest["objects"]),
            "refused": self.manifest["refused"],
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
        The target folder, created if needed. At every moment it holds only complete shards, and none twice.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    config : DatasetConfig
        Settings. The rows depend only on them, with every runner and after any number of interruptions.
    resume : bool
        Resume the folder's data set; otherwise it must hold none.
    runner : Runner, optional
        Executes the shards: `graspbox.data.trials.local` (all cores, by default) or `graspbox.data.trials.on_ray`.
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
    pyarrow()
    config.check()
    grouped = manifest.grouped_objects(object_sets.load(objects).objects)
    work = _Work(Path(folder), load_hand(hand), config, grouped)
    with locked(work.folder):
        work.prepare(manifest.read(work.folder), resume)
        work.write_manifest()
        try:
            made = work.run(runner or local(min(os.cpu_count() or 1, MOST_WORKERS)), progress)
        except BaseException:
            # Shards that the manifest does not list are made again.
            with suppress(FileError):
                work.write_manifest()
            raise
        return Result(work.folder, work.write_manifest(), made, len(work.shards) - made, work.seconds(), work.trials)


class _Work:
    """Generation in progress."""

    def __init__(self, folder: Path, hand: Hand, config: DatasetConfig, objects: list[GroupedObject]) -> None:
        self.folder, self.hand, self.config, self.objects = folder, hand, config, objects
        self.settings = manifest.settings_of(objects, hand, config)
        self.shards = divide(objects, config, manifest.fingerprint(self.settings))
        self.kinds = tuple(KINDS) if config.images else ("trials",)
        self.started, self.trials = time.perf_counter(), 0
        #: Facts of the complete shards, by name.
        self.done: dict[str, dict[str, Any]] = {}
        #: Time of the next write of the manifest.
        self._due = 0.0

    def seconds(self) -> float:
        """Time of this run."""
        return time.perf_counter() - self.started

    def prepare(self, before: Mapping[str, Any] | None, resume: bool) -> None:
        """Check that the folder belongs to this data set, find its complete shards, and remove half-written files."""
        present = {path for kind in KINDS for path in (self.folder / kind).glob("[!.]*.parquet") if path.is_file()}
        if before is None and present:
            raise ConfigError(f"{str(self.folder)!r} has shards but no {manifest.FILE}; name another folder")
        if before is not None and not resume:
            raise ConfigError(f"{str(self.folder)!r} holds a data set already; name another folder, or resume it")
        if before is not None:
            manifest.check_unchanged(before, self.settings, self.folder)
        for kind in self.kinds:
            (self.folder / kind).mkdir(exist_ok=True)
        for pattern in ("trials/.*.parquet", "images/.*.parquet", ".manifest-*.json", ".README-*.md"):
            for left in self.folder.glob(pattern):
                left.unlink()
        if others := present - {self.folder / kind / shard.name for kind in self.kinds for shard in self.shards}:
            raise ConfigError(f"{str(min(others))!r} is not a file of this data set; move it elsewhere")
        listed = {shard["name"]: shard for shard in before["shards"]} if before else {}
        for shard in self.shards:
            entry = listed.get(shard.name, {})
            if all(KINDS[kind] in entry and self.folder / kind / shard.name in present for kind in self.kinds):
                trials, *_ = [manifest.content_of(self.folder, kind, entry) for kind in self.kinds]
                facts = stored_facts(trials, self.folder / "trials" / shard.name)
                self.done[shard.name] = {**facts, **{KINDS[kind]: entry[KINDS[kind]] for kind in self.kinds}}

    def run(self, runner: Runner, progress: Callable[[Progress], None]) -> int:
        """Make the missing shards, and return their number.

        Their order is random, so that a partial data set is diverse too; one of each split comes first.
        """
        missing = [shard for shard in self.shards if shard.name not in self.done]
        missing.sort(key=lambda shard: sha256(shard.name.encode()).digest())
        firsts = {shard.name.partition("-")[0]: shard.name for shard in reversed(missing)}
        begun = {name.partition("-")[0] for name in self.done}
        early = [firsts[split] for split in SPLITS if split in firsts and split not in begun]
        missing.sort(key=lambda shard: early.index(shard.name) if shard.name in early else len(early))
        sizes = {shard.name: len(shard.tasks) * self.config.poses for shard in self.shards}
        total = sum(sizes.values())
        kept = sum(sizes[name] for name in self.done)
        progress(Progress(kept, total, 0, self.seconds()))
        made = 0
        for files in runner(missing, self.hand, self.config):
            self._store(files)
            self.done[files.name] = files.facts
            self.trials += sum(source["trials"] for source in files.facts["counts"].values())
            made += sizes[files.name]
            if time.perf_counter() > self._due:
                self.write_manifest()
            progress(Progress(kept + made, total, made, self.seconds()))
        return len(missing)

    def _store(self, files: ShardFiles) -> None:
        """Write a shard; its trials come last, so that they always have their images."""
        try:
            for kind, content in (("images", files.images), ("trials", files.trials)):
                if content is not None:
                    write_durably(self.folder / kind / files.name, content)
        except OSError as error:
            done = f"{len(self.done)} of {len(self.shards)} shards are complete, and the same command resumes"
            raise FileError(error.errno, f"{error.strerror} ({done})", error.filename or files.name) from None

    def write_manifest(self) -> dict[str, Any]:
        """Write the manifest of the current state, and the data set card."""
        began = time.perf_counter()
        summary = manifest.summary(self.settings, self.objects, self.done, len(self.shards))
        write_text(self.folder / manifest.FILE, dumps(summary) + "\n")
        write_text(self.folder / "README.md", manifest.card([shard.name for shard in self.shards], self.config.images))
        ended = time.perf_counter()
        self._due = ended + _PAUSE * (ended - began)
        return summary
