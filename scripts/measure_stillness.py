"""Measure how far the best grasp moves between images of a still scene, with and without the earlier grasp.

    python scripts/measure_stillness.py tests/captures --policy policies/panda_clutter

Each capture (`graspbox.evaluation.captures`) is seen again and again, with noise of single pixels that grows with the
square of the distance; its first thing is grasped by its mask. Two best grasps agree within 1 cm and 10 degrees; a hand
turned by half a turn about its approach is the same for parallel jaws.
"""

import argparse
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox._common.programs import run_program
from graspbox.evaluation.captures import Capture, captures_in
from graspbox.perception import DepthNoise
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps

#: Greatest differences of grasps that agree, metres and radians.
MOVED, TURNED = 0.01, np.radians(10.0)
#: Half a turn about the approach.
HALF = np.diag([-1.0, -1.0, 1.0])


def again(depth: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the image with the axial noise of `DepthNoise`."""
    noise = DepthNoise()
    deviation = noise.axial_floor + noise.axial_growth * np.maximum(depth - noise.axial_near, 0.0) ** 2
    return np.where(depth > 0, depth + rng.normal(0.0, deviation), 0.0)


def agree(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Tell whether two poses (4, 4) agree."""
    relative = one[:3, :3].T @ other[:3, :3]
    turns = [np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)) for turn in (relative, relative @ HALF)]
    return bool(np.linalg.norm(one[:3, 3] - other[:3, 3]) < MOVED and min(turns) < TURNED)


def pairs(grasper: ImageGrasper, capture: Capture, frames: int, seed: int, *, following: bool) -> tuple[int, int]:
    """Return how many pairs of best grasps agree, and their number."""
    assert capture.labels is not None
    rng, poses = np.random.default_rng(seed), []
    previous: ImageGrasps | None = None
    for _ in range(frames):
        found = grasper.find(
            again(capture.depth, rng),
            capture.intrinsics,
            mask=capture.labels == capture.things[0],
            previous=previous if following else None,
        )
        if len(found):
            poses.append(found.camera_from_hand[0])
            previous = found
    compared = [agree(one, other) for one, other in combinations(poses, 2)]
    return sum(compared), len(compared)


def main() -> None:
    """Measure all captures of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--policy", required=True)
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    grasper = ImageGrasper(args.policy)
    totals = np.zeros((2, 2), dtype=np.int64)
    print("| capture | pairs | agree | agree, following the earlier grasp |\n|---|--:|--:|--:|")
    for folder in captures_in(args.folder):
        capture = Capture.read(folder)
        counts = np.array(
            [pairs(grasper, capture, args.frames, args.seed, following=following) for following in (False, True)]
        )
        totals += counts
        shares = counts[:, 0] / np.maximum(counts[:, 1], 1)
        print(f"| {folder.name} | {counts[0, 1]} | {shares[0]:.0%} | {shares[1]:.0%} |", flush=True)
    shares = totals[:, 0] / np.maximum(totals[:, 1], 1)
    print(f"| all | {totals[0, 1]} | {shares[0]:.1%} | {shares[1]:.1%} |")


if __name__ == "__main__":
    run_program(main)
