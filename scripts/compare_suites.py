"""Compare grasping suites on one core: steps per processor second, and what the same learner learns in the same time.

All of them fit into one environment:

    python3.11 -m venv out/suites
    out/suites/bin/pip install '.[cli,train]' 'gymnasium-robotics==1.4.2' 'panda-gym==3.0.7' 'robosuite==1.5.2' \
        'metaworld==3.1.1' 'envpool==1.2.5' h5py packaging
    out/suites/bin/python scripts/compare_suites.py rates --out out/suites/rates.jsonl
    out/suites/bin/python scripts/compare_suites.py learn --out out/suites/learn.jsonl --minutes 12 --seed 1
    out/suites/bin/python scripts/compare_suites.py table out/suites/rates.jsonl out/suites/learn.jsonl

Each suite runs in a process of its own, with one thread, so that processor time counts all that it does. `rates` steps
with random actions: one environment, and 16 beside each other, in the first seconds (cold) and later (warm), and 16
inside Stable-Baselines3's PPO. `learn` trains with the numbers of ``graspbox train sb3 ppo`` for all, and tasks that
only reach with SAC and hindsight; an episode succeeds if one of its steps does, and evaluations are not counted.
A suite that fails leaves a row with its error.
"""

import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

app = typer.Typer(add_completion=False, help=__doc__, pretty_exceptions_enable=False)

#: One thread, and a renderer that needs no display.
PROCESS = {"OMP_NUM_THREADS": "1", "GRASPBOX_THREADS": "1", "MUJOCO_GL": "egl"}
#: Environments beside each other, and those of the learner.
SEVERAL, LEARNERS = 16, 128
OBJECTS = ("procedural:box:0-99", "procedural:can:0-99", "procedural:ball:0-99")
Out = Annotated[Path, typer.Option(help="File of results, a JSON object per line; rows are added.")]
Only = Annotated[list[str] | None, typer.Option(help="A suite; may be repeated. All by default.")]
Seed = Annotated[int, typer.Option(help="Seed.")]


