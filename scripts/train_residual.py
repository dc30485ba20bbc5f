"""Learn by rewards to correct the grasps of a policy that sees one depth image, and measure both on unseen objects.

    python scripts/train_residual.py policies/depth out/residual
    python scripts/train_residual.py out/heads/anchor out/residual --seeds 0 1 2 --steps 40000

In ``GraspPose-v0`` the base policy proposes a grasp; the agent sees the voxels around the proposed hand and moves it by
at most ``--distance`` and ``--angle`` (`graspbox.sb3.residual_env`). A base is what `graspbox.policies.load` takes, if
it finds its grasp in a depth image; of a head that was not published ``--filtered`` takes the best grasp that does not
collide with what is seen.

The folder then has a folder per seed (`graspbox.sb3.running`), ``results.jsonl`` with a row for the base policy and one
for each seed, all on the same trials, and ``README.md``, the page of them. The same command continues what was
interrupted, and does nothing twice; more ``--seeds``, ``--steps`` or ``--minutes`` extend it. Ctrl-C ends it after the
current step and saves it. Runs that end by ``--minutes`` depend on the speed of the machine.

Exit status: 0 at the end, 2 for wrong arguments, 130 for an interrupted run. Needs the extras ``cli`` and ``train``,
and what the base policy needs.
"""

import math
import shlex
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from graspbox import evaluation, policies, sb3
from graspbox.cli.common import console, print_json, progress
from graspbox.errors import ConfigError, GraspboxError
from graspbox.files import write_text
from graspbox.policies.residual import ResidualConfig
from graspbox.resume_log import ResumeLog

#: Test trials have other seeds than training and its evaluations.
TEST_SEED = 90_000


@dataclass(frozen=True)
class Settings:
    """Arguments of the training."""

    base: tyro.conf.Positional[str]
    """The policy whose grasps are corrected."""
    folder: tyro.conf.Positional[Path]
    """Folder of the results."""
    algorithm: str = "sac"
    """sac or ppo."""
    filtered: bool = True
    """Of a head that was not published: leave out grasps that collide with what is seen."""
    seeds: tuple[int, ...] = (0,)
    """A run for each."""
    steps: int = 20_000
    """Episodes of each run."""
    minutes: float | None = None
    """End the training of each run that is not done after about this time, in this call."""
    distance: float = 0.02
    """How far the place where the hand closes may move, metres."""
    angle: float = 0.35
    """How far the hand may turn, radians."""
    preshape: float = 0.25
    """How far the preshape may change, as a share of its range."""
    reward: str = "firm"
    """What is paid: sparse, dense or firm."""
    objects: tuple[str, ...] = ("procedural:seen:0-199",)
    """Objects to learn from: their split `train`; `validation` is watched."""
    unseen: tuple[str, ...] = ("procedural:unseen:20-29",)
    """Objects of the test."""
    trials: int = 400
    """Trials of the test of the base policy and of each run."""
    watched: int = 100
    """Trials of each evaluation during training."""
    evaluations: int = 5
    """Evaluations of each run after the one at the start."""
    num_envs: int = 16
    """Environments that step at once."""
    torch_threads: int = 1
    """Threads of the networks."""
    json: bool = False
    """Print the results as JSON, and nothing else, on standard output."""


def check(settings: Settings) -> ResidualConfig:
    """Refuse arguments that are out of range; gives the bounds."""
    for name in ("steps", "trials", "watched", "evaluations", "num_envs", "torch_threads"):
        if getattr(settings, name) < 1:
            raise ConfigError(f"--{name.replace('_', '-')} is {getattr(settings, name)}; give 1 or more")
    if not settings.seeds or min(settings.seeds) < 0:
        raise ConfigError(f"--seeds is {settings.seeds}; give numbers of 0 or more")
    if settings.minutes is not None and not settings.minutes > 0:
        raise ConfigError(f"--minutes is {settings.minutes}; give a positive number")
    return ResidualConfig(settings.distance, settings.angle, settings.preshape)


def make_base(settings: Settings) -> policies.Policy:
    """Make the base policy."""
    if (Path(settings.base) / policies.HEAD).is_file():
        return policies.HeadGrasp(Path(settings.base), filtered=settings.filtered)
    return policies.load(settings.base)


