"""History of a policy of Stable-Baselines3, read from the folders of its runs; without torch.

A clone of ``graspbox train clone`` was trained on demonstrations of ``graspbox record``, a student of ``graspbox train
student`` by a run of ``graspbox train sb3``. Each step is described with a command that reproduces it.
"""

import json
import logging
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from graspbox._common.runs import read_settings
from graspbox.data.trials.learned import of_splits
from graspbox.errors import ConfigError
from graspbox.learn.sb3.settings import read_parameters

__all__ = ["STUDENT", "TrainingStep", "history", "learned_from", "settings_of", "shown", "trained_on"]

_log = logging.getLogger(__name__)

#: File in the folder of a student: the options of its training, and its teacher's ``run`` and ``checkpoint``.
STUDENT = "student.json"
_NEEDED = {"algorithm", "id", "env", "num_envs", "model", "normalize", "seed"}


@dataclass(frozen=True)
class TrainingStep:
    """A step in a policy's history.

    Attributes
    ----------
    kind : str
        ``demonstrations``, ``clone``, ``student`` or ``training``.
    command : str
        The command that reproduces it, apart from time limits and interruptions.
    description : str
        A sentence that describes it.
    objects : mapping
        Keywords ``objects`` and ``split`` of the environments that it was trained in.
    seconds : float or None
        Wall time, evaluations included; None if unknown.
    """

    kind: str
    command: str
    description: str
    objects: Mapping[str, Any] = field(default_factory=dict)
    seconds: float | None = None


def settings_of(folder: Path) -> dict[str, Any]:
    """Read the settings of a run of ``graspbox train sb3`` or ``graspbox train clone``.

    Raises
    ------
    ConfigError
        If there is no such run.
    """
    found = read_settings(folder)
    if missing := _NEEDED - set(found):
        lacking = ", ".join(sorted(missing))
        made = "give the folder of a run of graspbox train sb3 or graspbox train clone"
        raise ConfigError(f"the settings of the run in {str(folder)!r} lack {lacking}; {made}")
    return found


def trained_on(folder: Path) -> list[Mapping[str, Any]]:
    """Return the keywords ``objects`` and ``split`` of all environments in which a run's policy learned, in order.

    A clone that a run began as and that is missing is left out, with a warning.
    """
    settings = settings_of(folder)
    if (taught := _taught(folder)) is not None:
        teacher = Path(taught["run"])
        # Its rounds have the environments of its teacher.
        chosen = {"objects": settings["env"].get("objects", "procedural"), "split": settings_of(teacher)["evaluate"]}
        return [*trained_on(teacher), *([chosen] if taught["checkpoint"] == "best" else [])]
    env, split, begun = settings["env"], "train", None
    if "clone" in settings:
        env, begun = settings["clone"]["shown_by"]["env_spec"]["kwargs"], settings["clone"].get("begins_as")
        split = env.get("split")
    own = {"objects": env.get("objects", "procedural"), "split": split}
    if begun and not (Path(begun) / "settings.json").is_file():
        _log.warning(
            "the objects from which the clone %s of the run %s learned are unknown: it is missing", begun, folder
        )
        begun = None
    return [*(trained_on(Path(begun)) if begun else []), own]


def learned_from(trained: Iterable[Mapping[str, Any]], chosen_on: str | None) -> list[str]:
    """Name a policy's training object sets (`trained_on`), and the split on which its checkpoint was selected."""
    found: list[str] = []
    names: tuple[str, ...] = ()
    for each in trained:
        sets, split = each.get("objects", ()), each.get("split")
        names = (sets,) if isinstance(sets, str) else tuple(sets)
        found += of_splits(names, [split]) if split else names
    if chosen_on is not None:
        found += of_splits(names, [chosen_on])
    return found


