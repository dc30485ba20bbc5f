r"""Compare a clone of demonstrations, learning from rewards alone, and a clone tuned by rewards, at equal budget.

    python scripts/compare_cloning.py out/cloning
    python scripts/compare_cloning.py out/cloning_state --inputs state --steps 300000 --shown 800
    python scripts/compare_cloning.py out/goal --inputs goal --demonstrator policies/depth \
        --objects procedural:seen:0-199 --unseen procedural:unseen:0-19 ycb

Records demonstrations, and for each input (``state``; ``seeing``: depth, proprio, tactile; ``goal``: the grasp that the
demonstrator finds in one depth image, proprio, tactile) trains

| run | method |
|---|---|
| ``clone-INPUT`` | behaviour cloning |
| ``rl-INPUT`` | PPO from scratch, ``--steps`` steps |
| ``tuned-INPUT`` | PPO from the clone, the same number of steps |
| ``dense-INPUT`` | as ``tuned``, with ``reward="dense"`` instead of ``"firm"`` (with ``--dense``) |

and evaluates all of them, and the demonstrator, on the same trials with unseen objects. Every step is a program of its
own, whose command is printed and kept in ``README.md`` of the folder, with the results and the curves. The same command
resumes: finished steps are not repeated, and an interrupted one is continued.

Exit status: 0, 2 for wrong arguments or a step that failed, 130 after Ctrl-C.

Needs the extras ``cli``, ``data`` and ``train``.
"""

import json
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from graspbox import evaluation
from graspbox._common.files import dumps, write_text
from graspbox.cli.common import console, progress
from graspbox.errors import ConfigError, GraspboxError
from graspbox.pictures.files import Figure, write
from graspbox.policies.goals import GOAL_NAME
from graspbox.programs import run_program
from graspbox.training.runs import Rows, refuse_changes

SCRIPTS = Path(__file__).parent
OBJECTS = ("procedural:box:0-99", "procedural:can:0-99", "procedural:ball:0-99")
UNSEEN = ("procedural:box:1000-1199", "procedural:can:1000-1199", "procedural:ball:1000-1199")
COLORS = {"rl": "tab:blue", "tuned": "tab:orange", "dense": "tab:green"}
INPUTS = {"state": ("state",), "seeing": ("proprio", "tactile", "depth"), "goal": ("proprio", "tactile", "goal")}
#: Seeds of the demonstrations, and of the trials of the comparison; training evaluates on others.
SHOWN_SEED, TEST_SEED = 20_000, 90_000
#: A randomly initialised policy has to explore, and may move fast.
SCRATCH = (
    "demonstrations=0",
    "value_warmup=0",
    "model.policy_kwargs.log_std_init=-1.0",
    "model.learning_rate=linear_3e-4",
    "model.value_lr_scale=1.0",
)


