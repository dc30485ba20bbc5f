r"""Compare a clone of demonstrations, learning only from rewards, and a clone tuned by rewards, at equal budget.

    python scripts/compare_cloning.py out/cloning
    python scripts/compare_cloning.py out/cloning_state --inputs state --steps 300000 --shown 800
    python scripts/compare_cloning.py out/goal --inputs goal --demonstrator policies/depth \
        --objects procedural:seen:0-199 --unseen procedural:unseen:0-19 --unseen ycb

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
import subprocess
import sys
from pathlib import Path

from cloning.page import write_page
from cloning.steps import INPUTS, TEST_SEED, Settings, Step, steps_of
from graspbox import evaluation
from graspbox._common.files import dumps, write_text
from graspbox._common.options import parse
from graspbox._common.programs import run_program
from graspbox._common.runs import refuse_changes
from graspbox.cli.common import console, progress
from graspbox.errors import ConfigError, GraspboxError


def call(words: list[str], output: bool) -> subprocess.CompletedProcess[str]:
    """Run a program; its output is saved, or shown."""
    return subprocess.run(words, stdout=subprocess.PIPE if output else None, text=True)


def run(step: Step) -> bool:
    """Run a step, unless it is done; returns whether it ran."""
    if step.result.exists() and json.loads(step.result.read_text())["command"] == step.text:
        return False
    console.print(step.text)
    words = step.command if step.output else ("-m", *step.command)
    done = call([sys.executable, *words], step.output)
    if done.returncode == 130:
        raise KeyboardInterrupt
    if done.returncode:
        raise ConfigError(f"{step.name} failed with status {done.returncode}; see its message above")
    write_text(step.result, dumps({"command": step.text, **(json.loads(done.stdout) if step.output else {})}) + "\n")
    return True


def test_policy(settings: Settings, name: str) -> None:
    """Evaluate a policy on the trials of the comparison."""
    path = settings.folder / f"{Path(name).name}.test.json"
    steps = settings.max_episode_steps
    asked = {"objects": list(settings.unseen), "episodes": settings.episodes, "steps": steps}
    if path.exists():
        refuse_changes(path, json.loads(path.read_text()).get("asked"), asked, "remove it, or name another folder")
        return
    keywords = {"split": "test", "num_envs": 32, "control_freq": 5, "max_episode_steps": steps}
    with progress() as bar:
        task = bar.add_task(name, total=settings.episodes)
        keywords["progress"] = lambda done: bar.update(task, completed=done)
        trials = (list(settings.unseen), settings.episodes, TEST_SEED)
        evaluated = evaluation.evaluate(name, "graspbox/Grasp-v0", *trials, **keywords)
    row = {"success": evaluated.rate, "ci95": list(evaluated.ci95), "episodes": len(evaluated.trials)}
    row |= {"secure": evaluated.secure / len(evaluated.trials), "secure_ci95": list(evaluated.secure_ci95)}
    write_text(path, dumps({"policy": row, "asked": asked}) + "\n")


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments and compare; returns the exit status."""
    settings = parse(Settings, arguments, text=__doc__)
    try:
        if unknown := [input_name for input_name in settings.inputs if input_name not in INPUTS]:
            raise ConfigError(f"--inputs names {unknown[0]!r}; choose from {', '.join(INPUTS)}")
        settings.folder.mkdir(parents=True, exist_ok=True)
        steps = steps_of(settings)
        for step, following in zip(steps, [*steps[1:], None], strict=True):
            if run(step) and following is not None and following.output:
                following.result.unlink(missing_ok=True)
            write_page(settings, steps)
        for name in dict.fromkeys((settings.demonstrator, "planner")):
            test_policy(settings, name)
        write_page(settings, steps)
    except (GraspboxError, OSError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    except KeyboardInterrupt:
        return 130
    console.print((settings.folder / "README.md").read_text(), markup=False)
    return 0


if __name__ == "__main__":
    run_program(main)
