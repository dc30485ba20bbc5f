"""Compare environment and policy servers with local environments and policies, and with other projects, in one run.

    python scripts/bench_server.py                        # a table; --json FILE for the figures
    python scripts/bench_server.py --only steps calls     # some of its parts
    python scripts/bench_server.py --policy policies/depth

Everything runs on this machine, over loopback; each figure is the median of at least five runs, alternating
with its rivals. Peers (`server_peers.py`) run in interpreters that have them, `--peer-python PATH ...`; peers installed
in none are named and left out (`pip install remote-gym`; elsewhere `openenv-core openpi-client websockets gymnasium`).
"""

import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import tyro

import graspbox
import server_peers
from graspbox import _core
from graspbox.envs._pools.remote import now_of
from graspbox.envs.remote_config import RemoteConfig
from graspbox.policies import Task
from graspbox.programs import run_program

#: Objects of all environments.
OBJECTS = "procedural:can:0-3"
WIDE = 64
#: Exit status of a peer that is not installed.
_NOT_INSTALLED = 3


@dataclass
class Args:
    """Measurements."""

    only: tuple[str, ...] = ()
    """Parts: steps, calls, clients, memory, policy, acting. All by default."""
    runs: int = 5
    """Runs of each figure."""
    policy: str = ""
    """Folder of a policy, for the parts policy and acting."""
    peer_python: tuple[str, ...] = ()
    """Interpreters with installed peers, besides this one."""
    json: Path | None = None
    """Write the figures into this file."""
    rows: tyro.conf.Suppress[list[dict[str, Any]]] = field(default_factory=list)


@contextmanager
def served(*options: str, command: str = "serve") -> Iterator[tuple[int, str]]:
    """Run a server in a process of its own: its process id and address."""
    call = [sys.executable, "-m", "graspbox", command, *options, "--port", "0"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"wss?://\S+?:\d+", process.stdout.readline())
        assert found is not None, "the server did not start"
        try:
            yield process.pid, found[0]
        finally:
            process.terminate()


def alternating(work: dict[str, Callable[[], float]], runs: int) -> dict[str, list[float]]:
    """Run each in turn and return their results by name."""
    found: dict[str, list[float]] = {name: [] for name in work}
    for name in work:
        work[name]()  # to warm up
    for _ in range(runs):
        for name, one in work.items():
            found[name].append(one())
    return found


def expert_actions(obs: str, steps: int) -> Any:
    """Return actions of the expert in the environments of `stepping`."""
    env = gymnasium.make_vec("graspbox/Grasp-v0", WIDE, objects=OBJECTS, obs="state")
    policy = graspbox.policies.load("expert")
    policy.bind(Task.of(env))
    observation, info = env.reset(seed=0)
    policy.reset(seed=0, info=info)
    actions, begins = [], np.zeros(WIDE, dtype=np.bool_)
    for _ in range(steps):
        if begins.any():
            policy.reset(mask=begins, info=info)
        actions.append(policy.act(observation).copy())
        observation, _, terminated, truncated, info = env.step(actions[-1])
        begins = ended if (ended := terminated | truncated).any() else np.zeros(WIDE, dtype=np.bool_)
    return np.stack(actions)


def rate(env: Any, actions: Any) -> float:
    """Measure environment steps per second of a vector environment under given actions."""
    env.reset(seed=0)
    started = time.perf_counter()
    for action in actions:
        env.step(action)
    return env.num_envs * len(actions) / (time.perf_counter() - started)


def steps(args: Args) -> None:
    """Measure steps per second of 64 environments under the expert: local, remote, through shared memory."""
    for obs in ("state", "depth"):
        actions = expert_actions(obs, 150)
        keywords = {"objects": OBJECTS, "obs": obs, "image_size": 64}
        with served("--objects", "procedural") as (_, url):
            places = {"local": None, "remote": url, "shared memory": RemoteConfig((url,), shm=True)}
            envs: dict[str, Any] = {
                name: gymnasium.make_vec("graspbox/Grasp-v0", WIDE, remote=place, **keywords)
                for name, place in places.items()
            }
            found = alternating({name: partial(rate, env, actions) for name, env in envs.items()}, args.runs)
            for name, rates in found.items():
                ratio = float(np.median(np.array(rates) / np.array(found["local"])))
                add(args, f"env-steps/s, {WIDE} envs, {obs}, expert: {name}", rates, "1/s", ratio=ratio)
            for env in envs.values():
                env.close()


