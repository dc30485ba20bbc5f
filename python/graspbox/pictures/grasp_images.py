"""Grasps detected in one depth image: the image with glyphs of the hand, and the best grasp in 3D."""

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from graspbox._common.colors import NOT_SIMULATED, OBJECT, SUCCESS
from graspbox.meshes import mesh_from_arrays
from graspbox.meshes.shapes import voxels
from graspbox.perception.crops import OCCUPIED
from graspbox.pictures.episodes import colored
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hands import PosedHand, glyphs
from graspbox.pictures.solids import Solid
from graspbox.pictures.view import Camera, View
from graspbox.policies.grasp_image import ImageGrasps


def save_grasp_image(path: PathLike, grasps: ImageGrasps) -> None:
    """Save the grasps that a policy detects in a depth image.

    Left: the image, the object's outline, and a glyph of the hand at each grasp, the best in green. Right: the object
    as the policy completed it, in voxels, and the open hand at the best grasp.

    Raises
    ------
    ConfigError, FileError
        As `check_path`.
    """
    target = check_path(path)
    figure = Figure(figsize=(10.5, 5.0), dpi=115)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.03, top=0.86, wspace=0.03)
    _plot_image(left, grasps)
    _plot_completion(right, grasps)
    best = "no grasp detected"
    if len(grasps):
        best = f"the best: success {grasps.success[0]:.0%}, secure {grasps.secure[0]:.0%}"
    figure.suptitle(f"{grasps.policy.name}: {len(grasps)} grasps; {best}", fontsize=12, weight="bold", y=0.975)
    write(figure, target, palette=False)


def _plot_image(axes: Any, grasps: ImageGrasps) -> None:
    """Plot the image, the object's outline and the glyphs of the hand."""
    rows, columns = grasps.depth.shape
    axes.imshow(colored(grasps.depth[..., None].astype(np.float32)), extent=(0, columns, rows, 0))
    if grasps.object.any():
        axes.contour(
            np.arange(columns) + 0.5,
            np.arange(rows) + 0.5,
            grasps.object.astype(float),
            levels=[0.5],
            colors="white",
            linewidths=1.2,
        )
    lines = glyphs(grasps.hand, grasps.camera_from_hand, grasps.preshape)
    for rank in reversed(range(len(grasps))):
        flat = lines[rank] @ grasps.intrinsics.T
        segments = list(flat[..., :2] / np.maximum(flat[..., 2:], 1e-3))
        width = 2.6 if rank == 0 else 1.3
        axes.add_collection(LineCollection(segments, colors="white", linewidths=width + 1.4, capstyle="round"))
        color = SUCCESS if rank == 0 else NOT_SIMULATED
        axes.add_collection(LineCollection(segments, colors=color, linewidths=width, capstyle="round"))
    axes.set_xlim(0, columns)
    axes.set_ylim(rows, 0)
    axes.set_axis_off()
    axes.set_title("depth (yellow near, violet far; white: not measured)", fontsize=10)


def _plot_completion(axes: Any, grasps: ImageGrasps) -> None:
    """Plot the completed object, and the open hand at the best grasp."""
    axes.set_axis_off()
    axes.set_title("the object as completed, and the best grasp", fontsize=10)
    solids, hand, camera = [], None, Camera()
    filled, crop = grasps.occupancy >= OCCUPIED, grasps.policy.crop
    if filled.any():
        mesh = mesh_from_arrays(*voxels(filled, crop.origin, crop.voxel_size), name="completed")
        solids.append(Solid(mesh, OBJECT, grasps.table_from_crop))
    if len(grasps):
        hand = PosedHand.open(grasps.hand, grasps.table_from_hand[0], float(grasps.preshape[0]))
        camera = Camera.across(hand.world_from_hand[:3, 2])
    if solids or hand is not None:
        # The origin of the table frame is arbitrary in x and y; only z = 0, the table top, is used.
        View(solids, camera, size=pixels(axes), hand=hand, table=True).show(axes)
