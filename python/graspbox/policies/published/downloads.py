"""Folders of policies by name; size-limited downloads of those on the hub, such as ``hf://owner/name@revision``.

Only the configuration, the files that it lists, the card and the licence are downloaded (extra ``hub``), to the cache
of huggingface_hub.
"""

import os
import re
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

from graspbox._common.files import read_bounded
from graspbox._common.imports import imported
from graspbox.errors import ConfigError, ConnectionLostError
from graspbox.policies.published import installed
from graspbox.policies.published.schema import parse

__all__ = [
    "CARD",
    "CONFIG",
    "LARGEST_CONFIG",
    "LICENCE",
    "download",
    "folder_of",
    "hub",
    "is_name",
    "repository",
    "root_of",
]

#: The configuration file of a policy, and its greatest size in bytes.
CONFIG = "config.json"
LARGEST_CONFIG = 1 << 20
CARD, LICENCE = "README.md", "LICENSE"
_SCHEME = "hf://"
_NAME = re.compile(r"hf://([\w.-]+/[\w.-]+)(?:@([\w./-]+))?")
#: Greatest total size of a policy's files, bytes.
_LARGEST = 1 << 28


def is_name(policy: str) -> bool:
    """Return whether a name refers to the hub."""
    return policy.startswith(_SCHEME)


def folder_of(policy: str | os.PathLike[str], others: Iterable[str] = ()) -> Path:
    """Return the folder of a policy: ``hf://owner/name``, a folder, or the bare name of an installed policy.

    A folder hides an installed policy; a path that is no `str` is always a folder. `others` are names that the caller
    takes too, for errors. Raises as `download` and `graspbox.policies.published.installed.find`.
    """
    if isinstance(policy, str) and is_name(policy):
        return download(policy)
    if isinstance(policy, str) and installed.is_bare(policy) and not Path(policy).exists():
        return installed.find(policy, others)
    return Path(policy)


def repository(name: str) -> tuple[str, str | None]:
    """Split ``hf://owner/name[@revision]`` into repository and revision; raises ConfigError for another name."""
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise ConfigError(f"the policy is {name!r}; pass hf://owner/name, or hf://owner/name@revision")
    return parts[1], parts[2]


def hub() -> Any:
    """Import huggingface_hub; raises MissingExtraError if it is not installed."""
    library = imported("huggingface_hub", "policies on the hub need the package huggingface_hub", "hub")
    import_module("huggingface_hub.errors")
    return library


def download(name: str) -> Path:
    """Return the folder of ``hf://owner/name[@revision]``, downloaded unless it is in the cache (``HF_HOME``).

    Raises
    ------
    ConfigError
        If there is no such repository or revision, it holds no policy, or one that is larger than 256 MB.
    ConnectionLostError
        If the hub cannot be reached and the policy is not in the cache.
    MissingExtraError
        If huggingface_hub is not installed.
    """
    repo, revision = repository(name)
    library = hub()
    failures = library.errors
    try:
        info = library.HfApi().model_info(repo, revision=revision, files_metadata=True)
    except failures.RevisionNotFoundError:
        raise ConfigError(f"{name}: the hub has no revision {revision!r} of {repo}") from None
    except failures.RepositoryNotFoundError:
        raise ConfigError(f"{name}: the hub has no repository {repo}, or it is private; see `hf auth login`") from None
    except (failures.HfHubHTTPError, failures.HFValidationError) as error:
        raise ConfigError(f"{name}: {str(error).splitlines()[0]}") from None
    except Exception as error:  # the errors of connections share no base class
        return _cached(library, name, repo, revision, error)
    sizes = {one.rfilename: one.size for one in info.siblings}
    _check_sizes(name, sizes, (CONFIG,), LARGEST_CONFIG)
    # By the requested name, which the cache then resolves without a connection too.
    folder = Path(library.snapshot_download(repo, revision=revision, allow_patterns=[CONFIG]))
    config = parse(read_bounded(folder / CONFIG, LARGEST_CONFIG), f"{name}: {CONFIG}")
    _check_sizes(name, sizes, config.holds, _LARGEST)
    names = [CONFIG, *config.holds, CARD, LICENCE]
    return Path(library.snapshot_download(repo, revision=info.sha, allow_patterns=names))


def root_of(folder: Path) -> Path:
    """Return the folder, links resolved, in which the files of a policy must lie.

    That is its own, or, in the cache of huggingface_hub, that of its repository, whose snapshots consist of links.
    """
    folder = folder.resolve()
    in_cache = folder.parent.name == "snapshots" and folder.parents[1].name.startswith("models--")
    return folder.parents[1] if in_cache else folder


def _cached(library: Any, name: str, repo: str, revision: str | None, error: Exception) -> Path:
    try:
        return Path(library.snapshot_download(repo, revision=revision, local_files_only=True))
    except library.errors.LocalEntryNotFoundError:
        raise ConnectionLostError(f"{name} is not in the cache, and the hub cannot be reached: {error}") from None


def _check_sizes(name: str, sizes: dict[str, int | None], files: tuple[str, ...], most: int) -> None:
    for file in files:
        if sizes.get(file) is None:
            raise ConfigError(f"{name} has no file {file}; its policy is missing or incomplete")
    total = sum(sizes[file] or 0 for file in files)
    if total > most:
        raise ConfigError(f"{name}: {', '.join(files)} have {total} bytes; at most {most} are downloaded")
