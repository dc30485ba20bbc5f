"""Settings of the trainings with Stable-Baselines3, and the parameters that they read from a file; without torch."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from graspbox._common.imports import imported
from graspbox._common.runs import read_settings
from graspbox.envs import GOAL_IDS
from graspbox.errors import ConfigError
from graspbox.learn.sb3.checks import check_name, check_parameters
from graspbox.learn.training.options import HandOption, Options

__all__ = [
    "EVALUATION_SEED",
    "PARAMETERS",
    "TEST_SEED",
    "CloneSettings",
    "Parameters",
    "Sb3Settings",
    "StudentSettings",
    "read_parameters",
    "settings_of_clone",
]

yaml = imported("yaml", "graspbox train needs the package pyyaml", "train")

#: Parameters by algorithm and environment; the comment of an entry documents the source of its values.
PARAMETERS = Path(__file__).with_name("parameters.yaml")
#: Seeds of evaluation trials during training and of tests; training episodes have other seeds.
EVALUATION_SEED, TEST_SEED = 10_000, 90_000

Algorithm = Literal["ppo", "sac", "td3", "tqc"]


@dataclass(frozen=True)
class Parameters:
    """An entry of the file of parameters: an algorithm in an environment."""

    #: Total steps of all environments.
    steps: int
    num_envs: int
    #: Whether vector observations, and rewards, are scaled by running statistics.
    normalize: dict[str, bool]
    #: Keywords of the environment.
    env: dict[str, Any]
    #: Arguments of the algorithm.
    model: dict[str, Any]
    #: Successful episodes of the scripted expert, which off-policy algorithms replay.
    demonstrations: int = 0


def read_parameters(
    path: Path,
    algorithm: str,
    env_id: str,
    changes: tuple[str, ...] = (),
    *,
    demonstrated: bool = False,
    **others: int | None,
) -> Parameters:
    """Read the entry of an algorithm and an environment.

    Values of the entry's ``demonstrated`` replace its own if that is true or there are demonstrations, then `changes`
    such as ``model.gamma=0.98``, then `others` that are not None.

    Raises
    ------
    ConfigError
        If there is no such entry, the file or a change is not YAML, a change names no parameter, or a value is not
        valid.
    """
    try:
        values = yaml.safe_load(path.read_text())[algorithm][env_id]
    except yaml.YAMLError as error:
        raise ConfigError(f"{str(path)!r} is not valid YAML: {_line(error)}") from None
    except (KeyError, TypeError):
        raise ConfigError(f"{str(path)!r} has no entry {algorithm!r}, {env_id!r}; add one") from None
    shown, plain = values.pop("demonstrated", {}), deepcopy(values)
    if demonstrated or _changed(plain, changes, others).get("demonstrations"):
        _merge(values, shown)
    _changed(values, changes, others)
    try:
        found = Parameters(**values)
    except TypeError as error:
        for name in values:
            check_name(name, Parameters.__annotations__, "parameter")
        raise ConfigError(f"parameters are {', '.join(Parameters.__annotations__)} ({error})") from None
    check_parameters(vars(found))
    if algorithm == "ppo" and found.demonstrations:
        raise ConfigError(
            f"demonstrations is {found.demonstrations}, but ppo learns from its own episodes alone; sac, tqc and td3 "
            "replay demonstrations, and graspbox train clone imitates them"
        )
    if env_id in GOAL_IDS and found.demonstrations:
        raise ConfigError(f"demonstrations is {found.demonstrations}; there are none of the goal task {env_id!r}")
    return found


def _changed(values: dict[str, Any], changes: tuple[str, ...], others: Mapping[str, Any]) -> dict[str, Any]:
    """Apply `changes` to values, and `others` that are not None; returns the values."""
    for change in changes:
        name, equals, value = change.partition("=")
        *parents, last = name.split(".")
        place: Any = values
        for parent in parents:
            place = place.get(parent) if isinstance(place, dict) else None
        if not equals or not isinstance(place, dict):
            raise ConfigError(f"--set {change!r} names no parameter; write, for example, model.gamma=0.98")
        try:
            place[last] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise ConfigError(f"--set {change!r} has a value that is not valid YAML: {_line(error)}") from None
    values |= {name: value for name, value in others.items() if value is not None}
    return values


def _merge(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Replace values, and those of dictionaries in them."""
    for name, value in changes.items():
        if isinstance(value, Mapping) and isinstance(values.get(name), dict):
            _merge(values[name], value)
        else:
            values[name] = value


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def settings_of_clone(folder: Path) -> dict[str, Any]:
    """Read the settings of a clone from the folder of its run.

    Raises
    ------
    ConfigError
        If the folder holds no clone.
    """
    found = read_settings(folder)
    if not {"algorithm", "id", "env", "clone"} <= set(found):
        raise ConfigError(f"there is no clone in {str(folder)!r}; graspbox train clone makes one")
    return found


