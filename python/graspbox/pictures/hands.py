"""Hands in pictures: posed hands, joints (which collision shapes lack), and small glyphs for grasp poses."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graspbox.hands.geometry import corners_of
from graspbox.meshes import mesh_from_arrays
from graspbox.meshes.shapes import Floats, cylinder, frame_along, place
from graspbox.pictures.solids import Solid, box_mesh
from graspbox.planning import Box
from graspbox.simulation import Hand

#: Colour of hinges and of the necks between a finger's links, equal to that of the renderer's knuckles.
_JOINT = "#4d525c"
#: Radius and half length of the hinge at a finger's root, as shares of the middle and least half side of its link.
_HINGE = (1.2, 1.6)
#: Half sides of the neck between a finger's links, as a share of the least half side of its first link.
_NECK = 0.62
#: Least length of a neck, metres.
_SHORTEST = 1e-4
#: Size of a glyph relative to the hand, length of its stem in metres, and the share by which its fingers are closed.
_GLYPH_SCALE, _STEM = 0.36, 0.03
_GLYPH_CLOSED = 0.3


@dataclass(frozen=True, eq=False)
class Finger:
    """Joints and tip of a chain, hand frame, metres; joints whose links have no collision shape are left out."""

    #: Points on the axes of the joints, (k, 3), each nearest to the centre of the joint's child link.
    points: Floats
    #: Unit vectors of these axes, (k, 3), and whether each joint is revolute.
    axes: Floats
    revolute: NDArray[np.bool_]
    #: The largest collision shape of each child link, and the far end of the last one.
    links: tuple[Box, ...]
    tip: Floats


@dataclass(frozen=True, eq=False)
class PosedHand:
    """A hand at a pose of its grasp frame, (4, 4), with its independent joints at positions (c,), rad or m."""

    hand: Hand
    world_from_hand: Floats
    joints: Floats

    @classmethod
    def open(cls, hand: Hand, world_from_hand: Floats, preshape: float) -> "PosedHand":
        """Return the open hand with a preshape."""
        return cls(hand, world_from_hand, hand.open(preshape))

    def corners(self) -> Floats:
        """Return the corners (n, 3) of the boxes of its collision shapes, world frame, metres."""
        return place(corners_of(self.hand, np.ascontiguousarray(self.joints, dtype=np.float64)), self.world_from_hand)

    def skeleton(self) -> list[Finger]:
        """Return the joints and the tip of every chain with a collision shape."""
        positions = np.ascontiguousarray(self.joints, dtype=np.float64)
        frames, halves, pads, carriers = self.hand.shapes(positions)
        joints, chains, revolute = self.hand.joint_frames(positions)
        fingers = []
        for chain in range(len(self.hand.chains)):
            rows = [row for row in np.flatnonzero(chains == chain) if (carriers == row).any()]
            if not rows:
                continue
            # Links without pads after the last one with a pad, as in a linkage, are behind the finger.
            padded = [number for number, row in enumerate(rows) if (pads & (carriers == row)).any()]
            rows = rows[: padded[-1] + 1 if padded else len(rows)]
            largest = [int(np.where(carriers == row, halves.prod(axis=1), -1.0).argmax()) for row in rows]
            links = tuple(Box(frames[i, :3, 3], frames[i, :3, :3], halves[i]) for i in largest)
            axes = joints[rows, :3, 0]
            centers = np.array([link.center for link in links])
            ahead = np.sum((centers - joints[rows, :3, 3]) * axes, axis=1, keepdims=True)
            points = joints[rows, :3, 3] + axes * ahead
            along = links[-1].center - points[-1]
            along /= max(float(np.linalg.norm(along)), 1e-9)
            tip = points[-1] + along * np.max((links[-1].corners() - points[-1]) @ along)
            fingers.append(Finger(points, axes, revolute[rows], links, tip))
        return fingers

    def hinges(self) -> list[Solid]:
        """Make a hinge at each finger's root and necks between its links, world frame; collision shapes lack them."""
        solids = []
        for finger in self.skeleton():
            if not finger.revolute[0]:
                continue
            least, middle, _ = np.sort(finger.links[0].half_extents)
            hinge = cylinder(finger.points[0], finger.axes[0], _HINGE[0] * middle, _HINGE[1] * least)
            meshes = [mesh_from_arrays(*hinge, name="hinge")]
            for link, knuckle, turns in zip(finger.links[:-1], finger.points[1:], finger.revolute[1:], strict=True):
                way = knuckle - link.center
                # A shape around the next joint needs no neck.
                if turns and float(np.linalg.norm(way)) > _SHORTEST:
                    side = _NECK * float(np.min(link.half_extents))
                    half = np.array([np.linalg.norm(way) / 2, side, side])
                    meshes.append(box_mesh(Box((knuckle + link.center) / 2, frame_along(way).T, half)))
            solids += [Solid(mesh, _JOINT, self.world_from_hand) for mesh in meshes]
        return solids


def glyphs(hand: Hand, poses: Floats, preshape: Floats) -> Floats:
    """Make a small hand with half-closed fingers for each grasp pose.

    A stem along the approach ends at the palm's centre; from there, lines along the joints of each finger to its tip
    show roll and preshape.

    Returns segments (n, s, 2, 3) in the frame of the poses (n, 4, 4), metres.
    """

    def shape(value: float) -> Floats:
        palm = np.zeros(3)
        segments = [(np.array([0.0, 0.0, -_STEM]) / _GLYPH_SCALE, palm)]
        for finger in PosedHand(hand, np.eye(4), hand.closed(value, _GLYPH_CLOSED)).skeleton():
            segments += pairwise([palm, *finger.points, finger.tip])
        return _GLYPH_SCALE * np.array(segments)

    shapes = {float(value): shape(float(value)) for value in np.unique(preshape)}
    lines = [place(shapes[float(value)], pose) for pose, value in zip(poses, preshape, strict=True)]
    return np.array(lines) if lines else np.zeros((0, *shape(hand.preshape_limits[0]).shape))