class Told(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Tells of success by one key, and of the time limit as Gymnasium does."""

    def __init__(self, env: Any, success: Callable[[dict[str, Any]], bool], *, truncates: bool = False) -> None:
        super().__init__(env)
        self._success, self._truncates = success, truncates

    def step(self, action: Any) -> Any:
        """Act; `success` is in the information of every step."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        if self._truncates:
            terminated, truncated = False, terminated or truncated
        return seen, float(reward), terminated, truncated, {**info, "success": bool(self._success(info))}


def _gymnasium(env_id: str, count: int, *, flat: bool, key: str = "is_success", **settings: Any) -> VecEnv:
    def one() -> Any:
        env = Told(gymnasium.make(env_id, **settings), lambda info: bool(info[key]))
        return gymnasium.wrappers.FlattenObservation(env) if flat else env

    return DummyVecEnv([one] * count)


def _fetch(env_id: str, count: int, *, flat: bool = True) -> VecEnv:
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    return _gymnasium(env_id, count, flat=flat)


def _panda(env_id: str, count: int, *, flat: bool = True) -> VecEnv:
    import panda_gym  # noqa: F401 (registers)

    return _gymnasium(env_id, count, flat=flat)


def _metaworld(count: int) -> VecEnv:
    import metaworld  # noqa: F401 (registers)

    def one(seed: int) -> Callable[[], Any]:
        # A vector made with one seed is one task many times.
        return lambda: Told(
            gymnasium.make("Meta-World/MT1", env_name="pick-place-v3", seed=seed, max_episode_steps=150),
            lambda info: info["success"] > 0,
        )

    return DummyVecEnv([one(seed) for seed in range(count)])


def _robosuite(count: int) -> VecEnv:
    import robosuite
    from robosuite.wrappers import GymWrapper

    def one() -> Any:
        lift = robosuite.make(
            "Lift",
            robots="Panda",
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
            reward_shaping=True,
            horizon=100,
        )
        return Told(GymWrapper(lift), lambda _: lift._check_success(), truncates=True)

    return DummyVecEnv([one] * count)


def _graspbox(env_id: str, count: int) -> VecEnv:
    from graspbox.sb3 import VecEnv as Native

    return Native.make(env_id, count, **({"objects": OBJECTS} if env_id != "graspbox/Reach-v0" else {}))


class Pool(VecEnv):  # type: ignore[misc]
    """Environments of EnvPool, which begin the next episode one step after the end."""

    def __init__(self, env_id: str, count: int, key: str, seed: int = 0, **settings: Any) -> None:
        import envpool

        self._envs = envpool.make(env_id, env_type="gymnasium", num_envs=count, num_threads=1, seed=seed, **settings)
        self._key, self._actions = key, np.zeros((count, 1))
        size = self.reset().shape[1]
        box = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        super().__init__(count, box, self._envs.action_space)

    def reset(self, where: Any = None) -> Any:
        """Begin episodes, everywhere by default."""
        return _flat(self._envs.reset(where)[0])

    def step_async(self, actions: Any) -> None:
        """Keep the actions."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Act, and begin the next episodes at once."""
        seen, rewards, terminated, truncated, info = self._envs.step(self._actions)
        seen, over = _flat(seen), terminated | truncated
        infos: list[dict[str, Any]] = [{"success": bool(value > 0)} for value in info[self._key]]
        if over.any():
            ended = np.flatnonzero(over)
            for env in ended:
                limit = bool(truncated[env] and not terminated[env])
                infos[env] |= {"terminal_observation": seen[env].copy(), "TimeLimit.truncated": limit}
            seen[ended] = self.reset(ended.astype(np.int32))
        return seen, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the pool."""
        del indices
        return [getattr(self._envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuse."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Nothing is wrapped."""
        del wrapper_class, indices
        return [False] * self.num_envs


def _flat(seen: Any) -> Any:
    """Return observations as one vector each."""
    parts = [seen[name] for name in sorted(seen)] if isinstance(seen, dict) else [seen]
    return np.concatenate(parts, axis=1).astype(np.float32)


@dataclass(frozen=True)
class Suite:
    """A task of a suite: makes its environments, and its rate of control in Hz; `reaches` has goals, for hindsight."""

    make: Callable[[int], VecEnv]
    hz: float
    reaches: bool = False


SUITES = {
    "graspbox Grasp-v0": Suite(lambda n: _graspbox("graspbox/Grasp-v0", n), 5),
    "FetchPickAndPlaceDense-v4": Suite(lambda n: _fetch("FetchPickAndPlaceDense-v4", n), 25),
    "PandaPickAndPlaceDense-v3": Suite(lambda n: _panda("PandaPickAndPlaceDense-v3", n), 25),
    "robosuite Lift": Suite(_robosuite, 20),
    "Meta-World pick-place-v3": Suite(_metaworld, 80),
    "EnvPool FetchPickAndPlaceDense-v4": Suite(lambda n: Pool("FetchPickAndPlaceDense-v4", n, "is_success"), 25),
    "EnvPool Meta-World PickPlace-v3": Suite(
        lambda n: Pool("MetaWorld/PickPlace-v3", n, "success", max_episode_steps=150), 80
    ),
    "EnvPool PandaPickCube-v1": Suite(lambda n: Pool("PandaPickCube-v1", n, "reward_success"), 50),
    "graspbox Reach-v0": Suite(lambda n: _graspbox("graspbox/Reach-v0", n), 5, reaches=True),
    "FetchReach-v4": Suite(lambda n: _fetch("FetchReach-v4", n, flat=False), 25, reaches=True),
    "PandaReach-v3": Suite(lambda n: _panda("PandaReach-v3", n, flat=False), 25, reaches=True),
}


def _seconds(began: float) -> float:
    return time.process_time() - began


def _step_for(envs: VecEnv, seconds: float) -> float:
    """Step with random actions for so many processor seconds; returns the steps per processor second."""
    actions = np.stack([envs.action_space.sample() for _ in range(64 * envs.num_envs)])
    actions = actions.reshape(64, envs.num_envs, -1)
    began, steps = time.process_time(), 0
    while _seconds(began) < seconds:
        envs.step(actions[steps % 64])
        steps += 1
    return steps * envs.num_envs / _seconds(began)


def _rates(suite: Suite, seconds: float, seed: int) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, count in (("one", 1), ("several", SEVERAL)):
        began = time.process_time()
        envs = suite.make(count)
        envs.action_space.seed(seed)
        envs.seed(seed)
        envs.reset()
        found[f"{name}_made_s"] = _seconds(began)
        found[f"{name}_cold"] = _step_for(envs, seconds)
        _step_for(envs, 2 * seconds)
        found[f"{name}_warm"] = _step_for(envs, seconds)
        envs.close()
    found["simulated"] = found["several_warm"] / suite.hz
    envs = suite.make(SEVERAL)
    policy = "MultiInputPolicy" if isinstance(envs.observation_space, gymnasium.spaces.Dict) else "MlpPolicy"
    model = PPO(policy, envs, n_steps=256, batch_size=256, device="cpu", seed=seed)
    model.learn(2 * SEVERAL * 256)
    began = time.process_time()
    model.learn(3 * SEVERAL * 256, reset_num_timesteps=False)
    found["in_ppo"] = 3 * SEVERAL * 256 / _seconds(began)
    return found


class Evaluation(BaseCallback):  # type: ignore[misc]
    """Evaluates every so many steps, and ends the training after its processor time."""

    def __init__(self, held: VecEnv, every: int, minutes: float, row: dict[str, Any]) -> None:
        super().__init__()
        self._held, self._every, self._minutes, self._row, self._apart = held, every, minutes, row, 0.0

    def _on_training_start(self) -> None:
        self._began = time.process_time()

    def _on_step(self) -> bool:
        curve = self._row["curve"]
        if self.num_timesteps >= self._every * (len(curve) + 1):
            began = time.process_time()
            spent = began - self._began - self._apart
            curve.append([self.num_timesteps, round(spent, 1), self.success()])
            print(*curve[-1], file=sys.stderr, flush=True)
            self._apart += _seconds(began)
        return _seconds(self._began) - self._apart < 60 * self._minutes

    def success(self, episodes: int = 50) -> float:
        """Return the share of episodes in which a step succeeds."""
        envs, scales = self._held, self.model.get_vec_normalize_env()
        envs.seed(10_000)
        seen, done, won = envs.reset(), 0, 0
        succeeded = np.zeros(envs.num_envs, dtype=bool)
        while done < episodes:
            actions, _ = self.model.predict(scales.normalize_obs(seen), deterministic=True)
            seen, _, over, infos = envs.step(actions)
            succeeded |= [bool(info.get("success", info.get("is_success", False))) for info in infos]
            done, won = done + int(over.sum()), won + int((succeeded & over).sum())
            succeeded &= ~over
        return won / done


def _learn(suite: Suite, steps: int, minutes: float, seed: int) -> dict[str, Any]:
    row: dict[str, Any] = {"curve": []}
    if suite.reaches:
        env = VecNormalize(suite.make(1), norm_reward=False)
        model: Any = SAC(
            "MultiInputPolicy",
            env,
            replay_buffer_class=HerReplayBuffer,
            learning_starts=500,
            gamma=0.95,
            tau=0.05,
            learning_rate=1e-3,
            ent_coef="auto_0.1",
            policy_kwargs={"net_arch": [64, 64]},
            seed=seed,
            device="cpu",
        )
        steps, every = 4000, 250
    else:
        env = VecNormalize(suite.make(LEARNERS), gamma=0.97)
        model = PPO(
            "MlpPolicy",
            env,
            n_steps=32,
            batch_size=512,
            n_epochs=5,
            gamma=0.97,
            learning_rate=lambda left: 7e-4 * left,
            policy_kwargs={"net_arch": [128, 128], "log_std_init": -0.5},
            seed=seed,
            device="cpu",
        )
        every = steps // 20
    model.learn(steps, callback=Evaluation(suite.make(10), every, minutes, row))
    return row


def _each(task: str, out: Path, only: list[str] | None, *options: str) -> None:
    """Run a task for each suite in a process of its own, and add its row; exits with 1 if one has failed."""
    out.parent.mkdir(parents=True, exist_ok=True)
    failed = False
    for name in only or SUITES:
        if name not in SUITES:
            raise typer.BadParameter(f"there is no suite {name!r}; choose from {', '.join(SUITES)}")
        print(f"{task}: {name}", file=sys.stderr, flush=True)
        command = [sys.executable, __file__, "one", task, name, *options]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env={**os.environ, **PROCESS})
        row = json.dumps({"suite": name, "task": task, "failed": True})
        if done.returncode:
            failed = True
        else:
            # Suites print before.
            row = done.stdout.splitlines()[-1]
        with out.open("a") as file:
            file.write(row + "\n")
    raise typer.Exit(int(failed))


