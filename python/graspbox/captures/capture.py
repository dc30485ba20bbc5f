"""A depth image with its camera, in metres and in graspbox's conventions; `Found` is what a reader passes on."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.depth_images import points_of

__all__ = ["Camera", "Capture", "Found"]

#: Labels that an error lists.
_LISTED = 20


@dataclass(frozen=True, eq=False)
class Capture:
    """A depth image of an ideal pinhole camera.

    Attributes
    ----------
    depth : (H, W) float64
        Metres along the optical axis, 0 where nothing was measured.
    intrinsics : (3, 3) float64
        Pixels; the centre of the first pixel is (0.5, 0.5).
    labels : (H, W) int64, optional
        The thing that each pixel shows, 0 for none.
    table_from_camera : (4, 4) float64, optional
        Pose of the camera (x right, y down, z forward); the table is the plane z = 0, metres.
    warnings : tuple of str
        What was assumed, as sentences.
    source : str
        The file, and the topic of a recording.
    """

    depth: NDArray[np.float64]
    intrinsics: NDArray[np.float64]
    labels: NDArray[np.int64] | None = None
    table_from_camera: NDArray[np.float64] | None = None
    warnings: tuple[str, ...] = ()
    source: str = ""

    def points(self, pixels: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return the seen points (n, 3), of some pixels (H, W) or all, camera's frame, metres."""
        return points_of(self.depth if pixels is None else np.where(pixels, self.depth, 0.0), self.intrinsics)

    def mask(self, label: int | None = None) -> NDArray[np.bool_]:
        """Return the pixels (H, W) of a label, by default of the only one.

        Raises
        ------
        ConfigError
            If there are no labels, several to choose from, or no pixel has this one.
        """
        if self.labels is None:
            raise ConfigError(f"{self.source or 'the capture'} has no labels; pass a mask or a map of labels")
        known = np.unique(self.labels)
        known = known[known != 0]
        if label is None and len(known) != 1:
            raise ConfigError(
                f"the labels of {self.source or 'the capture'} are {listed(known.tolist()) or 'all 0'}; "
                "choose one of them: --label, or Capture.mask(label)"
            )
        if label is not None and label not in known:
            raise ConfigError(
                f"no pixel of {self.source or 'the capture'} has the label {label}; choose from "
                f"{listed(known.tolist()) or 'none: all are 0'}"
            )
        return np.asarray(self.labels == (known[0] if label is None else label))


def listed(values: Sequence[object]) -> str:
    """Return values with commas; of many, the first."""
    more = f", ... ({len(values)} in all)" if len(values) > _LISTED else ""
    return ", ".join(str(value) for value in values[:_LISTED]) + more


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics as a file or message states them.

    Attributes
    ----------
    matrix : (3, 3) float64
        Pixels, pixel centres at integers + 0.5.
    name : str
        The file or topic, for errors.
    size : (int, int), optional
        Columns and rows of its image.
    model : str
        Distortion: a name of `graspbox.captures.distortion`.
    coefficients : tuple of float
        Of the distortion; empty if there is none.
    depth_scale : float, optional
        Metres per unit of its depth images.
    notes : tuple of str
        What was assumed of the file.
    """

    matrix: NDArray[np.float64]
    name: str
    size: tuple[int, int] | None = None
    model: str = ""
    coefficients: tuple[float, ...] = ()
    depth_scale: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(eq=False)
class Found:
    """The contents of a source, before units and sizes are checked.

    Attributes
    ----------
    name : str
        The source, for errors.
    image : (H, W) array, optional
        Depths in the units of the file.
    points : (n, 3) or (H, W, 3) array, optional
        A cloud in the camera's frame, in the units of the file, instead of an image; floats.
    camera : Camera, optional
        The camera, if the source states it.
    scale : float, optional
        Metres per unit, if the source states it.
    full_size : (int, int), optional
        Columns and rows of the image of which this is a part that begins at `offset`.
    offset : (int, int)
        First column and row.
    warnings : list of str
        What was assumed.
    """

    name: str
    image: NDArray[np.generic] | None = None
    points: NDArray[np.generic] | None = None
    camera: Camera | None = None
    scale: float | None = None
    full_size: tuple[int, int] | None = None
    offset: tuple[int, int] = (0, 0)
    warnings: list[str] = field(default_factory=list)
