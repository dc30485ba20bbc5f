"""Measurements of a server of environments: steps, calls without physics, many clients, memory."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from graspbox import policies
from graspbox.envs._pools.remote import now_of
from graspbox.envs.remote_config import RemoteConfig
from graspbox.policies import Task
from servers import peers
from servers.measuring import Args
from servers.processes import served

#: Objects of all environments.
OBJECTS = "procedural:can:0-3"
WIDE = 64
#: The meaning of an action, which `load_clients` has too.
ACTING = {"fingers": "each", "control_freq": 20}


def make(count: int = WIDE, **settings: Any) -> Any:
    """Make a vector environment."""
    return gymnasium.make_vec("graspbox/Grasp-v0", count, **{"objects": OBJECTS, **ACTING, **settings})


def expert_actions(steps: int) -> Any:
    """Return actions of the expert in the environments of `steps`."""
    env, policy = make(obs="state"), policies.load("expert")
    policy.bind(Task.of(env))
    observation, info = env.reset(seed=0)
    policy.reset(seed=0, info=info)
    actions, begins = [], np.zeros(WIDE, dtype=np.bool_)
    for _ in range(steps):
        if begins.any():
            policy.reset(mask=begins, info=info)
        actions.append(policy.act(observation).copy())
        observation, _, terminated, truncated, info = env.step(actions[-1])
        begins = terminated | truncated
    return np.stack(actions)


def rate(env: Any, actions: Any) -> float:
    """Measure environment steps per second of a vector environment under given actions."""
    env.reset(seed=0)
    started = perf_counter()
    for action in actions:
        env.step(action)
    return env.num_envs * len(actions) / (perf_counter() - started)


def steps(args: Args) -> None:
    """Measure steps per second of 64 environments under the expert: local, remote, through shared memory."""
    actions = expert_actions(150)
    for obs in ("state", "depth"):
        with served("--objects", "procedural") as server:
            places = {"local": None, "remote": server.url, "shared memory": RemoteConfig((server.url,), shm=True)}
            envs = {name: make(obs=obs, image_size=64, remote=place) for name, place in places.items()}
            work: dict[str, Callable[[], float]] = {name: partial(rate, env, actions) for name, env in envs.items()}
            args.compare(f"env-steps/s, {WIDE} envs, {obs}, expert", work)
            for env in envs.values():
                env.close()


def calls(args: Args) -> None:
    """Measure round trips of calls without physics: one environment and the peers, and 64 with depth images."""
    with served("--objects", "procedural") as server:
        shared = RemoteConfig((server.url,), shm=True)
        rivals: dict[str, Callable[[], Any]] = {}
        for name, count, obs, remote in (
            ("graspbox", 1, "state", server.url),
            ("64 depth", WIDE, "depth", server.url),
            ("64 depth, shared memory", WIDE, "depth", shared),
        ):
            env = make(count, objects="procedural:can:0", obs=obs, image_size=64, remote=remote)
            env.reset(seed=0)
            rivals[name] = lambda pool=env._core.pool: now_of(pool.call("observe", {}), None)
        times: dict[str, list[float]] = {name: [] for name in (*rivals, *peers.PEERS)}
        for _ in range(args.runs):
            for name, call in rivals.items():
                times[name] += peers.round_trips(call, 100 if name.startswith("64") else 1000)
            for name in peers.PEERS:
                durations = peers.measure(name, (sys.executable, *args.peer_python), 200) if name in times else None
                if durations is None and times.pop(name, None) is not None:
                    print(f"{name}: left out, no interpreter of --peer-python has it", file=sys.stderr)
                times.get(name, []).extend(durations or [])
        for name, values in times.items():
            args.add(f"round trip without physics: {name}", values, "us", p99=float(np.quantile(values, 0.99)))


def clients(args: Args) -> None:
    """Compare many clients of one environment with one of many, and two servers of one thread with one of two."""
    actions = np.random.default_rng(0).uniform(-1, 1, (100, WIDE, 10)).astype(np.float32)

    def vector(url: Any) -> float:
        env = make(remote=url)
        steps = rate(env, actions)
        env.close()
        return steps

    def load(url: str, count: int) -> float:
        call = ["cargo", "run", "--release", "--quiet", "-p", "graspbox-server", "--example", "load_clients", "--", url]
        words = [*call, str(count), str(WIDE // count), "200"]
        return float(subprocess.run(words, check=True, capture_output=True, text=True).stdout)

    with ExitStack() as stack:
        both, *each = (
            stack.enter_context(served("--objects", "procedural", "--threads", threads)).url for threads in "211"
        )
        many = {"one client of 64": partial(load, both, 1), "64 clients of one": partial(load, both, WIDE)}
        args.compare("env-steps/s, state", many)
        two = {"one server of two threads": partial(vector, both), "two of one thread": partial(vector, each)}
        args.compare("env-steps/s, state", two)


def memory(args: Args) -> None:
    """Measure the memory of an idle session of 16 environments."""
    with served("--objects", "procedural") as server:
        envs, used = [], []
        for _ in range(11):
            envs.append(make(16, obs=("state", "depth"), remote=server.url))
            envs[-1].reset(seed=0)
            used.append(server.memory())
        args.add("memory of an idle session of 16 envs", [(used[-1] - used[0]) / 10], "MiB")
