"""Packages that offer policies, as an installation leaves them: their metadata in a folder of ``sys.path``."""

from pathlib import Path

from graspbox.artifacts.installed import GROUP

__all__ = ["offer"]


def offer(site: Path, package: str, **entries: str) -> None:
    """Write the metadata of a package whose modules are in `site`: its entry points, by the names of policies."""
    folder = site / f"{package.replace('-', '_')}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in entries.items()]
    (folder / "entry_points.txt").write_text("\n".join([f"[{GROUP}]", *lines]) + "\n")
