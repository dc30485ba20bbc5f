"""Runs of ``graspbox train sb3`` and ``clone`` as policies: their folders, and the commands that take them.

Torch is imported once a folder is one of a run.
"""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from graspbox import learn
from graspbox._common.runs import read_settings
from graspbox.envs import GOAL_IDS
from graspbox.errors import ConfigError

if TYPE_CHECKING:
    from graspbox.learn.sb3.run_policy import RunPolicy

__all__ = ["next_commands", "policy_of_run"]

#: Settings that only runs of Stable-Baselines3 have.
_KNOWN = {"algorithm", "id", "env", "model", "normalize"}
#: Depth of the folders of checkpoints below that of their run.
_DEPTH = 2


def policy_of_run(folder: Path) -> "RunPolicy | None":
    """Make the policy of a run's best checkpoint, or of the checkpoint that the folder is; None for another folder.

    Raises
    ------
    ConfigError
        If there is no checkpoint yet, or it cannot be read.
    MissingExtraError
        Without torch or Stable-Baselines3 (extra ``train``).
    """
    run = next(_runs(Path(folder)), None)
    if run is None:
        return None
    learn.require("stable_baselines3", "sb3_contrib", "yaml", need="the policy of a run")
    from graspbox.learn.sb3.run_policy import RunPolicy

    return RunPolicy(run, Path(folder) if run != Path(folder) else _chosen(run))


def _runs(folder: Path) -> Iterator[Path]:
    """List the run that a folder is, or that it is a checkpoint of."""
    above = [folder.absolute().parents[i] for i in range(_DEPTH)] if (folder / "model.zip").is_file() else []
    for place in (folder, *above):
        if (place / "settings.json").is_file() and set(read_settings(place)) >= _KNOWN:
            yield place


def _chosen(run: Path) -> Path:
    """Return the best checkpoint; the last one of a clone, which has no other."""
    name = "checkpoint" if "clone" in read_settings(run) else "best"
    if not any((run / f"{name}{end}").is_dir() for end in ("", ".old")):
        raise ConfigError(
            f"the run in {str(run)!r} has no checkpoint {name!r} yet; its first evaluation writes it: train on, or wait"
        )
    return run / name


def next_commands(run: Path) -> str:
    """Name the commands that take a run."""
    name = shlex.quote(str(run))
    file = shlex.quote(f"{run}.webp"), shlex.quote(f"{run}.html")
    commands = [f"evaluate {name}", f"play {name} --video {file[0]}", f"report {name} --out {file[1]}"]
    if read_settings(run)["id"] not in GOAL_IDS:
        commands.append(f"view {name}")
    return "next: " + "; ".join(f"graspbox {words}" for words in commands)
