"""Folders of published policies: ``config.json`` says what the networks beside it are; read and checked without torch.

| file | contents |
|---|---|
| ``config.json``            | `DepthPolicyConfig`, and the object sets from which the policy learned |
| ``completion.onnx``, ``completion.safetensors`` | the completion; its weights |
| ``scorer.onnx``, ``scorer-N.safetensors``       | the scorer with all its members; their weights |
| ``head.onnx``, ``head.safetensors``            | the head, if it has one; its weights |
| ``README.md``              | the card: data, command, time, seed, scores, limits |
| ``LICENSE``                | the licence of the weights |
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar

from graspbox.arguments import config_of, to_json
from graspbox.errors import ConfigError, FileError
from graspbox.files import dumps, read_bounded, write_text
from graspbox.learned_sets import by_family
from graspbox.perception.calibration import Calibration
from graspbox.perception.configs import CropConfig, HandGridConfig
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.head_configs import HeadConfig, check_anchor

__all__ = [
    "CONFIG",
    "KIND",
    "POSE_KIND",
    "DepthPolicyConfig",
    "check_counts",
    "check_files",
    "check_hashes",
    "check_texts",
    "file_hash",
    "policy_hash",
    "read_config",
    "read_depth_policy",
    "read_kind",
    "read_learned_from",
    "write_config",
    "write_depth_policy",
    "write_learned_from",
]

#: The file that says what a folder holds.
CONFIG = "config.json"
#: Version of the folder's format.
FORMAT = 1
#: Kind of the policy that `DepthPolicyConfig` describes.
KIND = "depth-grasp"
#: Kind of those that `graspbox.learning.pose_folders` describes.
POSE_KIND = "study-pose"
#: Entry of ``config.json``, of policies of every kind: the object sets from which the policy learned.
_LEARNED_FROM = "learned_from"
_LARGEST_CONFIG = 1 << 20
_LARGEST_FILE = 1 << 30


@dataclass(frozen=True)
class DepthPolicyConfig:
    """What a policy that grasps from one depth image consists of.

    Attributes
    ----------
    name : str
        Name in results.
    graspbox : str
        Version that exported it.
    hand : str
        The hand that it was trained with.
    calibration : Calibration
        What made the scorer's logits probabilities; it is part of ``scorer.onnx``.
    files : mapping of str to str
        SHA-256 of every file of the networks.
    members : int
        Members of the scorer.
    width : int
        `graspbox.perception.scorer.ScorerNet`.
    finalists : int
        `graspbox.perception.graphs.ScorerGraph`.
    completion_width : int
        `graspbox.perception.completion.CompletionNet`.
    crop, grid, finder
        Settings with which it was trained, and with which grasps are found.
    head : HeadConfig or None
        The head whose grasps are scored beside the proposals.
    """

    name: str
    graspbox: str
    hand: str
    calibration: Calibration
    files: Mapping[str, str]
    members: int
    width: int
    finalists: int
    completion_width: int
    crop: CropConfig = field(default_factory=CropConfig)
    grid: HandGridConfig = field(default_factory=HandGridConfig)
    finder: FinderConfig = field(default_factory=FinderConfig)
    head: HeadConfig | None = None

    def __post_init__(self) -> None:
        check_texts(self, "name", "graspbox", "hand")
        check_counts(self, "members", "width", "finalists", "completion_width")
        check_hashes(self.files)
        if self.head is not None:
            check_anchor(self.head)

    @property
    def weights(self) -> tuple[str, ...]:
        """Files of the members' weights."""
        return tuple(f"scorer-{i}.safetensors" for i in range(self.members))