@app.command()
def rates(
    out: Out,
    only: Only = None,
    seconds: Annotated[float, typer.Option(help="Processor seconds of each rate.")] = 5.0,
    seed: Seed = 1,
) -> None:
    """Measure steps per processor second."""
    _each("rates", out, only, "--seconds", str(seconds), "--seed", str(seed))


@app.command()
def learn(
    out: Out,
    only: Only = None,
    steps: Annotated[int, typer.Option(help="Steps of all environments together.")] = 1_000_000,
    minutes: Annotated[float, typer.Option(help="Processor minutes.")] = 12.0,
    seed: Seed = 1,
) -> None:
    """Learn for so many steps or processor minutes, whichever is over first."""
    _each("learn", out, only, "--steps", str(steps), "--minutes", str(minutes), "--seed", str(seed))


@app.command(hidden=True)
def one(task: str, suite: str, seconds: float = 5.0, steps: int = 0, minutes: float = 0.0, seed: Seed = 1) -> None:
    """Do a task for one suite, and print its row."""
    import torch

    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    made = SUITES[suite]
    found = _rates(made, seconds, seed) if task == "rates" else _learn(made, steps, minutes, seed)
    print(json.dumps({"suite": suite, "task": task, "seed": seed, "hz": made.hz, **found}))