def history(folder: Path, parameters: Path, checkpoint: str = "checkpoint") -> list[TrainingStep]:
    """Return the steps that produced the policy of a run, in order.

    Parameters
    ----------
    folder : Path
        Folder of the run.
    parameters : Path
        The file of parameters; values that differ from it are part of the command.
    checkpoint : {"checkpoint", "best"}
        The run's model to describe.

    Raises
    ------
    ConfigError
        If one of its folders is missing, or of another version.
    """
    folder, settings = Path(folder), settings_of(folder)
    progress = _progress(folder / checkpoint)
    if (taught := _taught(folder)) is not None:
        before = history(Path(taught["run"]), parameters, taught["checkpoint"])
        return [*before, _student(folder, settings, parameters, taught, progress)]
    if "clone" in settings:
        return [_recorded(settings["clone"]), _cloned(folder, settings, parameters, progress)]
    return [_trained(folder, settings, parameters, progress)]


def _taught(folder: Path) -> dict[str, Any] | None:
    """Read how a student was taught; None for another run, or where the teacher is missing, with a warning."""
    if not (folder / STUDENT).is_file():
        return None
    try:
        found: dict[str, Any] = json.loads((folder / STUDENT).read_text())
        run = Path(found["run"])
    except (ValueError, KeyError, TypeError):
        raise ConfigError(
            f"{str(folder / STUDENT)!r} is damaged; the same graspbox train student writes it again"
        ) from None
    if not (run / "settings.json").is_file():
        _log.warning("the teacher %s of the student %s is missing; its own training is unknown", run, folder)
        return None
    return found


def _student(
    folder: Path,
    settings: Mapping[str, Any],
    parameters: Path,
    taught: Mapping[str, Any],
    progress: Mapping[str, Any],
) -> TrainingStep:
    known = read_parameters(parameters, settings["algorithm"], settings["id"], demonstrated=True)
    teacher = Path(taught["run"])
    named = teacher if taught["checkpoint"] == "best" else teacher / taught["checkpoint"]
    words = ["graspbox", "train", "student", shown(named), "--out", shown(folder), *_repeated("--obs", taught["obs"])]
    for name in ("rounds", "shown", "noise", "epochs", "batch", "rate", "seed"):
        words += [f"--{name}", str(taught[name])]
    words += _changes(vars(known), settings, ("steps", "env"))
    description = (
        f"a student of the run, {taught['rounds']} rounds of {taught['shown']} episodes, {taught['epochs']} epochs "
        f"each, {progress['timesteps']} updates in the last round, seed {taught['seed']}"
    )
    objects = {"objects": settings["env"].get("objects", "procedural"), "split": "train"}
    return TrainingStep("student", shlex.join(words), description, objects)


def _progress(folder: Path) -> dict[str, Any]:
    path = folder / "progress.json"
    if not path.is_file():
        raise ConfigError(f"there is no model in {str(folder)!r}; it has no progress.json")
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def _trained(folder: Path, settings: Mapping[str, Any], parameters: Path, progress: Mapping[str, Any]) -> TrainingStep:
    shows = bool(settings.get("demonstrations"))
    known = read_parameters(parameters, settings["algorithm"], settings["id"], demonstrated=shows)
    words = ["graspbox", "train", "sb3", settings["algorithm"], "--out", shown(folder)]
    words += ["--env", settings["id"]]
    words += ["--steps", str(progress["timesteps"]), "--seed", str(settings["seed"])]
    words += _changes(vars(known), settings, ("steps",))
    how = "from demonstrations" if shows else "from scratch"
    description = f"{settings['algorithm'].upper()} {how}, {progress['timesteps']} steps of the environments, reward "
    description += f"`{settings['env'].get('reward', 'sparse')}`, seed {settings['seed']}"
    objects = {"objects": settings["env"].get("objects", "procedural"), "split": "train"}
    return TrainingStep("training", shlex.join(words), description, objects, progress["seconds"])


