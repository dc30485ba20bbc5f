"""Pictures of several objects on the table."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from graspbox._common.colors import OBJECTS
from graspbox.errors import ConfigError
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.solids import solids_of
from graspbox.pictures.view import Camera, View
from graspbox.simulation.layouts import Arrangement

#: Most arrangements in one picture, and panels in a row.
_MOST, _COLUMNS = 12, 3
#: Viewing direction: into a bin.
_CAMERA = Camera(azimuth=-60.0, elevation=42.0)


def save_arrangements(path: PathLike, arrangements: Sequence[Arrangement], *, camera: Camera | None = None) -> None:
    """Save a picture of 1 to 12 arrangements; errors of the path as of `check_path`.

    Raises
    ------
    ConfigError
        For another number of arrangements.
    """
    target = check_path(path)
    if not 1 <= len(arrangements) <= _MOST:
        raise ConfigError(f"{len(arrangements)} arrangements; pass 1 to {_MOST}")
    columns = min(len(arrangements), _COLUMNS)
    rows = -(-len(arrangements) // columns)
    figure = Figure(figsize=(3.6 * columns, 3.1 * rows), dpi=115)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=1 - 0.28 / (3.1 * rows), wspace=0.03, hspace=0.12)
    for axes in panels:
        axes.set_axis_off()
    for number, (axes, arrangement) in enumerate(zip(panels, arrangements, strict=False)):
        solids = solids_of(arrangement, [OBJECTS[index % len(OBJECTS)] for index in arrangement.objects])
        View(solids, camera or _CAMERA, size=pixels(axes), table=True).show(axes)
        things = "1 object" if len(arrangement) == 1 else f"{len(arrangement)} objects"
        axes.set_title(f"{arrangement.layout} {number}: {things}", fontsize=9)
    write(figure, target, palette=False)