@dataclass(frozen=True, kw_only=True)
class Sb3Settings(HandOption):
    """Train a policy with Stable-Baselines3 on graspbox's environments, and evaluate it on held-out objects.

        graspbox train sb3 ppo --out out/train/ppo
        graspbox train sb3 sac --out out/train/sac --env graspbox/GraspPose-v0 --evaluate test --baselines
        graspbox train sb3 sac --out out/train/shown --demonstrations 500
        python scripts/plot_sb3.py out/train/ppo
        graspbox evaluate out/train/ppo

    A run ends after its number of steps, which is in a file of parameters like all hyperparameters; --steps and
    --set model.gamma=0.98 override one. The same command resumes an interrupted run from its checkpoint, and extends
    a finished one if --steps is larger. An interrupted run ends with the bits of one that was not; in an extended one
    a learning rate that decays to zero restarts at the remaining share of the new total. Ctrl-C ends a run after the
    current rollout and saves it (twice: at once, keeping the last checkpoint). The files of a run's folder are
    documented in graspbox.learn.sb3.running. Needs the extras cli and train.

    A run learns from nothing. With --demonstrations an off-policy algorithm samples half of each batch from episodes
    of the scripted expert, which knows the objects' meshes; values under `demonstrated` in the parameters then apply.

    Exit status: 0 for a complete run that reached its --target, if any; 1 for one that did not reach it, 2 for
    wrong arguments, 130 for an interrupted run.
    """

    algorithm: Annotated[Algorithm, typer.Argument()]
    """The reinforcement learning algorithm."""
    env: str = "graspbox/Grasp-v0"
    """Id of the environment."""
    parameters: Path = PARAMETERS
    """File of parameters, by algorithm and environment."""
    demonstrations: int | None = None
    """Successful episodes of the scripted expert to replay; by default as in the parameters: none."""
    set: tuple[str, ...] = ()
    """Override a parameter, for example model.gamma=0.98 or env.obs=depth; may be repeated."""
    steps: int | None = None
    """Total steps of all environments after which the run ends; by default as in the parameters."""
    minutes: float | None = None
    """Time limit of this call, minutes; results then depend on the speed of the machine."""
    evaluations: int = 10
    """Evaluations after the one at the start, evenly spaced in steps (with --minutes also in time)."""
    episodes: int = 100
    """Trials per evaluation."""
    evaluate: str = "validation"
    """Split of the objects for evaluations; training uses `train`."""
    baselines: bool = False
    """Evaluate random actions, zero actions and the planner on the same trials."""
    target: float | None = None
    """Success rate that the last evaluation must reach."""
    video: int = 4
    """Episodes of video.webp, which shows the best checkpoint with held-out objects at the end; 0: no video."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(steps=1, evaluations=1, episodes=1, video=0)
        self._positive("minutes")
        if self.demonstrations is not None:
            self._at_least(demonstrations=0)
        if self.target is not None and not 0 <= self.target <= 1:
            raise ConfigError(f"--target is {self.target}; give a rate between 0 and 1")

    def read_parameters(self) -> Parameters:
        """Read the parameters; --hand replaces their hand."""
        values = read_parameters(
            self.parameters,
            self.algorithm,
            self.env,
            self.set,
            demonstrated=bool(self.demonstrations),
            steps=self.steps,
            demonstrations=self.demonstrations,
        )
        if self.hand != "reflex":
            values = replace(values, env={**values.env, "hand": self.named_hand})
        return values

    def kept(self) -> dict[str, Any]:
        """Return the settings that must not change when the run is resumed; it may be extended."""
        values: dict[str, Any] = {"algorithm": self.algorithm, "id": self.env, "evaluate": self.evaluate}
        values |= {"seed": self.seed, "episodes": self.episodes, **asdict(replace(self.read_parameters(), steps=0))}
        return values


@dataclass(frozen=True, kw_only=True)
class _Imitation(Options):
    """Options of trainings that imitate recorded actions."""

    batch: int = 256
    """Steps per update."""
    rate: float = 1e-3
    """Initial learning rate; it decays to zero along half a cosine, in each round of a student."""
    parameters: Path = PARAMETERS
    """File of parameters, by algorithm and environment."""
    set: tuple[str, ...] = ()
    """Override a parameter, for example model.policy_kwargs.net_arch=[64]; may be repeated."""
    episodes: int = 100
    """Trials per evaluation."""
    evaluate: str = "validation"
    """Split of the objects for evaluations."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(epochs=1, batch=1, episodes=1)
        if not 0.0 < self.rate < 1.0:
            raise ConfigError(f"--rate is {self.rate}; give a number between 0 and 1")


