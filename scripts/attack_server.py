"""Attack an environment server and a policy server, and check that neither crashes, hangs, or leaks memory or sessions.

During every attack an honest client steps an environment and measures its round trips. The whole campaign is
``--messages 1000000 --kills 100``. The script starts the servers at 127.0.0.1 and ends them; it prints a
table and writes the figures to ``--out``.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from graspbox.programs import run_program

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "python"))

from hostile_attacks import ACTION, ATTACKS, kill, made  # noqa: E402
from hostile_policy import POLICY_ATTACKS  # noqa: E402
from hostile_wire import http  # noqa: E402

#: Widths of the columns of the table.
WIDTHS = (9, 8, 7, 9, 9, 9, 8)
#: Least seconds of an attack: short ones are repeated.
LEAST = 3.0
#: Seconds between two calls of the honest client.
NAP = 0.003


class Served:
    """A server in a process of its own."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "graspbox", *arguments, "--port", "0"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT)
        assert self.process.stdout is not None
        line = ""
        while "serving" not in line:
            line = self.process.stdout.readline()
            assert line, "the server does not start"
        self.url = next(word for word in line.split() if word.startswith("ws://")).rstrip(",;")

    def memory(self) -> float:
        """Return the used memory, MB."""
        lines = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024

    def metric(self, name: str) -> int:
        """Return one of its gauges."""
        text = http(self.url, "GET /metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").decode()
        return int(next(line.split()[1] for line in text.splitlines() if line.startswith(f"graspbox_{name} ")))

    def settled(self, name: str, value: int, within: float) -> int:
        """Wait until a gauge has a value, or time is over."""
        until = time.monotonic() + within
        while (found := self.metric(name)) > value and time.monotonic() < until:
            time.sleep(0.2)
        return found

    def end(self) -> None:
        """End the process."""
        self.process.terminate()
        try:
            self.process.wait(15)
        except subprocess.TimeoutExpired:
            self.process.kill()


def honest(url: str, seconds: float, policy: bool) -> None:
    """Step an environment, or ask for decisions, until standard input ends; print times and round trips as JSON."""
    found, until = [], time.monotonic() + seconds
    if policy:
        from graspbox import _core

        client = _core.PolicyClient(url, token=None, ca=None)
        ask = {"depth": np.zeros((1, 1), np.float32), "intrinsics": np.eye(3)}
    else:
        peer = made(url, keywords={"frame_skip": 1, "max_episode_steps": 1_000_000})
        actions = np.zeros((1, ACTION), np.float32)
    print("ready", flush=True)
    os.set_blocking(0, False)
    while time.monotonic() < until and sys.stdin.buffer.raw.read(1) is None:  # type: ignore[attr-defined]
        started = time.perf_counter()
        if policy:
            client.send(ask)
            client.receive()
        else:
            answer = peer.call("step", actions=actions)
            assert "error" not in answer, answer
        found.append(1e3 * (time.perf_counter() - started))
        time.sleep(NAP)
    print(json.dumps(found), flush=True)


class Honest:
    """The honest client, in a process of its own."""

    def __init__(self, url: str, policy: bool) -> None:
        command = [sys.executable, __file__, "--honest", url, *(["--policy"] if policy else [])]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def end(self) -> list[float]:
        """Stop it and return its round trips, milliseconds."""
        try:
            out, _ = self.process.communicate("\n", timeout=60)
            return [float(x) for x in json.loads(out)]
        except (subprocess.TimeoutExpired, ValueError):
            self.process.kill()
            return []


def rest(_url: str, _rng: random.Random, count: int) -> int:
    """Do nothing for `count` seconds."""
    time.sleep(count)
    return 0


def beside(served: Served, policy: bool, attack: Any, seed: int, count: int) -> dict[str, Any]:
    """Repeat an attack for some seconds, while an honest client runs."""
    client, started = Honest(served.url, policy), time.monotonic()
    sent, failure = 0, ""
    try:
        while not sent or time.monotonic() - started < LEAST:
            sent += attack(served.url, random.Random(seed + sent), count)
            if not count or attack is rest:
                break
    except Exception:
        failure = traceback.format_exc(limit=-2)
    seconds = time.monotonic() - started
    trips = client.end()
    return {
        "sent": sent,
        "seconds": round(seconds, 2),
        "failure": failure,
        "alive": served.process.poll() is None,
        "honest_calls": len(trips),
        "p50_ms": round(float(np.median(trips)), 3) if trips else None,
        "p99_ms": round(float(np.quantile(trips, 0.99)), 3) if trips else None,
        "max_ms": round(max(trips), 3) if trips else None,
        "memory_mb": round(served.memory(), 1) if served.process.poll() is None else None,
    }


