"""Learning, by rewards, to correct the grasps of another policy: the runs of ``scripts/train_residual.py``.

A run learns in a `ResidualVectorEnv` and is evaluated as a `ResidualGrasp`, beside its base policy on the same trials.
Its first action is the base policy's own grasp, since the last layer of its actor begins with zeros.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecMonitor
from torch import nn

from graspbox.errors import ConfigError
from graspbox.policies import Policy
from graspbox.policies.residual import ResidualConfig, ResidualGrasp
from graspbox.resume_log import ResumeLog
from graspbox.sb3.decision_buffer import DecisionBuffer
from graspbox.sb3.extractors import Extractor
from graspbox.sb3.policy import ModelPolicy
from graspbox.sb3.residual_env import ResidualVectorEnv
from graspbox.sb3.running import ALGORITHMS, Run, load, load_policy, make_held_out
from graspbox.sb3.vec_env import VecEnv

__all__ = [
    "ENV_ID",
    "PARAMETERS",
    "ResidualRun",
    "begin_at_zero",
    "load_residual",
    "make_residual_env",
    "train_residual",
]

ENV_ID = "graspbox/GraspPose-v0"
#: Evaluations of a run have other episodes than training, whatever its seed.
EVALUATION_SEED = 10_000
#: Arguments of the algorithms; for others the defaults of Stable-Baselines3 hold. An episode is one decision, so there
#: is nothing to discount.
PARAMETERS: dict[str, dict[str, Any]] = {
    "sac": {
        "buffer_size": 30_000,
        "learning_starts": 256,
        "batch_size": 128,
        "gamma": 0.0,
        "learning_rate": 5e-4,
        "gradient_steps": 4,
        "ent_coef": "auto_0.1",
        "policy_kwargs": {"net_arch": [256, 256]},
    },
    "ppo": {
        "n_steps": 16,
        "batch_size": 128,
        "n_epochs": 8,
        "gamma": 0.0,
        "gae_lambda": 1.0,
        "learning_rate": 5e-4,
        "ent_coef": 0.0,
        "target_kl": 0.05,
        "policy_kwargs": {"net_arch": [256, 256], "log_std_init": -2.0},
    },
}
#: Logarithm of the standard deviation with which an actor of SAC begins to explore.
_FIRST_LOG_STD = -1.0


@dataclass(frozen=True)
class ResidualRun:
    """What a run depends on.

    Attributes
    ----------
    algorithm : {"sac", "ppo"}
        What learns.
    num_envs : int
        Environments that step at once.
    seed : int
        Seed of everything random.
    config : ResidualConfig
        The bounds of the corrections.
    env : dict
        Keywords of the training environments: objects, split, reward.
    held_out : dict
        Those that replace them in the environments of evaluations.
    episodes : int
        Trials of an evaluation.
    every : int
        Steps between two evaluations, which also write the checkpoint.
    base : str
        Names the base policy; a run is not continued with another.
    """

    algorithm: str = "sac"
    num_envs: int = 16
    seed: int = 0
    config: ResidualConfig = field(default_factory=ResidualConfig)
    env: dict[str, Any] = field(default_factory=dict)
    held_out: dict[str, Any] = field(default_factory=dict)
    episodes: int = 100
    every: int = 2000
    base: str = ""

    def __post_init__(self) -> None:
        if self.algorithm not in PARAMETERS:
            raise ConfigError(f"there is no algorithm {self.algorithm!r}; choose from {', '.join(PARAMETERS)}")


def make_residual_env(num_envs: int, base: Policy, config: ResidualConfig, **settings: Any) -> VecMonitor:
    """Make environments in which Stable-Baselines3 learns to correct a base policy.

    Parameters
    ----------
    num_envs : int
        Number of environments.
    base : DepthGrasp
        What proposes; it is bound to these environments.
    config : ResidualConfig
        The bounds of the corrections.
    **settings
        Other keywords of ``GraspPose-v0``; what the base policy observes, and its own settings, are given already.
    """
    given = {**base.settings, "obs": base.obs, **settings}
    envs = gymnasium.make_vec(ENV_ID, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **given)
    return VecMonitor(VecEnv(ResidualVectorEnv(envs, base, config)))


def begin_at_zero(model: BaseAlgorithm) -> None:
    """Let the mean action of a new model be zero for every observation."""
    policy: Any = model.policy
    with torch.no_grad():
        if hasattr(policy, "action_net"):
            last = policy.action_net
        else:
            last = policy.actor.mu
            nn.init.zeros_(policy.actor.log_std.weight)
            nn.init.constant_(policy.actor.log_std.bias, _FIRST_LOG_STD)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)


def train_residual(
    folder: Path,
    make_base: Callable[[], Policy],
    run: ResidualRun,
    steps: int,
    *,
    minutes: float | None = None,
    on_progress: Callable[[int, dict[str, Any] | None], None] = lambda *_: None,
    started: Callable[[Run], None] = lambda _: None,
) -> Run:
    """Train until the run has its number of steps; a run in the folder continues from its checkpoint.

    Parameters
    ----------
    folder : Path
        Folder of the run; its files are those of `graspbox.sb3.running`.
    make_base : callable
        Makes the base policy; training and evaluations have one each.
    run : ResidualRun
        What it depends on.
    steps : int
        Steps of all environments together after which it ends.
    minutes : float, optional
        End this call earlier, after about this time; results then depend on the speed of the machine.
    on_progress : callable
        Called after each step with the number of steps and the last evaluation.
    started : callable
        Called with the `Run` before it learns, so that a signal can interrupt it.

    Returns
    -------
    Run
        With its evaluations; ``interrupted`` tells whether it was.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings.
    """
    begun = any((folder / name).exists() for name in ("checkpoint", "checkpoint.old"))
    bounds = {name: getattr(run.config, name) for name in ("distance", "angle", "preshape")}
    # How often a run is evaluated changes nothing of what it learns.
    what = {k: v for k, v in vars(run).items() if k not in ("config", "every")} | bounds
    # Before its first checkpoint an interrupted run leaves rows and nothing to resume from.
    log = ResumeLog(folder / "evaluations.jsonl", what, fresh=not begun)
    env = make_residual_env(run.num_envs, make_base(), run.config, **run.env)
    tested = make_base()
    keywords = {**tested.settings, "obs": tested.obs, **run.env, **run.held_out}
    held_out = make_held_out(ENV_ID, min(run.num_envs, run.episodes), **keywords)
    try:
        model, seconds = _model(folder, run, env, begun)

        def corrected(model: BaseAlgorithm, statistics: Any) -> Policy:
            return ResidualGrasp(tested, ModelPolicy(model, statistics).act, run.config)

        found = Run(
            folder,
            held_out,
            log,
            every=run.every,
            episodes=run.episodes,
            seed=EVALUATION_SEED,
            minutes=minutes,
            seconds=seconds,
            policy=corrected,
        )
        found.on_progress = on_progress
        started(found)
        model.learn(max(steps - model.num_timesteps, 0), callback=found, reset_num_timesteps=not begun)
        if found.interrupted or (found.last and found.last["timesteps"] == model.num_timesteps):
            found.save()
        else:
            found.evaluate()
        return found
    finally:
        env.close()
        held_out.close()


def _model(folder: Path, run: ResidualRun, env: Any, begun: bool) -> tuple[Any, float]:
    """Load the model of a run with its training time in seconds, or make one."""
    algorithm = ALGORITHMS[run.algorithm]
    if begun:
        model, seconds = load(algorithm, folder / "checkpoint", env, device="cpu")
        # Other episodes and actions than those that the run began with.
        model.set_random_seed(run.seed + model.num_timesteps)
        return model, seconds
    given = dict(PARAMETERS[run.algorithm])
    if "n_steps" in given:
        # Batches that divide what was collected.
        given["batch_size"] = math.gcd(given["batch_size"], given["n_steps"] * run.num_envs)
    policy = {**given["policy_kwargs"], "features_extractor_class": Extractor}
    if "buffer_size" in given:
        given["replay_buffer_class"] = DecisionBuffer
    model = algorithm("MultiInputPolicy", env, seed=run.seed, device="cpu", **{**given, "policy_kwargs": policy})
    begin_at_zero(model)
    return model, 0.0


def load_residual(
    folder: Path,
    base: Policy,
    algorithm: str = "sac",
    config: ResidualConfig = ResidualConfig(),  # noqa: B008 (frozen)
) -> tuple[ResidualGrasp, int]:
    """Load a trained correction as a policy.

    Parameters
    ----------
    folder : Path
        A checkpoint: ``RUN/checkpoint`` or ``RUN/best``.
    base : DepthGrasp
        The base policy with which it was trained.
    algorithm : {"sac", "ppo"}
        What it was trained with.
    config : ResidualConfig
        The bounds with which it was trained.

    Returns
    -------
    ResidualGrasp, int
        The policy, and the number of steps for which it was trained.

    Raises
    ------
    ConfigError
        If there is no checkpoint.
    """
    found = load_policy(algorithm, folder)
    return ResidualGrasp(base, found.act, config), int(found.model.num_timesteps)