@app.command()
def table(files: list[Path]) -> None:
    """Print the tables of results in Markdown."""
    rows = [json.loads(line) for file in files for line in file.read_text().splitlines()]
    good = [row for row in rows if not row.get("failed")]
    print("| task | Hz | one | 16, cold | 16, warm | simulated s/s | inside PPO |\n|---|--:|--:|--:|--:|--:|--:|")
    for row in (row for row in good if row["task"] == "rates"):
        rates = (row[name] for name in ("one_warm", "several_cold", "several_warm", "simulated", "in_ppo"))
        print(f"| {row['suite']} | {row['hz']:g} | " + " | ".join(f"{rate:,.0f}" for rate in rates) + " |")
    print("\n| task | seed | steps | processor time, s | success | best | 90 % after steps | after s |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|")
    for row in (row for row in good if row["task"] == "learn" and row["curve"]):
        steps, seconds, last = row["curve"][-1]
        best = max(rate for _, _, rate in row["curve"])
        reached = next(((f"{s:,}", f"{t:,.0f}") for s, t, rate in row["curve"] if rate >= 0.9), ("-", "-"))
        cells = row["suite"], row["seed"], f"{steps:,}", f"{seconds:,.0f}", f"{last:.0%}", f"{best:.0%}", *reached
        print("| " + " | ".join(map(str, cells)) + " |")
    for row in (row for row in rows if row.get("failed")):
        print(f"\n{row['suite']} failed: {row['task']}")


if __name__ == "__main__":
    app()
