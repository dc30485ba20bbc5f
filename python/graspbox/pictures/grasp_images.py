"""Grasps found in one depth image: the image with glyphs of the hand, and the best grasp in 3D."""

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from graspbox.meshes import Mesh, mesh_from_arrays
from graspbox.pictures.episodes import colored
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hands import PosedHand, glyphs
from graspbox.pictures.solids import NOT_SIMULATED, OBJECT, SUCCESS, Floats, Solid, place
from graspbox.pictures.view import Camera, View
from graspbox.policies.grasp_image import ImageGrasps

#: Voxels with at least this value are shown; perception counts them as occupied.
_OCCUPIED = 64
#: Sides of a voxel: the offset of the neighbour, and offsets of the corners, counter-clockwise from outside.
_SIDES = (
    ((1, 0, 0), ((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1))),
    ((-1, 0, 0), ((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0))),
    ((0, 1, 0), ((0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0))),
    ((0, -1, 0), ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1))),
    ((0, 0, 1), ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))),
    ((0, 0, -1), ((0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0))),
)


def save_grasp_image(path: PathLike, found: ImageGrasps) -> None:
    """Save the grasps that a policy found in a depth image.

    Left: the image, the object's outline, and a glyph of the hand at each grasp, the best in green. Right: the object
    as the policy completed it, in voxels, and the open hand at the best grasp.

    Parameters
    ----------
    path : str or PathLike
        The picture's file; its extension is one of `graspbox.pictures.SUFFIXES`.
    found : ImageGrasps
        The grasps, with the image and the completed object.

    Raises
    ------
    ConfigError
        If the path is not that of a picture.
    FileError
        If the file cannot be written.
    """
    target = check_path(path)
    figure = Figure(figsize=(10.5, 5.0), dpi=115)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.03, top=0.86, wspace=0.03)
    _plot_image(left, found)
    _plot_completion(right, found)
    best = f"the best: success {found.success[0]:.0%}, secure {found.secure[0]:.0%}" if len(found) else "no grasp found"
    figure.suptitle(f"{found.policy.name}: {len(found)} grasps; {best}", fontsize=12, weight="bold", y=0.975)
    write(figure, target, palette=False)


def _plot_image(axes: Any, found: ImageGrasps) -> None:
    """Plot the image, the object's outline and the glyphs of the hand."""
    rows, columns = found.depth.shape
    axes.imshow(colored(found.depth[..., None].astype(np.float32)), extent=(0, columns, rows, 0))
    if found.object.any():
        axes.contour(
            np.arange(columns) + 0.5,
            np.arange(rows) + 0.5,
            found.object.astype(float),
            levels=[0.5],
            colors="white",
            linewidths=1.2,
        )
    lines = glyphs(found.hand, found.camera_from_hand, found.preshape)
    for rank in reversed(range(len(found))):
        flat = lines[rank] @ found.intrinsics.T
        segments = list(flat[..., :2] / np.maximum(flat[..., 2:], 1e-3))
        width = 2.6 if rank == 0 else 1.3
        axes.add_collection(LineCollection(segments, colors="white", linewidths=width + 1.4, capstyle="round"))
        color = SUCCESS if rank == 0 else NOT_SIMULATED
        axes.add_collection(LineCollection(segments, colors=color, linewidths=width, capstyle="round"))
    axes.set_xlim(0, columns)
    axes.set_ylim(rows, 0)
    axes.set_axis_off()
    axes.set_title("depth (yellow near, violet far; white: not measured)", fontsize=10)


def _plot_completion(axes: Any, found: ImageGrasps) -> None:
    """Plot the completed object, and the open hand at the best grasp."""
    mesh = _voxel_mesh(found)
    hand = None
    shown = [] if mesh is None else [place(mesh.vertices, found.table_from_crop)]
    if len(found):
        hand = PosedHand.open(found.hand, found.table_from_hand[0], float(found.preshape[0]))
        shown.append(hand.corners())
    axes.set_axis_off()
    axes.set_title("the object as completed, and the best grasp", fontsize=10)
    if not shown:
        return
    points = np.concatenate(shown)
    camera = Camera() if hand is None else Camera.across(hand.world_from_hand[:3, 2])
    solids = [] if mesh is None else [Solid(mesh, OBJECT, found.table_from_crop)]
    # The origin of the table frame is arbitrary in x and y; only z = 0, the table top, is used.
    View(solids, camera, shown=points, size=pixels(axes), hand=hand, table=points).show(axes)


def _voxel_mesh(found: ImageGrasps) -> Mesh | None:
    """Make a mesh of the surface of the occupied voxels, crop frame; None if there are none."""
    filled = np.pad(found.occupancy >= _OCCUPIED, 1)
    corners: list[Floats] = []
    for neighbour, side in _SIDES:
        open_side = filled & ~np.roll(filled, tuple(-n for n in neighbour), axis=(0, 1, 2))
        cells = np.argwhere(open_side) - 1
        corners.append(cells[:, None].astype(np.float64) + np.array(side, dtype=np.float64))
    quads = np.concatenate(corners)
    if not len(quads):
        return None
    crop = found.policy.crop
    points, index = np.unique(quads.reshape(-1, 3), axis=0, return_inverse=True)
    quad = index.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return mesh_from_arrays(points * crop.voxel_size + np.array(crop.origin), faces, name="completed")
