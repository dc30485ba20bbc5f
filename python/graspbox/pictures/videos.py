"""Videos of pictures with captions: GIF and WebP by Pillow, MP4 by moviepy (extra ``video``)."""

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from graspbox._common.files import check_output, replacing, write_bytes
from graspbox._common.imports import imported
from graspbox.errors import ConfigError
from graspbox.pictures.files import PathLike

#: File name extensions of videos.
VIDEO_SUFFIXES = (".gif", ".webp", ".mp4")
#: Height of a caption's strip and of its letters, as shares of the height of a picture.
_STRIP, _LETTERS = 0.09, 0.055
#: Colours of a GIF.
_COLORS = 128


def check_video(path: PathLike) -> Path:
    """Check before any work that a video can be written to `path`.

    Raises
    ------
    ConfigError
        If its extension is not in `VIDEO_SUFFIXES`.
    FileError
        If the folder does not exist or cannot be written to.
    MissingExtraError
        For ``.mp4`` without moviepy.
    """
    target = Path(path)
    if target.suffix.lower() not in VIDEO_SUFFIXES:
        raise ConfigError(
            f"{os.fspath(path)!r} has the extension {target.suffix!r}; use one of {', '.join(VIDEO_SUFFIXES)}"
        )
    if target.suffix.lower() == ".mp4":
        imported("moviepy", "a video as MP4 needs moviepy; or name a .gif", "video")
    return check_output(target)


def save_video(
    path: PathLike, pictures: Sequence[NDArray[np.uint8]], captions: Sequence[str], *, seconds: float = 1.0
) -> None:
    """Save pictures (H, W, 3) of one size, each for some seconds, with a caption above it.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `check_video`; also for no picture, another number of captions, pictures of different sizes, or a time that
        is not positive.
    """
    target = check_video(path)
    if not len(pictures) or len(captions) != len(pictures):
        raise ConfigError(
            f"there are {len(pictures)} pictures and {len(captions)} captions; pass one caption per picture"
        )
    if len({np.shape(picture) for picture in pictures}) > 1:
        raise ConfigError("pictures differ in size; they must have one size")
    if not 0 < seconds < np.inf:
        raise ConfigError(f"seconds is {seconds!r}; it must be above 0")
    frames = [_captioned(picture, caption) for picture, caption in zip(pictures, captions, strict=True)]
    if target.suffix.lower() == ".mp4":
        _write_mp4(target, frames, seconds)
        return
    kind, raw = target.suffix.lower().removeprefix("."), BytesIO()
    if kind == "gif":
        frames = [frame.quantize(_COLORS, dither=Image.Dither.NONE) for frame in frames]
    frames[0].save(
        raw, format=kind, save_all=True, append_images=frames[1:], duration=round(1000 * seconds), loop=0, optimize=True
    )
    write_bytes(target, raw.getvalue())


def _captioned(picture: NDArray[np.uint8], caption: str) -> Image.Image:
    """Put a picture under its caption; sides are even, as MP4 needs them."""
    high, wide = picture.shape[:2]
    strip = round(_STRIP * high)
    frame = Image.new("RGB", (wide + wide % 2, high + strip + (high + strip) % 2), "white")
    frame.paste(Image.fromarray(picture), (0, strip))
    place = (strip // 3, strip // 2)
    ImageDraw.Draw(frame).text(place, caption, "black", ImageFont.load_default(_LETTERS * high), anchor="lm")
    return frame


def _write_mp4(path: Path, frames: list[Image.Image], seconds: float) -> None:
    """Write an MP4 with moviepy, atomically."""
    moviepy = imported("moviepy", "a video as MP4 needs moviepy; or name a .gif", "video")
    clip = moviepy.ImageSequenceClip([np.asarray(frame) for frame in frames], durations=[seconds] * len(frames))
    with replacing(path) as temporary:
        clip.write_videofile(str(temporary), fps=max(1, round(4 / seconds)), codec="libx264", audio=False, logger=None)
