"""Reinforcement learning of corrections to the grasps of another policy: ``graspbox train residual``.

A run trains in a `ResidualVectorEnv` and is evaluated as a `ResidualGrasp`, with its base policy on the same trials.
Its first action is the base policy's own grasp, because the last layer of its actor is initialized with zeros.
"""

import math
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import DictReplayBuffer
from stable_baselines3.common.vec_env import VecMonitor
from torch import nn

from graspbox import evaluation, policies
from graspbox._common.files import write_text
from graspbox.policies import HeadGrasp, Policy
from graspbox.policies.head import HEAD
from graspbox.policies.residual import ResidualConfig, ResidualGrasp
from graspbox.sb3.extractors import Extractor
from graspbox.sb3.policy import ModelPolicy, summary
from graspbox.sb3.residual_env import ResidualVectorEnv
from graspbox.sb3.running import ALGORITHMS, RunCallback, has_checkpoint, load, load_policy, make_held_out
from graspbox.sb3.settings import EVALUATION_SEED, TEST_SEED, ResidualSettings
from graspbox.sb3.vec_env import VecEnv
from graspbox.training.options import Outcome
from graspbox.training.runs import Rows, Run

__all__ = [
    "ENV_ID",
    "PARAMETERS",
    "DecisionBuffer",
    "begin_at_zero",
    "load_residual",
    "make_residual_env",
    "train",
    "train_seed",
]

ENV_ID = "graspbox/GraspPose-v0"
#: Arguments of the algorithms; others have the defaults of Stable-Baselines3. An episode is one decision, so there
#: is no discounting.
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
#: Initial log standard deviation of an actor of SAC.
_FIRST_LOG_STD = -1.0


