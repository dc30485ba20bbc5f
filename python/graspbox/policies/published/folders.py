"""Folders of published policies: ``config.json`` is read, validated and written, and the other files are verified.

The kind of policy determines all file names; a link must stay in the folder. A policy refers to other policies by their
folders or names, with a hash of their ``config.json``.
"""

import hashlib
import os
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any, TypeVar, overload

from graspbox._common.files import dumps, read_bounded, write_text
from graspbox.errors import ConfigError, FileError
from graspbox.hands import Hand, load_hand
from graspbox.object_sets.learned_sets import by_family
from graspbox.policies.published import installed
from graspbox.policies.published.configs import COMPLETION, HAND_FILES, DepthPolicyConfig, PolicyConfig, Use
from graspbox.policies.published.downloads import CONFIG, LARGEST_CONFIG, folder_of, is_name, root_of
from graspbox.policies.published.registry import other_policy, policy_class
from graspbox.policies.published.schema import content_of, parse

__all__ = [
    "CONFIG",
    "completion_folder",
    "file_hash",
    "hand_of",
    "load",
    "policy_of",
    "read_depth_policy",
    "save",
    "use_of",
    "used_folder",
]

#: Greatest size of a network, bytes.
_LARGEST_FILE = 1 << 28

Config = TypeVar("Config", bound=PolicyConfig)


@overload
def load(folder: str | os.PathLike[str]) -> PolicyConfig: ...


@overload
def load(folder: str | os.PathLike[str], kind: type[Config]) -> Config: ...


def load(folder: str | os.PathLike[str], kind: type[PolicyConfig] = PolicyConfig) -> PolicyConfig:
    """Read the configuration of a published policy, of an expected kind or any, and verify its files.

    Raises
    ------
    ConfigError
        If there is no ``config.json``, a field of it is missing, unknown or wrong, the policy is of another kind, or a
        file is missing, outside the folder, or different from the exported one.
    MissingExtraError
        If pydantic is not installed.
    """
    path = Path(folder) / CONFIG
    config = _read(path)
    if not isinstance(config, kind):
        raise ConfigError(f"{path}: kind is {config.kind!r}; expected {kind.kind!r}")
    _check_names(config, str(path))
    for name, expected in config.files.items():
        content = _bytes_of(path.parent / name, _LARGEST_FILE)
        if hashlib.sha256(content).hexdigest() != expected:
            raise ConfigError(f"{path.parent / name} is not the file that {path} names; export the policy again")
    _check(config, path)
    return config


def hand_of(folder: str | os.PathLike[str], config: PolicyConfig) -> str | tuple[str, str]:
    """Return the hand of a policy as environments take it: the name of a shipped one, or the paths of its two files.

    A policy without these files has the hand of a policy that it uses; raises as `used_folder`.
    """
    if config.hand in Hand.names():
        return config.hand
    if set(HAND_FILES) <= set(config.files):
        urdf, toml = (os.path.normpath(Path(folder) / name) for name in HAND_FILES)
        return urdf, toml
    for role in set(config.uses) - {COMPLETION}:
        used = used_folder(folder, config, role)
        return hand_of(used, _read(used / CONFIG))
    known = ", ".join(Hand.names())
    raise ConfigError(
        f"{Path(folder) / CONFIG}: hand is {config.hand!r}, which is none of {known}, and the folder lacks its files "
        f"{' and '.join(HAND_FILES)}; export the policy again"
    )


def save(folder: Path, config: Config) -> Config:
    """Write ``config.json``, and return the configuration as written: names of training object sets expand to families.

    Raises
    ------
    ConfigError
        If `load` would refuse it.
    ObjectSetError
        If `learned_from` has an invalid name of a procedural set.
    """
    path = Path(folder) / CONFIG
    learned = dict.fromkeys(each for name in config.learned_from for each in by_family(name))
    config = replace(config, learned_from=tuple(learned))
    text = dumps(content_of(config)) + "\n"
    _check_names(config, str(path))
    _check(parse(text.encode(), str(path)), path)
    write_text(path, text)
    return config


def read_depth_policy(folder: str | os.PathLike[str]) -> DepthPolicyConfig:
    """Read the configuration of a policy that grasps from one depth image; raises as `load`."""
    return load(folder, DepthPolicyConfig)


def policy_of(folder: str | os.PathLike[str], **options: Any) -> Any:
    """Build the policy of a folder, a `graspbox.policies.Policy`, with options of its class.

    Raises ConfigError as `load`, or for an option that its class does not have.
    """
    if not (Path(folder) / CONFIG).exists() and (other := other_policy(Path(folder))) is not None:
        if options:
            raise ConfigError(f"the policy {other.name!r} does not take {next(iter(options))!r}")
        return other
    config = _read(Path(folder) / CONFIG)
    made = policy_class(config.kind)
    for option in options:
        if option not in signature(made).parameters:
            raise ConfigError(f"the policy {config.name!r} of the kind {config.kind!r} does not take {option!r}")
    return made(Path(folder), **options)


