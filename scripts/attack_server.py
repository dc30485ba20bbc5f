"""Attack an environment server and a policy server, and check that neither crashes, hangs, or leaks memory or sessions.

During every attack an honest client steps an environment and measures its round trips. The whole campaign is
``--messages 1000000 --kills 100``. The script starts the servers at 127.0.0.1 and ends them; it prints a
table and writes the figures to ``--out``.
"""

import argparse
import json
import os
import random
import sys
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/python"))

from graspbox._common.programs import run_program
from hostile_attacks import ATTACKS, kill
from hostile_policy import POLICY_ATTACKS
from servers.honest import Honest
from servers.processes import Served, served

#: Columns of the table, and their widths.
COLUMNS = {"sent": 9, "seconds": 9, "honest_calls": 14, "p50_ms": 9, "p99_ms": 9, "max_ms": 9, "memory_mb": 11}
#: Least seconds of an attack: short ones are repeated.
LEAST = 3.0


def rest(_url: str, _rng: random.Random, count: int) -> int:
    """Do nothing for `count` seconds."""
    time.sleep(count)
    return 0


def beside(server: Served, kind: str, attack: Any, seed: int, count: int) -> dict[str, Any]:
    """Repeat an attack for some seconds, while an honest client runs."""
    client, started = Honest(server.url, kind), time.monotonic()
    sent, failure = 0, ""
    try:
        while not sent or time.monotonic() - started < LEAST:
            sent += attack(server.url, random.Random(seed + sent), count)
            if not count or attack is rest:
                break
    except Exception:
        failure = traceback.format_exc(limit=-2)
    seconds, trips = time.monotonic() - started, client.end()
    quantiles = {"p50_ms": 0.5, "p99_ms": 0.99, "max_ms": 1.0}
    alive = server.process.poll() is None
    return {
        "sent": sent,
        "seconds": round(seconds, 2),
        "failure": failure,
        "alive": alive,
        "honest_calls": len(trips),
        **{name: round(float(np.quantile(trips, q)), 3) if trips else None for name, q in quantiles.items()},
        "memory_mb": round(server.memory(), 1) if alive else None,
    }


def campaign(server: Served, plan: list[tuple[str, Any, int]], kind: str, seed: int, rounds: int) -> dict[str, Any]:
    """Run all attacks of a plan in every round, after a rest as baseline."""
    print(f"{'attack':<38}" + "".join(f"{name:>{width}}" for name, width in COLUMNS.items()))
    rows: dict[str, Any] = {}
    after: list[float] = []
    for index in range(rounds):
        for name, attack, count in [("warm up", rest, 2), ("no attack", rest, 10), *plan]:
            row = rows[f"{name}, round {index + 1}"] = beside(server, kind, attack, seed + 1000 * index, count)
            print(f"{name:<38}" + "".join(f"{row[key]!s:>{w}}" for key, w in COLUMNS.items()), flush=True)
            if row["failure"]:
                print("  " + row["failure"].strip().replace("\n", "\n  "), flush=True)
            if not row["alive"]:
                return {"attacks": rows, "crashed": True}
        left = server.settled("sessions", 0)
        after.append(server.memory())
    base = min(row["p99_ms"] for name, row in rows.items() if name.startswith("no attack"))
    ratios = {name: round(row["p99_ms"] / base, 2) for name, row in rows.items() if row["p99_ms"] and row["sent"]}
    return {
        "attacks": rows,
        # Parts of endless messages do not count.
        "messages": sum(row["sent"] for name, row in rows.items() if not name.startswith("continuations")),
        "failures": sum(bool(row["failure"]) for row in rows.values()),
        "crashed": False,
        "sessions_left": left,
        "environments_left": server.settled("environments", 0),
        "connections_left": server.settled("connections", 1) - 1,
        "memory_mb": [round(memory, 1) for memory in after],
        # Memory of the first round is kept for reuse; a leak continues to grow.
        "memory_growth": round(after[-1] / after[0] - 1, 4),
        "p99_ratios": ratios,
        "worst_p99_ratio": max(ratios.values()),
    }


def main() -> None:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=100_000, help="to the environment server, in each round")
    parser.add_argument("--kills", type=int, default=10, help="client processes killed in each round")
    parser.add_argument("--connections", type=int, default=200, help="connections of each attack on connections")
    parser.add_argument("--policy-folder", help="policy whose server to attack too, such as policies/depth")
    parser.add_argument("--rounds", type=int, default=2, help="of all attacks; memory growth counts from the second")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="file for the figures, JSON")
    arguments = parser.parse_args()
    os.nice(5)
    plan = [
        (name, attack, int(arguments.messages * part) or arguments.connections)
        for name, (attack, part) in ATTACKS.items()
    ]
    plans = {"environments": (("serve", "--objects", "procedural"), [*plan, ("clients killed", kill, arguments.kills)])}
    if arguments.policy_folder:
        asked = [(name, attack, count) for name, (attack, count) in POLICY_ATTACKS.items()]
        plans["policy"] = (("serve-policy", arguments.policy_folder), asked)
    results: dict[str, Any] = {}
    for name, ((command, *options), work) in plans.items():
        with served(*options, command=command) as server:
            results[name] = campaign(server, work, name, arguments.seed, arguments.rounds)
        print({key: value for key, value in results[name].items() if key not in ("attacks", "p99_ratios")})
    if arguments.out is not None:
        arguments.out.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    run_program(main)