class DecisionBuffer(DictReplayBuffer):  # type: ignore[misc]
    """Stores each observation once: an episode has one step, so its next observation is unused.

    It replaces a ``DictReplayBuffer`` of Stable-Baselines3. Saving stores only the filled rows, compressed.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.next_observations = self.observations

    def add(
        self,
        obs: dict[str, NDArray[Any]],
        next_obs: dict[str, NDArray[Any]],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Add a row for each environment; ignores `next_obs`."""
        del next_obs
        super().add(obs, obs, action, reward, done, infos)

    def __getstate__(self) -> dict[str, Any]:
        """Pack the observations for a file."""
        filled = self.size()
        packed = {name: zlib.compress(rows[:filled].tobytes(), 1) for name, rows in self.observations.items()}
        types = {name: rows.dtype.str for name, rows in self.observations.items()}
        own = {k: v for k, v in self.__dict__.items() if k not in ("observations", "next_observations")}
        return {**own, "packed": (packed, types, filled)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Unpack them."""
        packed, types, filled = state.pop("packed")
        self.__dict__.update(state)
        self.observations = {}
        for name, values in packed.items():
            shape = (self.buffer_size, self.n_envs, *self.obs_shape[name])
            rows = self.observations[name] = np.zeros(shape, dtype=types[name])
            found = np.frombuffer(zlib.decompress(values), dtype=types[name])
            rows[:filled] = found.reshape(filled, *shape[1:])
        self.next_observations = self.observations


def make_residual_env(num_envs: int, base: Policy, config: ResidualConfig, **settings: Any) -> VecMonitor:
    """Make environments for corrections to a base policy, for Stable-Baselines3.

    Parameters
    ----------
    num_envs : int
        Number of environments.
    base : DepthGrasp
        The policy that proposes; it is bound to these environments.
    config : ResidualConfig
        Bounds of the corrections.
    **settings
        Other keywords of ``GraspPose-v0``; the observations and settings of the base policy are added.
    """
    arguments = {**base.settings, "obs": base.obs, **settings}
    envs = gymnasium.make_vec(ENV_ID, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
    return VecMonitor(VecEnv(ResidualVectorEnv(envs, base, config)))


def begin_at_zero(model: BaseAlgorithm) -> None:
    """Initialize a new model so that its mean action is zero for every observation."""
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


def train_seed(
    settings: ResidualSettings,
    seed: int,
    folder: Path,
    echo: Callable[[str], None] = lambda _: None,
    started: Callable[[RunCallback], None] = lambda _: None,
) -> RunCallback:
    """Train the run of a seed for its number of steps; a run in the folder resumes from its checkpoint.

    Parameters
    ----------
    settings : ResidualSettings
        Settings of the training.
    seed : int
        Random seed.
    folder : Path
        Folder of the run; its files are those of `graspbox.sb3.running`.
    echo : callable
        Called with each line of the log.
    started : callable
        Called before training starts.

    Returns
    -------
    RunCallback
        Its evaluations, and ``interrupted``: whether it was interrupted.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings.
    """
    bounds, watched = settings.bounds(), settings.watched
    values = {"seed": seed, "watched": watched, "num_envs": settings.num_envs, **settings.kept()}
    # Objects of the test.
    del values["unseen"], values["trials"]
    keywords: dict[str, Any] = {"objects": list(settings.objects), "reward": settings.reward}
    keywords |= {"hand": settings.named_hand}
    with Run(folder, values, resume=settings.resume, echo=echo) as run:
        begun, base = has_checkpoint(run.folder), _base(settings)
        env = make_residual_env(settings.num_envs, _base(settings), bounds, split="train", **keywords)
        shown = {**base.settings, "obs": base.obs, **keywords, "split": "validation"}
        held_out = make_held_out(ENV_ID, min(settings.num_envs, watched), **shown)
        try:
            model = _model(settings, seed, run.folder, env, begun)
            found = RunCallback(
                run,
                held_out,
                steps=settings.steps,
                every=-(-settings.steps // settings.evaluations),
                episodes=watched,
                seed=EVALUATION_SEED,
                minutes=settings.minutes,
                policy=lambda model, scales: ResidualGrasp(base, ModelPolicy(model, scales).act, bounds),
            )
            started(found)
            found.learn(model, begun=begun)
            return found
        finally:
            env.close()
            held_out.close()


def _model(settings: ResidualSettings, seed: int, folder: Path, env: Any, begun: bool) -> Any:
    """Load the model of a run, or create one."""
    algorithm = ALGORITHMS[settings.algorithm]
    if begun:
        return load(algorithm, folder / "checkpoint", env, seed, device=settings.device)
    parameters = dict(PARAMETERS[settings.algorithm])
    if "n_steps" in parameters:
        # Batch size that divides a rollout.
        parameters["batch_size"] = math.gcd(parameters["batch_size"], parameters["n_steps"] * settings.num_envs)
    parameters["policy_kwargs"] = {**parameters["policy_kwargs"], "features_extractor_class": Extractor}
    if "buffer_size" in parameters:
        parameters["replay_buffer_class"] = DecisionBuffer
    model = algorithm("MultiInputPolicy", env, seed=seed, device=settings.device, **parameters)
    begin_at_zero(model)
    return model


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
        The algorithm that trained it.
    config : ResidualConfig
        Bounds it was trained with.

    Returns
    -------
    ResidualGrasp, int
        The policy, and its number of training steps.

    Raises
    ------
    ConfigError
        If there is no checkpoint.
    """
    found = load_policy(algorithm, folder)
    return ResidualGrasp(base, found.act, config), int(found.model.num_timesteps)


def train(settings: ResidualSettings, command: str, echo: Callable[[str], None]) -> Outcome:
    """Run ``graspbox train residual``: train and test the runs that are missing.

    Raises
    ------
    ConfigError
        If the folder holds results with other settings, or the base policy proposes no grasp from a depth image.
    """
    settings.load_hand()
    with settings.run(echo) as run:
        run.log(command)
        rows = run.rows("results")
        done = {(row["name"], row["steps"]) for row in rows}
        if ("base", 0) not in done:
            rows.append({"name": "base", "steps": 0, **_test(settings, _base(settings), run, "base")})
        interrupted = False
        for seed in settings.seeds or (settings.seed,):
            name, folder = f"seed {seed}", run.folder / f"seed-{seed}"
            run.log(f"{name}, in {folder}")
            interrupted = train_seed(settings, seed, folder, echo).interrupted
            if interrupted:
                break
            checkpoint, bounds = folder / "checkpoint", settings.bounds()
            policy, steps = load_residual(checkpoint, _base(settings), settings.algorithm, bounds)
            if (name, steps) not in done:
                rows.append({"name": name, "steps": steps, **_test(settings, policy, run, name)})
            write_text(run.folder / "README.md", _page(settings, rows, command))
        shown = [{key: value for key, value in row.items() if key != "trials"} for row in rows]
        return Outcome({"results": shown}, _page(settings, rows, command), 130 if interrupted else 0)


def _base(settings: ResidualSettings) -> Policy:
    """Load the base policy."""
    if (Path(settings.base) / HEAD).is_file():
        return HeadGrasp(Path(settings.base), filtered=settings.filtered)
    return policies.load(settings.base)


def _test(settings: ResidualSettings, policy: Policy, run: Run, name: str) -> dict[str, Any]:
    """Evaluate a policy on the unseen objects."""
    found = evaluation.evaluate(
        policy,
        objects=list(settings.unseen),
        trials=settings.trials,
        seed=TEST_SEED,
        num_envs=settings.num_envs,
        reward=settings.reward,
        hand=settings.named_hand,
        progress=run.counter(settings.trials, f"trials of {name}"),
    )
    return {**summary(found), "trials": [[trial.success, trial.secure] for trial in found.trials]}


def _page(settings: ResidualSettings, rows: Rows, command: str) -> str:
    """Write the page of the results so far."""
    bounds = f"{100 * settings.distance:g} cm, {math.degrees(settings.angle):.0f} degrees and {settings.preshape:.0%}"
    lines = [
        *("# Corrections of a proposed grasp", "", "Written by `graspbox train residual`.", ""),
        f"{settings.algorithm} learns to correct `{settings.base}` by at most {bounds} of the preshape's range.",
        f"{settings.trials} trials with {', '.join(settings.unseen)}, the same for each row; in brackets Wilson's",
        "95 % intervals. Gained and lost: trials that the base policy failed, or succeeded in, and the other not.",
        *("", "| policy | steps | success | secure | gained, lost |", "|---|--:|--:|--:|--:|"),
    ]
    first = rows[0]["trials"]
    for row in rows:
        cells = [
            f"{row[key]:.1%} ({row[interval][0]:.1%} to {row[interval][1]:.1%})"
            for key, interval in (("success", "ci95"), ("secure", "secure_ci95"))
        ]
        pairs = list(zip(first, row["trials"], strict=True))
        gained, lost = (sum(a[0] != b[0] and b[0] is now for a, b in pairs) for now in (True, False))
        change = "" if row["name"] == "base" else f"{gained}, {lost}"
        lines.append(f"| {row['name']} | {row['steps']:,} | {' | '.join(cells)} | {change} |")
    return "\n".join([*lines, "", "```", command, "```", ""])
