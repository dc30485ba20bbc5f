"""The programs of a comparison: demonstrations, clones, runs that learn from rewards, and their tests."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from graspbox.policies.goals import GOAL_NAME

OBJECTS = ("procedural:box:0-99", "procedural:can:0-99", "procedural:ball:0-99")
UNSEEN = ("procedural:box:1000-1199", "procedural:can:1000-1199", "procedural:ball:1000-1199")
INPUTS = {"state": ("state",), "seeing": ("proprio", "tactile", "depth"), "goal": ("proprio", "tactile", "goal")}
#: Seeds of the demonstrations, and of the trials of the comparison; training evaluates on others.
SHOWN_SEED, TEST_SEED = 20_000, 90_000


@dataclass(frozen=True)
class Settings:
    """Arguments of a comparison."""

    folder: Annotated[Path, typer.Argument()]
    """Folder of all results."""
    inputs: tuple[str, ...] = ("state", "seeing")
    """Observations of the policies: state, seeing, goal."""
    demonstrator: str = "expert"
    """Demonstrating policy: a name, or a folder; for the input `goal` the folder of one that sees one image."""
    objects: tuple[str, ...] = OBJECTS
    """Object sets to learn from, the split `train` of each."""
    unseen: tuple[str, ...] = UNSEEN
    """Object sets of the comparison, the split `test` of each."""
    max_episode_steps: int = 50
    """Steps of an episode, 0.2 s each."""
    shown: int = 800
    """Demonstrations of the kept kind."""
    keep: str = "secure"
    """Demonstrations to keep: secure successes, every success (`success`), or all."""
    noise: float = 0.1
    """Noise that disturbs the demonstrator, in shares of an action."""
    epochs: int = 60
    """Passes over the demonstrations."""
    steps: int = 300_000
    """Steps of all environments together, of each run that learns from rewards."""
    episodes: int = 500
    """Trials of the comparison."""
    evaluations: int = 10
    """Evaluations of each run that learns from rewards, without the one at its start."""
    watched: int = 100
    """Trials of each of them, and of the clone's; with other objects than those of the comparison."""
    seed: int = 0
    """Seed of the training."""
    dense: bool = False
    """Tune with the reward `dense` too."""
    set: tuple[str, ...] = ()
    """Replace a parameter of every run that learns from rewards; may be repeated."""


@dataclass(frozen=True)
class Step:
    """A program to run; it is done once `result` has the same command. With `output`, `result` has its output too."""

    name: str
    command: tuple[str, ...]
    result: Path
    output: bool = False

    @property
    def text(self) -> str:
        """The command as typed in a shell."""
        return shlex.join(("python", *self.command) if self.output else self.command)


def repeated(option: str, values: tuple[str, ...]) -> list[str]:
    """Repeat an option for each value."""
    return [word for value in values for word in (option, value)]


def steps_of(settings: Settings) -> list[Step]:
    """Return all steps, in order."""
    folder, shown, steps = settings.folder, str(settings.folder / "shown"), settings.max_episode_steps
    kept = () if settings.keep == "secure" else ("--keep", settings.keep)
    observed = tuple(dict.fromkeys(name for input_name in settings.inputs for name in INPUTS[input_name]))
    words = ["graspbox", "record", settings.demonstrator, "--out", shown, "--split", "train"]
    words += [*repeated("--objects", settings.objects), *repeated("--obs", observed)]
    words += repeated("--set", ("control_freq=5", f"max_episode_steps={steps}", "reward=firm"))
    words += ["--episodes", str(settings.shown), "--noise", str(settings.noise), "--seed", str(SHOWN_SEED), *kept]
    all_steps = [Step("demonstrations", tuple(words), folder / "shown.done.json")]
    script = Path(__file__).parents[1] / "evaluate_sb3.py"
    for input_name in settings.inputs:
        for name, words in runs_of(settings, input_name, shown, kept):
            all_steps.append(Step(name, tuple(words), folder / f"{name}.done.json"))
            words = [str(script), str(folder / name), "--episodes", str(settings.episodes), "--json", "--seed"]
            words += [str(TEST_SEED), *repeated("--objects", settings.unseen)]
            all_steps.append(Step(f"test of {name}", tuple(words), folder / f"{name}.test.json", output=True))
    return all_steps


def runs_of(settings: Settings, input_name: str, shown: str, kept: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Return the names and commands of the clone of an input, and of the runs that learn from rewards."""
    folder, clone, names = settings.folder, f"clone-{input_name}", INPUTS[input_name]
    watched = ("--episodes", str(settings.watched))
    words = ["graspbox", "train", "clone", "ppo", shown, "--out", str(folder / clone), "--seed", str(settings.seed)]
    words += ["--epochs", str(settings.epochs), "--shown", str(settings.shown), *watched, *kept]
    runs = [(clone, words + repeated("--obs", names))]
    env = [f"env.obs={names[0] if len(names) == 1 else '[' + ', '.join(names) + ']'}"]
    if settings.objects != OBJECTS:
        env.append(f"env.objects=[{', '.join(f'{name!r}' for name in settings.objects)}]")
    if settings.max_episode_steps != 50:
        env.append(f"env.max_episode_steps={settings.max_episode_steps}")
    if GOAL_NAME in names:
        env.append(f"env.goal_from={settings.demonstrator}")
    for kind in ("rl", "tuned", "dense") if settings.dense else ("rl", "tuned"):
        more = () if kind == "rl" else ("--clone", str(folder / clone))
        words = ["graspbox", "train", "sb3", "ppo", "--out", str(folder / f"{kind}-{input_name}"), *more]
        words += ["--steps", str(settings.steps), "--evaluations", str(settings.evaluations), *watched]
        changes = (f"env.reward={'dense' if kind == 'dense' else 'firm'}", *env)
        words += ["--seed", str(settings.seed), *repeated("--set", (*changes, *settings.set))]
        runs.append((f"{kind}-{input_name}", words))
    return runs
