"""Hands in pictures: posed hands, the joints that collision shapes lack, and small glyphs for grasp poses."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from graspbox.pictures.solids import Floats, Solid, box_mesh, cylinder_mesh, frame_along, place
from graspbox.planning import Box
from graspbox.simulation import Hand

#: Colour of hinges and of the necks between a finger's links: that of the renderer's knuckles.
_JOINT = "#4d525c"
#: Radius and half length of the hinge at a finger's root, as shares of the middle and least half side of its link.
_HINGE = (1.2, 1.6)
#: Half sides of the neck between a finger's links, as a share of the least half side of its first link.
_NECK = 0.62
#: Angle by which joints are turned to find their axes, radians.
_TURN = 0.1
#: Size of a glyph relative to the hand, length of its stem in metres, and its fingers' angles in radians.
_GLYPH_SCALE, _STEM = 0.36, 0.03
_GLYPH_ANGLES = (0.95, 0.45)


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger's joints and its tip, hand frame, metres.

    Attributes
    ----------
    root, knuckle : (3,) float64
        Points on the axes of the proximal and of the distal joint, each nearest to the centre of the link that it
        carries.
    root_axis : (3,) float64
        Unit direction of the proximal axis.
    tip : (3,) float64
        The far end of the distal link.
    link : Box
        The largest collision shape of the proximal link.
    """

    root: Floats
    root_axis: Floats
    knuckle: Floats
    tip: Floats
    link: Box


@dataclass(frozen=True, eq=False)
class PosedHand:
    """A hand at one configuration.

    Attributes
    ----------
    hand : Hand
        The hand.
    world_from_hand : (4, 4) float64
        Pose of the grasp frame.
    preshape : float
        Radians.
    fingers : (f, 2), optional
        Proximal and distal angle of each finger, radians; all 0, the open hand, by default.
    """

    hand: Hand
    world_from_hand: Floats
    preshape: float
    fingers: Floats | None = None

    def angles(self) -> tuple[Floats, Floats]:
        """Proximal and distal angles (f,), radians."""
        angles = np.zeros((self.hand.fingers, 2)) if self.fingers is None else self.fingers
        return np.ascontiguousarray(angles[:, 0]), np.ascontiguousarray(angles[:, 1])

    def corners(self) -> Floats:
        """Corners (n, 3) of its collision shapes' boxes, world frame, metres."""
        shapes, halves, _ = self.hand.shapes(self.preshape, *self.angles())
        frames = self.world_from_hand @ shapes
        boxes = [Box(frame[:3, 3], frame[:3, :3], half) for frame, half in zip(frames, halves, strict=True)]
        return np.concatenate([box.corners() for box in boxes])

    def skeleton(self) -> list[Finger]:
        """Find the joints of every finger that has a collision shape on each of its two links."""
        proximal, distal = self.angles()
        frames, halves, _ = self.hand.shapes(self.preshape, proximal, distal)
        fingers = []
        for index in range(self.hand.fingers):
            turn = np.where(np.arange(self.hand.fingers) == index, _TURN, 0.0)
            root_turned, _, _ = self.hand.shapes(self.preshape, proximal + turn, distal)
            knuckle_turned, _, _ = self.hand.shapes(self.preshape, proximal, distal + turn)
            in_distal = ~np.isclose(knuckle_turned, frames).all(axis=(1, 2))
            in_proximal = ~np.isclose(root_turned, frames).all(axis=(1, 2)) & ~in_distal
            if not in_distal.any() or not in_proximal.any():
                continue
            first, last = _largest(in_proximal, halves), _largest(in_distal, halves)
            root, axis = _joint(frames[first], root_turned[first])
            knuckle, _ = _joint(frames[last], knuckle_turned[last])
            ends = Box(frames[last, :3, 3], frames[last, :3, :3], halves[last]).corners()
            along = frames[last, :3, 3] - knuckle
            along /= np.linalg.norm(along)
            tip = knuckle + along * np.max((ends - knuckle) @ along)
            link = Box(frames[first, :3, 3], frames[first, :3, :3], halves[first])
            fingers.append(Finger(root, axis, knuckle, tip, link))
        return fingers

    def joints(self) -> list[Solid]:
        """Make a hinge at each finger's root and a neck between its links, which collision shapes lack; world frame."""
        solids = []
        for finger in self.skeleton():
            least, middle, _ = np.sort(finger.link.half_extents)
            hinge = cylinder_mesh(finger.root, finger.root_axis, _HINGE[0] * middle, _HINGE[1] * least)
            way = finger.knuckle - finger.link.center
            axes = frame_along(way).T
            half = np.array([np.linalg.norm(way) / 2, _NECK * least, _NECK * least])
            neck = box_mesh(Box((finger.knuckle + finger.link.center) / 2, axes, half))
            solids += [Solid(mesh, _JOINT, self.world_from_hand) for mesh in (hinge, neck)]
        return solids


def _largest(chosen: Any, halves: Floats) -> int:
    """Find the shape of greatest volume among those chosen."""
    return int(np.where(chosen, halves.prod(axis=1), -1.0).argmax())


def _joint(before: Floats, after: Floats) -> tuple[Floats, Floats]:
    """Find the axis about which a shape's frame (4, 4) turned: its point nearest to the shape, and its direction."""
    moved = after @ np.linalg.inv(before)
    rotation = moved[:3, :3]
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    axis /= np.linalg.norm(axis)
    point = np.linalg.lstsq(np.eye(3) - rotation, moved[:3, 3], rcond=1e-6)[0]
    return point + axis * ((before[:3, 3] - point) @ axis), axis


def glyphs(hand: Hand, poses: Floats, preshape: Floats) -> Floats:
    """Make a small hand with half-closed fingers for each grasp pose.

    A stem along the approach ends at the palm's centre; from there lines lead to the root, knuckle and tip of each
    finger, which show roll and preshape.

    Parameters
    ----------
    hand : Hand
        The hand.
    poses : (n, 4, 4) float64
        Of the grasp frame.
    preshape : (n,) float64
        Radians.

    Returns
    -------
    (n, s, 2, 3) float64
        Segments, in the frame of the poses, metres; s is 1 plus 3 per finger.
    """
    angles = np.tile(_GLYPH_ANGLES, (hand.fingers, 1))
    shapes: dict[float, Floats] = {}
    for value in np.unique(preshape):
        palm = np.zeros(3)
        segments = [(np.array([0.0, 0.0, -_STEM]) / _GLYPH_SCALE, palm)]
        for finger in PosedHand(hand, np.eye(4), float(value), angles).skeleton():
            chain = [palm, finger.root, finger.knuckle, finger.tip]
            segments += pairwise(chain)
        shapes[float(value)] = _GLYPH_SCALE * np.array(segments)
    lines = [place(shapes[float(value)], pose) for pose, value in zip(poses, preshape, strict=True)]
    return np.array(lines) if lines else np.zeros((0, 1 + 3 * hand.fingers, 2, 3))