def _cloned(folder: Path, settings: Mapping[str, Any], parameters: Path, progress: Mapping[str, Any]) -> TrainingStep:
    clone = settings["clone"]
    known = read_parameters(parameters, settings["algorithm"], settings["id"], demonstrated=True)
    obs = settings["env"]["obs"]
    words = [
        "graspbox",
        "train",
        "clone",
        settings["algorithm"],
        *(shown(Path(one)) for one in clone["demonstrations"]),
    ]
    words += ["--out", shown(folder), *_repeated("--obs", obs), "--keep", clone["keep"]]
    words += [] if clone["shown"] is None else ["--shown", str(clone["shown"])]
    words += [word for name in ("epochs", "batch", "rate") for word in (f"--{name}", str(clone[name]))]
    words += ["--seed", str(settings["seed"])]
    # The environment is that of the demonstrations.
    words += _changes(vars(known), settings, ("steps", "env"))
    description = (
        f"behaviour cloning, {progress['timesteps']} updates, {clone['epochs']} epochs, seed {settings['seed']}"
    )
    return TrainingStep("clone", shlex.join(words), description, seconds=progress["seconds"])


def _recorded(clone: Mapping[str, Any]) -> TrainingStep:
    recording, source = clone["shown_by"], Path(clone["demonstrations"][0])
    spec = recording["env_spec"]
    kept = {name: value for name, value in spec["kwargs"].items() if value is not None}
    objects, split = kept.pop("objects", "procedural"), kept.pop("split", None)
    for name in ("obs", "num_threads"):
        kept.pop(name, None)
    counts = _counts(source)
    words = ["graspbox", "record", recording["policy"], "--out", shown(source), "--env", recording["env_id"]]
    words += ["--episodes", str(counts["episodes"])] if counts else []
    words += ["--seed", str(recording["seed"]), "--keep", recording["keep"], "--noise", str(recording["noise"])]
    words += [*(["--split", split] if split else []), *_repeated("--objects", objects)]
    words += _repeated("--obs", recording["observations"])
    if (hand := kept.pop("hand", None)) is not None:
        words += ["--hand", hand if isinstance(hand, str) else ",".join(shown(Path(file)) for file in hand)]
    kept.setdefault("max_episode_steps", spec["max_episode_steps"])
    words += [word for name, value in kept.items() for word in ("--set", f"{name}={_json(value)}")]
    description = f"demonstrations of `{recording['policy']}`, kept: {recording['keep']}, noise {recording['noise']}"
    if counts:
        description = f"{counts['episodes']} {description}: {counts['steps']} steps of {counts['trials']} trials"
    if clone["shown"] is not None:
        description += f"; the clone learned from the first {clone['shown']}"
    return TrainingStep("demonstrations", shlex.join(words), description, {"objects": objects, "split": split})


def _counts(source: Path) -> dict[str, int]:
    """Read the counts of demonstrations; empty if their folder is missing."""
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


def _changes(known: Mapping[str, Any], settings: Mapping[str, Any], skipped: tuple[str, ...]) -> list[str]:
    """Format ``--set`` for every value that differs from the known ones."""
    names = [name for name in known if name not in skipped]
    pairs = _differing({n: known[n] for n in names}, {n: settings[n] for n in names if n in settings})
    return [word for name, value in pairs for word in ("--set", f"{name}={_yaml(value)}")]


def _differing(known: Any, settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Find the values that differ, by their names in ``--set``; a mapping with missing keys counts as one value."""
    for name, value in settings.items():
        old = known.get(name) if isinstance(known, Mapping) else None
        if value == old:
            continue
        if isinstance(value, Mapping) and isinstance(old, Mapping) and set(old) <= set(value):
            yield from _differing(old, value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _yaml(value: Any) -> str:
    """Format a value on one line, in the syntax of ``--set``."""
    text = yaml.safe_dump(value, default_flow_style=True, width=float("inf"), sort_keys=False)
    return str(text).removesuffix("\n").removesuffix("\n...")


def shown(path: Path) -> str:
    """Return a folder's path for the reader: relative to the current one, else in ``out``."""
    whole, here = Path(path).resolve(), Path.cwd().resolve()
    return str(whole.relative_to(here)) if whole.is_relative_to(here) else f"out/{whole.name}"
