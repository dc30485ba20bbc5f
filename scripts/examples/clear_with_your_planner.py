"""Your own planner on a truncated signed distance field, in rounds of clearing after VGN's protocol.

    python scripts/examples/clear_with_your_planner.py --layout packed --rounds 10

`plan` is what you replace, such as with a network of the kind of VGN. This one grasps from above: it looks for pairs of
points of the surface that face away from each other, no farther apart than the fingers open, and keeps those at whose
sides the field leaves room for the fingers.
"""

import argparse

import numpy as np
from numpy.typing import NDArray

from graspbox.evaluation.rounds import Rounds, clear_rounds
from graspbox.policies import TsdfPolicy

Floats = NDArray[np.float64]
#: Height of the table top in the workspace, and least height of the fingertips over it, metres.
TABLE, CLEARANCE = 0.05, 0.005
#: The Franka hand, metres: from the frame's origin to the middle of the pads and to the fingertips; least and greatest
#: distance of two points to grasp; where the open fingers are along y, and half their size along x.
PADS, TIPS = 0.038, 0.048
NARROW, WIDE = 0.01, 0.07
FINGERS, HALF = (0.038, 0.07), 0.012
#: Most points, least cosine between a normal and the line through a pair, greatest difference of height (metres).
POINTS, FACING, LEVEL = 800, 0.85, 0.01


def surface(field: NDArray[np.float32], voxel: float) -> tuple[Floats, Floats]:
    """Points (p, 3) where the field crosses 0.5 between neighbours along x or y, and normals out of the object."""
    slopes = np.stack(np.gradient(field.astype(np.float64)), axis=-1)
    points, normals = [], []
    for axis in (0, 1):
        here, there = np.moveaxis(field, axis, 0)[:-1], np.moveaxis(field, axis, 0)[1:]
        crossed = (here > 0) & (there > 0) & ((here - 0.5) * (there - 0.5) < 0)
        share = (0.5 - here[crossed]) / (there[crossed] - here[crossed])
        # The index along the axis comes first here.
        index = np.argwhere(crossed).astype(np.float64)
        index[:, 0] += share
        nearest = np.round(index).astype(int)
        points.append(np.insert(index[:, 1:], axis, index[:, 0], axis=1))
        normals.append(np.moveaxis(slopes, axis, 0)[tuple(nearest.T)])
    out = np.concatenate(normals)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return (np.concatenate(points) + 0.5) * voxel, out


def pairs(points: Floats, normals: Floats) -> tuple[Floats, Floats, Floats]:
    """Middles (m, 3) of pairs of points that face away from each other, lines (m, 3) through them, and how well."""
    between = points[None] - points[:, None]
    wide = np.linalg.norm(between[..., :2], axis=2)
    lines = between / np.maximum(wide, 1e-9)[..., None]
    lines[..., 2] = 0.0
    facing = np.minimum(-np.einsum("pi,pqi->pq", normals, lines), np.einsum("qi,pqi->pq", normals, lines))
    good = (wide > NARROW) & (wide < WIDE) & (np.abs(between[..., 2]) < LEVEL) & (facing > FACING)
    first, second = np.nonzero(good & (np.arange(len(points))[:, None] < np.arange(len(points))))
    middles = 0.5 * (points[first] + points[second])
    return middles, lines[first, second] * wide[first, second, None], facing[first, second]


def room(heights: Floats, voxel: float, middles: Floats, closing: Floats) -> Floats:
    """How high the surface is (m,) where the open fingers of grasps go, metres."""
    across = np.stack([-closing[:, 1], closing[:, 0]], axis=1)
    highest = np.zeros(len(middles))
    for along in np.arange(FINGERS[0], FINGERS[1], voxel / 2):
        for side in np.arange(-HALF, HALF + 1e-9, voxel / 2):
            for sign in (-1.0, 1.0):
                places = middles[:, :2] + sign * along * closing[:, :2] + side * across
                i, j = np.clip((places / voxel).astype(int), 0, len(heights) - 1).T
                highest = np.maximum(highest, heights[i, j])
    return highest


def plan(tsdf: NDArray[np.float32], voxel_size: float) -> tuple[Floats, Floats, Floats]:
    """Find grasps: poses (n, 4, 4) in the workspace, widths (n,), scores (n,)."""
    field = tsdf[0]
    points, normals = surface(field, voxel_size)
    over = points[:, 2] > TABLE + CLEARANCE
    points, normals = points[over], normals[over]
    chosen = np.random.default_rng(0).permutation(len(points))[:POINTS]
    middles, lines, facing = pairs(points[chosen], normals[chosen])
    widths = np.linalg.norm(lines, axis=1)
    closing = lines / np.maximum(widths, 1e-9)[:, None]
    solid = (field > 0) & (field < 0.5)
    heights = np.where(solid, np.arange(1, len(field) + 1) * voxel_size, 0.0).max(axis=2)
    floor = np.maximum(room(heights, voxel_size, middles, closing), TABLE) + CLEARANCE
    # As deep as the pair asks, but over what is beside it.
    tips = np.maximum(middles[:, 2] - (TIPS - PADS), floor)
    kept = tips < middles[:, 2] + (TIPS - PADS)
    poses = np.tile(np.eye(4), (int(kept.sum()), 1, 1))
    poses[:, :3, 1], poses[:, :3, 2] = closing[kept], (0.0, 0.0, -1.0)
    poses[:, :3, 0] = np.cross(poses[:, :3, 1], poses[:, :3, 2])
    poses[:, :2, 3], poses[:, 2, 3] = middles[kept, :2], tips[kept] + TIPS
    # The higher an object, the less is in the way.
    return poses, widths[kept], facing[kept] + 2.0 * middles[kept, 2]


def main(layout: str = "packed", rounds: int = 10, views: int = 6, seed: int = 0) -> Rounds:
    """Measure the planner."""
    policy = TsdfPolicy(plan, views=views, name="your_planner")
    return clear_rounds(policy, layout=layout, hand="panda_gripper", rounds=rounds, seed=seed)  # type: ignore[arg-type]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layout", default="packed", help="packed, pile or bin")
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--views", type=int, default=6, help="depth images before each attempt")
    parser.add_argument("--seed", type=int, default=0)
    print(main(**vars(parser.parse_args())))