def file_hash(path: Path) -> str:
    """Give the SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(read_bounded(path, _LARGEST_FILE)).hexdigest()


def check_files(path: Path, files: Mapping[str, str]) -> None:
    """Check the files beside `path`, which names each with its SHA-256.

    Raises
    ------
    FileError
        If one is missing.
    ConfigError
        If one is elsewhere, or not the one that was exported.
    """
    for name, expected in files.items():
        if Path(name).name != name:
            raise ConfigError(f"{path} names the file {name!r}; files of a policy are in its own folder")
        if file_hash(path.parent / name) != expected:
            raise ConfigError(f"{path.parent / name} is not the file that {path} names; export the policy again")


def check_texts(config: object, *names: str) -> None:
    """Refuse attributes of a config that are no text, or an empty one."""
    for name in names:
        value = getattr(config, name)
        if not isinstance(value, str) or not value:
            raise ConfigError(f"{name} is {value!r}; give a text")


def check_counts(config: object, *names: str) -> None:
    """Refuse attributes of a config that are no positive integers."""
    for name in names:
        value = getattr(config, name)
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise ConfigError(f"{name} is {value!r}; give a positive integer")


def check_hashes(files: object) -> None:
    """Refuse what does not give texts by names, as the SHA-256 of files."""
    if not isinstance(files, Mapping) or not all(isinstance(text, str) for text in files.values()):
        raise ConfigError(f"files is {files!r}; give the SHA-256 of each file by its name")


def write_config(folder: Path, kind: str, config: Any) -> None:
    """Write ``config.json`` of a policy of some kind."""
    content = {"format": FORMAT, "kind": kind, **json.loads(to_json(config, type(config)))}
    write_text(Path(folder) / CONFIG, dumps(content) + "\n")


def write_depth_policy(folder: Path, config: DepthPolicyConfig) -> None:
    """Write ``config.json``."""
    write_config(folder, KIND, config)


def read_kind(folder: Path) -> str:
    """Tell which kind of policy a folder holds.

    Raises
    ------
    FileError
        If it has no ``config.json``.
    ConfigError
        If that is no JSON object of a format that is known, or names no kind.
    """
    return str(_content(folder)["kind"])


def read_depth_policy(folder: Path) -> DepthPolicyConfig:
    """Read ``config.json`` of a policy that grasps from one depth image, and check the files that it names.

    Raises
    ------
    FileError
        If a file is missing.
    ConfigError
        If the policy is of another kind, an entry is missing, unknown or wrong, or a file is not the one that was
        exported.
    """
    return read_config(Path(folder), KIND, DepthPolicyConfig)


class _Published(Protocol):
    """The config of a policy that names the files of its networks."""

    @property
    def files(self) -> Mapping[str, str]: ...


_Config = TypeVar("_Config", bound=_Published)


def read_config(folder: Path, kind: str, config_class: type[_Config]) -> _Config:
    """Read ``config.json`` of a policy of some kind; raises as `read_depth_policy`."""
    path = folder / CONFIG
    content = _content(folder)
    if content["kind"] != kind:
        raise ConfigError(f"{path} describes a policy of the kind {content['kind']!r}; expected {kind!r}")
    given = {name: value for name, value in content.items() if name not in ("format", "kind", _LEARNED_FROM)}
    try:
        config = config_of(config_class, given, str(path))
    except TypeError as error:
        # Of the class's own __init__: "missing ... required positional arguments: 'hand'".
        raise ConfigError(f"{path} is incomplete: {str(error).partition('__init__() ')[2]}") from None
    except ConfigError as error:
        text = str(error)
        raise ConfigError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    check_files(path, config.files)
    return config


def policy_hash(folder: Path) -> str:
    """Give the SHA-256 of what a policy does: of its ``config.json`` but for what it learned from.

    The file has the hashes of the networks beside it. Raises as `read_kind`.
    """
    content = {key: value for key, value in _content(folder).items() if key != _LEARNED_FROM}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def read_learned_from(folder: Path) -> tuple[str, ...]:
    """Read from which object sets a policy learned, ``NAME`` or ``NAME/SPLIT``; raises as `read_kind`."""
    found = _content(folder).get(_LEARNED_FROM, [])
    if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
        path = Path(folder) / CONFIG
        raise ConfigError(f"{path}: {_LEARNED_FROM} is {found!r}; give a list of names of object sets")
    return tuple(found)


def write_learned_from(folder: Path, names: Iterable[str]) -> None:
    """Add to a policy's ``config.json`` from which object sets it learned, family by family.

    Raises
    ------
    ConfigError, FileError
        As `read_kind`.
    ObjectSetError
        If a name is that of no procedural set.
    """
    known = (*read_learned_from(folder), *(each for name in names for each in by_family(name)))
    content = {**_content(folder), _LEARNED_FROM: list(dict.fromkeys(known))}
    write_text(Path(folder) / CONFIG, dumps(content) + "\n")


def _content(folder: Path) -> dict[str, Any]:
    path = Path(folder) / CONFIG
    if not path.is_file():
        raise FileError(2, "there is no policy in this folder", str(path))
    try:
        content = json.loads(read_bounded(path, _LARGEST_CONFIG))
    except ValueError as error:
        raise ConfigError(f"{path} is no JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else None
        raise ConfigError(f"{path} has the format {found!r}; this version of graspbox reads {FORMAT}")
    if not isinstance(content.get("kind"), str):
        raise ConfigError(f"{path} names no kind of policy; its entry 'kind' is {content.get('kind')!r}")
    return content