def peer_round_trips(name: str, pythons: Iterable[str], count: int) -> list[float] | None:
    """Measure a peer's calls, microseconds, in the first interpreter that has it; None if none has."""
    program = str(Path(server_peers.__file__))
    for python in pythons:
        call = [python, program, name, "--calls", str(count)]
        run = subprocess.run(call, capture_output=True, text=True)
        if run.returncode == 0:
            return list(json.loads(run.stdout))
        if run.returncode != _NOT_INSTALLED:
            raise SystemExit(f"{name} failed: {run.stderr}")
    return None


def calls(args: Args) -> None:
    """Measure round trips of calls without physics: one environment and the peers, and 64 with depth images."""
    with ExitStack() as stack:
        _, url = stack.enter_context(served("--objects", "procedural"))
        shared = RemoteConfig((url,), shm=True)
        rivals: dict[str, Callable[[], Any]] = {}
        for name, count, remote in (
            ("graspbox", 1, url),
            ("64 depth", WIDE, url),
            ("64 depth, shared memory", WIDE, shared),
        ):
            obs = "state" if count == 1 else "depth"
            env: Any = gymnasium.make_vec(
                "graspbox/Grasp-v0", count, objects="procedural:can:0", obs=obs, image_size=64, remote=remote
            )
            env.reset(seed=0)
            rivals[name] = lambda pool=env._core.pool: now_of(pool.call("observe", {}), None)
        times: dict[str, list[float]] = {name: [] for name in (*rivals, *server_peers.PEERS)}
        for _ in range(args.runs):
            for name, call in rivals.items():
                times[name] += server_peers.round_trips(call, 100 if name.startswith("64") else 1000)
            for name in server_peers.PEERS:
                found = peer_round_trips(name, (sys.executable, *args.peer_python), 200) if name in times else None
                if found is None and times.pop(name, None) is not None:
                    print(f"{name}: left out, no interpreter of --peer-python has it", file=sys.stderr)
                times.get(name, []).extend(found or [])
        for name, values in times.items():
            add(args, f"round trip without physics: {name}", values, "us", p99=float(np.quantile(values, 0.99)))


