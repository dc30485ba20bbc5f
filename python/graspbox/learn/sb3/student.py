"""A student that sees and feels, taught by a policy that knows the state: rounds of recording and cloning (`train`)."""

from collections.abc import Callable, Iterator
from pathlib import Path

from graspbox import policies
from graspbox._common.files import dumps, write_text
from graspbox.data.episodes import record
from graspbox.errors import ConfigError
from graspbox.learn.sb3 import cloning
from graspbox.learn.sb3.histories import STUDENT, settings_of
from graspbox.learn.sb3.run_policy import RunPolicy
from graspbox.learn.sb3.settings import CloneSettings, StudentSettings
from graspbox.learn.training.options import TrainingOutcome

__all__ = ["train"]

#: Seed of the episodes of the first round, which are not those of training and evaluation; that of a round is as many
#: millions greater.
_SEED, _ROUND = 20_000, 1_000_000
#: Settings of every round that are those of the training.
_SHARED = (
    *("resume", "seed", "device", "torch_threads", "obs", "epochs", "batch", "rate", "parameters", "set"),
    *("episodes", "evaluate"),
)


def train(settings: StudentSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train student``.

    Raises
    ------
    ConfigError
        If the teacher is no run of Stable-Baselines3, or the folder holds another training.
    """
    teacher = policies.load(str(settings.teacher))
    if not isinstance(teacher, RunPolicy):
        raise ConfigError(f"{str(settings.teacher)!r} is no run of graspbox train sb3; name one")
    shown, before = [], None
    for number, folder in enumerate(_folders(settings)):
        shown.append(settings.out / "rounds" / str(number))
        _record(settings, teacher, shown[-1], number, before, echo)
        chosen = {name: getattr(settings, name) for name in _SHARED}
        student = CloneSettings(
            algorithm="ppo", demonstrations=tuple(shown), clone=before, out=folder, keep="all", **chosen
        )
        outcome = cloning.train(student, command, echo)
        before = folder
    # Runs and cards tell of the teacher.
    told = {**settings.kept(), "run": str(teacher.run.resolve()), "checkpoint": teacher.checkpoint}
    write_text(settings.out / STUDENT, dumps(told) + "\n")
    return outcome


def _folders(settings: StudentSettings) -> Iterator[Path]:
    """Yield the folder of the student of each round; that of the last one is the folder of the training."""
    for number in range(settings.rounds - 1):
        yield settings.out / "students" / str(number)
    yield settings.out


def _record(
    settings: StudentSettings,
    teacher: RunPolicy,
    folder: Path,
    number: int,
    student: Path | None,
    echo: Callable[[str], None],
) -> None:
    """Record a round, unless it is complete: what the teacher does in the states to which teacher or student lead."""
    run = settings_of(teacher.run)
    env = {name: value for name, value in run["env"].items() if name not in ("obs", "objects", "split")}
    tenth = max(1, settings.shown // 10)

    def progress(kept: int, trials: int) -> None:
        del trials
        if not kept % tenth:
            echo(f"round {number}: {kept} of {settings.shown} episodes")

    record(
        teacher,
        folder,
        run["id"],
        run["env"].get("objects", "procedural"),
        settings.shown,
        obs=settings.obs,
        seed=_SEED + _ROUND * number + settings.seed,
        keep="all",
        acting=None if student is None else str(student),
        noise=settings.noise,
        split="train",
        progress=progress,
        **env,
    )
