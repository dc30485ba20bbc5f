"""The frames in which programs place a hand: graspbox's grasp frame, and the frame of each format of grasps."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from graspbox.hands import HandLike, load_hand
from graspbox.hands.conventions import convention_of, frame_from_hand, mechanism_of
from graspbox.meshes.shapes import Floats
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hands import PosedHand
from graspbox.pictures.view import Camera, View
from graspbox.simulation import Hand

#: Colours of the axes x, y and z, which colour-blind readers can distinguish.
AXES = {"x": "#d55e00", "y": "#009e73", "z": "#0072b2"}
#: Length of the drawn axes, metres.
_LENGTH = 0.042
#: The palm faces down, as over a table.
_WORLD_FROM_HAND = np.diag([1.0, -1.0, -1.0, 1.0])
#: Hands that are drawn by default.
_HANDS = ("panda_gripper", "robotiq_2f_85", "reflex", "leap", "inspire", "soft_hand")


def save_hand_frames(path: PathLike, hands: Sequence[HandLike] = _HANDS) -> None:
    """Save a panel per hand and frame: the open hand, its grasp frame, and the frame of formats of grasps.

    Hands whose frames ``base`` and ``gripper`` are the same have one panel for all formats.

    Raises
    ------
    ConfigError, FileError
        As `check_path` and `graspbox.load_hand`.
    """
    target, panels = check_path(path), []
    for hand in map(load_hand, hands):
        base, gripper = frame_from_hand(hand, "base"), frame_from_hand(hand, "gripper")
        link = f"base link {convention_of(hand).prefix + mechanism_of(hand).base_link!r}"
        same = np.allclose(base, gripper)
        if not same:
            panels.append((hand, gripper, "frame 'gripper'", "ACRONYM, GraspGen"))
        panels.append((hand, base, link, "all formats" if same else "Isaac Grasp, DexGraspBench"))
    figure = Figure(figsize=(3.1 * len(panels), 3.5), dpi=130)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    figure.subplots_adjust(left=0.005, right=0.995, bottom=0.03, top=0.82, wspace=0.03)
    for panel, (hand, frame_pose, name, formats) in zip(axes, panels, strict=True):
        _plot(panel, hand, frame_pose, name)
        panel.set_title(f"{hand.name}: {formats}", fontsize=10, pad=4)
    figure.text(0.012, 0.93, "Frames of hands", fontsize=12, weight="bold", ha="left")
    for index, (letter, color) in enumerate(AXES.items()):
        figure.text(0.988 - 0.018 * (2 - index), 0.93, letter, color=color, fontsize=12, weight="bold", ha="right")
    write(figure, target, palette=False)


def _plot(panel: Any, hand: Hand, pose: Floats, name: str) -> None:
    """Plot the open hand with its grasp frame and another one; `pose` is that of the grasp frame in the other."""
    low, _ = hand.preshape_limits
    posed = PosedHand.open(hand, _WORLD_FROM_HAND, low)
    frames = {"grasp frame": _WORLD_FROM_HAND, name: _WORLD_FROM_HAND @ np.linalg.inv(pose)}
    lines = {text: frame_axes(frame) for text, frame in frames.items()}
    shown = np.concatenate([posed.corners(), *(ends.reshape(-1, 3) for ends in lines.values())])
    view = View([], Camera(-35.0, 20.0), shown=shown, size=pixels(panel), hand=posed)
    view.show(panel)
    for text, ends in lines.items():
        _label(panel, view.lens.size, plot_axes(panel, view, ends), text)


def plot_axes(panel: Any, view: View, ends: Floats) -> Floats:
    """Plot the axes (3, 2, 3) of a frame with their letters; return the origin (3,) as column, row and depth."""
    for end, (letter, color) in zip(ends, AXES.items(), strict=True):
        view.lines(panel, end[None], color, width=2.6, hidden=0.55, halo=0.9)
        tip = view.lens.project(end[1] + 0.13 * (end[1] - end[0]))
        style = {"color": color, "fontsize": 9, "weight": "bold", "ha": "center", "va": "center"}
        panel.text(*tip[:2], letter, **style, path_effects=[withStroke(linewidth=2.2, foreground="white")])
    origin = view.lens.project(ends[0, 0])
    panel.plot(*origin[:2], "o", color="black", markersize=4)
    return origin


def _label(panel: Any, size: tuple[int, int], origin: Floats, text: str) -> None:
    """Write the name of a frame at the left margin, with a line to its origin."""
    panel.annotate(
        text,
        xy=origin[:2],
        xytext=(0.03 * size[0], max(origin[1] - 0.10 * size[1], 0.09 * size[1])),
        fontsize=9,
        ha="left",
        va="bottom",
        arrowprops={"arrowstyle": "-", "color": "black", "linewidth": 0.9},
        bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "black", "linewidth": 0.6},
    )


def frame_axes(frame: Floats) -> Floats:
    """Return the axes of a frame as segments (3, 2, 3)."""
    return np.stack([np.stack([frame[:3, 3], frame[:3, 3] + _LENGTH * frame[:3, i]]) for i in range(3)])
