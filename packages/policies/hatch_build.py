"""Build steps of the wheel graspbox-policies: its metadata, and the files of the policies, from the checkout.

A policy is a folder of ``policies/`` with ``config.json``. The wheel contains its configuration, the files that the
configuration names, checked against their hashes, its card, the licence and the card's pictures.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

PACKAGE = "graspbox_policies"
POLICIES = Path(__file__).parents[2] / "policies"


def folders() -> list[Path]:
    """Folders of the policies, by name."""
    found = sorted(path.parent for path in POLICIES.glob("*/config.json"))
    if not found:
        raise ValueError(f"there is no policy in {POLICIES}; build the wheel in a checkout of graspbox")
    return found


def files(folder: Path) -> list[Path]:
    """List the files of a policy that the wheel contains.

    Raises
    ------
    ValueError
        If one is missing, or not the file that was exported.
    """
    named = json.loads((folder / "config.json").read_text())["files"]
    for name, wanted in named.items():
        if hashlib.sha256((folder / name).read_bytes()).hexdigest() != wanted:
            raise ValueError(f"{folder / name} is not the file that config.json names; export the policy again")
    found = [folder / name for name in ("config.json", "README.md", "LICENSE", *named)]
    return [*found, *sorted(folder.glob("*.png"))]


class CustomMetadataHook(MetadataHookInterface):
    """Adds the fields of ``[project]`` that follow from the checkout."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Pin graspbox, and name the policies."""
        metadata["dependencies"] = [f"graspbox[cli,onnx]=={metadata['version']}"]
        names = {folder.name: f"{PACKAGE}.{folder.name}" for folder in folders()}
        metadata["entry-points"] = {"graspbox.policies": names}


class CustomBuildHook(BuildHookInterface[Any]):
    """Adds the files of the policies to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Map each file to its place in the wheel."""
        if self.target_name != "wheel" or version != "standard":
            raise ValueError("graspbox-policies is built as a wheel alone: pip install ./packages/policies")
        build_data["force_include"] |= {
            str(path): f"{PACKAGE}/{folder.name}/{path.name}" for folder in folders() for path in files(folder)
        }
