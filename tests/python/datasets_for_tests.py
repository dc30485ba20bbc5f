"""A small data set shared by several test modules."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from graspbox.data import trials as dataset

#: Objects of two splits; trials take well under a second per object.
OBJECTS = ["procedural:can:0-1", "procedural:box:1"]


def config(**changes: Any) -> dataset.DatasetConfig:
    """Give settings of a data set that takes seconds."""
    return dataset.DatasetConfig(
        **{"poses": 10, "rests": 2, "views": 2, "shard_trials": 10, "image_size": (24, 32), **changes}
    )


def command(folder: Path, *more: str) -> list[str]:
    """Give the command that makes a small data set."""
    words = ["dataset", "--out", str(folder), "--poses", "10", "--rests", "2", "--views", "1", "--shard-trials", "10"]
    return [sys.executable, "-m", "graspbox", *words, *(w for name in OBJECTS for w in ("--objects", name)), *more]


def run(folder: Path, *more: str, **settings: Any) -> "subprocess.CompletedProcess[str]":
    """Run that command to its end, at most ten minutes."""
    env = {**os.environ, "GRASPBOX_THREADS": "1"}
    return subprocess.run(command(folder, *more), capture_output=True, text=True, env=env, timeout=600.0, **settings)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a data set but its lock, by its path."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