def clients(args: Args) -> None:
    """Compare many clients of one environment with one of many, and two servers of one thread with one of two."""

    def vector(url: Any) -> float:
        env: Any = gymnasium.make_vec("graspbox/Grasp-v0", WIDE, objects=OBJECTS, remote=url)
        found = rate(env, actions)
        env.close()
        return found

    def load(url: str, count: int) -> float:
        numbers = (str(count), str(WIDE // count), "200")
        call = ["cargo", "run", "--release", "--quiet", "-p", "graspbox-server", "--example", "load_clients", "--"]
        return float(subprocess.run([*call, url, *numbers], check=True, capture_output=True, text=True).stdout)

    actions = np.random.default_rng(0).uniform(-1, 1, (100, WIDE, 10)).astype(np.float32)
    with ExitStack() as stack:
        _, one = stack.enter_context(served("--objects", "procedural", "--threads", "2"))
        pair = [stack.enter_context(served("--objects", "procedural", "--threads", "1"))[1] for _ in range(2)]
        rivals: tuple[dict[str, Callable[[], float]], ...] = (
            {"one client of 64": partial(load, one, 1), "64 clients of one": partial(load, one, WIDE)},
            {"one server of two threads": partial(vector, one), "two of one thread": partial(vector, pair)},
        )
        for work in rivals:
            found = alternating(work, args.runs)
            first = np.array(next(iter(found.values())))
            for name, rates in found.items():
                ratio = float(np.median(np.array(rates) / first))
                add(args, f"env-steps/s, state: {name}", rates, "1/s", ratio=ratio)


def resident(process: int) -> float:
    """Return the resident memory of a process, MiB."""
    text = Path(f"/proc/{process}/status").read_text()
    found = re.search(r"VmRSS:\s+(\d+) kB", text)
    return float(found[1]) / 1024 if found else float("nan")


def memory(args: Args) -> None:
    """Measure the memory of an idle session of 16 environments."""
    with served("--objects", "procedural") as (process, url):
        envs = []

        def another() -> None:
            env = gymnasium.make_vec("graspbox/Grasp-v0", 16, objects=OBJECTS, obs=("state", "depth"), remote=url)
            env.reset(seed=0)
            envs.append(env)

        another()
        before = resident(process)
        for _ in range(10):
            another()
        add(args, "memory of an idle session of 16 envs", [(resident(process) - before) / 10], "MiB")


def policy(args: Args) -> None:
    """Measure grasps for an image of 480 x 640: the overhead of the wire, and eight clients at once against one."""
    if not args.policy:
        print("policy: left out, name a folder with --policy", file=sys.stderr)
        return
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:mug:0", obs="depth", image_size=(480, 640))
    image, _ = env.reset(seed=1)
    intrinsics, pose = next(iter(env.unwrapped.cameras().values()))  # type: ignore[attr-defined]
    request = {"depth": (image[..., 0] * 1000).astype(np.uint16), "intrinsics": intrinsics, "camera_pose": pose}
    with served(args.policy, command="serve-policy") as (_, url):
        peers = [_core.PolicyClient(url, token=None, ca=None) for _ in range(8)]
        beyond: list[float] = []

        def decide(client: Any, count: int) -> None:
            for _ in range(count):
                started = time.perf_counter()
                client.send(request)
                answer = client.receive()
                seconds = time.perf_counter() - started
                beyond.append(1e3 * seconds - answer["server_timing"]["infer_ms"])

        def at_once(count: int) -> float:
            each = 16 // count
            threads = [threading.Thread(target=decide, args=(peer, each)) for peer in peers[:count]]
            started = time.perf_counter()
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            return 16 / (time.perf_counter() - started)

        decide(peers[0], 4)
        beyond.clear()
        decide(peers[0], 20)
        add(args, "grasps for 480 x 640, beyond the decision", list(beyond), "ms")
        found = alternating({"one client": lambda: at_once(1), "eight clients": lambda: at_once(8)}, args.runs)
        for name, rates in found.items():
            ratios = np.array(rates) / np.array(found["one client"])
            add(args, f"decisions/s: {name}", rates, "1/s", ratio=float(np.median(ratios)))


def acting(args: Args) -> None:
    """Measure actions for observations: the first one of a connection, and eight clients at once against one."""
    if not args.policy:
        print("acting: left out, name a folder with --policy", file=sys.stderr)
        return
    with served(args.policy, command="serve-policy") as (_, url):
        hello: Any = _core.PolicyClient(url, token=None, ca=None).metadata
        made = {"objects": "procedural:mug:0", "obs": hello["observations"], **hello["settings"]}
        env = gymnasium.make(hello["environment"], **made)
        seen, _ = env.reset(seed=1)
        request = {name: np.ascontiguousarray(value) for name, value in seen.items()}

        def first() -> float:
            started = time.perf_counter()
            client = _core.PolicyClient(url, token=None, ca=None)
            client.send({**request, "reset": True})
            client.receive()
            return 1e3 * (time.perf_counter() - started)

        add(args, f"first answer of a connection: {hello['policy']}", [first() for _ in range(3 * args.runs)], "ms")
        peers = [_core.PolicyClient(url, token=None, ca=None) for _ in range(8)]
        inferring: list[float] = []

        def act(client: Any, count: int) -> None:
            for _ in range(count):
                client.send(request)
                inferring.append(client.receive()["server_timing"]["infer_ms"])

        def at_once(count: int) -> float:
            threads = [threading.Thread(target=act, args=(peer, 1600 // count)) for peer in peers[:count]]
            started = time.perf_counter()
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            return 1600 / (time.perf_counter() - started)

        found = alternating({"one client": lambda: at_once(1), "eight clients": lambda: at_once(8)}, args.runs)
        for name, rates in found.items():
            ratios = np.array(rates) / np.array(found["one client"])
            add(args, f"actions/s, {hello['policy']}: {name}", rates, "1/s", ratio=float(np.median(ratios)))
        act(peers[0], 400)
        add(args, "of an answer, in the policy itself", inferring[-400:], "ms")


def add(args: Args, work: str, values: list[float], unit: str, **more: float) -> None:
    """Add a row, and print it."""
    row = {"work": work, "median": float(np.median(values)), "unit": unit, "count": len(values), **more}
    args.rows.append(row)
    extra = "".join(f"  {name} {value:.3g}" for name, value in more.items())
    print(f"{work:<60} {row['median']:>10.4g} {unit}{extra}", flush=True)


PARTS = {"steps": steps, "calls": calls, "clients": clients, "memory": memory, "policy": policy, "acting": acting}


def main(args: Args) -> None:
    """Measure the parts."""
    for name in args.only or PARTS:
        if name not in PARTS:
            raise SystemExit(f"there is no part {name!r}; choose from {', '.join(PARTS)}")
        PARTS[name](args)
    if args.json is not None:
        args.json.write_text(json.dumps(args.rows, indent=1) + "\n")


if __name__ == "__main__":
    run_program(lambda: main(tyro.cli(Args, description=__doc__)))
