"""Packages with entry points, as an installation leaves them: their metadata in a folder of ``sys.path``."""

from collections.abc import Mapping
from pathlib import Path

from graspbox.policies.published.installed import GROUP

__all__ = ["install", "offer"]


def install(site: Path, package: str, group: str, entries: Mapping[str, str]) -> None:
    """Write the metadata of a package whose modules are in `site`: its entry points of a group, by name."""
    folder = site / f"{package.replace('-', '_')}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in entries.items()]
    (folder / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines]) + "\n")


def offer(site: Path, package: str, **entries: str) -> None:
    """Install a package that offers policies, by their names."""
    install(site, package, GROUP, entries)
