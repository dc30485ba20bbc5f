"""Settings of the trainings with Stable-Baselines3, and the parameters that they read from a file; without torch."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro
import yaml

from graspbox.errors import ConfigError
from graspbox.policies.residual import ResidualConfig
from graspbox.training.options import HandOption, Options

__all__ = [
    "EVALUATION_SEED",
    "PARAMETERS",
    "TEST_SEED",
    "CloneSettings",
    "Parameters",
    "ResidualSettings",
    "Sb3Settings",
    "read_parameters",
]

#: Parameters by algorithm and environment; the comment of an entry documents the source of its values.
PARAMETERS = Path(__file__).with_name("parameters.yaml")
#: Seeds of evaluation trials during training and of tests; training episodes have other seeds.
EVALUATION_SEED, TEST_SEED = 10_000, 90_000

Algorithm = Literal["ppo", "sac", "td3"]
Changes = Annotated[tuple[str, ...], tyro.conf.UseAppendAction]


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
    #: Successful episodes of the scripted expert: sac and td3 replay them, ppo clones them.
    demonstrations: int = 0
    #: Passes over the demonstrations when cloning.
    clone_epochs: int = 60
    #: Number of first steps in which the value function of a cloned policy trains alone.
    value_warmup: int = 0
    #: Weight of the cloning loss in the training of a policy initialized from a clone (``--clone``).
    clone_weight: float = 0.0
    #: Steps over which that weight falls to zero.
    clone_steps: int = 0


def read_parameters(
    path: Path, algorithm: str, env_id: str, changes: tuple[str, ...] = (), steps: int | None = None
) -> Parameters:
    """Read the entry of an algorithm and an environment, and override values.

    Parameters
    ----------
    path : Path
        The file.
    algorithm, env_id : str
        Names of the entry.
    changes : tuple of str
        Overrides such as ``model.gamma=0.98``; values are YAML.
    steps : int, optional
        Overrides the number of steps.

    Raises
    ------
    ConfigError
        If there is no such entry, the file or a change is not YAML, or a change names no parameter.
    """
    try:
        found = yaml.safe_load(path.read_text())
        values = found[algorithm][env_id]
    except yaml.YAMLError as error:
        raise ConfigError(f"{str(path)!r} is not valid YAML: {_line(error)}") from None
    except (KeyError, TypeError):
        raise ConfigError(f"{str(path)!r} has no entry {algorithm!r}, {env_id!r}; add one") from None
    for change in changes:
        name, equals, value = change.partition("=")
        *parents, last = name.split(".")
        place = values
        for parent in parents:
            place = place.get(parent) if isinstance(place, dict) else None
        if not equals or not isinstance(place, dict):
            raise ConfigError(f"--set {change!r} names no parameter; write, for example, model.gamma=0.98")
        try:
            place[last] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise ConfigError(f"--set {change!r} has a value that is not valid YAML: {_line(error)}") from None
    if steps is not None:
        values["steps"] = steps
    try:
        return Parameters(**values)
    except TypeError as error:
        raise ConfigError(f"parameters are {', '.join(Parameters.__annotations__)} ({error})") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


@dataclass(frozen=True, kw_only=True)
class Sb3Settings(HandOption):
    """Train a policy with Stable-Baselines3 on graspbox's environments, and evaluate it on held-out objects.

        graspbox train sb3 ppo --out out/train/ppo
        graspbox train sb3 sac --out out/train/sac --env graspbox/GraspPose-v0 --evaluate test --baselines
        graspbox train sb3 sac --out out/train/sac --env graspbox/GraspPose-v0 --steps 48000
        graspbox train sb3 ppo --out out/train/tuned --clone out/clone --set env.reward=firm
        python scripts/plot_sb3.py out/train/ppo
        python scripts/evaluate_sb3.py out/train/ppo

    A run ends after its number of steps, which is in a file of parameters like all hyperparameters; --steps and
    --set model.gamma=0.98 override one. The same command resumes an interrupted run from its checkpoint, and extends
    a finished one if --steps is larger; it starts new episodes, and a learning rate that decays to zero restarts
    at the remaining share of the new total. Ctrl-C ends a run after its current step and saves it (twice: at
    once, keeping the last checkpoint). The files of a run's folder are documented in graspbox.sb3.running.

    With --clone a run starts from the policy of `graspbox train clone`; it must have the same observations and
    networks. Its value function trains alone for the first value_warmup steps, and a cloning loss, whose weight falls
    from clone_weight to zero within clone_steps, keeps it near its demonstrations.

    Exit status: 0 for a complete run that reached its --target, if any; 1 for one that did not reach it, 2 for
    wrong arguments, 130 for an interrupted run.
    """

    algorithm: tyro.conf.Positional[Algorithm]
    """The reinforcement learning algorithm."""
    env: str = "graspbox/Grasp-v0"
    """Id of the environment."""
    parameters: Path = PARAMETERS
    """File of parameters, by algorithm and environment."""
    clone: Path | None = None
    """Start from the policy of `graspbox train clone` in this folder, instead of from demonstrations."""
    set: Changes = ()
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

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(steps=1, evaluations=1, episodes=1)
        self._positive("minutes")
        if self.target is not None and not 0 <= self.target <= 1:
            raise ConfigError(f"--target is {self.target}; give a rate between 0 and 1")

    def read_parameters(self) -> Parameters:
        """Read the parameters; a clone replaces demonstrations, and --hand the hand of the environment."""
        found = read_parameters(self.parameters, self.algorithm, self.env, self.set, self.steps)
        if self.hand != "reflex":
            found = replace(found, env={**found.env, "hand": self.named_hand})
        return found if self.clone is None else replace(found, demonstrations=0)

    def kept(self) -> dict[str, Any]:
        """Return the settings that must not change when the run is resumed; it may be extended."""
        values: dict[str, Any] = {"algorithm": self.algorithm, "id": self.env, "evaluate": self.evaluate}
        values |= {"seed": self.seed, "episodes": self.episodes, **asdict(replace(self.read_parameters(), steps=0))}
        return values | {"begins_as": None if self.clone is None else str(self.clone.resolve())}


@dataclass(frozen=True, kw_only=True)
class CloneSettings(Options):
    """Train a policy of Stable-Baselines3 by behaviour cloning of recorded demonstrations, and evaluate it.

        graspbox record expert --out out/shown --objects procedural:can:0-99 --split train --set frame_skip=4
        graspbox train clone ppo out/shown --out out/clone
        graspbox train clone ppo out/shown --out out/seeing --obs depth --obs proprio --obs tactile
        graspbox train sb3 ppo --out out/tuned --clone out/clone

    Environment and hand are those of the demonstrations; networks and normalization are those of `graspbox train sb3`,
    in which --set overrides values. Every tenth episode is held out of training. The folder holds evaluations.jsonl,
    whose timesteps count updates; cloning, the folder of the training, with the losses of every epoch; and checkpoint,
    the policy. scripts/evaluate_sb3.py and scripts/plot_sb3.py read it.
    """

    algorithm: tyro.conf.Positional[Algorithm]
    """The algorithm whose policy is trained."""
    demonstrations: tyro.conf.Positional[Path]
    """Folder of recorded demonstrations (`graspbox record`)."""
    obs: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Observation of the policy, `state` by default; may be repeated."""
    keep: str = "secure"
    """Episodes to imitate: secure, success or all."""
    shown: int | None = None
    """Number of first episodes to imitate; all by default."""
    epochs: int = 60
    """Passes over the demonstrations."""
    batch: int = 256
    """Steps per update."""
    rate: float = 1e-3
    """Initial learning rate; it decays to zero along half a cosine."""
    parameters: Path = PARAMETERS
    """File of parameters, by algorithm and environment."""
    set: Changes = ()
    """Override a parameter, for example model.policy_kwargs.net_arch=[64]; may be repeated."""
    evaluations: int = 1
    """Evaluations, evenly spaced in epochs; the last one is at the end."""
    episodes: int = 100
    """Trials per evaluation."""
    evaluate: str = "validation"
    """Split of the objects for evaluations."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(epochs=1, batch=1, evaluations=1, episodes=1)
        if not 0.0 < self.rate < 1.0:
            raise ConfigError(f"--rate is {self.rate}; give a number between 0 and 1")

    def kept_of(self, env_id: str, env: Mapping[str, Any], shown_by: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings that must not change when the run is resumed, with those of the demonstrations."""
        parameters = asdict(read_parameters(self.parameters, self.algorithm, env_id, self.set))
        values = {"algorithm": self.algorithm, "id": env_id, "evaluate": self.evaluate, "seed": self.seed}
        clone = {name: getattr(self, name) for name in ("keep", "shown", "epochs", "batch", "rate")}
        clone |= {"demonstrations": str(self.demonstrations.resolve()), "shown_by": dict(shown_by)}
        return {**values, "episodes": self.episodes, **parameters, "env": dict(env), "clone": clone}


