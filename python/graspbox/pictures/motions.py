"""A hand open, half closed and closed, with its pads and its grasp frame; and a video of an arm on its path."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from graspbox._common.colors import OBJECT
from graspbox.arms import ArmLike, Trajectory
from graspbox.hands import HandLike, load_hand
from graspbox.hands.geometry import corners_of
from graspbox.meshes import MeshLike, Surroundings
from graspbox.meshes.shapes import Floats
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hand_frames import AXES, frame_axes, plot_axes
from graspbox.pictures.hands import PosedHand
from graspbox.pictures.solids import Solid, box_edges, solids_of
from graspbox.pictures.videos import check_video, save_video
from graspbox.pictures.view import Camera, View
from graspbox.planning import Box
from graspbox.simulation import Hand
from graspbox.simulation.path_motion import PathMotion

#: Names of the panels, and the shares by which the hand is closed in them.
_STAGES = {"open": 0.0, "half closed": 0.5, "closed": 1.0}
#: Greatest number of preshapes, one row each.
_ROWS = 4
_PAD, _CENTER = "#cc79a7", "#444444"
#: Where the words of the legend begin, shares of the width.
_PLACES = (0.60, 0.66, 0.785, 0.90, 0.92, 0.94)
#: Half a size of the cross at the grasp centre, metres.
_CROSS = 0.006
#: The approach points up, and the camera looks across the motion of the fingers.
_CAMERA = Camera(-66.0, 18.0)
#: Size of a video of a path, its pictures per second, and how long its end is shown, seconds.
_SIZE, _RATE, _STILL = (560, 420), 10.0, 1.0
#: Colours of the links, in turn.
_LINKS = ("#e9e9e6", "#cfd2d6")


def save_hand_motion(path: PathLike, hand: HandLike) -> None:
    """Save a row of panels per preshape: the hand open, half closed and closed, its pads, grasp frame and grasp centre.

    Raises
    ------
    ConfigError, FileError
        As `check_path` and `graspbox.load_hand`.
    """
    target, loaded = check_path(path), load_hand(hand)
    preshapes = sorted(loaded.preshapes.items(), key=lambda item: item[1])[:_ROWS]
    figure = Figure(figsize=(9.6, 0.75 + 3.1 * len(preshapes)), dpi=130)
    panels = figure.subplots(len(preshapes), len(_STAGES), squeeze=False)
    height = figure.get_figheight()
    figure.subplots_adjust(left=0.005, right=0.995, bottom=0.01, top=1 - 0.8 / height, wspace=0.02, hspace=0.12)
    for row, (name, preshape) in zip(panels, preshapes, strict=True):
        for panel, (stage, share) in zip(row, _STAGES.items(), strict=True):
            _plot(panel, loaded, preshape, share)
            panel.set_title(f"preshape {name}, {stage}" if len(preshapes) > 1 else stage, fontsize=10, pad=4)
    figure.text(0.012, 1 - 0.36 / height, loaded.name, fontsize=12, weight="bold", ha="left")
    legend = [("pads", _PAD), ("grasp centre", _CENTER), ("grasp frame:", "black"), *AXES.items()]
    for place, (text, ink) in zip(_PLACES, legend, strict=True):
        figure.text(place, 1 - 0.36 / height, text, color=ink, fontsize=9.5, ha="left", weight="bold")
    write(figure, target, palette=False)


def save_path(
    path: PathLike,
    trajectory: Trajectory,
    arm: ArmLike,
    hand: HandLike,
    world_from_base: ArrayLike,
    *,
    target: tuple[MeshLike, ArrayLike],
    neighbours: Surroundings | None = None,
    mount: ArrayLike | None = None,
    camera: Camera | None = None,
) -> None:
    """Save a video of an arm on its path, in real time, with its collision shapes.

    Where the fingers stop is simulated; the rest of the motion is the trajectory's.

    Parameters
    ----------
    path : str or Path
        The file.
    trajectory : Trajectory
        Of `graspbox.arms.plan_path`.
    arm, hand, world_from_base, target, neighbours, mount
        As there.
    camera : Camera, optional
        By default it looks across the way from the base to the object.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `check_video`, `graspbox.arms.load_arm` and `graspbox.load_hand`; and for another arm or hand than the
        trajectory's, or a pose of another shape.
    SimulationError
        If the grasp cannot be simulated.
    """
    file = check_video(path)
    motion = PathMotion.of(
        trajectory, arm, hand, world_from_base, target=target, neighbours=neighbours, mount=mount, hz=_RATE
    )
    around = [] if neighbours is None else solids_of(neighbours)
    hands = zip(motion.world_from_hand, motion.joints, strict=True)
    posed = [PosedHand(motion.hand, place, joints) for place, joints in hands]
    links = motion.links()
    frames = [motion.link_frames(sample) for sample in range(len(motion.times))]
    arms = [[Solid(one, _LINKS[i % 2], at[link]) for i, (link, one) in enumerate(links)] for at in frames]
    corners = [solid.points for solid in around] + [solid.points for row in arms for solid in row]
    shown = np.concatenate([*corners, *(one.corners() for one in posed)])
    way = motion.world_from_object[0, :3, 3] - motion.world_from_base[:3, 3]
    look = camera or Camera.across(way, elevation=22.0)
    views = [
        View([*around, *row, Solid(motion.mesh, OBJECT, at)], look, size=_SIZE, shown=shown, hand=one, table=shown)
        for row, one, at in zip(arms, posed, motion.world_from_object, strict=True)
    ]
    pictures = [view.image for view in views]
    captions = [f"{phase}, {time:.1f} s" for phase, time in zip(motion.phases, motion.times, strict=True)]
    still = round(_STILL * _RATE)
    save_video(file, pictures + still * pictures[-1:], captions + still * captions[-1:], seconds=1 / _RATE)


def _plot(panel: Any, hand: Hand, preshape: float, share: float) -> None:
    joints = hand.closed(preshape, share)
    posed = PosedHand(hand, np.eye(4), joints)
    ends = frame_axes(np.eye(4))
    reach = [corners_of(hand, hand.closed(preshape, each)) for each in _STAGES.values()]
    shown = np.concatenate([*reach, ends.reshape(-1, 3)])
    view = View([], _CAMERA, shown=shown, size=pixels(panel), hand=posed)
    view.show(panel)
    shapes, halves, pads, _ = hand.shapes(joints)
    for pose, half in zip(shapes[pads], halves[pads], strict=True):
        view.lines(panel, box_edges(Box(pose[:3, 3], pose[:3, :3], half)), _PAD, width=1.4, hidden=0.35)
    view.lines(panel, _cross(hand.closing_center(preshape)), _CENTER, width=1.8, hidden=0.6)
    plot_axes(panel, view, ends)


def _cross(center: Floats) -> Floats:
    """Return three short lines (3, 2, 3) through a point."""
    return np.stack([np.stack([center - way, center + way]) for way in _CROSS * np.eye(3)])