def use_of(folder: Path, used: Path) -> Use:
    """Build the reference from a folder to a published policy: the name of an installed one, else a relative path.

    Raises as `load` if `used` holds no published policy.
    """
    load(used)
    place = installed.name_of(used) or Path(os.path.relpath(used.resolve(), folder.resolve())).as_posix()
    return Use(place, file_hash(used / CONFIG))


def used_folder(folder: str | os.PathLike[str], config: PolicyConfig, role: str) -> Path:
    """Find the folder of a policy that another one, of `folder` and `config`, needs in a role of ``config.uses``.

    A policy on the hub is found there. Another one is found at its relative path or, with the same hash, among the
    installed policies, by the last part of that path.

    Raises
    ------
    ConfigError
        If it is missing, differs from the policy at the time of publication, or was trained for another hand.
    """
    use = config.uses[role]

    def same(place: Path) -> bool:
        return (place / CONFIG).is_file() and file_hash(place / CONFIG) == use.sha256

    own = folder_of(use.policy) if is_name(use.policy) else Path(folder) / use.policy
    named = [] if is_name(use.policy) else installed.folders(Path(use.policy).name)
    place = next(filter(same, [own, *named]), None)
    if place is None:
        raise ConfigError(
            f"{Path(folder) / CONFIG}: uses.{role}.policy is {use.policy!r}, but {str(own)!r} is missing, or differs "
            f"from the policy that {config.name!r} was published with; restore it, or install its package"
        )
    if role != COMPLETION and (known := _read(place / CONFIG).hand) != config.hand:
        raise ConfigError(
            f"{Path(folder) / CONFIG}: hand is {config.hand!r}, but the policy of uses.{role}, {use.policy!r}, knows "
            f"the hand {known!r}; name the hand that both were trained with"
        )
    return place


def completion_folder(folder: str | os.PathLike[str], config: DepthPolicyConfig) -> Path:
    """Find the folder with the completion of a policy: its own, or that of the policy that it uses.

    Raises ConfigError as `used_folder`, or if that policy has other crops, or no completion of its own.
    """
    if COMPLETION not in config.uses:
        return Path(folder)
    place = used_folder(folder, config, COMPLETION)
    used = read_depth_policy(place)
    fits = used.crop.has_voxels_of(config.crop) and used.completion_width == config.completion_width
    if COMPLETION in used.uses or not fits:
        raise ConfigError(
            f"{Path(folder) / CONFIG}: uses.{COMPLETION} names {str(place)!r}, whose completion takes other crops, or "
            "is of yet another policy; name the policy with which this one was trained"
        )
    return place


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file of a policy, in hexadecimal digits; raises ConfigError if it cannot be read."""
    return hashlib.sha256(_bytes_of(path, _LARGEST_FILE)).hexdigest()


def _read(path: Path) -> PolicyConfig:
    return parse(_bytes_of(path, LARGEST_CONFIG), str(path))


def _bytes_of(path: Path, largest: int) -> bytes:
    if not path.is_file():
        hint = "name the folder of a policy or of a run" if path.name == CONFIG else "export the policy again"
        raise ConfigError(f"there is no {path.name} in {str(path.parent)!r}; {hint}")
    if not path.resolve().is_relative_to(root_of(path.parent)):
        raise ConfigError(f"{path} is a link to a file outside its folder; put the file itself there")
    try:
        return read_bounded(path, largest)
    except FileError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from None


def _check(config: PolicyConfig, path: Path) -> None:
    """Check values that need the hand or the core."""
    try:
        config.check(load_hand(hand_of(path.parent, config)))
    except ValueError as error:
        text = str(error)
        raise ConfigError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def _check_names(config: PolicyConfig, called: str) -> None:
    """Check that the files are those of the kind of policy, and of its hand."""
    listed, wanted = set(config.files), set(config.holds)
    if config.carries_hand and config.hand not in Hand.names() and listed & set(HAND_FILES):
        wanted |= set(HAND_FILES)
    if listed != wanted:
        wrong = [f"lacks {name!r}" for name in sorted(wanted - listed)]
        wrong += [f"has {name!a}" for name in sorted(listed - wanted)]
        expected = ", ".join(config.holds)
        raise ConfigError(f"{called}: files {wrong[0]}; a policy of the kind {config.kind!r} has {expected}")
