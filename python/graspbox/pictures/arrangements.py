"""Pictures of several objects on the table."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from graspbox.errors import ConfigError
from graspbox.layouts import Arrangement
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.solids import OBJECTS, Solid, place, wall_solids
from graspbox.pictures.view import Camera, View

#: Most arrangements in one picture, and panels in a row.
_MOST, _COLUMNS = 12, 3
#: Viewing direction: into a bin.
_CAMERA = Camera(azimuth=-60.0, elevation=42.0)


def save_arrangements(path: PathLike, arrangements: Sequence[Arrangement], *, camera: Camera | None = None) -> None:
    """Save a picture of 1 to 12 arrangements.

    Parameters
    ----------
    path : str or PathLike
        The picture's file; its extension is one of `graspbox.pictures.SUFFIXES`.
    arrangements : sequence of Arrangement
        What to show.
    camera : Camera, optional
        Viewing direction.

    Raises
    ------
    ConfigError, FileError
        For another path or number of arrangements.
    """
    target = check_path(path)
    if not 1 <= len(arrangements) <= _MOST:
        raise ConfigError(f"{len(arrangements)} arrangements; give 1 to {_MOST}")
    columns = min(len(arrangements), _COLUMNS)
    rows = -(-len(arrangements) // columns)
    figure = Figure(figsize=(3.6 * columns, 3.1 * rows), dpi=115)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=1 - 0.28 / (3.1 * rows), wspace=0.03, hspace=0.12)
    for axes in panels:
        axes.set_axis_off()
    for number, (axes, arrangement) in enumerate(zip(panels, arrangements, strict=False)):
        solids = _solids(arrangement)
        shown = np.concatenate([place(s.mesh.vertices, s.world_from_mesh) for s in solids] or [np.zeros((1, 3))])
        View(solids, camera or _CAMERA, shown=shown, size=pixels(axes), table=shown).show(axes)
        things = "1 object" if len(arrangement) == 1 else f"{len(arrangement)} objects"
        axes.set_title(f"{arrangement.layout} {number}: {things}", fontsize=9)
    write(figure, target, palette=False)


def _solids(arrangement: Arrangement) -> list[Solid]:
    solids = [
        Solid(mesh, OBJECTS[index % len(OBJECTS)], pose)
        for index, mesh, pose in zip(
            arrangement.objects, arrangement.meshes, arrangement.world_from_objects, strict=True
        )
    ]
    return solids + wall_solids(arrangement.world_from_walls, arrangement.wall_half_extents)
