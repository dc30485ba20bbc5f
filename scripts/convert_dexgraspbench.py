"""Convert a grasp of DexGraspBench (``.npy``) to Isaac Grasp (``.yaml``), which graspbox reads (extra ``exchange``).

    python scripts/convert_dexgraspbench.py 0.npy --hand panda_gripper --out grasp.yaml --trust

The file is a pickle, which can run any code when it is read. graspbox itself reads no such files; ``--trust`` says that
you know where this one comes from. Such a file has no outcome; the confidence of the grasp is written as 1.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from graspbox import load_hand
from graspbox._common.programs import run_program
from graspbox.errors import GraspboxError
from graspbox.tools import exchange
from graspbox.tools.exchange.dexgraspbench import grasps_of


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="the grasp")
    parser.add_argument("--hand", default="panda_gripper", help="its hand (%(default)s)")
    parser.add_argument("--preshape", type=float, help="its preshape (the only one of the hand)")
    parser.add_argument("--out", type=Path, required=True, help="file to write, .yaml")
    parser.add_argument("--trust", action="store_true", help="run the code that the file may contain")
    args = parser.parse_args()
    if not args.trust:
        sys.exit(f"{args.file} may run any code when it is read; add --trust if you know where it comes from")
    try:
        fields = np.load(args.file, allow_pickle=True).item()
        grasps = grasps_of(fields, load_hand(args.hand), args.preshape)
        exchange.save(replace(grasps, confidence=np.ones(1)), args.out, "isaac")
    except (GraspboxError, OSError, ValueError) as error:
        sys.exit(f"{args.file}: {error}")
    print(f"wrote {args.out}")


if __name__ == "__main__":
    run_program(main)
