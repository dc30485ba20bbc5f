"""Making a data set: shard after shard, each written whole, resumed where it was interrupted."""

import hashlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from graspbox import object_sets
from graspbox._core import Hand
from graspbox.dataset import extras, manifest
from graspbox.dataset.runners import Runner, local
from graspbox.dataset.settings import DatasetConfig
from graspbox.dataset.shards import Shard, divide, stored_facts
from graspbox.errors import ConfigError, FileError
from graspbox.files import locked, replacing, write_text
from graspbox.hands import HandLike, load_hand
from graspbox.object_sets import ObjectSet

__all__ = ["Progress", "Result", "generate"]

#: The manifest is written again after a shard once this time has passed, seconds; the shards hold all that it says.
_MANIFEST_EVERY = 30.0


@dataclass(frozen=True)
class Progress:
    """How far a data set is.

    Attributes
    ----------
    trials, total : int
        Trials that are on the disk, and all that are wanted. Objects that are refused, or have few poses, have fewer.
    made : int
        Those of them that this run made.
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
        """Expected time to the end, seconds; infinity before the first shard."""
        return (self.total - self.trials) / self.rate if self.rate else float("inf")


@dataclass(frozen=True)
class Result:
    """What `generate` did.

    Attributes
    ----------
    folder : Path
        Where the data set is.
    manifest : dict
        As ``manifest.json`` has it.
    made, resumed : int
        Shards that this run made, and those that it found.
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
        """Sum it up, as ``graspbox dataset --json`` prints it."""
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
    """Make a data set of simulated grasp trials, or continue one that was interrupted.

    Parameters
    ----------
    objects : str, Path, ObjectSet, or sequence of str
        See `graspbox.object_sets`.
    folder : str or PathLike
        Where to; it is created. At every moment it holds whole shards alone, and none twice.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    config : DatasetConfig
        What to make. The same settings give the same rows, whoever makes them and however often it is interrupted.
    resume : bool
        Continue what the folder holds; otherwise it must hold no data set.
    runner : Runner, optional
        Who makes the shards: `graspbox.dataset.local` (all cores, by default) or `graspbox.dataset.on_ray`.
    progress : callable
        Called at the beginning and after each shard.

    Raises
    ------
    ConfigError
        If a setting is wrong, the folder holds a data set with other settings, or another process is writing there.
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
        work = _Work(place, loaded, config, settings, shards, started)
        work.prepare()
        work.write_manifest(subjects)
        made = work.run(runner or local(os.cpu_count() or 1), progress, subjects)
        return Result(place, work.write_manifest(subjects), made, len(shards) - made, work.seconds(), work.trials)


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
    """A data set in the making."""

    def __init__(
        self,
        folder: Path,
        hand: Hand,
        config: DatasetConfig,
        settings: dict[str, Any],
        shards: list[Shard],
        started: float,
    ) -> None:
        self.folder, self.hand, self.config, self.settings, self.shards = folder, hand, config, settings, shards
        self.started, self.trials, self._last = started, 0, float("-inf")
        self.done: dict[str, dict[str, Any]] = {}

    def seconds(self) -> float:
        """Time of this run."""
        return time.perf_counter() - self.started

    def prepare(self) -> None:
        """Find the shards that exist, and remove what an interruption left half-written."""
        kinds = ("trials", "images") if self.config.images else ("trials",)
        for kind in kinds:
            (self.folder / kind).mkdir(exist_ok=True)
        for pattern in ("trials/.*.parquet", "images/.*.parquet", ".manifest-*.json", ".README-*.md"):
            for left in self.folder.glob(pattern):
                left.unlink()
        for shard in self.shards:
            paths = [self.folder / kind / shard.name for kind in kinds]
            if all(path.is_file() for path in paths):
                facts = stored_facts(paths[0])
                if facts["fingerprint"] != shard.fingerprint:
                    raise ConfigError(f"{str(paths[0])!r} has other settings than its folder; remove it, or the folder")
                self.done[shard.name] = facts

    def run(self, runner: Runner, progress: Callable[[Progress], None], subjects: list[Any]) -> int:
        """Make the shards that are missing; return how many. They are shuffled: a part of them is diverse too."""
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
            if time.perf_counter() - self._last > _MANIFEST_EVERY:
                self.write_manifest(subjects)
            progress(Progress(kept + made, total, made, self.seconds()))
        return len(missing)

    def _store(self, name: str, images: bytes | None, trials: bytes) -> None:
        """Write a shard; its trials come last, so that they are never without their images."""
        try:
            if images is not None:
                _write(self.folder / "images" / name, images)
            _write(self.folder / "trials" / name, trials)
        except OSError as error:
            done = f"{len(self.done)} of {len(self.shards)} shards are complete, and the same command resumes"
            raise FileError(error.errno, f"{error.strerror} ({done})", error.filename or name) from None

    def write_manifest(self, subjects: list[Any]) -> dict[str, Any]:
        """Write the manifest as things are, and the page for readers of data sets."""
        self._last = time.perf_counter()
        found = manifest.summary(self.settings, subjects, self.done, len(self.shards))
        write_text(self.folder / manifest.FILE, manifest.write_text_of(found))
        write_text(self.folder / "README.md", manifest.card([shard.name for shard in self.shards], self.config.images))
        return found


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, also if the machine loses power."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