def train(settings: Settings, config: ResidualConfig, seed: int) -> bool:
    """Train one run, or continue; tells whether it came to its end."""
    from graspbox.sb3.residual_training import ResidualRun, train_residual

    run = ResidualRun(
        settings.algorithm,
        settings.num_envs,
        seed,
        config,
        env={"objects": list(settings.objects), "split": "train", "reward": settings.reward},
        held_out={"split": "validation"},
        episodes=settings.watched,
        every=-(-settings.steps // settings.evaluations),
        base=settings.base if settings.filtered else f"{settings.base}, not filtered",
    )
    handlers: dict[int, Any] = {}

    def interruptible(found: Any) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            handlers[number] = signal.signal(number, found.interrupt)

    name = f"seed {seed}"
    with progress() as bar:
        task = bar.add_task(name, total=settings.steps)

        def show(done: int, last: dict[str, Any] | None) -> None:
            rates = f", {last['success']:.0%} succeed, {last['secure']:.0%} secure" if last else ""
            bar.update(task, completed=done, description=name + rates)

        try:
            found = train_residual(
                settings.folder / f"seed-{seed}",
                lambda: make_base(settings),
                run,
                settings.steps,
                minutes=settings.minutes,
                on_progress=show,
                started=interruptible,
            )
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return not found.interrupted


def test(settings: Settings, policy: policies.Policy, name: str) -> dict[str, Any]:
    """Evaluate a policy on the unseen objects."""
    from graspbox.sb3.policy import summary

    with progress() as bar:
        task = bar.add_task(f"test of {name}", total=settings.trials)
        found = evaluation.evaluate(
            policy,
            objects=list(settings.unseen),
            trials=settings.trials,
            seed=TEST_SEED,
            num_envs=settings.num_envs,
            reward=settings.reward,
            progress=lambda done: bar.update(task, completed=done),
        )
    return {**summary(found), "trials": [[trial.success, trial.secure] for trial in found.trials]}


def results(settings: Settings, config: ResidualConfig, log: ResumeLog) -> bool:
    """Train and test what has not been; tells whether all came to its end."""
    from graspbox.sb3.residual_training import load_residual

    done = {(row["name"], row["steps"]) for row in log.rows}
    base = "base"
    if (base, 0) not in done:
        log.append({"name": base, "steps": 0, **test(settings, make_base(settings), base)})
    for seed in settings.seeds:
        name, folder = f"seed {seed}", settings.folder / f"seed-{seed}"
        if not train(settings, config, seed):
            return False
        policy, steps = load_residual(folder / "checkpoint", make_base(settings), settings.algorithm, config)
        if (name, steps) not in done:
            log.append({"name": name, "steps": steps, **test(settings, policy, name)})
        write_text(settings.folder / "README.md", page(settings, log))
    return True


def page(settings: Settings, log: ResumeLog) -> str:
    """Write what was found so far, and how."""
    lines = ["# Corrections of a proposed grasp", "", "Written by `scripts/train_residual.py`.", ""]
    bounds = f"{100 * settings.distance:g} cm, {math.degrees(settings.angle):.0f} degrees and {settings.preshape:.0%}"
    lines += [f"{settings.algorithm} learns to correct `{settings.base}` by at most {bounds} of the preshape's range."]
    lines += [
        f"{settings.trials} trials with {', '.join(settings.unseen)}, the same for each row; in brackets Wilson's"
    ]
    lines += [
        "95 % intervals. Gained and lost: trials that the base policy failed, or succeeded in, and the other not.",
        "",
    ]
    lines += ["| policy | steps | success | secure | gained, lost |", "|---|--:|--:|--:|--:|"]
    first = log.rows[0]["trials"]
    for row in log.rows:
        cells = [
            f"{row[key]:.1%} ({row[interval][0]:.1%} to {row[interval][1]:.1%})"
            for key, interval in (("success", "ci95"), ("secure", "secure_ci95"))
        ]
        pairs = list(zip(first, row["trials"], strict=True))
        gained, lost = (sum(a[0] != b[0] and b[0] is now for a, b in pairs) for now in (True, False))
        change = "" if row["name"] == "base" else f"{gained}, {lost}"
        lines.append(f"| {row['name']} | {row['steps']:,} | {' | '.join(cells)} | {change} |")
    words = shlex.join(["python", f"scripts/{Path(__file__).name}", *sys.argv[1:]])
    return "\n".join([*lines, "", "```", words, "```", ""])


def main(arguments: list[str] | None = None) -> int:
    """Parse the arguments, train and test; returns the exit status."""
    settings = tyro.cli(Settings, args=arguments, description=__doc__)
    try:
        config = check(settings)
        sb3.require()
        import torch

        torch.set_num_threads(settings.torch_threads)
        tested = {name: getattr(settings, name) for name in ("base", "filtered", "algorithm", "trials", "reward")}
        tested |= {"unseen": list(settings.unseen), "objects": list(settings.objects)}
        tested |= {name: getattr(config, name) for name in ("distance", "angle", "preshape")}
        log = ResumeLog(settings.folder / "results.jsonl", tested)
        if not results(settings, config, log):
            return 130
    except (GraspboxError, OSError) as error:
        console.print(f"error: {error}", markup=False)
        return 2
    except KeyboardInterrupt:
        return 130
    if settings.json:
        print_json({"results": [{key: value for key, value in row.items() if key != "trials"} for row in log.rows]})
    else:
        console.print((settings.folder / "README.md").read_text(), markup=False)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