def campaign(served: Served, plan: list[tuple[str, Any, int]], policy: bool, seed: int, rounds: int) -> dict[str, Any]:
    """Run all attacks of a plan in every round, after a rest as baseline."""
    print(f"{'attack':<38}{'sent':>9}{'s':>8}{'calls':>7}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}{'MB':>8}")
    rows: dict[str, Any] = {}
    after: list[float] = []
    for index in range(rounds):
        for name, attack, count in [("warm up", rest, 2), ("no attack", rest, 10), *plan]:
            row = beside(served, policy, attack, seed + 1000 * index, count)
            rows[f"{name}, round {index + 1}"] = row
            numbers = [
                row[key] for key in ("sent", "seconds", "honest_calls", "p50_ms", "p99_ms", "max_ms", "memory_mb")
            ]
            print(f"{name:<38}" + "".join(f"{n!s:>{w}}" for n, w in zip(numbers, WIDTHS, strict=True)), flush=True)
            if row["failure"]:
                print("  " + row["failure"].strip().replace("\n", "\n  "), flush=True)
            if not row["alive"]:
                return {"attacks": rows, "crashed": True}
        served.settled("sessions", 0, 20.0)
        after.append(served.memory())
    left = served.settled("sessions", 0, 20.0)
    base = min(row["p99_ms"] for name, row in rows.items() if name.startswith("no attack"))
    worst = {name: row["p99_ms"] / base for name, row in rows.items() if row["p99_ms"] and row["sent"]}
    return {
        "attacks": rows,
        # Parts of endless messages do not count.
        "messages": sum(row["sent"] for name, row in rows.items() if not name.startswith("continuations")),
        "failures": sum(bool(row["failure"]) for row in rows.values()),
        "crashed": False,
        "sessions_left": left,
        "environments_left": served.metric("environments"),
        "connections_left": served.settled("connections", 1, 20.0) - 1,
        "memory_mb": [round(memory, 1) for memory in after],
        # Memory of the first round is kept for reuse; a leak continues to grow.
        "memory_growth": round(after[-1] / after[0] - 1, 4),
        "p99_ratios": {name: round(ratio, 2) for name, ratio in worst.items()},
        "worst_p99_ratio": round(max(worst.values()), 2),
    }


def main() -> None:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--messages", type=int, default=100_000, help="messages to the environment server, in each round"
    )
    parser.add_argument("--kills", type=int, default=10, help="client processes killed in each round")
    parser.add_argument("--connections", type=int, default=200, help="connections of each attack on connections")
    parser.add_argument(
        "--policy-folder", default="", help="folder of a policy whose server to attack too, such as policies/depth"
    )
    parser.add_argument(
        "--rounds", type=int, default=2, help="rounds of all attacks; memory growth counts from the second"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=None, help="file for the figures, JSON")
    parser.add_argument("--honest", default="", help=argparse.SUPPRESS)
    parser.add_argument("--policy", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.honest:
        return honest(given.honest, 3600.0, given.policy)
    os.nice(5)
    found: dict[str, Any] = {}
    plan = [
        (name, attack, int(given.messages * share) or given.connections) for name, (attack, share) in ATTACKS.items()
    ]
    plans = {"environments": (["serve", "--objects", "procedural"], [*plan, ("clients killed", kill, given.kills)])}
    if given.policy_folder:
        asked = [(name, attack, count) for name, (attack, count) in POLICY_ATTACKS.items()]
        plans["policy"] = (["serve-policy", given.policy_folder], asked)
    for name, (arguments, work) in plans.items():
        served = Served(*arguments)
        try:
            found[name] = campaign(served, work, name == "policy", given.seed, given.rounds)
        finally:
            served.end()
        print({key: value for key, value in found[name].items() if key not in ("attacks", "p99_ratios")})
    if given.out is not None:
        given.out.write_text(json.dumps(found, indent=1) + "\n")
    return None


if __name__ == "__main__":
    run_program(main)
