"""How a policy of Stable-Baselines3 came about, read off the folders of its runs; without torch.

A run of ``scripts/train_sb3.py`` may have begun as a clone of ``scripts/clone_sb3.py``, and that learned from
demonstrations of ``graspbox record``. Each step is told with a command that repeats it.
"""

import json
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from graspbox.errors import ConfigError
from graspbox.sb3.parameters import read_parameters

__all__ = ["Made", "history", "settings_of", "shown"]

_NEEDED = {"algorithm", "id", "env", "num_envs", "model", "normalize", "seed"}


@dataclass(frozen=True)
class Made:
    """A step in the making of a policy.

    Attributes
    ----------
    what : str
        ``demonstrations``, ``clone`` or ``training``.
    command : str
        What repeats it, but for limits of time and interruptions.
    told : str
        What it was, in a sentence.
    objects : mapping
        Keywords ``objects`` and ``split`` of the environments from which it learned.
    seconds : float or None
        Wall time, evaluations included; None where it is not known.
    """

    what: str
    command: str
    told: str
    objects: Mapping[str, Any] = field(default_factory=dict)
    seconds: float | None = None


def settings_of(folder: Path) -> dict[str, Any]:
    """Read the settings of a run of ``train_sb3.py`` or ``clone_sb3.py``.

    Raises
    ------
    ConfigError
        If there is no such run.
    """
    try:
        first = (Path(folder) / "evaluations.jsonl").read_text().splitlines()[0]
        found: dict[str, Any] = json.loads(first)["settings"]
        missing = _NEEDED - set(found)
    except (OSError, ValueError, LookupError, TypeError):
        raise ConfigError(
            f"there is no run of train_sb3.py or clone_sb3.py in {str(folder)!r}; name its folder"
        ) from None
    if missing:
        raise ConfigError(f"the run in {str(folder)!r} is of another version; it lacks {', '.join(sorted(missing))}")
    return found


def history(folder: Path, parameters: Path, checkpoint: str = "checkpoint") -> list[Made]:
    """Tell the steps that made the policy of a run, the first one first.

    Parameters
    ----------
    folder : Path
        Folder of the run.
    parameters : Path
        ``scripts/sb3.yaml``; what a run has otherwise is part of its command.
    checkpoint : {"checkpoint", "best"}
        Which of the run's models it is.

    Raises
    ------
    ConfigError
        If a folder of it is missing, or of another version.
    """
    folder, settings = Path(folder), settings_of(folder)
    progress = _progress(folder / checkpoint)
    if "clone" in settings:
        return [_recorded(settings["clone"]), _cloned(folder, settings, parameters, progress)]
    begun = settings.get("begins_as")
    before = history(Path(begun), parameters) if begun else []
    return [*before, _trained(folder, settings, parameters, progress)]


def _progress(folder: Path) -> dict[str, Any]:
    path = folder / "progress.json"
    if not path.is_file():
        raise ConfigError(f"there is no model in {str(folder)!r}; it has no progress.json")
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def _trained(folder: Path, settings: Mapping[str, Any], parameters: Path, progress: Mapping[str, Any]) -> Made:
    known = read_parameters(parameters, settings["algorithm"], settings["id"])
    begun = settings.get("begins_as")
    # A clone takes the place of demonstrations of its own.
    skipped = ("steps", "demonstrations") if begun else ("steps",)
    words = ["python", "scripts/train_sb3.py", settings["algorithm"], shown(folder)]
    words += ["--env", settings["id"], *(["--clone", shown(Path(begun))] if begun else [])]
    words += ["--steps", str(progress["timesteps"]), "--seed", str(settings["seed"])]
    words += _changes(vars(known), settings, skipped)
    how = "from a clone" if begun else "from demonstrations" if settings.get("demonstrations") else "from scratch"
    told = f"{settings['algorithm'].upper()} {how}, {progress['timesteps']} steps of the environments, reward "
    told += f"`{settings['env'].get('reward', 'sparse')}`, seed {settings['seed']}"
    objects = {"objects": settings["env"].get("objects", "procedural"), "split": "train"}
    return Made("training", shlex.join(words), told, objects, progress["seconds"])


