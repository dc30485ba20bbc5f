"""Picture files: paths are checked before any work, and files are written atomically."""

import os
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Figure  # for modules outside this package, which must import this one first
from PIL import Image

from graspbox._common.files import write_bytes
from graspbox.errors import ConfigError, FileError

#: File name extensions of pictures. All but ``.pdf`` and ``.svg`` are raster formats.
SUFFIXES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".webp")
_CHOICES = ", ".join(SUFFIXES)
#: A path to a picture.
PathLike = str | os.PathLike[str]


def check_path(path: PathLike) -> Path:
    """Check before any work that a picture can be written to `path`.

    Raises
    ------
    ConfigError
        If `path` is not a path, is a folder, or its extension is not in `SUFFIXES`.
    FileError
        If the folder does not exist or cannot be written to.
    """
    try:
        target = Path(path)
    except TypeError:
        raise ConfigError(f"path is {path!r}; pass a str or a Path that ends in one of {_CHOICES}") from None
    if target.is_dir():
        raise ConfigError(f"{str(target)!r} is a folder; name a picture in it, such as {str(target / 'picture.png')!r}")
    if target.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"{str(target)!r} has the extension {target.suffix!r}; use one of {_CHOICES}")
    folder = target.parent
    if not folder.is_dir():
        raise FileError(2, "the picture's folder does not exist; make it first", str(folder))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise FileError(13, "the picture's folder cannot be written to", str(folder))
    return target


def write(figure: Figure, path: Path, *, palette: bool = True) -> None:
    """Write a figure, rendered by Agg, to a path that `check_path` has checked, atomically.

    A PNG is reduced to 256 colours (`palette`), for charts and lines; or its channels are rounded to multiples of 3,
    which is invisible in shaded surfaces and saves a quarter of the size.
    """
    kind = path.suffix.lower().removeprefix(".")
    raw = BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(raw, format=kind)
    if kind == "png":
        colors, raw = Image.open(raw).convert("RGB"), BytesIO()
        rounded = [min(255, 3 * round(value / 3)) for value in range(256)]
        packed = colors.quantize(256, dither=Image.Dither.NONE) if palette else colors.point(3 * rounded)
        packed.save(raw, format="png", optimize=True)
    write_bytes(path, raw.getvalue())


def pixels(axes: Any) -> tuple[int, int]:
    """Return the width and height of axes in pixels."""
    box = axes.get_window_extent()
    return round(box.width), round(box.height)
