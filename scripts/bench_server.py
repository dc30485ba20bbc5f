"""Compare environment and policy servers with local environments and policies, and with other projects, in one run.

    python scripts/bench_server.py                        # a table; --json FILE for the figures
    python scripts/bench_server.py --only steps --only calls   # some of its parts
    python scripts/bench_server.py --policy policies/depth

Everything runs on this machine, over loopback; each figure is the median of at least five runs, alternating
with its rivals. Peers (`servers/peers.py`) run in interpreters that have them, `--peer-python PATH`; peers
installed in none are named and left out (`pip install openpi-client websockets gymnasium`).
"""

import json

from graspbox._common.options import parse
from graspbox._common.programs import run_program
from servers import environments, policies
from servers.measuring import Args

PARTS = {
    "steps": environments.steps,
    "calls": environments.calls,
    "clients": environments.clients,
    "memory": environments.memory,
    "policy": policies.policy,
    "acting": policies.acting,
}


def main(args: Args) -> None:
    """Measure the parts."""
    if unknown := [name for name in args.only if name not in PARTS]:
        raise SystemExit(f"there is no part {unknown[0]!r}; choose from {', '.join(PARTS)}")
    for name in args.only or PARTS:
        PARTS[name](args)
    if args.json is not None:
        args.json.write_text(json.dumps(args.rows, indent=1) + "\n")


if __name__ == "__main__":
    run_program(lambda: main(parse(Args, text=__doc__)))