@dataclass(frozen=True)
class Settings:
    """Arguments of a comparison."""

    folder: tyro.conf.Positional[Path]
    """Folder of all results."""
    inputs: tuple[str, ...] = ("state", "seeing")
    """Observations of the policies: state, seeing, goal."""
    demonstrator: str = "expert"
    """Demonstrating policy: a name, or a folder; for the input `goal` the folder of one that looks once."""
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
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Replace a parameter of every run that learns from rewards; may be repeated."""


def call(words: list[str], output: bool) -> subprocess.CompletedProcess[str]:
    """Run a program; its output is saved, or shown."""
    return subprocess.run(words, stdout=subprocess.PIPE if output else None, text=True)


@dataclass(frozen=True)
class Step:
    """A program to run; it is done once `result` has the same command. With `output`, `result` has its output too."""

    name: str
    command: tuple[str, ...]
    result: Path
    output: bool = False

    def text(self) -> str:
        """Return the command as typed in a shell."""
        words = ("python", *self.command) if self.command[0].endswith(".py") else self.command
        return shlex.join(words)

    def run(self) -> bool:
        """Run it, unless it is done; returns whether it ran."""
        if self.result.exists() and json.loads(self.result.read_text())["command"] == self.text():
            return False
        console.print(self.text())
        script = self.command[0].endswith(".py")
        words = [sys.executable, *self.command] if script else [sys.executable, "-m", "graspbox", *self.command[1:]]
        done = call(words, self.output)
        if done.returncode == 130:
            raise KeyboardInterrupt
        if done.returncode:
            raise ConfigError(f"{self.name} failed with status {done.returncode}; see its message above")
        found = json.loads(done.stdout) if self.output else {}
        write_text(self.result, dumps({"command": self.text(), **found}) + "\n")
        return True


def steps_of(settings: Settings) -> list[Step]:
    """Return all steps, in order."""
    folder, shown = settings.folder, settings.folder / "shown"
    observed = dict.fromkeys(name for given in settings.inputs for name in INPUTS[given])
    words = ["graspbox", "record", settings.demonstrator, "--out", str(shown), "--split", "train"]
    words += [word for name in settings.objects for word in ("--objects", name)]
    words += [word for name in observed for word in ("--obs", name)]
    words += ["--set", "frame_skip=4", "--set", f"max_episode_steps={settings.max_episode_steps}"]
    words += ["--set", "reward=firm"]
    words += ["--episodes", str(settings.shown), "--noise", str(settings.noise), "--seed", str(SHOWN_SEED)]
    words += [] if settings.keep == "secure" else ["--keep", settings.keep]
    found = [Step("demonstrations", tuple(words), folder / "shown.done.json")]
    for given in settings.inputs:
        found += _runs(settings, given, shown)
    return found


def _runs(settings: Settings, given: str, shown: Path) -> list[Step]:
    folder = settings.folder
    clone = folder / f"clone-{given}"
    words = ["graspbox", "train", "clone", "ppo", str(shown), "--out", str(clone), "--seed", str(settings.seed)]
    words += ["--epochs", str(settings.epochs), "--shown", str(settings.shown), "--episodes", str(settings.watched)]
    words += [] if settings.keep == "secure" else ["--keep", settings.keep]
    words += [word for name in INPUTS[given] for word in ("--obs", name)]
    found = [Step(clone.name, tuple(words), folder / f"{clone.name}.done.json")]
    kinds: dict[str, Any] = {"rl": ("firm", SCRATCH, ()), "tuned": ("firm", (), ("--clone", str(clone)))}
    if settings.dense:
        kinds["dense"] = ("dense", (), ("--clone", str(clone)))
    obs = INPUTS[given][0] if len(INPUTS[given]) == 1 else "[" + ", ".join(INPUTS[given]) + "]"
    for kind, (reward, changes, more) in kinds.items():
        run = folder / f"{kind}-{given}"
        changes = (f"env.reward={reward}", f"env.obs={obs}", *_environment(settings, given), *changes, *settings.set)
        words = ["graspbox", "train", "sb3", "ppo", "--out", str(run), *more, "--steps", str(settings.steps)]
        words += ["--evaluations", str(settings.evaluations), "--episodes", str(settings.watched)]
        words += ["--seed", str(settings.seed), *(word for change in changes for word in ("--set", change))]
        found.append(Step(run.name, tuple(words), folder / f"{run.name}.done.json"))
    return [step for one in found for step in (one, _test(settings, folder / one.name))]


def _environment(settings: Settings, given: str) -> tuple[str, ...]:
    """Return parameters of the environment that differ from the file's."""
    found: list[str] = []
    if settings.objects != OBJECTS:
        found.append(f"env.objects=[{', '.join(f'{name!r}' for name in settings.objects)}]")
    if settings.max_episode_steps != 50:
        found.append(f"env.max_episode_steps={settings.max_episode_steps}")
    if GOAL_NAME in INPUTS[given]:
        found.append(f"env.goal_from={settings.demonstrator}")
    return tuple(found)


def _test(settings: Settings, run: Path) -> Step:
    words = [str(SCRIPTS / "evaluate_sb3.py"), str(run), "--episodes", str(settings.episodes), "--json"]
    words += ["--seed", str(TEST_SEED), *(word for name in settings.unseen for word in ("--objects", name))]
    return Step(f"test of {run.name}", tuple(words), run.with_name(f"{run.name}.test.json"), output=True)


def test_policies(settings: Settings) -> None:
    """Evaluate the demonstrator and the planner on the trials of the comparison."""
    for name in dict.fromkeys((settings.demonstrator, "planner")):
        path = settings.folder / f"{Path(name).name}.test.json"
        asked = {"objects": list(settings.unseen), "episodes": settings.episodes, "steps": settings.max_episode_steps}
        if path.exists():
            refuse_changes(path, json.loads(path.read_text()).get("asked"), asked, "remove it, or name another folder")
            continue
        with progress() as bar:
            task = bar.add_task(name, total=settings.episodes)
            found = evaluation.evaluate(
                name,
                "graspbox/Grasp-v0",
                list(settings.unseen),
                settings.episodes,
                TEST_SEED,
                split="test",
                num_envs=32,
                progress=lambda done, task=task: bar.update(task, completed=done),
                frame_skip=4,
                max_episode_steps=settings.max_episode_steps,
            )
        row = {"success": found.rate, "ci95": list(found.ci95), "episodes": len(found.trials)}
        row |= {"secure": found.secure / len(found.trials), "secure_ci95": list(found.secure_ci95)}
        write_text(path, dumps({"policy": row, "asked": asked}) + "\n")