@dataclass(frozen=True, kw_only=True)
class CloneSettings(_Imitation):
    """Train a policy of Stable-Baselines3 by behaviour cloning of recorded demonstrations, and evaluate it.

        graspbox record expert --out out/shown --objects procedural:can:0-99 --split train --set control_freq=5
        graspbox train clone ppo out/shown --out out/clone
        graspbox train clone ppo out/shown --out out/seeing --obs depth --obs proprio --obs tactile

    Environment and hand are those of the demonstrations; networks and normalization are those of `graspbox train sb3`,
    in which --set overrides values. Every tenth episode is held out of training. The folder holds evaluations.jsonl,
    whose timesteps count updates; cloning, the folder of the training, with the losses of every epoch; and checkpoint,
    the policy. scripts/plot_sb3.py reads it. Needs the extras cli, data and train.
    """

    algorithm: Annotated[Algorithm, typer.Argument()]
    """The algorithm whose policy is trained."""
    demonstrations: Annotated[tuple[Path, ...], typer.Argument()]
    """Folders of recorded demonstrations (`graspbox record`), of the same environment."""
    clone: Path | None = None
    """Start from the policy of another clone, in this folder."""
    obs: tuple[str, ...] = ()
    """Observation of the policy, `state` by default; may be repeated."""
    keep: str = "secure"
    """Episodes to imitate: secure, success or all."""
    shown: int | None = None
    """Number of first episodes to imitate; all by default."""
    epochs: int = 60
    """Passes over the demonstrations."""
    evaluations: int = 1
    """Evaluations, evenly spaced in epochs; the last one is at the end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(evaluations=1)
        if not self.demonstrations:
            raise ConfigError("name a folder of demonstrations")

    def kept_of(self, env_id: str, env: Mapping[str, Any], shown_by: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings that must not change when the run is resumed, with those of the demonstrations."""
        parameters = asdict(read_parameters(self.parameters, self.algorithm, env_id, self.set, demonstrated=True))
        values = {"algorithm": self.algorithm, "id": env_id, "evaluate": self.evaluate, "seed": self.seed}
        clone = {name: getattr(self, name) for name in ("keep", "shown", "epochs", "batch", "rate")}
        clone |= {"demonstrations": [str(folder.resolve()) for folder in self.demonstrations]}
        clone |= {"shown_by": dict(shown_by), "begins_as": None if self.clone is None else str(self.clone.resolve())}
        return {**values, "episodes": self.episodes, **parameters, "env": dict(env), "clone": clone}


@dataclass(frozen=True, kw_only=True)
class StudentSettings(_Imitation):
    """Teach a policy that sees and feels what one that knows the state does (DAgger), and evaluate it.

        graspbox train sb3 ppo --out out/teacher
        graspbox train student out/teacher --out out/student
        graspbox evaluate out/student

    The teacher is a run of `graspbox train sb3`. In the first round it acts, later the student: the teacher says what
    to do in each state, and the student imitates that. Each round records episodes in rounds/N of the folder and
    trains on those of all rounds; students/N has its policy, the folder itself the last one's, as `graspbox train
    clone` leaves it. Needs the extras cli, data and train.
    """

    teacher: Annotated[Path, typer.Argument()]
    """Folder of the run that teaches, or of one of its checkpoints."""
    obs: tuple[str, ...] = ("depth", "proprio", "tactile")
    """Observation of the student; may be repeated."""
    rounds: int = 6
    """Rounds."""
    shown: int = 1000
    """Episodes of a round."""
    noise: float = 0.1
    """Standard deviation of the noise on executed actions, as a share of their range."""
    epochs: int = 8
    """Passes over the episodes in a round."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(rounds=1, shown=10)
        if not self.obs:
            raise ConfigError("--obs is empty; name at least one observation")