def _cloned(folder: Path, settings: Mapping[str, Any], parameters: Path, progress: Mapping[str, Any]) -> Made:
    known, clone = read_parameters(parameters, settings["algorithm"], settings["id"]), settings["clone"]
    obs = settings["env"]["obs"]
    words = ["python", "scripts/clone_sb3.py", settings["algorithm"], shown(Path(clone["demonstrations"]))]
    words += [shown(folder), *_repeated("--obs", obs), "--keep", clone["keep"]]
    words += [] if clone["shown"] is None else ["--shown", str(clone["shown"])]
    words += [word for name in ("epochs", "batch", "rate") for word in (f"--{name}", str(clone[name]))]
    words += ["--seed", str(settings["seed"])]
    # The environment is that of the demonstrations.
    words += _changes(vars(known), settings, ("steps", "env"))
    told = f"behaviour cloning, {progress['timesteps']} updates, {clone['epochs']} epochs, seed {settings['seed']}"
    return Made("clone", shlex.join(words), told, seconds=progress["seconds"])


def _recorded(clone: Mapping[str, Any]) -> Made:
    given, source = clone["shown_by"], Path(clone["demonstrations"])
    spec = given["env_spec"]
    kept = {name: value for name, value in spec["kwargs"].items() if value is not None}
    objects, split = kept.pop("objects", "procedural"), kept.pop("split", None)
    for name in ("obs", "num_threads"):
        kept.pop(name, None)
    counts = _counts(source)
    words = [
        "graspbox",
        "record",
        given.get("goal_from", given["policy"]),
        "--out",
        shown(source),
        "--env",
        given["env_id"],
    ]
    words += ["--episodes", str(counts["episodes"])] if counts else []
    words += ["--seed", str(given["seed"]), "--keep", given["keep"], "--noise", str(given["noise"])]
    words += [*(["--split", split] if split else []), *_repeated("--objects", objects)]
    words += _repeated("--obs", given["observations"])
    kept.setdefault("max_episode_steps", spec["max_episode_steps"])
    words += [word for name, value in kept.items() for word in ("--set", f"{name}={_json(value)}")]
    told = f"demonstrations of `{given['policy']}`, kept: {given['keep']}, noise {given['noise']}"
    if counts:
        told = f"{counts['episodes']} {told}: {counts['steps']} steps of {counts['trials']} trials"
    if clone["shown"] is not None:
        told += f"; the clone learned from the first {clone['shown']}"
    return Made("demonstrations", shlex.join(words), told, {"objects": objects, "split": split})


def _counts(source: Path) -> dict[str, int]:
    """Read the counts of demonstrations; empty where their folder is gone."""
    path = source / "manifest.json"
    if not path.is_file():
        return {}
    found: dict[str, int] = json.loads(path.read_text())["counts"]
    return found


def _json(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _repeated(option: str, values: Any) -> list[str]:
    named = [values] if isinstance(values, str) else values
    return [word for value in named for word in (option, value)]


def _changes(known: Mapping[str, Any], given: Mapping[str, Any], skipped: tuple[str, ...]) -> list[str]:
    """Write ``--set`` for every value that differs from those known."""
    names = [name for name in known if name not in skipped]
    pairs = _differing({n: known[n] for n in names}, {n: given[n] for n in names if n in given})
    return [word for name, value in pairs for word in ("--set", f"{name}={_yaml(value)}")]


def _differing(known: Any, given: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Find the values that differ, by the names that ``--set`` takes; a mapping that lacks something is one value."""
    for name, value in given.items():
        old = known.get(name) if isinstance(known, Mapping) else None
        if value == old:
            continue
        if isinstance(value, Mapping) and isinstance(old, Mapping) and set(old) <= set(value):
            yield from _differing(old, value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _yaml(value: Any) -> str:
    """Write a value in one line, as ``--set`` reads it."""
    text = yaml.safe_dump(value, default_flow_style=True, width=float("inf"), sort_keys=False)
    return str(text).removesuffix("\n").removesuffix("\n...")


def shown(path: Path) -> str:
    """Name a folder as a reader would: below the present one, else in ``out``."""
    whole, here = Path(path).resolve(), Path.cwd().resolve()
    return str(whole.relative_to(here)) if whole.is_relative_to(here) else f"out/{whole.name}"
