"""A hand open, half closed and closed, with its pads and its grasp frame; and a video of an arm on its path."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox._common.colors import OBJECT
from graspbox.arms import ArmLike, Trajectory, load_arm
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.hands.conventions import mechanism_of
from graspbox.hands.geometry import corners_of
from graspbox.meshes import Mesh, MeshLike, Surroundings, as_mesh, mesh_from_arrays
from graspbox.meshes.shapes import Floats
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hand_frames import AXES, frame_axes, plot_axes
from graspbox.pictures.hands import PosedHand
from graspbox.pictures.solids import Solid, box_edges, solids_of
from graspbox.pictures.videos import check_video, save_video
from graspbox.pictures.view import Camera, View
from graspbox.planning import Box
from graspbox.simulation import Hand, Scene

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
#: Phases in which the object moves with the hand.
_HELD = ("lift", "carry", "lower")


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
    file, loaded, with_hand = check_video(path), load_arm(arm), load_hand(hand)
    for given, own, argument in ((loaded, trajectory.arm, "arm"), (with_hand, trajectory.hand_name, "hand")):
        if given.name != own:
            raise ConfigError(f"{argument} is {given.name!r}, but the trajectory is that of {own!r}; pass that one")
    base, mesh = _pose(world_from_base, "world_from_base"), as_mesh(target[0])
    first, around = _pose(target[1], "the pose of the target"), [] if neighbours is None else solids_of(neighbours)
    flange_from_base = loaded.flange_from_base_of(with_hand) if mount is None else _pose(mount, "mount")
    flange_from_hand = flange_from_base @ mechanism_of(with_hand).base_from_hand
    times = np.append(np.arange(0.0, trajectory.duration, 1 / _RATE), trajectory.duration)
    sample = trajectory.sample(times)
    hands = base @ loaded.flange_poses(sample.positions) @ flange_from_hand
    at_grasp = int(np.flatnonzero(np.isin(sample.phases, ("close", *_HELD)))[0])
    joints = _closing(with_hand, mesh, first, hands[at_grasp], trajectory.preshape, sample.hand)
    posed = [PosedHand(with_hand, place, row) for place, row in zip(hands, joints, strict=True)]
    objects = _carried(first, hands, hands[at_grasp], sample.phases)
    surfaces = [(link, mesh_from_arrays(v, f, name="link", clean=None)) for link, v, f in loaded.link_surfaces()]
    poses = [base @ loaded.link_frames(q) for q in sample.positions]
    arms = [[Solid(one, _LINKS[i % 2], frames[link]) for i, (link, one) in enumerate(surfaces)] for frames in poses]
    corners = [solid.points for solid in around] + [solid.points for row in arms for solid in row]
    shown = np.concatenate([*corners, *(one.corners() for one in posed)])
    view = camera or Camera.across(first[:3, 3] - base[:3, 3], elevation=22.0)
    pictures = [
        View([*around, *row, Solid(mesh, OBJECT, at)], view, size=_SIZE, shown=shown, hand=one, table=shown).image
        for row, one, at in zip(arms, posed, objects, strict=True)
    ]
    captions = [f"{phase}, {time:.1f} s" for phase, time in zip(sample.phases, times, strict=True)]
    still = round(_STILL * _RATE)
    save_video(file, pictures + still * pictures[-1:], captions + still * captions[-1:], seconds=1 / _RATE)


def _closing(
    hand: Hand, mesh: Mesh, world_from_object: Floats, world_from_hand: Floats, preshape: float, command: Floats
) -> Floats:
    """Return the joints (m, c) by the command (m,), from open to where a simulation of the grasp stops them.

    If the open hand cannot be at the grasp, they close without resistance.
    """
    opened, held = hand.open(preshape), hand.closed(preshape, 1.0)
    scene = Scene(mesh, hand=hand, world_from_object=world_from_object)
    _, trace = scene.trace(np.linalg.inv(scene.world_from_object) @ world_from_hand, preshape)
    if len(trace.time):
        held = trace.joints[np.searchsorted(trace.time[:-1], TrialConfig().close_time)]
    return np.asarray(opened + command[:, None] * (held - opened))


def _pose(values: ArrayLike, name: str) -> Floats:
    pose = floats(values, name)
    if pose.shape != (4, 4):
        raise ConfigError(f"{name} has the shape {pose.shape}; give (4, 4)")
    return pose


def _carried(first: Floats, hands: Floats, grasp: Floats, phases: NDArray[np.str_]) -> list[Floats]:
    """Return the poses of an object that rests, is carried by a hand (m, 4, 4) that grasped it, and is released."""
    hand_from_object, poses, pose = np.linalg.inv(grasp) @ first, [], first
    for hand, phase in zip(hands, phases, strict=True):
        pose = hand @ hand_from_object if phase in _HELD else pose
        poses.append(pose)
    return poses


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
