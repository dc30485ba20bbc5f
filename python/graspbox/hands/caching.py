"""The folder for cached data."""

import os
from pathlib import Path

__all__ = ["cache_folder"]


def cache_folder() -> Path | None:
    """Return the folder for cached data: ``GRASPBOX_CACHE`` (no cache if empty), else the user's cache folder."""
    chosen = os.environ.get("GRASPBOX_CACHE")
    if chosen is not None:
        return Path(chosen).expanduser() if chosen else None
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "graspbox"
