"""Compare the verdicts of our inverse kinematics with those of ssik, an analytic solver, on random poses.

    python -m venv /tmp/ssik && /tmp/ssik/bin/pip install "ssik[urdf]==8.2.0"
    python scripts/judge_inverse.py --judge /tmp/ssik/bin/python

ssik lives in an environment of its own, and builds a solver from our URDF and its limits. Half of the poses are those
of random postures, a quarter has their positions with random rotations, a quarter is anywhere within reach. What either
one answers is checked by our forward kinematics and the limits; poses that only one finds are counted by their kind.
Times are processor times per pose, of all poses.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox import ReachConfig, arms
from graspbox._common.programs import run_program

KINDS = ("posture", "turned", "anywhere")
#: Greatest difference of an element of a pose that counts as met, m and 1.
MET = 1e-4
#: What the judge's interpreter runs: arguments are the URDF, base, flange, and the folder of poses and answers.
JUDGE = """
import importlib.util, sys, time
import numpy as np
from ssik.cli import main
urdf, base, flange, folder = sys.argv[1:]
built = folder + "/built.py"
assert main(["build", urdf, "--base", base, "--ee", flange, "--out", built, "--no-validate"]) in (0, None)
spec = importlib.util.spec_from_file_location("built", built)
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
poses = np.load(folder + "/poses.npy")
start = time.process_time()
found = [module.solve(pose, enumerate_windings=False) for pose in poses]
spent = time.process_time() - start
rows = [(i, *one.q) for i, answers in enumerate(found) for one in answers]
np.savez(folder + "/answers.npz", rows=np.array(rows).reshape(len(rows), -1), seconds=spent)
"""


def poses_of(arm: arms.Arm, count: int, random: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw poses (n, 4, 4) of the flange, and the kind of each."""
    low, high = arm.joint_limits.T
    poses = arm.flange_poses(random.uniform(low, high, (count, len(low))))
    kinds = np.arange(count) % 4 - 1
    kinds = np.maximum(kinds, 0)
    turned = np.flatnonzero(kinds > 0)
    poses[turned, :3, :3] = rotations(len(turned), random)
    anywhere = np.flatnonzero(kinds == 2)
    ways = random.normal(size=(len(anywhere), 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    shoulder = arm.link_frames(np.zeros(len(low)))[1][:3, 3]
    lengths = arm.reach_length * random.uniform(0, 1, (len(anywhere), 1)) ** (1 / 3)
    poses[anywhere, :3, 3] = shoulder + lengths * ways
    return poses, kinds


def rotations(count: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Draw rotations (n, 3, 3), evenly distributed."""
    q, r = np.linalg.qr(random.normal(size=(count, 3, 3)))
    q *= np.sign(np.einsum("nii->ni", r))[:, None]
    q[np.linalg.det(q) < 0] *= -1.0
    return np.asarray(q)


def judged(arm: arms.Arm, poses: NDArray[np.float64], judge: Path) -> tuple[NDArray[np.float64], float]:
    """Return the judge's answers, rows of the pose's number and the positions, and its processor time, seconds."""
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder, "arm.urdf")
        urdf.write_text(arm.files[0])
        np.save(Path(folder, "poses.npy"), poses)
        base, flange = (re.search(rf'^{key} = "(\w+)"', arm.files[1], re.MULTILINE)[1] for key in ("base", "flange"))
        command = [str(judge), "-c", JUDGE, str(urdf), base, flange, folder]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={"PATH": "/usr/bin"})
        with np.load(Path(folder, "answers.npz")) as answers:
            return answers["rows"], float(answers["seconds"])


def valid(arm: arms.Arm, postures: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which postures (n, k) are within the limits and meet their poses (n, 4, 4)."""
    low, high = arm.joint_limits.T
    within = ((postures >= low - 1e-9) & (postures <= high + 1e-9)).all(axis=1)
    return within & (np.abs(arm.flange_poses(np.ascontiguousarray(postures)) - poses).max(axis=(1, 2)) < MET)


def compared(name: str, count: int, seed: int, starts: int, judge: Path) -> dict[str, object]:
    """Compare both solvers on random poses of an arm."""
    arm = arms.load_arm(name)
    poses, kinds = poses_of(arm, count, np.random.default_rng(seed))
    start = time.process_time()
    ours = arms.inverse(arm, poses, config=ReachConfig(starts=starts), num_threads=1)
    spent = time.process_time() - start
    given = np.isfinite(ours.solutions).all(axis=2)
    which = np.nonzero(given)
    own = valid(arm, ours.solutions[which], poses[which[0]])
    rows, seconds = judged(arm, poses, judge)
    number = rows[:, 0].astype(np.int64)
    theirs = valid(arm, rows[:, 1:], poses[number])
    by_judge = np.zeros(count, dtype=np.bool_)
    by_judge[number[theirs]] = True
    missed, more = by_judge & ~ours.reached, ours.reached & ~by_judge

    def per_kind(mask: NDArray[np.bool_]) -> dict[str, int]:
        return {kind: int((mask & (kinds == i)).sum()) for i, kind in enumerate(KINDS)}

    return {
        "arm": name,
        "poses": count,
        "reached": int(ours.reached.sum()),
        "same verdict": float((by_judge == ours.reached).mean()),
        "random postures that ours, ssik miss": [
            int((~found & (kinds == 0)).sum()) for found in (ours.reached, by_judge)
        ],
        "only ssik": per_kind(missed),
        "only ours": per_kind(more),
        "ours beyond limits or off the pose": int((~own).sum()),
        "ssik's beyond limits or off the pose": int((~theirs).sum()),
        "ours, microseconds": round(1e6 * spent / count),
        "ssik, microseconds": round(1e6 * seconds / count),
    }


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--judge", type=Path, required=True, help="the Python that has ssik")
    parser.add_argument("--poses", type=int, default=3000)
    parser.add_argument("--starts", type=int, default=ReachConfig().starts, help="as of graspbox.ReachConfig")
    parser.add_argument("--arms", nargs="+", default=["fr3", "ur5e", "xarm7"])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for name in arguments.arms:
        row = compared(name, arguments.poses, arguments.seed, arguments.starts, arguments.judge)
        sys.stdout.write(json.dumps(row) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    run_program(main)