def results(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the results of the comparison so far, by the name of the run."""
    paths = sorted(folder.glob("*.test.json"))
    return {path.name.removesuffix(".test.json"): json.loads(path.read_text())["policy"] for path in paths}


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """Read the evaluations of a run."""
    return Rows(folder / "evaluations.jsonl").rows


def curves(settings: Settings) -> Figure:
    """Plot success and secure grasps over the steps of training, with lines for the clone and the demonstrator."""
    found = results(settings.folder)
    figure = Figure(figsize=(5.5 * len(settings.inputs), 7.5), dpi=120, layout="constrained")
    panels = figure.subplots(2, len(settings.inputs), sharex=True, sharey=True, squeeze=False)
    for column, given in enumerate(settings.inputs):
        for line, (name, interval) in enumerate((("success", "ci95"), ("secure", "secure_ci95"))):
            panel = panels[line, column]
            for kind, color in COLORS.items():
                rows = rows_of(settings.folder / f"{kind}-{given}")
                if not rows:
                    continue
                places = [row["timesteps"] for row in rows]
                panel.plot(places, [row[name] for row in rows], marker=".", label=kind, color=color)
                bands = np.array([row[interval] for row in rows]).T
                panel.fill_between(places, *bands, color=color, alpha=0.15, lw=0)
            for row in rows_of(settings.folder / f"clone-{given}")[-1:]:
                panel.axhline(row[name], ls="--", color="0.3", lw=1, label="clone")
            shown = Path(settings.demonstrator).name
            if shown in found:
                rate = found[shown][name]
                panel.axhline(rate, ls=":", color="0.3", lw=1, label=f"{shown}, on test objects")
            panel.set(ylim=(-0.03, 1.03), ylabel="share that succeeds" if name == "success" else "share secure")
            panel.grid(alpha=0.3)
        panels[0, column].set_title(", ".join(INPUTS[given]))
        panels[1, column].set_xlabel("steps of all environments")
    if panels[0, 0].get_legend_handles_labels()[0]:
        panels[0, 0].legend(loc="best", fontsize=9)
    return figure


def report(settings: Settings, steps: list[Step]) -> str:
    """Write the results so far, with the commands."""
    lines = ["# Cloning, rewards, and both", "", "Written by `scripts/compare_cloning.py`.", ""]
    lines += [f"{settings.episodes} trials with unseen objects; in brackets Wilson's 95 % intervals.", ""]
    lines += ["| policy | success | secure |", "|---|--:|--:|"]
    for name, row in results(settings.folder).items():
        cells = (
            f"{row[key]:.1%} ({row[interval][0]:.1%} to {row[interval][1]:.1%})"
            for key, interval in (("success", "ci95"), ("secure", "secure_ci95"))
        )
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines += ["", "![Curves](curves.png)", "", "```", *(step.text() for step in steps), "```", ""]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and compare; returns the exit status."""
    settings = tyro.cli(Settings, args=arguments, description=__doc__)
    try:
        for given in settings.inputs:
            if given not in INPUTS:
                raise ConfigError(f"--inputs names {given!r}; choose from {', '.join(INPUTS)}")
        settings.folder.mkdir(parents=True, exist_ok=True)
        steps = steps_of(settings)
        for step, following in zip(steps, [*steps[1:], None], strict=True):
            if step.run() and following is not None and following.output:
                following.result.unlink(missing_ok=True)
            write(curves(settings), settings.folder / "curves.png")
            write_text(settings.folder / "README.md", report(settings, steps))
        test_policies(settings)
        write(curves(settings), settings.folder / "curves.png")
        write_text(settings.folder / "README.md", report(settings, steps))
    except (GraspboxError, OSError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    except KeyboardInterrupt:
        return 130
    console.print((settings.folder / "README.md").read_text(), markup=False)
    return 0


if __name__ == "__main__":
    run_program(main)
