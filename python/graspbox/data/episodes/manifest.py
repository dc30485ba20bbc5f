"""The manifest of a folder of demonstrations: the episodes of each file, and the settings of the recording."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from graspbox._common import schemas
from graspbox._common.files import dumps, read_bounded, write_text
from graspbox.data.files import MANIFEST, check_names, read_checked, sha256
from graspbox.errors import ConfigError

__all__ = ["REMEDY", "Episode", "File", "Manifest", "content_of", "read_manifest", "write_manifest"]

#: How a missing or damaged file is made again.
REMEDY = "the same call of record makes its episodes again"
#: Greatest size of a manifest, bytes.
_MAX_MANIFEST = 1 << 28
_NAME = re.compile(r"episodes-\d{5,9}\.parquet")


@dataclass(frozen=True)
class Episode:
    """An episode and its outcome.

    `trial` indexes its seed, that of its reset, in `graspbox.evaluation.trial_seeds`; `success` and `secure` are those
    of `graspbox.simulation`; `steps` counts its actions, and `reward` sums its rewards.
    """

    trial: int
    seed: int
    object: str
    success: bool
    secure: bool
    steps: int
    reward: float


@dataclass(frozen=True)
class File:
    """A file of episodes, and its range of trials."""

    name: str
    sha256: str
    first_trial: int
    next_trial: int
    episodes: tuple[Episode, ...]


@dataclass(frozen=True)
class Manifest:
    """Contents of a folder's manifest; `sha256` is the hash of all other fields."""

    format: Literal["graspbox.demonstrations"]
    version: Literal[2]
    sha256: str
    files: tuple[File, ...]
    refused: dict[str, str]
    settings: dict[str, Any]


@dataclass(frozen=True)
class _Space:
    shape: tuple[int, ...]
    dtype: Literal["uint8", "int32", "int64", "float32", "float64"]


@dataclass(frozen=True)
class _EnvSpec:
    kwargs: dict[str, Any]
    max_episode_steps: int | None


@dataclass(frozen=True)
class _Settings:
    """Settings that are used here; the file has more."""

    env_id: str
    env_spec: _EnvSpec
    observations: dict[str, _Space]
    action_size: int
    fps: float
    policy: str
    keep: str
    versions: dict[str, str]


def write_manifest(
    folder: Path, files: Sequence[File], refused: Mapping[str, str], settings: Mapping[str, Any]
) -> None:
    """Write the manifest."""
    rows = [episode for file in files for episode in file.episodes]
    counts = {
        "trials": files[-1].next_trial if files else 0,
        "episodes": len(rows),
        "steps": sum(row.steps for row in rows),
        "success": sum(row.success for row in rows),
        "secure": sum(row.secure for row in rows),
    }
    manifest = {"format": "graspbox.demonstrations", "version": 2, "counts": counts, "refused": dict(refused)}
    manifest |= {"files": [asdict(file) for file in files], "settings": settings}
    write_text(folder / MANIFEST, dumps({**manifest, "sha256": _digest(manifest)}) + "\n")


def _digest(manifest: Mapping[str, Any]) -> str:
    """Hash a manifest without its own hash."""
    rest = {name: value for name, value in manifest.items() if name != "sha256"}
    return sha256(json.dumps(rest, sort_keys=True).encode())


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a folder; a `ConfigError` says what is missing, damaged or of another version."""
    path = folder / MANIFEST
    if not path.is_file():
        raise ConfigError(f"there are no demonstrations in {str(folder)!r}: it has no {MANIFEST}")
    content = read_bounded(path, _MAX_MANIFEST)
    complaint = f"{str(path)!r} is not a valid manifest of demonstrations"
    manifest = schemas.parse(Manifest, content, complaint)
    schemas.parse(_Settings, json.dumps(manifest.settings).encode(), f"{complaint}: settings")
    if _digest(json.loads(content)) != manifest.sha256:
        raise ConfigError(f"{str(path)!r} was changed or damaged: its hash differs; record into another folder")
    check_names((file.name for file in manifest.files), _NAME, complaint)
    return manifest


def content_of(folder: Path, file: File) -> bytes:
    """Read a file of a folder, whose hash must be that of the manifest; raises as `read_checked`."""
    return read_checked(folder / file.name, file.sha256, REMEDY)
