"""Folders of published heads: ``config.json``, ``head.onnx``, ``head.safetensors``; read and checked without torch."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from graspbox.perception.configs import CropConfig
from graspbox.perception.head_configs import HeadConfig, check_anchor
from graspbox.perception.policy_folders import check_hashes, read_config, write_config

__all__ = ["HEAD_KIND", "HeadPolicyConfig", "read_head_policy", "write_head_policy"]

#: Kind of the policy that `HeadPolicyConfig` describes.
HEAD_KIND = "head-grasp"


@dataclass(frozen=True)
class HeadPolicyConfig:
    """What a policy of one network consists of.

    Attributes
    ----------
    name : str
        Name in results.
    graspbox : str
        Version that exported it.
    hand : str
        The hand that it was trained with.
    preshapes : int
        Preshapes of the hand.
    files : mapping of str to str
        SHA-256 of every file of the network.
    filtered : bool
        Whether it takes the best grasp that does not collide with what is seen, instead of the best.
    head, crop
        Settings of the network.
    """

    name: str
    graspbox: str
    hand: str
    preshapes: int
    files: Mapping[str, str]
    filtered: bool = True
    head: HeadConfig = field(default_factory=HeadConfig)
    crop: CropConfig = field(default_factory=CropConfig)

    def __post_init__(self) -> None:
        check_anchor(self.head)
        check_hashes(self.files)


def write_head_policy(folder: Path, config: HeadPolicyConfig) -> None:
    """Write ``config.json``."""
    write_config(folder, HEAD_KIND, config)


def read_head_policy(folder: Path) -> HeadPolicyConfig:
    """Read ``config.json`` of a published head, and check the files that it names; raises as `read_depth_policy`."""
    return read_config(Path(folder), HEAD_KIND, HeadPolicyConfig)