@dataclass(frozen=True, kw_only=True)
class ResidualSettings(HandOption):
    """Learn corrections to the grasps of a policy of one depth image by rewards, and evaluate both on unseen objects.

        graspbox train residual policies/depth --out out/residual
        graspbox train residual out/heads/anchor --out out/residual --seeds 0 1 2 --steps 40000

    In GraspPose-v0 the base policy proposes a grasp; the agent observes the voxels around the proposed hand and moves
    it by at most --distance and --angle (graspbox.sb3.residual_env). The base is any policy of
    graspbox.policies.load that finds its grasp in a depth image; of an unpublished head --filtered uses the
    best grasp that does not collide with the visible scene.

    The folder holds a folder per seed (graspbox.sb3.running), results.jsonl with a row for the base policy and one for
    each seed, all on the same trials, and README.md, which presents them. The same command resumes an interrupted run,
    and repeats nothing; more --seeds, --steps or --minutes extend it. Ctrl-C ends it after the current step and
    saves it. Runs that end by --minutes depend on the speed of the machine.
    """

    free: ClassVar[tuple[str, ...]] = (
        *(*Options.free, "seed", "seeds", "steps", "minutes"),
        *("watched", "evaluations", "num_envs"),
    )

    base: tyro.conf.Positional[str]
    """The base policy, whose grasps are corrected."""
    algorithm: Literal["sac", "ppo"] = "sac"
    """The reinforcement learning algorithm."""
    filtered: bool = True
    """For an unpublished head: leave out grasps that collide with the visible scene."""
    seeds: tuple[int, ...] = ()
    """Seeds, one run for each; --seed by default."""
    steps: int = 20_000
    """Episodes per run."""
    minutes: float | None = None
    """Time limit for the training of each run in this call, minutes."""
    distance: float = 0.02
    """Greatest shift of the point where the hand closes, metres."""
    angle: float = 0.35
    """Greatest rotation of the hand, radians."""
    preshape: float = 0.25
    """Greatest change of the preshape, as a share of its range."""
    reward: str = "firm"
    """The reward: sparse, dense or firm."""
    objects: tuple[str, ...] = ("procedural:seen:0-199",)
    """Training objects, from their split `train`; evaluations during training use `validation`."""
    unseen: tuple[str, ...] = ("procedural:unseen:20-29",)
    """Test objects."""
    trials: int = 400
    """Test trials of the base policy and of each run."""
    watched: int = 100
    """Trials of each evaluation during training."""
    evaluations: int = 5
    """Evaluations of each run after the one at the start."""
    num_envs: int = 16
    """Environments stepped in parallel."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._at_least(steps=1, trials=1, watched=1, evaluations=1, num_envs=1)
        self._positive("minutes")
        if min(self.seeds, default=0) < 0:
            raise ConfigError(f"--seeds is {self.seeds}; give numbers of 0 or more")
        self.bounds()

    def bounds(self) -> ResidualConfig:
        """Return the bounds of the corrections."""
        return ResidualConfig(self.distance, self.angle, self.preshape)
